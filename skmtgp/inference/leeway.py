r"""What the rows leave open of theta, and what that adds to the variance of f.

At a mode theta counts as known. Few rows leave it open, by a covariance
:math:`C = \sum_a c_a c_a^T`. By the law of total variance that of f is larger by what
the mean of f varies with theta,

.. math::
    \mathrm{var}_\theta\, \mu(x; \theta) \approx \tfrac14 \sum_a
    \bigl(\mu(x; \theta + c_a) - \mu(x; \theta - c_a)\bigr)^2,

the correction of Kass and Steffey (1989) with symmetric differences, as in the
unscented transform (Julier and Uhlmann 1997).
"""

from copy import copy
from typing import NamedTuple

import numpy as np

from skmtgp.model.described import describes


class OfTheta(NamedTuple):
    """What is open of all of theta.

    Attributes
    ----------
    ends : ndarray of shape (n_axes, 2, n_theta)
        theta + c_a and theta - c_a.
    """

    ends: np.ndarray

    def ends_at(self, prior, theta):
        """The ends, of shape (n_axes, 2, n_theta)."""
        return self.ends

    def concerns(self, tasks):
        """Of which tasks the variances grow, a mask."""
        return np.ones(len(tasks), dtype=bool)

    def bordered(self, prior, theta, rows, *border):
        """The same once a task has joined by this border, see `Prior.bordered`.

        The task stays the same sum of the others, as far as it is one: its row of F is
        l F^+ F' at an end with F'.
        """

        def joined(end):
            return prior.bordered(end, _rows_at(prior, theta, end, rows), *border)[1]

        return OfTheta(np.array([list(map(joined, pair)) for pair in self.ends]))

    def with_row(self, prior, theta, rows, own, task):
        """The same once a task has other rows of F, as in `bordered`."""

        def changed(end):
            return prior.with_row(end, _rows_at(prior, theta, end, rows), own, task)

        return OfTheta(np.array([list(map(changed, pair)) for pair in self.ends]))


