"""Modes of models that are part of each other: a rank's is one of the next rank too.

Where a rank ends below a lower one, it is learned again from that mode, with columns
added; where a higher rank has found more, its mode is cut to the lower rank and learned
on.
"""

import numpy as np

from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.climbing import climb
from skmtgp.learning.problem import best_of


def descend(data, settings, forms, modes):
    """Learn each rank again from the next higher one's mode, cut to its rank.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Kernel, bounds and budget.
    forms : list of FixedTaskCovariance, LowRank or WithDiagonal
        Forms of K^rho of ascending rank.
    modes : list of Mode
        The mode of each.

    Returns
    -------
    modes : list of Mode
        None is worse than before.
    """
    modes = list(modes)
    for k in reversed(range(len(forms) - 1)):
        higher = modes[k + 1]
        if modes[k].value + settings.tol < higher.value:
            kernel, rho, noise = settings.split(higher.theta)
            cut = forms[k].parameters(forms[k + 1].matrix(rho))
            start = settings.with_noise(np.concatenate([kernel, cut, noise]), forms[k])
            again = climb(data, settings, forms[k], start)
            modes[k] = best_of([modes[k], higher.led_to(again)])
    return modes


def nest(data, settings, forms, modes):
    """Learn a rank again from a lower one's mode where it ended below it.

    Parameters are those of :func:`descend`. The values of the modes that it returns do
    not fall as the rank grows.
    """
    modes = list(modes)
    for k in range(1, len(forms)):
        lower = modes[k - 1]
        if modes[k].value < lower.value:
            embedded, grown = _embed(data, settings, forms[k - 1 : k + 1], lower)
            regrown = lower.led_to(climb(data, settings, forms[k], grown))
            same = lower._replace(theta=embedded, n_evaluations=0, seconds=0.0)
            modes[k] = best_of([modes[k], regrown, same])
    return modes


def _embed(data, settings, forms, mode):
    """A mode as one of the next rank: with empty columns, and with better ones.

    The best new columns are along the leading eigenvectors of dL / dK^rho; their
    length is the best of a few.
    """
    lower, higher = forms
    kernel, rho, noise = settings.split(mode.theta)
    D = settings.likelihood(data, lower).task_gradient(mode.theta)
    added = higher.rank - lower.rank
    with limit_threads(len(D)):
        columns = np.linalg.eigh(D)[1][:, -added:]
    size = np.sqrt(np.trace(lower.matrix(rho)))

    def with_columns(length):
        grown = lower.grown(rho, length * columns)
        return np.concatenate([kernel, grown, noise])

    likelihood = settings.likelihood(data, higher)
    candidates = [with_columns(size * 10.0**-k) for k in range(1, 9)]
    return with_columns(0.0), max(candidates, key=likelihood.value)
