"""Fast functions that a climb takes for noise.

A climb begins with k^x that is as smooth as features spread. Where functions are faster
than that, all of them may look like noise, and it ends there. But then faster ones with
less noise are likelier as they are, before anything is learned: that takes some values
of the likelihood. A climb from there then gains dozens of nats, in pure noise a few.
"""

from itertools import product
from operator import itemgetter

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
    candidates = _faster(problem, start, mode)
    if not candidates:
        return mode
    likelihood = problem.likelihood()
    valued = _valued(likelihood, candidates)
    best, _ = max(valued, key=itemgetter(1))
    valued += _valued(likelihood, [_with_less_noise(problem, best)])
    best, value = max(valued, key=itemgetter(1))
    likelihood.release()
    if value <= mode.value:
        return mode
    found = climb(problem, best, relaxed=True, known=[mode])
    gains = found.value > mode.value + problem.tuning.swifter
    return spent_on(found if gains else mode, [mode, found])


def _valued(likelihood, candidates):
    """Points and their log likelihoods, minus infinity where there is none."""
    values = [likelihood.value(theta) for theta in candidates]
    values = [value if np.isfinite(value) else -np.inf for value in values]
    return list(zip(candidates, values, strict=True))


def _faster(problem, start, mode):
    """The mode with shorter length-scales, all or one.

    Functions are as large as at the start: in the mode they may have vanished.
    """
    prior, tuning = problem.prior, problem.tuning
    scales = np.flatnonzero(prior.of_length_scales)
    if not len(scales):
        return []
    alone = scales[:, None] if 1 < len(scales) <= tuning.most_alone else []
    begin = np.where(prior.of_kernel | prior.of_noise, mode.theta, start)
    found = []
    for group, step in product([scales, *alone], tuning.swift):
        theta = begin.copy()
        theta[group] = start[group] + step
        if (theta[group] < mode.theta[group]).all():
            found.append(np.clip(theta, *prior.bounds()))
    return found


def _with_less_noise(problem, theta):
    """A point with less noise than one has."""
    less = np.where(problem.prior.of_noise, np.log(problem.tuning.less_noise), 0.0)
    return np.clip(theta + less, *problem.prior.bounds())
