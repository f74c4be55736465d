"""skmtgp, through its public interface."""

import warnings

import numpy as np
from adapter import main
from problem import N_X, Parameters
from threadpoolctl import threadpool_limits

import skmtgp
from skmtgp import MultiTaskGPRegressor
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import LowRank, WithDiagonal

PAPER = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}


class Adapter:
    """skmtgp, from its own start: the first stage's time counts.

    At its best it has the diagonal of K^rho that the peers have; by default it has not.
    Its targets are scaled: it has no levels, and one unit and noise, as the peers have.
    """

    version = skmtgp.__version__

    def __init__(self, problem, settings, threads):
        self.problem, self.limit = problem, threadpool_limits(threads)
        self.n, self.kernel = len(problem.y), inverse_dynamics_kernel(N_X // 3)
        self.model = None
        self.form, self.diagonal = LowRank(*problem.F.shape), settings == "best"
        self.likelihood = self.make_likelihood(problem.u, problem.tasks, problem.y)
        self.start_theta = self.theta_at_start()

    def make_likelihood(self, *data):
        """The objective."""
        return DenseLikelihood(Prior(self.kernel, self.form), *data)

    def theta_at_start(self):
        """The start in this package's order: kernel, F, noise."""
        s = self.problem.start
        kernel = self.kernel.clone_with_theta(self.kernel.theta)
        kernel.set_params(
            k1__weights=s.weights,
            k1__bias=float(s.bias),
            k2__k1__constant_value=float(s.amplitude),
            k2__k2__kernel__length_scale=s.length_scales,
        )
        return np.concatenate([kernel.theta, self.problem.F.ravel(), [np.log(s.noise)]])

    def evaluate(self, k):
        """The likelihood and its gradient, once."""
        return self.likelihood.value_and_grad(self.start_theta + 1e-6 * k)[0]

    def fit(self, recorder):
        """Learn, noting the likelihoods of the model itself on all of the data."""
        inner = DenseLikelihood.value_and_grad
        forms = (LowRank, WithDiagonal) if self.diagonal else LowRank  # 0 is a diagonal

        def recorded(likelihood, theta):
            value, gradient = inner(likelihood, theta)
            ours = isinstance(likelihood.prior.task_covariance, forms)
            whole = len(likelihood.y) == self.n
            recorder(value if ours and whole else -np.inf)
            return value, gradient

        options = PAPER | {"rank": self.form.rank, "diagonal": self.diagonal}
        model = MultiTaskGPRegressor(self.kernel, **options)
        DenseLikelihood.value_and_grad = recorded
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                self.model = model.fit(self.problem.X, self.problem.y)
        finally:
            DenseLikelihood.value_and_grad = inner
        return "; ".join({w.category.__name__ for w in caught}) or "converged"

    def restore(self, state):
        """There is no model before the fit has ended."""
        raise TimeoutError("the budget ended before the fit")

    def parameters(self):
        """The learned parameters, or those at the start, in units of the targets."""
        if self.model is None:
            return self.problem.start
        linear, smooth = self.model.kernel_.k1, self.model.kernel_.k2
        return Parameters(
            smooth.k2.kernel.length_scale,
            linear.weights,
            linear.bias,
            smooth.k1.constant_value,
            self.model.noise_variance_,
            self.model.task_covariance_,
        )


if __name__ == "__main__":
    main(Adapter)