class OfRow(NamedTuple):
    """What is open of a task's row of F.

    Attributes
    ----------
    task : int
        Position of the task.
    axes : list of ndarray of shape (n_axes, rank)
        The c_a, those of each term.
    """

    task: int
    axes: list

    def ends_at(self, prior, theta):
        """The ends, of shape (n_axes, 2, n_theta)."""
        n_axes = len(self.axes[0])
        ends = np.tile(theta, (n_axes, 2, 1))
        for mask, of_term in zip(prior.of_factors, self.axes, strict=True):
            away = np.zeros((n_axes, prior.n_tasks, mask.sum() // prior.n_tasks))
            away[:, self.task, : of_term.shape[1]] = of_term
            away = away.reshape(n_axes, -1)
            ends[:, :, mask] += np.stack([away, -away], axis=1)
        return ends

    def concerns(self, tasks):
        """Of which tasks the variances grow, a mask."""
        return np.asarray(tasks) == self.task

    def bordered(self, prior, theta, rows, own, position, log_noise):
        """The same once a task has joined by this border, see `Prior.bordered`."""
        return self._replace(task=self.task + (self.task >= position))

    def with_row(self, prior, theta, rows, own, task):
        """The same once another task has other rows of F."""
        return self


def _rows_at(prior, theta, end, rows):
    """A task's rows of F at an end, of each term."""
    found, terms = [], [form for _, form in prior.terms]
    thetas = prior.theta_of_terms(theta), prior.theta_of_terms(end)
    for form, (_, rho), (_, rho_at), row in zip(terms, *thetas, rows, strict=True):
        if row is not None and not describes(form):
            turn = np.linalg.lstsq(form.columns(rho), form.columns(rho_at))[0]
            row = row @ turn
        found.append(row)
    return found


class Widened:
    """A posterior of f whose variances count what is open of theta.

    Means are those of the mode. What is open of a task's row of F widens the variances
    of this task alone. Posteriors at the ends of the axes are made when a variance that
    needs them is asked for.

    Parameters
    ----------
    posterior : Posterior
        Of the mode.
    likelihood : Likelihood
        Where it comes from.
    leeway : tuple of OfTheta or OfRow
        What is open.
    """

    before = None  # what `with_unseen` was asked, and `unseen` is what it was told

    def __init__(self, posterior, likelihood, leeway):
        self.posterior, self.likelihood = posterior, likelihood
        self.leeway, self.known = leeway, {}

    def __getattr__(self, name):
        if name.startswith("__") or name == "posterior":
            raise AttributeError(name)
        return getattr(self.posterior, name)

    def __getstate__(self):  # that of a model that has predicted is the same
        return vars(self) | {"known": {}}

    def _thetas(self, k):
        """What they are at the ends of the axes of the k-th leeway."""
        return self.leeway[k].ends_at(self.posterior.prior, self.posterior.theta)

    def _ends(self, k):
        """Pairs of posteriors at the ends of axes, without what variances need."""
        if k not in self.known:
            pairs = self.before._ends(k) if self.before else self._thetas(k)
            self.known[k] = [list(map(self._end, pair)) for pair in pairs]
        return self.known[k]

    def _end(self, at):
        if self.before:
            return at.with_unseen(*self.unseen)
        return self.likelihood.posterior(at).of_means()

    def _spread(self, X, tasks):
        """What means vary by along each axis, an array (n_axes, n_samples) each."""
        for k, leeway in enumerate(self.leeway):
            rows = leeway.concerns(tasks)
            if rows.any():
                at = X[rows], tasks[rows]
                ends = self._ends(k)
                spread = np.zeros((len(ends), len(X)))
                spread[:, rows] = [
                    0.5 * (more.mean(*at) - less.mean(*at)) for more, less in ends
                ]
                yield spread

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""
        return self.posterior.variance(X, tasks) + _squares(self._spread(X, tasks))

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        covariance = self.posterior.covariance(X, tasks)
        for of_parameter in self._spread(X, tasks):
            covariance += of_parameter.T @ of_parameter
        return covariance

    def leave_one_out(self, include_noise=False):
        """Each training sample predicted from the others, see Posterior."""

        def residuals(theta):
            return self.likelihood.posterior(theta).leave_one_out()[0]

        residual, variance = self.posterior.leave_one_out(include_noise)
        spread = (
            _half_differences(self._thetas(k), residuals)
            * leeway.concerns(self.likelihood.tasks)
            for k, leeway in enumerate(self.leeway)
        )
        return residual, variance + _squares(spread)

    def level_variances(self):
        """Variance of the level of each task; of all of theta that counts alone."""
        return self.posterior.level_variances() + self._spread_of(lambda of: of.levels)

    def coefficients_in_units(self):
        """Means and deviations of the trend's coefficients, (n_sets, n_trend) each."""
        means, deviations = self.posterior.coefficients_in_units()
        spread = self._spread_of(lambda of: of.coefficients_in_units()[0])
        return means, np.sqrt(np.square(deviations) + spread)

    def _spread_of(self, evaluate):
        """What it varies by, squared and summed, along the axes of all of theta."""
        return _squares(
            _half_differences(self._ends(k), evaluate)
            for k, leeway in enumerate(self.leeway)
            if isinstance(leeway, OfTheta)
        )

    def with_unseen(self, n_unseen, described=None):
        """The same that knows tasks without data, too; this one stays as it is."""
        widened = copy(self)
        widened.before, widened.unseen = self, (n_unseen, described)
        widened.posterior = self.posterior.with_unseen(*widened.unseen)
        widened.known = {}
        return widened


def _half_differences(pairs, evaluate):
    """Half of what it gives at one end less that at the other, (n_axes, ...)."""
    return np.array([0.5 * np.subtract(*map(evaluate, pair)) for pair in pairs])


def _squares(spreads):
    """Sums of squares over all axes."""
    return sum(np.square(spread).sum(axis=0) for spread in spreads)
