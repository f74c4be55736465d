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

    def coefficients(self, likelihood, cholesky):
        """The posterior of the coefficients, from the likelihood of the rows and C."""
        trend, basis = likelihood.prior.trend, likelihood.basis
        half = cholesky.half_solve(likelihood.y)
        of_basis = np.linalg.solve(self.R, self.B.T @ half)
        mean = trend.slopes.ravel() + basis.coefficients(of_basis)
        return Coefficients(trend, mean, basis.coefficients(np.linalg.inv(self.R)))

    def rest(self, half):
        """C^{-1} b without what the trend explains of it, for b in columns."""
        rest = half - self.B @ (self.B.T @ half)
        return rest - self.B @ (self.B.T @ rest)  # once more, for steep trends


class Coefficients:
    """The posterior of the trend's coefficients, and what it does to predictions.

    Parameters
    ----------
    trend : Trend
        Its columns.
    mean : ndarray of shape (n_coefficients,)
        Of the coefficients, in units of y.
    root : ndarray of shape (n_coefficients, rank)
        Their covariance is root root^T.
    """

    def __init__(self, trend, mean, root):
        self.trend, self.mean, self.root = trend, mean, root

    def means(self, X, tasks):
        """What the trend adds to the mean of f, (n_samples,)."""
        return self._times(X, tasks, self.mean)

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
        return self._times(X, tasks, self.beside_slopes)

    def _times(self, X, tasks, coefficients):
        of_sets = coefficients.reshape(self.trend.slopes.shape)
        return self.trend.times(X, tasks, of_sets)

    def spread(self, X, tasks, explained):
        """What adds its square to the variance of f, of shape (rank, n_samples).

        Parameters
        ----------
        X, tasks
            Rows.
        explained : ndarray of shape (rank, n_samples)
            What f would be at X if the columns times `root` were the targets.
        """
        return self.root.T @ self.trend.rows(X, tasks).T - explained

    def in_units(self):
        """Means and deviations of shape (n_sets, n_trend)."""
        deviation = np.linalg.norm(self.root, axis=1)
        shape = self.trend.slopes.shape
        return self.mean.reshape(shape), deviation.reshape(shape)


class WithCoefficients:
    """What posteriors of f tell of a trend, which is part of f.

    Attributes
    ----------
    coefficients : Coefficients or None
        Of the trend, if there is one.
    """

    coefficients = None

    def without_trend(self, y, X, tasks):
        """Targets of training rows without what the trend adds to their means."""
        return y if self.coefficients is None else y - self.coefficients.left(X, tasks)

    def coefficients_in_units(self):
        """Means and deviations of the trend's coefficients, (n_sets, n_trend) each."""
        return self.coefficients.in_units()

    def trend_of(self, tasks):
        """The trend's part in the means of these tasks, in units of y.

        Returns
        -------
        columns : callable
            h(x) of rows of inputs, (n_samples, n_trend).
        coefficients : ndarray of shape (n_trend, n_tasks)
        constants : ndarray of shape (n_tasks,)
            The part is h(x) coefficients + constants.
        """
        return self.coefficients.trend.columns, *self.coefficients.of_tasks(tasks)
