r"""Coefficients of a trend that have a flat prior, in exact inference.

With an orthonormal basis Q of the trend's columns and K = C C^T,

.. math::
    \log p(y) = -\tfrac12\bigl[y^T P y + \log|K| + \log|Q^T K^{-1} Q|
    + (n - p) \log 2\pi\bigr],\quad
    P = K^{-1} - K^{-1} Q (Q^T K^{-1} Q)^{-1} Q^T K^{-1}

is the density of y without what the p columns explain, in any orthonormal basis of the
rest: restricted maximum likelihood, as Harville (1974) writes it. Columns in other
units, or others that span the same, do not change it.
"""

import numpy as np

from skmtgp.exceptions import NotPositiveDefiniteError


class Flat:
    """What the trend's basis is, given the factor C of K.

    Parameters
    ----------
    cholesky : Cholesky
        C.
    basis : Basis
        Q.

    Attributes
    ----------
    B, R : ndarray of shape (n_samples, rank) and (rank, rank)
        C^{-1} Q = B R with orthonormal columns of B.
    V : ndarray of shape (n_samples, rank)
        C^{-T} B: P = K^{-1} - V V^T.
    log_det : float
        log|Q^T K^{-1} Q|.
    """

    def __init__(self, cholesky, basis):
        # no product of half with itself, which would square its condition number
        self.B, self.R = np.linalg.qr(cholesky.half_solve(basis.Q))
        pivots = np.abs(np.diagonal(self.R))
        if not (pivots > 0.0).all():
            raise NotPositiveDefiniteError("a column of the trend is no column of C")
        self.log_det = 2.0 * np.log(pivots).sum()
        self.V = cholesky.half_solve(self.B, transposed=True)

    def rest(self, half):
        """C^{-1} b without what the trend explains of it, for b in columns."""
        rest = half - self.B @ (self.B.T @ half)
        return rest - self.B @ (self.B.T @ rest)  # once more, for steep trends


class Coefficients:
    """The posterior of the trend's coefficients, and what it does to predictions.

    Parameters
    ----------
    likelihood : DenseLikelihood
        Of the rows.
    flat : Flat
        At the parameters.
    cholesky : Cholesky
        C.

    Attributes
    ----------
    mean : ndarray of shape (n_coefficients,)
        Of the coefficients, in units of y.
    root : ndarray of shape (n_coefficients, rank)
        Their covariance is root root^T.
    """

    def __init__(self, likelihood, flat, cholesky):
        self.trend, self.flat, basis = likelihood.prior.trend, flat, likelihood.basis
        half = cholesky.half_solve(likelihood.y)
        of_basis = np.linalg.solve(flat.R, flat.B.T @ half)
        self.mean = self.trend.slopes.ravel() + basis.coefficients(of_basis)
        self.root = basis.coefficients(np.linalg.inv(flat.R))

    def means(self, X, tasks):
        """What the trend adds to the mean of f, (n_samples,)."""
        return self.trend.rows(X, tasks) @ self.mean

    def of_tasks(self, tasks):
        """Coefficients, (n_trend, n_tasks), and constants, (n_tasks,), of tasks."""
        of_sets = self.mean.reshape(self.trend.slopes.shape)
        found = of_sets[tasks if self.trend.per_task else np.zeros_like(tasks)]
        centre = self.trend.centre
        centre = centre if len(centre) == 1 else centre[tasks]
        return found.T, -(centre * found).sum(axis=1)

    @property
    def beside_slopes(self):
        """Their means, less what least squares have taken off the targets."""
        return self.mean - self.trend.slopes.ravel()

    def left(self, X, tasks):
        """What the trend adds to the mean of targets as they are learned."""
        return self.trend.rows(X, tasks) @ self.beside_slopes

    def spread(self, X, tasks, half):
        """What adds its square to the variance of f, of shape (rank, n_samples).

        Parameters
        ----------
        X, tasks
            Rows.
        half : ndarray of shape (n_train, n_samples)
            C^{-1} cov(y, f(X)).
        """
        return self.root.T @ self.trend.rows(X, tasks).T - self.flat.B.T @ half

    def in_units(self):
        """Means and deviations of shape (n_sets, n_trend)."""
        deviation = np.linalg.norm(self.root, axis=1)
        shape = self.trend.slopes.shape
        return self.mean.reshape(shape), deviation.reshape(shape)
