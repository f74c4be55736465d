r"""What the rows leave open of rows of F, and what that adds to the variance of f.

At a mode F counts as known. But a task is :math:`f = l^T z` with latent functions z,
beside what it has of its own: its row l of F has the coefficients of a regression on z,
and few samples, or samples in a corner of the inputs, leave them open. Let :math:`\mu`
be the posterior means of z, let rows of F have the covariance :math:`S S^T`, as those
of the other tasks say (`scale_of_open_row`), and let a row of which nothing is known
differ from l by d. With the means in the place of z a task is then

.. math::
    f(x) + \mu(x)^T d, \quad d \sim N(0, S S^T).

Those are explicit basis functions (Rasmussen and Williams 2006, section 2.7). G, of
shape (n_train, rank), has their values in the task's samples and zeros in those of
others. With the covariance K of all samples, and k(x) with f(x), the variance of f(x)
grows by

.. math::
    r(x)^T C\, r(x), \quad r(x) = \mu(x) - G^T K^{-1} k(x), \quad
    C = (S^{-T} S^{-1} + G^T K^{-1} G)^{-1}.

It leaves out the product of what is open of l and of z. With a trend P takes the place
of K^{-1}, see :mod:`skmtgp.inference.flat`. This C is a covariance, no root of K. It is
that of the samples from which l was learned. Samples that come later, or go,
change r(x) alone, since l stays.
"""

from copy import copy
from typing import NamedTuple

import numpy as np

from skmtgp.model.population import factors_of, scale_of_open_row


class OfRow(NamedTuple):
    """What is open of a task's row of F.

    Attributes
    ----------
    task : int
        Position of the task.
    axes : list of ndarray of shape (n_axes, rank)
        A root of C, those of each term.
    """

    task: int
    axes: list

    def bordered(self, prior, theta, rows, own, position, log_noise):
        """The same once a task has joined by this border, see `Prior.bordered`."""
        return self._replace(task=self.task + (self.task >= position))

    def with_row(self, prior, theta, rows, own, task):
        """The same once another task has other rows of F."""
        return self


class Effect(NamedTuple):
    """r(x), how f of a task varies with its row of F.

    Attributes
    ----------
    weights : ndarray of shape ([n_terms,] rank, n_inputs)
        It is a sum of k^x between x and inputs, with these weights,
    constants : ndarray of shape (rank,)
        and of these,
    of_trend : ndarray of shape (n_columns, rank) or None
        and of the columns of a trend, times its `root` and these, taken off.
    """

    weights: np.ndarray
    constants: np.ndarray
    of_trend: np.ndarray = None

    def along(self, axes):
        """The same along axes, an array of shape (n_axes, rank)."""
        of_trend = None if self.of_trend is None else self.of_trend @ axes.T
        return Effect(axes @ self.weights, axes @ self.constants, of_trend)


def open_rows(posterior, likelihood, tasks):
    """What is open of rows of F that were learned from the samples.

    Parameters
    ----------
    posterior : Posterior
        Of the mode.
    likelihood : Likelihood
        Where it comes from.
    tasks : list of int
        Whose rows. Columns of F that one task has alone count as known.

    Returns
    -------
    leeway : tuple of OfRow
    """
    factors = factors_of(posterior.prior, posterior.theta)
    F, found = np.hstack(factors), []
    several = np.count_nonzero(F, axis=0) > 1  # the others are one task's own
    if not several.any():
        return ()
    ends = np.cumsum([of.shape[1] for of in factors])[:-1]
    sizes = _sizes(posterior, likelihood, factors)[several]
    informations = posterior.informations(tasks, factors, likelihood)
    for task, information in zip(tasks, informations, strict=True):
        others = np.delete(F[:, several], task, axis=0)
        axes = np.zeros((len(sizes), F.shape[1]))
        axes[:, several] = axes_of(information[np.ix_(several, several)], others, sizes)
        found.append(OfRow(task, np.split(axes, ends, axis=1)))
    return tuple(found)


def axes_of(information, others, sizes):
    """A root of C, of shape (n_axes, rank).

    Parameters
    ----------
    information : ndarray of shape (rank, rank)
        G^T K^{-1} G.
    others : ndarray of shape (n_others, rank)
        Rows of F of the other tasks.
    sizes : ndarray of shape (rank,)
        Deviations of the latent functions.
    """
    scale = scale_of_open_row(others * sizes) / sizes[:, None]
    values, vectors = np.linalg.eigh(scale.T @ information @ scale)
    return (scale @ vectors / np.sqrt(1.0 + np.maximum(values, 0.0))).T


def _sizes(posterior, likelihood, factors):
    """Deviations of latent functions, which make columns of terms comparable."""
    of_terms = zip(posterior.terms, factors, strict=True)
    sizes = [
        np.full(F.shape[1], np.sqrt(kernel.diag(likelihood.inputs).mean()) or 1.0)
        for (kernel, _), F in of_terms
    ]
    return np.concatenate(sizes)


class OpenRows:
    """A posterior of f whose variances count what is open of rows of F.

    Means are those of the mode. What is open of a row widens the variances of its task
    alone. How it does is computed when a variance that needs it is asked for.

    Parameters
    ----------
    posterior : Posterior
        Of the mode.
    likelihood : Likelihood
        Where it comes from.
    rows : list of OfRow
        What is open.
    """

    def __init__(self, posterior, likelihood, rows):
        self.posterior, self.likelihood = posterior, likelihood
        self.axes = {of.task: of.axes for of in rows}
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
            pairs = zip(self.axes[task], factors, strict=True)
            axes = np.hstack([_padded(axes, F.shape[1]) for axes, F in pairs])
            effect, along = effect.along(axes), copy(self.of_data)
            along.weights, along.levels = effect.weights, effect.constants
            self.effects[task] = along, effect.of_trend
        return self.effects[task]

    def _spread(self, X, tasks):
        """Rows of each task that is open, and what f varies by, (n_axes, n_rows)."""
        for task in np.unique(tasks):
            if task in self.axes:
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

        r(x_i) without the sample is r(x_i) times v / sigma^2, if v is the variance of
        y_i given the others. C and mu stay: they know the sample.
        """
        residual, variance = self.posterior.leave_one_out(include_noise)
        precision, noise = self.of_data.precision(), self.of_data.noise_of_rows()
        for rows, spread in self._spread(self.likelihood.X, self.likelihood.tasks):
            times = 1.0 / (precision[rows] * noise[rows])
            variance[rows] += np.square(times * spread).sum(axis=0)
        return residual, variance

    def with_unseen(self, n_unseen, described=None):
        """The same that knows tasks without data, too; this one stays as it is."""
        widened = object.__new__(OpenRows)
        vars(widened).update(vars(self))  # not by copy(), which drops the effects
        widened.posterior = self.posterior.with_unseen(n_unseen, described)
        return widened


def _padded(axes, rank):
    """Axes with zeros for columns that tasks had to themselves when they joined."""
    return np.pad(axes, [(0, 0), (0, rank - axes.shape[1])])
