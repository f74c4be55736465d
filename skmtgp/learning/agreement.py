"""Whether a climb is worth going on, beside what is known already."""

import numpy as np


class Rivals:
    """Where other climbs of the same problem ended.

    Parameters
    ----------
    problem : Problem
        What is learned.
    modes : sequence of Mode
        Modes of it, or none. Those that stalled, whose values lack digits, do not
        count.
    least : float, default=-inf
        What a climb must reach to be of use, beside the best of them.
    noisy : bool, default=False
        Whether the data are known to have noise, without modes that say so. Then hope
        is lost from the first look on, and by what noisy climbs gain.
    """

    def __init__(self, problem, modes, least=-np.inf, *, noisy=False):
        self.problem, self.modes = problem, [of for of in modes if not of.stalled]
        self.best = max([least, *(mode.value for mode in self.modes)])
        self.before, self.soon = -np.inf, noisy
        are_noisy = [problem.is_noisy(mode, beyond=0.1) for mode in self.modes]
        noisy |= bool(are_noisy) and all(are_noisy)  # without modes it is not known
        self.times = problem.tuning.hopeless if noisy else problem.tuning.creeping

    def settle(self, n_iter, theta, value):
        """Whether a climb may end at theta: near a mode, or with no hope of the best.

        Called after each iteration, of which it looks at some.
        """
        tuning = self.problem.tuning
        if self.soon and n_iter == 1:
            self.before = value
        if value > self.best or n_iter % tuning.look_every:
            return False
        gain, self.before = value - self.before, value
        hopeless = self.best - value > max(self.times * gain, tuning.alike)
        return hopeless or self.near(theta, value)

    def near(self, theta, value):
        """Whether a point is as good as one of the modes.

        Its value is within a nat of the mode's, and the covariances of f between some
        of the rows, which rotations of the factor and features without effect leave
        alone, are nearly the same, as are the noise variances.
        """
        tuning, prior = self.problem.tuning, self.problem.prior
        log_noise = prior.log_noise_at(theta)
        close = [
            mode
            for mode in self.modes
            if abs(mode.value - value) < tuning.alike
            and np.abs(log_noise - prior.log_noise_at(mode.theta)).max()
            < tuning.alike_noise
        ]
        if not close:
            return False
        K = self._covariance(theta)
        others = [self._covariance(mode.theta) for mode in close]
        limit = tuning.alike_covariance * np.linalg.norm(K)
        return any(np.linalg.norm(K - other) < limit for other in others)

    def _covariance(self, theta):
        """Of f, between some of the rows."""
        data = self.problem.data
        rows = np.linspace(
            0, len(data) - 1, min(len(data), self.problem.tuning.compared)
        )
        rows = rows.astype(int)
        X, tasks = (np.asarray(of[rows]) for of in (data.X, data.tasks))
        return self.problem.prior.covariance(theta, X.astype(float), tasks)
