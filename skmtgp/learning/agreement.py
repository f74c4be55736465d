"""Whether a climb is on its way to a mode that is known already."""

from functools import cache

import numpy as np


def nearing(problem, known):
    """What says whether a point is as good as one of several modes.

    Its value is within a nat below the mode's, and the covariances of f between some of
    the rows, which rotations of the factor and features without effect leave alone, are
    nearly the same, as are the noise variances.

    Parameters
    ----------
    problem : Problem
        What is learned.
    known : sequence of Mode
        Modes of the same problem.

    Returns
    -------
    near : callable
        (theta, value) -> bool.
    """
    tuning, prior, data = problem.tuning, problem.prior, problem.data

    @cache
    def some():
        rows = np.linspace(0, len(data) - 1, min(len(data), tuning.compared))
        rows = rows.astype(int)
        return np.asarray(data.X[rows], dtype=float), np.asarray(data.tasks[rows])

    @cache
    def covariance_of(i):
        return prior.covariance(known[i].theta, *some())

    def near(theta, value):
        return any(
            abs(mode.value - value) < tuning.alike
            and _is_near(prior.log_noise_at(theta), prior.log_noise_at(mode.theta))
            and np.linalg.norm(prior.covariance(theta, *some()) - covariance_of(i))
            < tuning.alike_covariance * np.linalg.norm(covariance_of(i))
            for i, mode in enumerate(known)
        )

    def _is_near(log_noise, other):
        return np.abs(log_noise - other).max() < tuning.alike_noise

    return near
