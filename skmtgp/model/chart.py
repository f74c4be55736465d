r"""Coordinates of theta in which its posterior is nearly normal.

A logarithm between bounds l and u is :math:`l + (u - l) / (1 + e^{-x})`, so that x has
no bounds. The factor F of K^rho is

.. math:: F = L Q, \qquad L = e^{\kappa (|g| - 1)}\, g / |g|,

times the size of the targets. Q, which no data tell, is left out; L is a lower
trapezoid whose first rows are those of the tasks that tell most; g are its elements.
Where the amplitude of F grows with the length-scales of k^x, along a ridge of the
posterior, what is known of its direction stays as it is: |g| alone moves, and little,
for :math:`\kappa` is large.
"""

import numpy as np
from scipy.linalg.lapack import dpstrf
from scipy.special import expit, logit

from skmtgp.model.task_covariance import lower_trapezoid

STRETCH = 10.0  # kappa: the amplitude changes by e where |g| does by a tenth
INSIDE = 1e-3  # least share of the range that a point at a bound is taken off it
LEAST = 1e-3  # of the length of L: least element on its diagonal, which never is zero


class Chart:
    """Coordinates x of theta, around some theta.

    Parameters
    ----------
    hyperprior : Hyperprior
        Prior of theta, with respect to whose measure densities are.
    theta : ndarray of shape (n_theta,)
        Parameters. What is held stays as it is here, and the strongest tasks here are
        the first ones of L.

    Attributes
    ----------
    size : int
        Number of coordinates: those of L, then those of the logarithms.
    """

    def __init__(self, hyperprior, theta):
        prior = hyperprior.prior
        self.around, self.unit = theta.copy(), hyperprior.unit
        self.of_factor, self.of_logs = prior.of_factor, hyperprior.precision > 0.0
        lower, upper = prior.bounds()[:, self.of_logs]
        self.lower, self.width = lower, upper - lower
        self.shape = prior.factor_shape
        self._set_order(theta[self.of_factor].reshape(self.shape))
        self.n_factor = int(self.used.sum())
        self.size = self.n_factor + len(lower)

    def _set_order(self, F):
        """The order of the tasks in L, and which of its elements are not zero."""
        n_tasks, rank = self.shape
        self.order = np.arange(n_tasks)
        if rank:
            self.order = dpstrf(F @ F.T, lower=1)[1] - 1
        self.used = np.zeros(self.shape, dtype=bool)
        self.used[self.order] = np.tri(n_tasks, rank, dtype=bool)
        self.diagonal = self.order[:rank], np.arange(rank)
        self.powers = rank - 1.0 - np.arange(rank)  # of the diagonal, in dF = L.. dL dQ

    def among_logs(self, mask):
        """Which coordinates are logarithms under a mask of theta; a mask."""
        return np.append(np.zeros(self.n_factor, dtype=bool), mask[self.of_logs])

    def theta(self, x):
        """Theta, of shape (n_theta,), of coordinates of shape (size,)."""
        g, of_logs = np.split(x, [self.n_factor])
        theta = self.around.copy()
        theta[self.of_logs] = self.lower + self.width * expit(of_logs)
        if self.n_factor:
            length = np.linalg.norm(g)
            amplitude = self.unit * np.exp(STRETCH * (length - 1.0))
            theta[self.of_factor] = self._matrix(amplitude * g / length).ravel()
        return theta

    def _matrix(self, elements):
        L = np.zeros(self.shape)
        L[self.used] = elements
        return L

    def coordinates(self, theta):
        """Coordinates, of shape (size,), of a theta of which K^rho is the same."""
        share = (theta[self.of_logs] - self.lower) / self.width
        of_logs = logit(np.clip(share, INSIDE, 1.0 - INSIDE))
        L = np.empty(self.shape)
        L[self.order] = lower_trapezoid(
            theta[self.of_factor].reshape(self.shape)[self.order]
        )
        length = np.linalg.norm(L) or 1.0
        L[self.diagonal] = np.maximum(L[self.diagonal], LEAST * length)
        g = L[self.used] / np.linalg.norm(L[self.used])
        return np.append(g * (1.0 + np.log(length / self.unit) / STRETCH), of_logs)

    def turned(self, x, rng):
        """Another point of the same amplitude, to jump to, as likely the way back.

        Few rows leave open with which sign tasks go together, or along which functions
        a task is. So, by equal chances, some tasks change sign, those together that are
        alike, or one task takes another direction.

        Parameters
        ----------
        x : ndarray of shape (size,)
            Coordinates.
        rng : Generator
            Source of randomness.

        Returns
        -------
        turned : ndarray of shape (size,)
            Coordinates.
        signs : ndarray of shape (size,)
            1, or -1 for those that changed sign alone.
        """
        L, signs = self._matrix(x[: self.n_factor]), np.ones(self.size)
        task = rng.integers(len(L))
        lengths = np.linalg.norm(L, axis=1)
        if rng.uniform() < 0.5:
            direction = rng.standard_normal(self.shape[1]) * self.used[task]
            L[task] = lengths[task] * direction / np.linalg.norm(direction)
        else:
            alike = np.abs(L @ L[task]) / (lengths * lengths[task])
            chance = np.where(np.arange(len(L)) == task, 1.0, 0.5 * alike)
            sign = np.where(rng.uniform(size=len(L)) < chance, -1.0, 1.0)
            L *= sign[:, None]
            signs[: self.n_factor] = np.broadcast_to(sign[:, None], L.shape)[self.used]
        return np.append(L[self.used], x[self.n_factor :]), signs

    def polar_density(self, x, value, gradient):
        """The log density of the length and direction of g, and of the logarithms.

        Its modes are what a climb looks for: the density of x itself has a pole where g
        is 0, of next to no mass, and the more tasks, the wider.

        Parameters
        ----------
        x : ndarray of shape (size,)
            Coordinates.
        value : float
            Log density of theta(x), with respect to the measure of the hyperprior.
        gradient : ndarray of shape (n_theta,)
            Its gradient by theta.

        Returns
        -------
        value : float
            Log density.
        gradient : ndarray of shape (size,)
            Its gradient by x.
        """
        g, of_logs = np.split(x, [self.n_factor])
        share = expit(of_logs)
        slope = self.width * share * expit(-of_logs)
        of_logs = gradient[self.of_logs] * slope + 1.0 - 2.0 * share
        value += np.log(np.maximum(slope, np.finfo(float).tiny)).sum()
        if not self.n_factor:
            return value, of_logs
        log_volume, of_g = self._of_factor(g, gradient[self.of_factor])
        return value + log_volume, np.append(of_g, of_logs)

    def jacobian(self, x):
        """Derivatives of theta by the coordinates, of shape (n_theta, size)."""
        n, g = self.n_factor, x[: self.n_factor]
        J = np.zeros((len(self.around), self.size))
        share = expit(x[n:])
        logs = np.flatnonzero(self.of_logs)
        J[logs, n + np.arange(len(logs))] = self.width * share * (1.0 - share)
        if n:
            length = np.linalg.norm(g)
            amplitude = self.unit * np.exp(STRETCH * (length - 1.0))
            along = np.outer(g, g) / length**2
            block = (np.eye(n) - along) / length + STRETCH * along
            elements = np.flatnonzero(self.of_factor)[self.used.ravel()]
            J[elements, :n] = amplitude * block
        return J

    def log_spread(self, x):
        """Log density of x over `polar_density`, and its gradient.

        Of n elements g it is -(n - 1) log|g|.
        """
        gradient, n = np.zeros(self.size), self.n_factor
        if n < 2:
            return 0.0, gradient
        g = x[:n]
        square = float(g @ g)
        gradient[:n] = -(n - 1) / square * g
        return -0.5 * (n - 1) * np.log(square), gradient

    def _of_factor(self, g, d_F):
        """Log volume of g, and the gradient of the log density by g."""
        length = np.linalg.norm(g)
        direction = g / length
        amplitude = self.unit * np.exp(STRETCH * (length - 1.0))
        d_L = d_F.reshape(self.shape)[self.used]
        pivots = self._matrix(direction)[self.diagonal]
        with np.errstate(divide="ignore", invalid="ignore"):
            log_volume = self.powers @ np.log(np.abs(pivots) + np.finfo(float).tiny)
            d_direction = np.zeros(self.shape)
            d_direction[self.diagonal] = self.powers / pivots
        log_volume += np.log(STRETCH)
        along = STRETCH * amplitude * (d_L @ direction)
        across = amplitude * d_L + d_direction[self.used]
        across -= direction * (direction @ across)
        return log_volume, along * direction + across / length
