"""What is told of learning, in words, and of a climb while it goes on."""

import logging
from functools import partial

import numpy as np

from skmtgp._data.dask import map_parts
from skmtgp._support.progress import is_due, say
from skmtgp.learning.forecast import is_large
from skmtgp.learning.problem import THE_OUTPUT


def about(problem, *of):
    """How a line begins: with the output, if there are several, and more."""
    names = [] if problem.name == THE_OUTPUT else [problem.name]
    names += map(str, of)
    return f"{', '.join(names)}: " if names else ""


def in_words(problem, theta, value, *, bound=False):
    """A maximum that was found, in units of y.

    Parameters
    ----------
    problem : Problem
        Of the rows that it was found from.
    theta : ndarray of shape (n_theta,)
        Where it is.
    value : float
        Log marginal likelihood of the scaled targets, with the densities of theta.
    bound : bool, default=False
        Whether it is a bound by inducing inputs.

    Returns
    -------
    words : str
        Such as "log likelihood 355.7".
    """
    what = "lower bound on the log likelihood" if bound else "log likelihood"
    of_theta = problem.log_density(theta)
    value = value - (of_theta if np.isfinite(of_theta) else 0.0)
    value = value - problem.of_equal_targets(theta)[0]
    return f"{what} {value + _log_jacobian(problem):.1f}"


def _log_jacobian(problem):
    """Log density of the targets in units of y less that in which they are learned."""
    log_scales, data, trend = problem.log_scales, problem.data, problem.prior.trend
    of_trend = 0.0 if trend is None else trend.log_jacobian(data.X, data.tasks)
    if len(log_scales) == 1:
        return of_trend - float(log_scales[0] * data.counts.sum())
    if data.known is not None:
        return of_trend - float(log_scales @ np.bincount(data.tasks, data.counts))
    count = partial(np.bincount, minlength=data.n_tasks)
    return of_trend - float(log_scales @ sum(map_parts(count, data.tasks)))


class Teller:
    """Tells how far a climb is; nothing without `verbose`.

    Parameters
    ----------
    problem : Problem
        What is learned.
    """

    def __init__(self, problem):
        self.problem, self.verbose = problem, problem.budget.verbose
        self.n_iter = self.n_evaluations = 0
        self.best, self.theta = -np.inf, None

    def begin(self):
        """Say what is climbed if that may take long, and how long an evaluation does.

        The first one may take longer than a user waits without a sign.
        """
        if not (self.verbose and is_large(self.problem)):
            return
        data, pace = self.problem.data, self.problem.budget.pace
        seconds = pace * self.problem.engine.side(data) ** 3
        each = f", about {seconds:.2g} s for each evaluation" if seconds else ""
        say(f"{self.begin_of_line}a climb from {len(data)} rows begins{each}")

    def told(self, objective):
        """The objective, which says after some seconds how far the climb is."""
        if not self.verbose:
            return objective

        def evaluate(theta):
            value, gradient = objective(theta)
            self.n_evaluations += 1
            if -value > self.best or self.theta is None:
                self.best, self.theta = -value, theta
            if is_due(self.problem.budget.begun):
                self._say()
            return value, gradient

        return evaluate

    def iterated(self, n_iter, theta, value):
        """After an iteration: every so many a line, if many lines are asked for."""
        self.n_iter = n_iter
        if self.verbose >= 2 and n_iter % self.problem.tuning.report_every == 0:
            self.best, self.theta = value, theta
            self._say(level=logging.DEBUG)

    def end(self, mode):
        """Say where the climb ended, and why, if many lines are asked for."""
        if self.verbose >= 2:
            why = "no more to gain" if mode.converged else "given up"
            why = "at the limit of rounding" if mode.stalled else why
            self.n_iter, self.best, self.theta = mode.n_iter, mode.value, mode.theta
            self._say(f"; done, {why}", level=logging.DEBUG)

    @property
    def begin_of_line(self):
        """With the output and the form of K^rho."""
        return about(self.problem, self.problem.prior)

    def _say(self, why="", *, level=logging.INFO):
        problem, prior = self.problem, self.problem.prior
        noise = np.exp(prior.log_noise_at(self.theta).min()) / prior.scale**2
        of_best = self.theta, self.best
        found = in_words(problem, *of_best, bound=problem.data.Z is not None)
        say(
            f"{self.begin_of_line}iteration {self.n_iter}, {found}, noise {noise:.1e} "
            f"of the variance ({self.n_evaluations} evaluations of "
            f"{len(problem.data)} rows){why}",
            level,
        )
