"""What a climb prints while it goes on."""

import numpy as np

from skmtgp._support.progress import is_due, say
from skmtgp.learning.forecast import is_large


class Teller:
    """Prints how far a climb is; nothing without `verbose`.

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
        each = f", about {seconds:.2g} s for each likelihood" if seconds else ""
        say(f"{self.name}: a climb with {len(data)} rows begins{each}")

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
            self._say()

    def end(self, mode):
        """Say where the climb ended, and why, if many lines are asked for."""
        if self.verbose >= 2:
            why = "no more gain" if mode.converged else "budget spent"
            why = "no digits left" if mode.stalled else why
            self.n_iter, self.best, self.theta = mode.n_iter, mode.value, mode.theta
            self._say(f": {why}")

    @property
    def name(self):
        """Of the output, and the form of K^rho."""
        return f"{self.problem.name}, {self.problem.prior}"

    def _say(self, why=""):
        prior = self.problem.prior
        noise = np.exp(prior.log_noise_at(self.theta).min()) / prior.scale**2
        say(
            f"{self.name}, {len(self.problem.data)} rows, iteration {self.n_iter}, "
            f"{self.n_evaluations} likelihoods: log marginal likelihood "
            f"{self.best:.2f}, noise variance {noise:.1e} of the target's{why}"
        )
