"""GPflow.

Shipped: a kernel times Coregion in a GPR, ``Scipy().minimize`` with maxiter 10000, as
in its notebook on coregionalisation. Best: noise down to 1e-10,
logarithms as parameters, L-BFGS-B with a long memory and tight tolerances, started
again while it gains.
"""

import os

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")

import gpflow
import numpy as np
import tensorflow as tf
from adapter import main
from lbfgs import maximise
from problem import (
    FACTOR,
    KAPPA,
    KAPPA_BOUNDS,
    LENGTH_SCALES,
    N_X,
    NOISE,
    WEIGHTS,
    Parameters,
)


class Recorded(gpflow.optimizers.Scipy):
    """GPflow's optimiser, telling a recorder of every evaluation."""

    def __init__(self, recorder):
        super().__init__()
        self.recorder = recorder

    def eval_func(self, *arguments, **options):
        """The objective."""
        inner = super().eval_func(*arguments, **options)

        def recorded(x):
            loss, gradient = inner(x)
            self.recorder(-float(loss), x.copy())
            return loss, gradient

        return recorded


class Adapter:
    """GPflow."""

    version = gpflow.__version__
    kappa = KAPPA

    def __init__(self, problem, settings, threads):
        self.settings, self.best = settings, settings != "shipped"
        self.n = len(problem.y)
        tf.config.threading.set_intra_op_parallelism_threads(threads)
        tf.config.threading.set_inter_op_parallelism_threads(1)
        if self.best:
            gpflow.config.set_default_positive_bijector("exp")
        self.make_kernels(problem)
        lower = {"variance_lower_bound": NOISE[0]} if self.best else {}
        noise = gpflow.likelihoods.Gaussian(problem.start.noise.item(), **lower)
        self.model = self.make_model(problem, noise)
        self.variables = self.model.trainable_variables
        self.scipy = gpflow.optimizers.Scipy()
        loss = self.model.training_loss_closure(compile=False)
        self.function = self.scipy.eval_func(loss, self.variables, {}, compile=True)
        self.start_x = self.scipy.initial_parameters(self.variables).numpy()

    def make_model(self, problem, noise):
        """The model of the data."""
        return gpflow.models.GPR(self.data(problem), self.kernel, likelihood=noise)

    @staticmethod
    def data(problem):
        """Inputs with the task, and targets in a column."""
        return problem.X, problem.y[:, None]

    @property
    def kernel(self):
        """k^x times K^rho."""
        return (self.linear + self.bias + self.rbf) * self.tasks

    def make_kernels(self, problem):
        """The parts of the kernel at the start."""
        start, (n_tasks, rank) = problem.start, problem.F.shape
        n_u = problem.u.shape[1]
        kernels = gpflow.kernels
        self.linear = kernels.Linear(start.weights, active_dims=slice(0, n_u))
        self.bias = kernels.Constant(start.bias.item())
        self.rbf = kernels.SquaredExponential(
            start.amplitude.item(), start.length_scales, active_dims=slice(0, N_X)
        )
        self.tasks = kernels.Coregion(n_tasks, rank, active_dims=[n_u])
        self.tasks.W.assign(problem.F)
        self.tasks.kappa.assign(np.full(n_tasks, self.kappa))

    def bounds(self):
        """Bounds of the optimiser's vector: of logarithms, and of W."""
        kinds = [
            (self.linear.variance, np.log(WEIGHTS)),
            (self.bias.variance, np.log(WEIGHTS)),
            (self.rbf.variance, np.log(WEIGHTS)),
            (self.rbf.lengthscales, np.log(LENGTH_SCALES)),
            (self.tasks.W, FACTOR),
            (self.tasks.kappa, np.log(KAPPA_BOUNDS)),
            (self.model.likelihood.variance, np.log([1e-3 * NOISE[0], NOISE[1]])),
        ]
        by_variable = {p.unconstrained_variable.ref(): b for p, b in kinds}
        return [
            tuple(by_variable[v.ref()])
            for v in self.variables
            for _ in range(v.shape.num_elements())
        ]

    def value_and_grad(self, x):
        """Log likelihood and gradient at x, or None where it fails."""
        try:
            loss, gradient = self.function(x)
        except tf.errors.InvalidArgumentError:
            return None
        return -float(loss), -np.asarray(gradient)

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
        return self.fit_as_shipped(recorder)

    def fit_as_shipped(self, recorder):
        """The notebook's call."""
        result = Recorded(recorder).minimize(
            self.model.training_loss, self.variables, options={"maxiter": 10000}
        )
        return result.message

    def restore(self, x):
        """Go back to a state."""
        self.scipy.assign_tensors(
            self.variables, self.scipy.unpack_tensors(self.variables, x)
        )

    def parameters(self):
        """The current parameters."""
        return Parameters(
            self.rbf.lengthscales.numpy(),
            self.linear.variance.numpy(),
            self.bias.variance.numpy(),
            self.rbf.variance.numpy(),
            self.model.likelihood.variance.numpy(),
            self.tasks.output_covariance().numpy(),
        )


if __name__ == "__main__":
    main(Adapter)
