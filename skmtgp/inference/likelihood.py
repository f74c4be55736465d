"""What the likelihoods share: parameters, failures, the Fisher information."""

import contextlib
from abc import ABC, abstractmethod
from itertools import chain
from math import isqrt

import numpy as np

from skmtgp._contraction import compile_kernel
from skmtgp.exceptions import NotPositiveDefiniteError

FISHER_ROWS = 200
FISHER_SIZE = 2**24  # elements of the derivatives by all parameters


class Likelihood(ABC):
    r"""Log marginal likelihood of one output over all tasks, eq. 6.

    .. math::
        \log p(t | X) = -\tfrac12 t^T K^{-1} t - \tfrac12 \log|K| - \tfrac n2 \log 2\pi,
        \quad K_{ij} = K^\rho_{m_i m_j} k^x(x_i, x_j) + \sigma^2_{m_i} \delta_{ij}

    Parameters
    ----------
    kernel : Kernel
        k^x; only its form matters, theta sets its free hyperparameters.
    task_covariance : FixedTaskCovariance, LowRank or WithDiagonal
        Form of K^rho.
    X : ndarray of shape (n_samples, n_features)
        Inputs without the task column, sorted by task.
    tasks : ndarray of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1, ascending.
    y : ndarray of shape (n_samples,)
        Targets, of which the model takes the mean to be zero.
    n_noise : int, default=1
        1 for a noise variance shared by the tasks, n_tasks for one each.

    Notes
    -----
    theta is the concatenation of the kernel's theta, the parameters of K^rho and the
    logarithms of the noise variances.
    """

    def __init__(self, kernel, task_covariance, X, tasks, y, n_noise=1):
        self.kernel, self.node = kernel, compile_kernel(kernel)
        self.task_covariance = task_covariance
        self.X, self.tasks, self.y = X, tasks, y
        self.n_noise = n_noise

    @property
    def noise_of_row(self):
        """Which noise variance each row has."""
        return self.tasks if self.n_noise > 1 else np.broadcast_to(0, len(self.tasks))

    @abstractmethod
    def _evaluate(self, theta):
        """The value; NotPositiveDefiniteError where K cannot be factorised."""

    @abstractmethod
    def _evaluate_with_grad(self, theta):
        """The same with the gradient by theta."""

    @abstractmethod
    def task_gradient(self, theta):
        """Derivative of the value with respect to K^rho, (n_tasks, n_tasks)."""

    @abstractmethod
    def posterior(self, theta):
        """The posterior of f given y.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        posterior : Posterior
            Where the covariance is singular in floating point, a JitterWarning says
            what was added to it.
        """

    @abstractmethod
    def release(self):
        """Give back the memory that is kept for the next evaluation."""

    def split(self, theta):
        """Theta's three parts: kernel, K^rho, log noise variances."""
        return np.split(theta, [self.node.n_dims, len(theta) - self.n_noise])

    def value(self, theta):
        """Log marginal likelihood; -inf where K cannot be factorised."""
        try:
            value = self._evaluate(theta)
        except NotPositiveDefiniteError:
            return -np.inf
        return value if np.isfinite(value) else -np.inf

    def value_and_grad(self, theta):
        """Log marginal likelihood and its gradient; -inf and nan where K fails.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        value : float
            Log marginal likelihood.
        gradient : ndarray of shape (n_theta,)
            Its gradient.
        """
        with contextlib.suppress(NotPositiveDefiniteError):
            value, gradient = self._evaluate_with_grad(theta)
            if np.isfinite(value):
                return value, gradient
        return -np.inf, np.full(len(theta), np.nan)

    def fisher_information(self, theta):
        """Fisher information of theta, from some of the rows.

        At most FISHER_ROWS, and fewer where there are thousands of parameters.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        information : ndarray of shape (n_theta, n_theta)
            1/2 tr(K^{-1} dK_p K^{-1} dK_q), scaled to all rows.
        """
        self.release()  # the derivatives need as much memory
        n = len(self.X)
        most = min(n, FISHER_ROWS, 1 + isqrt(FISHER_SIZE // len(theta)))
        rows = np.linspace(0, n - 1, most).astype(int)
        K, derivatives = self._derivatives(theta, rows)
        inverse, scores = np.linalg.inv(K), np.empty((len(theta), most, most))
        for score, derivative in zip(scores, derivatives, strict=True):
            np.matmul(inverse, derivative, out=score)
        information, flat = np.empty((len(theta),) * 2), scores.reshape(len(theta), -1)
        for a in range(0, len(theta), 16):  # a few transposed at a time
            transposed = scores[a : a + 16].swapaxes(1, 2).reshape(-1, most * most)
            information[a : a + 16] = 0.5 * transposed @ flat.T
        return information * (n / most)

    def _derivatives(self, theta, rows):
        """K of some rows, and its derivatives by theta, one after another."""
        kernel, rho, log_noise = self.split(theta)
        tasks, noise_of_row = (
            np.asarray(of_row[rows]) for of_row in (self.tasks, self.noise_of_row)
        )
        between, noise = np.ix_(tasks, tasks), np.exp(log_noise)
        K_rho = self.task_covariance.matrix(rho)[between]
        kernel = self.kernel.clone_with_theta(kernel)
        X = np.asarray(self.X[rows], dtype=float)
        K_x, dK_x = kernel(X, eval_gradient=True)
        dK_rho = self.task_covariance.derivatives(rho)
        derivatives = chain(
            (d * K_rho for d in np.moveaxis(dK_x, 2, 0)),
            (d[between] * K_x for d in dK_rho),
            (np.diag(v * (noise_of_row == k)) for k, v in enumerate(noise)),
        )
        return K_x * K_rho + np.diag(noise[noise_of_row]), derivatives


def log_density(fit, log_det, n):
    """Of n numbers y ~ N(0, K), with fit = y^T K^{-1} y."""
    return -0.5 * (fit + log_det + n * np.log(2.0 * np.pi))
