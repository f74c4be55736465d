"""GPy.

Shipped: a kernel times Coregionalize and ``model.optimize()``, as in its tutorial of
coregionalised regression: 1000 evaluations of L-BFGS-B. Best: logarithms
as parameters, L-BFGS-B with a long memory and tight tolerances, started
again while it gains, and targets multiplied by 1000: GPy adds 1e-8 to every noise
variance, which is counted as noise, and which is too much beside a variance of 1.
"""

import warnings

import GPy
import numpy as np
from adapter import main
from lbfgs import maximise
from paramz.transformations import Exponent
from problem import KAPPA, KAPPA_BOUNDS, LENGTH_SCALES, N_X, NOISE, WEIGHTS, Parameters

ADDED_NOISE, SCALE = 1e-8, 1e3
BOUNDS = {
    "lengthscale": np.log(LENGTH_SCALES),
    "variances": np.log(WEIGHTS),
    "variance": np.log(WEIGHTS),
    "W": np.array([-10.0, 10.0]),
    "kappa": np.log(KAPPA_BOUNDS),
    "noise": np.log(NOISE),
}


class Adapter:
    """GPy."""

    version = GPy.__version__

    def __init__(self, problem, settings, threads):
        warnings.simplefilter("ignore")
        self.best = settings == "best"
        self.n, self.scale = len(problem.y), SCALE if self.best else 1.0
        self.model = GPy.models.GPRegression(
            problem.X,
            problem.y[:, None] * self.scale,
            self.make_kernel(problem),
            noise_var=float(problem.start.noise) * self.scale**2,
        )
        inputs, self.tasks = self.model.kern.parts  # a product copies its factors
        self.linear, self.bias, self.rbf = inputs.parts
        if self.best:
            self.learn_logarithms()
        self.start_x = self.model.optimizer_array.copy()

    def make_kernel(self, problem):
        """The kernel at the start."""
        start, (n_tasks, rank) = problem.start, problem.F.shape
        n_u, kern, square = problem.u.shape[1], GPy.kern, self.scale**2
        u, x = range(n_u), range(N_X)
        linear = kern.Linear(n_u, start.weights * square, ARD=True, active_dims=u)
        bias = kern.Bias(n_u, start.bias * square, active_dims=u)
        rbf = kern.RBF(
            N_X, start.amplitude * square, start.length_scales, ARD=True, active_dims=x
        )
        kappa = np.full(n_tasks, KAPPA)
        tasks = kern.Coregionalize(
            1, n_tasks, rank, W=problem.F.copy(), kappa=kappa, active_dims=[n_u]
        )
        return (linear + bias + rbf) * tasks

    def learn_logarithms(self):
        """Constrain by exp rather than by softplus."""
        positive = [self.linear.variances, self.bias.variance, self.rbf.variance]
        positive += [self.rbf.lengthscale, self.model.likelihood.variance]
        positive += [self.tasks.kappa]
        for parameter in positive:
            parameter.unconstrain()
            parameter.constrain(Exponent(), warning=False)

    def bounds(self):
        """Bounds of the optimiser's vector: of logarithms, and of W."""
        names = np.array(self.model.parameter_names_flat(include_fixed=True))
        last = [str(name).split(".")[-1].split("[")[0] for name in names]
        noise = ["noise" in str(name).lower() for name in names]
        kinds = np.where(noise, "noise", last)
        shift = {"noise": True, "variance": True, "variances": True}
        return [
            tuple(BOUNDS[k] + shift.get(k, False) * 2.0 * np.log(SCALE)) for k in kinds
        ]

    def value_and_grad(self, x):
        """Log likelihood and gradient at x, or None where it fails."""
        try:
            self.model.optimizer_array = x
            if self.jitter(rows=slice(0, 1)) > 0.0:
                return None
            gradient = self.model._transform_gradients(
                self.model.objective_function_gradients()
            )
            value = float(self.model.log_likelihood()) + self.n * np.log(self.scale)
            return value, -gradient
        except (np.linalg.LinAlgError, ZeroDivisionError, ValueError):
            return None

    def evaluate(self, k):
        """The likelihood and its gradient, once."""
        return self.value_and_grad(self.start_x + 1e-6 * k)[0]

    def fit(self, recorder):
        """Learn."""
        if self.best:
            stop = maximise(
                self.value_and_grad, self.start_x, recorder, self.n, self.bounds()
            )
            self.restore(recorder.state)
            return stop
        inner = self.model._objective_grads

        def recorded(x):
            value, gradient = inner(x)
            recorder(-float(value), x.copy())
            return value, gradient

        self.model._objective_grads = recorded
        return self.model.optimize().status

    def restore(self, x):
        """Go back to a state."""
        self.model.optimizer_array = x

    def jitter(self, rows=slice(None)):
        """What GPy had to add to the diagonal of K to factorise it."""
        posterior = self.model.posterior
        L, K = posterior.woodbury_chol[rows], posterior._K[rows]
        have, noise = np.square(L).sum(axis=1), float(self.model.likelihood.variance[0])
        added = np.median(have - np.diagonal(K) - noise - ADDED_NOISE)
        return float(added) if added > 1e-7 * np.diagonal(K).mean() else 0.0

    def parameters(self):
        """The current parameters, any jitter counted as noise."""
        noise = float(self.model.likelihood.variance[0]) + ADDED_NOISE + self.jitter()
        square = self.scale**2
        return Parameters(
            np.array(self.rbf.lengthscale),
            np.array(self.linear.variances) / square,
            float(self.bias.variance[0]) / square,
            float(self.rbf.variance[0]) / square,
            noise / square,
            np.array(self.tasks.B),
        )


if __name__ == "__main__":
    main(Adapter)
