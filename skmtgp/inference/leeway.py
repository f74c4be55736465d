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

from skmtgp.inference.open_rows import OfRow, OpenRows
from skmtgp.model.described import describes


class OfTheta(NamedTuple):
    """What is open of all of theta.

    Attributes
    ----------
    ends : ndarray of shape (n_axes, 2, n_theta)
        theta + c_a and theta - c_a.
    """

    ends: np.ndarray

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


class OfAll(NamedTuple):
    """How much larger all variances are, those of the noise among them.

    Attributes
    ----------
    times : float
        What they are multiplied by.
    """

    times: float

    def bordered(self, prior, theta, *border):
        """The same once a task has joined."""
        return self

    def with_row(self, prior, theta, rows, own, task):
        """The same once a task has other rows of F."""
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


def widened(posterior, likelihood, leeway):
    """A posterior whose variances count all that is open.

    Parameters
    ----------
    posterior : Posterior
        Of the mode.
    likelihood : Likelihood
        Where it comes from.
    leeway : tuple of OfTheta, OfRow or OfAll
        What is open, see :mod:`skmtgp.inference.open_rows` too.

    Returns
    -------
    posterior : Posterior, Widened, OpenRows or Scaled
    """
    rows = [of for of in leeway if isinstance(of, OfRow)]
    if rows:
        posterior = OpenRows(posterior, likelihood, rows)
    for of in leeway:
        if isinstance(of, OfTheta):
            posterior = Widened(posterior, likelihood, of.ends)
    times = times_of(leeway)
    return posterior if times == 1.0 else Scaled(posterior, times)


def times_of(leeway):
    """What all variances are multiplied by, beside what else is open."""
    return float(np.prod([of.times for of in leeway if isinstance(of, OfAll)]))


class Widened:
    """A posterior of f whose variances count what is open of theta.

    Means are those of the mode. Posteriors at the ends of the axes are made when a
    variance that needs them is asked for.

    Parameters
    ----------
    posterior : Posterior
        Of the mode.
    likelihood : Likelihood
        Where it comes from.
    thetas : ndarray of shape (n_axes, 2, n_theta)
        The ends.
    """

    before = None  # what `with_unseen` was asked, and `unseen` is what it was told

    def __init__(self, posterior, likelihood, thetas):
        self.posterior, self.likelihood = posterior, likelihood
        self.thetas, self.known = thetas, None

    def __getattr__(self, name):
        if name.startswith("__") or name == "posterior":
            raise AttributeError(name)
        return getattr(self.posterior, name)

    def __getstate__(self):  # that of a model that has predicted is the same
        return vars(self) | {"known": None}

    def _ends(self):
        """Pairs of posteriors at the ends of axes, without what variances need."""
        if self.known is None:
            pairs = self.before._ends() if self.before else self.thetas
            self.known = [list(map(self._end, pair)) for pair in pairs]
        return self.known

    def _end(self, at):
        if self.before:
            return at.with_unseen(*self.unseen)
        return self.likelihood.posterior(at).of_means()

    def _spread(self, X, tasks):
        """What means vary by along each axis, an array (n_axes, n_samples)."""
        return _half_differences(self._ends(), lambda of: of.mean(X, tasks))

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""
        return self.posterior.variance(X, tasks) + _squares(self._spread(X, tasks))

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        covariance = self.posterior.covariance(X, tasks)
        spread = self._spread(X, tasks)
        covariance += spread.T @ spread
        return covariance

    def leave_one_out(self, include_noise=False):
        """Each training sample predicted from the others, see Posterior."""

        def residuals(theta):
            return self.likelihood.posterior(theta).leave_one_out()[0]

        residual, variance = self.posterior.leave_one_out(include_noise)
        spread = _half_differences(self.thetas, residuals)
        return residual, variance + _squares(spread)

    def level_variances(self):
        """Variance of the level of each task, given the data, (n_tasks,)."""
        return self.posterior.level_variances() + self._spread_of(lambda of: of.levels)

    def coefficients_in_units(self):
        """Means and deviations of the trend's coefficients, (n_sets, n_trend) each."""
        means, deviations = self.posterior.coefficients_in_units()
        spread = self._spread_of(lambda of: of.coefficients_in_units()[0])
        return means, np.sqrt(np.square(deviations) + spread)

    def _spread_of(self, evaluate):
        """What it varies by, squared and summed."""
        return _squares(_half_differences(self._ends(), evaluate))

    def with_unseen(self, n_unseen, described=None):
        """The same that knows tasks without data, too; this one stays as it is."""
        widened = copy(self)
        widened.before, widened.unseen = self, (n_unseen, described)
        widened.posterior = self.posterior.with_unseen(*widened.unseen)
        widened.known = None
        return widened


class Scaled:
    """A posterior of f whose variances are so many times as large; means stay.

    So do training samples predicted from the others: they tell the factor.

    Parameters
    ----------
    posterior : Posterior, Widened or OpenRows
        Of the mode.
    times : float
        What variances are multiplied by.
    """

    def __init__(self, posterior, times):
        self.posterior, self.times = posterior, times

    def __getattr__(self, name):
        if name.startswith("__") or name == "posterior":
            raise AttributeError(name)
        return getattr(self.posterior, name)

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""
        return self.times * self.posterior.variance(X, tasks)

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        covariance = self.posterior.covariance(X, tasks)
        covariance *= self.times
        return covariance

    def level_variances(self):
        """Variance of the level of each task, given the data, (n_tasks,)."""
        return self.times * self.posterior.level_variances()

    def coefficients_in_units(self):
        """Means and deviations of the trend's coefficients, (n_sets, n_trend) each."""
        means, deviations = self.posterior.coefficients_in_units()
        return means, np.sqrt(self.times) * deviations

    def with_unseen(self, n_unseen, described=None):
        """The same that knows tasks without data, too; this one stays as it is."""
        return Scaled(self.posterior.with_unseen(n_unseen, described), self.times)


def _half_differences(pairs, evaluate):
    """Half of what it gives at one end less that at the other, (n_axes, ...)."""
    return np.array([0.5 * np.subtract(*map(evaluate, pair)) for pair in pairs])


def _squares(spread):
    """Sums of squares over all axes."""
    return np.square(spread).sum(axis=0)
