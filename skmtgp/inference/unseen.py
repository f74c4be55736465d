r"""Tasks without data: draws from the population of those with data.

With the latent functions z of eq. 3 and 5, another task is :math:`f = l^T z` and what
it has of its own. Its loadings l are not known, but have the mean :math:`\mu` and the
covariance :math:`\sum_j s_j s_j^T` of the population, whatever the data. By the laws of
total mean and covariance, given the data,

.. math::
    \mathrm E f = \mu^T \mathrm E z,\quad
    \mathrm{cov}(f, f') = \mathrm{cov}(\mu^T z, \mu^T z')
    + \sum_j \bigl[\mathrm{cov}(s_j^T z, s_j^T z')
    + \mathrm E(s_j^T z)\, \mathrm E(s_j^T z')\bigr].

So the posterior is asked for a task with the loadings :math:`\mu`, and for one along
each axis :math:`s_j`. Two tasks without data have only :math:`\mu^T z` in common.
"""

from copy import copy

import numpy as np

from skmtgp.inference.flat import Coefficients, WithCoefficients
from skmtgp.model.population import another_task


class WithUnseen(WithCoefficients):
    """What posteriors of f tell of tasks without data.

    A subclass has ``_with_loadings(unseen)``, the same posterior with more tasks, the
    last ones. Of each term it is given what they have of the latent functions, an array
    of shape (n_more, n_common), and variances beside these, of shape (n_more,).
    """

    def with_unseen(self, n_unseen, described=None):
        """Return a posterior that also knows tasks without data, as the last ones.

        Parameters
        ----------
        n_unseen : int
            Number of these tasks.
        described : ndarray of shape (n_unseen, n_rows), default=None
            What is known about each, see :class:`~skmtgp.model.described.Described`.

        Returns
        -------
        posterior : Posterior or OfPopulation
            A new one; the present posterior does not change.
        """
        known, axes = another_task(self.prior, self.theta, described)
        more = [
            (_below(loadings, n_unseen, of), np.repeat([own, 0.0], [n_unseen, len(of)]))
            for (loadings, own), of in zip(known, axes, strict=True)
        ]
        posterior, n_axes = self._with_loadings(more), len(axes[0])
        return OfPopulation(posterior, n_unseen, n_axes) if n_axes else posterior


def _below(loadings, n_unseen, axes):
    """Loadings of tasks without data, and below them axes."""
    return np.vstack([np.broadcast_to(loadings, (n_unseen, axes.shape[1])), axes])


def bordered(K_rho, F, loadings, own):
    """K^rho with tasks that share some of the latent functions, and nothing else.

    Parameters
    ----------
    K_rho : ndarray of shape (n_tasks, n_tasks)
        Of the tasks with data.
    F : ndarray of shape (n_tasks, n_latent)
        Their latent functions, see `LowRank.latent`.
    loadings, own
        See `WithUnseen`.

    Returns
    -------
    K_rho : ndarray of shape (n_tasks + n_more, n_tasks + n_more)
    """
    n_tasks = len(K_rho)
    F = np.vstack([F[:, : loadings.shape[1]], loadings])
    found = F @ F.T
    found[:n_tasks, :n_tasks] = K_rho
    more = np.arange(n_tasks, len(found))
    found[more, more] += own
    return found


class OfPopulation:
    """A posterior of f that knows tasks of a population, whose loadings are unknown.

    Parameters
    ----------
    posterior : Posterior
        It knows them by their mean loadings. Last it knows tasks along the axes.
    n_unseen, n_axes : int
        How many tasks and axes it knows.
    """

    def __init__(self, posterior, n_unseen, n_axes):
        self.posterior, n_tasks = posterior, posterior.K_rho.shape[-1]
        self.axes = range(n_tasks - n_axes, n_tasks)
        self.first = n_tasks - n_axes - n_unseen
        self.along = copy(posterior)
        if posterior.coefficients is not None:
            self.along.coefficients = NoTrend(posterior.coefficients)

    def __getattr__(self, name):
        if name.startswith("__") or name == "posterior":
            raise AttributeError(name)
        return getattr(self.posterior, name)

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""
        variance, rows = self.posterior.variance(X, tasks), tasks >= self.first
        for at in self._at_axes(X[rows]):
            own = np.maximum(self.along.variance(*at) - self.level, 0.0)
            variance[rows] += own + np.square(self.along.mean(*at))
        return variance

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        covariance = self.posterior.covariance(X, tasks)
        for task in np.unique(tasks[tasks >= self.first]):
            rows = np.flatnonzero(tasks == task)
            for at in self._at_axes(X[rows]):
                mean = self.along.mean(*at)
                more = self.along.covariance(*at) - self.level
                covariance[np.ix_(rows, rows)] += more + np.outer(mean, mean)
        return covariance

    def _at_axes(self, X):
        """Rows and tasks along each axis, if there are rows."""
        return [(X, np.full(len(X), axis)) for axis in self.axes if len(X)]


class NoTrend(Coefficients):
    """A trend's coefficients, of sums of the latent functions alone.

    Parameters
    ----------
    coefficients : Coefficients
        Of the tasks.
    """

    def __init__(self, coefficients):
        super().__init__(coefficients.trend, coefficients.mean, coefficients.root)

    def means(self, X, tasks):
        """What the trend adds to the mean, (n_samples,)."""
        return np.zeros(len(X))

    def spread(self, X, tasks, explained):
        """What adds its square to the variance, see Coefficients."""
        return -explained
