"""The posterior of sparse inference."""

import numpy as np

from skmtgp._parallel import limit_threads
from skmtgp.inference.sums import sum_residuals
from skmtgp.inference.weights import Covariances


class SparsePosterior:
    """Posterior of f at given parameters, by way of the inducing variables.

    Parameters
    ----------
    bound : SparseBound
        Where the data and the model's form come from.
    theta : ndarray of shape (n_theta,)
        Parameters.

    Attributes
    ----------
    kernel : Kernel
        k^x at these parameters.
    K_rho : ndarray of shape (n_tasks, n_tasks)
        K^rho at these parameters.
    features : Features
        Whitened features at these parameters.
    log_likelihood : float
        The bound on the log marginal likelihood of the targets.

    Notes
    -----
    A mean takes O(m) a point, a variance O(m^2), whatever the rank: the posterior
    covariance of each task's weights is kept.
    """

    def __init__(self, bound, theta):
        with limit_threads(len(bound.y)):
            self.features, weights = bound.forward(theta)
            sums = bound.over_rows(sum_residuals, self.features, weights.omega)
            self.log_likelihood = weights.log_density(sums.squares)
            self.omega = weights.refined(sums.errors)
            self.covariances = Covariances(weights)
        self.features.warn_of_jitter()
        self.kernel, self.block_size = self.features.kernel, bound.block_size
        self.K_rho = bound.task_covariance.matrix(bound.split(theta)[1])
        # f^m(x) = omega_m . L^{-1} k^x(Z, x)
        solve = self.features.cholesky.half_solve
        self.weights = solve(self.omega.T, transposed=True).T

    def mean(self, X, tasks):
        """Mean of f, of shape (n_samples,), for rows of X and their tasks."""

        def of_rows(X, tasks):
            present, column = np.unique(tasks, return_inverse=True)
            return self.mean_of_tasks(X, present)[np.arange(len(X)), column]

        return self._by_block(of_rows, X, tasks)

    def mean_of_tasks(self, X, tasks):
        """Mean of f for each row of X and each of the tasks.

        Parameters
        ----------
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        tasks : ndarray of shape (n_tasks,)
            Tasks.

        Returns
        -------
        mean : ndarray of shape (n_samples, n_tasks)
            f^m(x) = omega_m . phi(x).
        """
        weights, m = self.weights[tasks].T, len(self.features)

        def of_rows(X):
            cross = self.features.against(X)
            return cross.times(slice(0, len(X)), slice(0, m), weights)

        return self._by_block(of_rows, X)

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""

        def of_rows(X, tasks):
            tile = self.features.tile(X)
            variance = self.K_rho[tasks, tasks] * tile.rest
            for task in np.unique(tasks):
                rows = tasks == task
                phi = tile.phi[:, rows]
                Sigma = self.covariances.Sigma[task]
                variance[rows] += np.einsum("ji,ji->i", phi, Sigma @ phi)
            return np.maximum(variance, 0.0)

        return self._by_block(of_rows, X, tasks)

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        phi = self.features.tile(X).phi
        rest = self.kernel(X) - phi.T @ phi
        covariance = self.K_rho[np.ix_(tasks, tasks)] * rest
        covariance += self.covariances.between(phi, tasks)
        diagonal = np.einsum("ii->i", covariance)  # a view
        np.maximum(diagonal, 0.0, out=diagonal)  # as in `variance`
        return covariance

    def _by_block(self, function, X, *parts):
        """``function(X, *parts)`` for blocks of rows, put together again."""
        starts = range(0, len(X), self.block_size)
        blocks = [slice(a, a + self.block_size) for a in starts]
        return np.concatenate(
            [function(*(part[rows] for part in (X, *parts))) for rows in blocks]
        )
