"""scikit-learn, which has no multi-task kernel: with one written on its Kernel API.

Shipped: GaussianProcessRegressor with alpha 1e-10 and its own L-BFGS-B. Best: alpha 0,
L-BFGS-B with a long memory and tight tolerances, started
again while it gains. The gradient is an n x n x p array, as scikit-learn wants it, so
that n is small.
"""

import warnings

import numpy as np
import sklearn
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
from scipy.spatial.distance import cdist
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Kernel


class MultiTask(Kernel):
    """K^rho[t, t'] k^x(u, u') + sigma^2; the task is the last column.

    Parameters
    ----------
    length_scales, weights : ndarray of shape (18,) and (24,)
        l and w.
    bias, amplitude, noise : float
        b, a and sigma^2.
    F : ndarray of shape (n_tasks, rank)
        Factor of K^rho. It is not learned as a logarithm, for its signs matter.
    kappa : ndarray of shape (n_tasks,)
        Diagonal of K^rho beside F F^T.
    """

    def __init__(self, length_scales, weights, bias, amplitude, noise, F, kappa):
        self.length_scales, self.weights = length_scales, weights
        self.bias, self.amplitude, self.noise = bias, amplitude, noise
        self.F, self.kappa = F, kappa

    @property
    def K_rho(self):
        """K^rho."""
        return self.F @ self.F.T + np.diag(self.kappa)

    @property
    def theta(self):
        """Logarithms of the positive parameters, and F."""
        scalars = [self.bias, self.amplitude, self.noise]
        positive = np.concatenate(
            [self.length_scales, self.weights, scalars, self.kappa]
        )
        return np.concatenate([np.log(positive), np.ravel(self.F)])

    @theta.setter
    def theta(self, theta):
        shape, n_weights = np.shape(self.F), len(self.weights)
        positive, F = np.exp(theta[: -np.prod(shape)]), theta[-np.prod(shape) :]
        scales, weights, scalars, self.kappa = np.split(
            positive, np.cumsum([N_X, n_weights, 3])
        )
        self.length_scales, self.weights = scales, weights
        self.bias, self.amplitude, self.noise = scalars
        self.F = F.reshape(shape)

    @property
    def bounds(self):
        """Bounds of theta."""
        return np.array(
            [np.log(LENGTH_SCALES)] * len(self.length_scales)
            + [np.log(WEIGHTS)] * (len(self.weights) + 2)
            + [np.log(NOISE)]
            + [np.log(KAPPA_BOUNDS)] * len(self.kappa)
            + [FACTOR] * np.size(self.F)
        )

    @property
    def n_dims(self):
        """Number of parameters."""
        return len(self.theta)

    def __call__(self, X, Y=None, eval_gradient=False):
        """Covariance and, if asked, the array of its derivatives by theta."""
        Y_ = X if Y is None else Y
        tasks, tasks_Y = X[:, -1].astype(int), Y_[:, -1].astype(int)
        u, v = X[:, :-1], Y_[:, :-1]
        x, z = u[:, :N_X], v[:, :N_X]
        scaled = cdist(x / self.length_scales, z / self.length_scales, "sqeuclidean")
        smooth = self.amplitude * np.exp(-0.5 * scaled)
        K_x = self.bias + (u * self.weights) @ v.T + smooth
        K_rho = self.K_rho[np.ix_(tasks, tasks_Y)]
        K = K_rho * K_x
        if Y is None:
            K[np.diag_indices_from(K)] += self.noise
        return (
            (K, self._derivatives(u, tasks, K_rho, K_x, smooth)) if eval_gradient else K
        )

    def _derivatives(self, u, tasks, K_rho, K_x, smooth):
        n, (n_tasks, rank) = len(u), self.F.shape
        dK = np.empty((n, n, self.n_dims))
        smooth = K_rho * smooth
        for d, scale in enumerate(self.length_scales):
            dK[:, :, d] = smooth * np.subtract.outer(u[:, d], u[:, d]) ** 2 / scale**2
        for d, weight in enumerate(self.weights):
            dK[:, :, N_X + d] = K_rho * (weight * np.outer(u[:, d], u[:, d]))
        k = N_X + len(self.weights)
        dK[:, :, k], dK[:, :, k + 1] = self.bias * K_rho, smooth
        dK[:, :, k + 2] = self.noise * np.eye(n)
        dK[:, :, k + 3 :] = 0.0
        for m in range(n_tasks):
            of_task = tasks == m
            own = np.ix_(of_task, of_task)
            dK[(*own, k + 3 + m)] = self.kappa[m] * K_x[own]
            for r in range(rank):
                half = self.F[tasks, r] * K_x[of_task]
                k_mr = k + 3 + n_tasks + m * rank + r
                dK[of_task, :, k_mr] += half
                dK[:, of_task, k_mr] += half.T
        return dK

    def diag(self, X):
        """Diagonal of the covariance of f."""
        u, tasks = X[:, :-1], X[:, -1].astype(int)
        K_x = self.bias + u**2 @ self.weights + self.amplitude
        return np.diagonal(self.K_rho)[tasks] * K_x

    def is_stationary(self):
        """No."""
        return False


class Adapter:
    """scikit-learn."""

    version = sklearn.__version__

    def __init__(self, problem, settings, threads):
        warnings.simplefilter("ignore")
        self.best, self.n = settings == "best", len(problem.y)
        self.X, self.y = problem.X, problem.y
        start = problem.start
        self.kernel = MultiTask(
            start.length_scales,
            start.weights,
            float(start.bias),
            float(start.amplitude),
            float(start.noise),
            problem.F,
            np.full(len(problem.F), KAPPA),
        )
        self.alpha = 0.0 if self.best else 1e-10
        self.start_x = self.kernel.theta

    def regressor(self, optimizer):
        """GaussianProcessRegressor with the kernel."""
        return GaussianProcessRegressor(
            self.kernel, alpha=self.alpha, optimizer=optimizer
        )

    def evaluate(self, k):
        """The likelihood and its gradient, once."""
        if not hasattr(self, "unlearned"):
            self.unlearned = self.regressor(None).fit(self.X, self.y)
        value, _ = self.unlearned.log_marginal_likelihood(
            self.start_x + 1e-6 * k, eval_gradient=True, clone_kernel=False
        )
        return value

    def fit(self, recorder):
        """Learn."""
        self.stop = ""

        def recorded(objective, theta):
            loss, gradient = objective(theta)
            recorder(-loss, theta.copy())
            return loss, gradient

        def longer(objective, theta, bounds):
            def value_and_grad(theta):
                loss, gradient = objective(theta)
                return -loss, -gradient

            self.stop = maximise(value_and_grad, theta, recorder, self.n, bounds)
            return recorder.state, -recorder.best

        regressor = self.regressor(longer if self.best else "fmin_l_bfgs_b")
        if not self.best:
            inner = regressor._constrained_optimization
            regressor._constrained_optimization = lambda objective, theta, bounds: (
                inner(lambda x: recorded(objective, x), theta, bounds)
            )
        regressor.fit(self.X, self.y)
        self.kernel = regressor.kernel_
        return self.stop or "fit ended"

    def restore(self, theta):
        """Go back to a state."""
        self.kernel = self.kernel.clone_with_theta(theta)

    def parameters(self):
        """The current parameters."""
        k = self.kernel
        return Parameters(
            k.length_scales,
            k.weights,
            k.bias,
            k.amplitude,
            k.noise + self.alpha,
            k.K_rho,
        )


if __name__ == "__main__":
    main(Adapter)
