r"""What the rows leave open of rows of F, and what that adds to the variance of f.

At a mode F counts as known. But a task is :math:`f = l^T z` with latent functions z,
beside what it has of its own: its row l of F has the coefficients of a regression on z,
and few samples, or samples in a corner of the inputs, leave them open. Let :math:`\mu`
be the posterior means of z, let rows of F have the covariance :math:`S S^T`, as those
of the other tasks say, and let a row of which nothing is known differ from l by d,

.. math::
    f(x) + \mu(x)^T d, \quad d \sim N(0, S S^T).

Those are explicit basis functions (Rasmussen and Williams 2006, section 2.7). With
their values G in the task's samples, zero in those of others, and the covariance K of
all samples, the variance of f(x) grows by

.. math::
    r(x)^T C\, r(x), \quad r(x) = \mu(x) - G^T K^{-1} k(x), \quad
    C = (S^{-T} S^{-1} + G^T K^{-1} G)^{-1}.
"""

from copy import copy
from typing import NamedTuple

import numpy as np

from skmtgp._numerics.linalg import RESOLVED
from skmtgp.model.population import factors_of, scale_of_open_row


class Effect(NamedTuple):
    """How f of a task varies with its row of F.

    Attributes
    ----------
    information : ndarray of shape (rank, rank)
        G^T K^{-1} G: what the samples tell of the row.
    weights : ndarray of shape ([n_terms,] rank, n_inputs)
        r(x) is a sum of k^x between x and inputs, with these weights,
    constants : ndarray of shape (rank,)
        and of these,
    of_trend : ndarray of shape (n_columns, rank) or None
        and of the columns of a trend, times its `root` and these, taken off.
    """

    information: np.ndarray
    weights: np.ndarray
    constants: np.ndarray
    of_trend: np.ndarray = None

    def along(self, axes):
        """The same along axes, an array of shape (n_axes, rank)."""
        of_trend = None if self.of_trend is None else self.of_trend @ axes.T
        return Effect(
            axes @ self.information @ axes.T,
            axes @ self.weights,
            axes @ self.constants,
            of_trend,
        )


class OfRows(NamedTuple):
    """Whose rows of F are open.

    Attributes
    ----------
    are_open : ndarray of shape (n_tasks,)
        A mask.
    """

    are_open: np.ndarray

    def bordered(self, prior, theta, rows, own, position, log_noise):
        """The same once a task has joined; it is not open, see :func:`with_open`."""
        return OfRows(np.insert(self.are_open, position, False))

    def with_row(self, prior, theta, rows, own, task):
        """The same once a task has another row, which is not open."""
        are_open = self.are_open.copy()
        are_open[task] = False
        return OfRows(are_open)

    def widened(self, posterior, likelihood):
        """The posterior whose variances count it."""
        return OpenRows(posterior, likelihood, self.are_open)


def with_open(leeway, tasks, n_tasks):
    """What is open with rows of F of some tasks.

    Parameters
    ----------
    leeway : tuple of OfTheta or OfRows
        What was open.
    tasks : int or list of int
        Which tasks.
    n_tasks : int
        Of all.

    Returns
    -------
    leeway : tuple of OfTheta or OfRows
        That of rows comes first: it is of a posterior of the mode itself.
    """
    are_open = np.zeros(n_tasks, dtype=bool)
    are_open[tasks] = True
    others = tuple(of for of in leeway if not isinstance(of, OfRows))
    for of in leeway:
        if isinstance(of, OfRows):
            are_open |= of.are_open
    return (OfRows(are_open), *others)


class OpenRows:
    """A posterior of f whose variances count what is open of rows of F.

    Means are those of the mode. What is open of a row widens the variances of its task
    alone. It is computed when a variance that needs it is asked for.

    Parameters
    ----------
    posterior : Posterior
        Of the mode.
    likelihood : Likelihood
        Where it comes from.
    are_open : ndarray of shape (n_tasks,)
        Whose rows are open, a mask.
    """

    def __init__(self, posterior, likelihood, are_open):
        self.posterior, self.likelihood, self.are_open = posterior, likelihood, are_open
        self.of_data, self.effects = posterior, {}  # it knows tasks with data alone

    def __getattr__(self, name):
        if name.startswith("__") or name == "posterior":
            raise AttributeError(name)
        return getattr(self.posterior, name)

    def __getstate__(self):  # that of a model that has predicted is the same
        return vars(self) | {"effects": {}}

    def _effect(self, task):
        """How f varies along the axes of what is open of a row.

        Returns
        -------
        along : Posterior
            Whose means, of tasks that stand for axes, are that without a trend.
        of_trend : ndarray of shape (n_columns, n_axes) or None
            See Effect.
        """
        if task not in self.effects:
            factors = factors_of(self.of_data.prior, self.of_data.theta)
            effect = self.of_data.effect_of_row(task, factors, self.likelihood)
            scale = scale_of_open_row(np.delete(np.hstack(factors), task, axis=0))
            precision = scale.T @ effect.information @ scale
            precision[np.diag_indices(len(precision))] += 1.0
            axes = np.linalg.solve(np.linalg.cholesky(precision), scale.T)
            effect, along = effect.along(axes), copy(self.of_data)
            along.weights, along.levels = effect.weights, effect.constants
            self.effects[task] = along, effect.of_trend
        return self.effects[task]

    def _spread(self, X, tasks):
        """Of each task that is open its rows, and what f varies by, (rank, n_rows)."""
        for task in np.unique(tasks):
            if task < len(self.are_open) and self.are_open[task]:
                rows = np.flatnonzero(tasks == task)
                yield rows, self._along_axes(X[rows], task)

    def _along_axes(self, X, task):
        along, of_trend = self._effect(task)
        spread = along.mean_of_tasks(X, np.arange(len(along.levels))).T
        if of_trend is not None:
            coefficients = self.of_data.coefficients
            columns = coefficients.trend.rows(X, np.full(len(X), task))
            spread -= of_trend.T @ (columns @ coefficients.root).T
        return spread

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""
        variance = self.posterior.variance(X, tasks)
        for rows, spread in self._spread(X, tasks):
            variance[rows] += np.square(spread).sum(axis=0)
        return variance

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        covariance = self.posterior.covariance(X, tasks)
        for rows, spread in self._spread(X, tasks):
            covariance[np.ix_(rows, rows)] += spread.T @ spread
        return covariance

    def leave_one_out(self, include_noise=False):
        """Each training sample predicted from the others, see Posterior.

        With open rows [K^{-1}]_ii is less by r^T C r / sigma^4, with the r of x_i.
        """
        residual, variance = self.posterior.leave_one_out(include_noise)
        precision, noise = self.of_data.precision(), self.of_data.noise_of_rows()
        for rows, spread in self._spread(self.likelihood.X, self.likelihood.tasks):
            v = 1.0 / precision[rows]
            told = v * np.square(spread / noise[rows]).sum(axis=0)
            variance[rows] += v * told / np.maximum(1.0 - told, RESOLVED)
        return residual, variance

    def with_unseen(self, n_unseen, described=None):
        """The same that knows tasks without data, too; this one stays as it is."""
        widened = copy(self)
        widened.posterior = self.posterior.with_unseen(n_unseen, described)
        return widened
