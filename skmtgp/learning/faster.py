"""Fast functions that a climb takes for noise.

A climb begins with k^x that is as smooth as features spread. Where functions are faster
than that, all of them may look like noise, and it ends there. But then faster ones with
less noise are likelier as they are, before anything is learned: that takes some values
of the likelihood. A climb from there then gains dozens of nats, in pure noise a few.
"""

from itertools import product

import numpy as np

from skmtgp.learning.climbing import climb
from skmtgp.learning.problem import spent_on


def with_faster(problem, start, mode):
    """A mode, or one of faster functions if they were taken for noise.

    Parameters
    ----------
    problem : Problem
        With a few hundred rows.
    start : ndarray of shape (n_theta,)
        Where a relaxed climb began.
    mode : Mode
        Where it ended.

    Returns
    -------
    mode : Mode
        With what was spent on both.
    """
    learns = problem.budget.max_iter and problem.prior.n_terms == 1
    if not (learns and problem.is_noisy(mode)):
        return mode
    candidates = _candidates(problem, start, mode)
    if not candidates:
        return mode
    likelihood = problem.likelihood()
    values = [likelihood.value(theta) for theta in candidates]
    likelihood.release()
    best = int(np.nanargmax(values))
    if values[best] <= mode.value:
        return mode
    found = climb(problem, candidates[best], relaxed=True, known=[mode])
    gains = found.value > mode.value + problem.tuning.swifter
    return spent_on(found if gains else mode, [mode, found])


def _candidates(problem, start, mode):
    """The mode with shorter length-scales, all or one, and with less noise.

    Functions are as large as at the start: in the mode they may have vanished.
    """
    prior, tuning = problem.prior, problem.tuning
    scales, lower, upper = np.flatnonzero(prior.of_length_scales), *prior.bounds()
    if not len(scales):
        return []
    alone = scales[:, None] if 1 < len(scales) <= tuning.most_alone else []
    begin = np.where(prior.of_kernel | prior.of_noise, mode.theta, start)
    groups, found = [scales, *alone], []
    for group, step, factor in product(groups, tuning.swift, tuning.less_noise):
        theta = begin + np.where(prior.of_noise, np.log(factor), 0.0)
        theta[group] = start[group] + step
        if (theta[group] < mode.theta[group]).all():
            found.append(np.clip(theta, lower, upper))
    return found
