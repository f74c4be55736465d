"""Modes of data without noise that chose other features than the best ones.

A climb decides early which features k^x varies with, while the noise still hides what
the small ones explain, and without noise it has no way back. Where two features explain
much the same, the better one is found by exchanging their parameters: that is an
evaluation, not a climb. Or features that were switched off are brought back.
"""

from itertools import combinations

import numpy as np

from skmtgp.learning.climbing import climb
from skmtgp.learning.problem import best_of


def exchange(problem, mode):
    """Exchange parameters of two features where that gains, and climb on from there.

    Parameters
    ----------
    problem : Problem
        What to learn.
    mode : Mode
        The best so far.

    Returns
    -------
    mode : Mode
        Not worse. The same where the data are noisy.
    """
    if problem.is_noisy(mode):
        return mode
    likelihood, tuning, best = problem.likelihood(), problem.tuning, mode
    for _ in range(tuning.exchanges):
        thetas = exchanged(problem, best.theta)
        values = [likelihood.value(theta) for theta in thetas]
        if not values or max(values) < best.value + tuning.relaxed_tol:
            break
        found = best.led_to(climb(problem, thetas[int(np.argmax(values))]))
        theta, best = best.theta, best_of([best, found], doubt=tuning.doubt)
        if best.theta is theta:  # what was found stalled, and its digits are in doubt
            break
    return best


def reopen(problem, mode):
    """Bring features back that a mode has switched off, and climb again, twice.

    A wide penalty moves the parameters of k^x towards where learning began, so that
    all features have a gradient again.

    Parameters
    ----------
    problem : Problem
        What to learn.
    mode : Mode
        Of data without noise.

    Returns
    -------
    mode : Mode
        Not worse.
    """
    raised = problem.with_noise(mode.theta)
    relaxed = climb(problem, raised, relaxed=True)
    found = relaxed.then(climb(problem, relaxed.theta))
    raised = problem.with_noise(found.theta)
    again = found.led_to(climb(problem, raised))
    return best_of([mode, found, again], doubt=problem.tuning.doubt)


def exchanged(problem, theta):
    """Theta with the parameters of two features exchanged, for pairs that differ.

    Parameters
    ----------
    problem : Problem
        Whose kernel has parameters for each feature, such as length-scales.
    theta : ndarray of shape (n_theta,)
        Parameters.

    Returns
    -------
    thetas : list of ndarray of shape (n_theta,)
        The features that matter most first; none where all features share theirs.
    """
    kernel, start, tuning = problem.prior.kernel, 0, problem.tuning
    pairs = []
    for of in kernel.hyperparameters:
        if not of.fixed:
            pairs += _pairs(theta, range(start, start + of.n_elements), of, tuning)
            start += of.n_elements
    return [_with_exchanged(theta, *pair) for pair in pairs[: tuning.most_exchanges]]


def _pairs(theta, positions, hyperparameter, tuning):
    """Positions of parameters that differ, of which one is far from all bounds."""
    bounds = np.log(np.atleast_2d(hyperparameter.bounds))
    inside = np.abs(theta[list(positions), None] - bounds).min(axis=1)
    inside = dict(zip(positions, inside, strict=True))
    pairs = [
        (max(inside[i], inside[j]), i, j)
        for i, j in combinations(positions, 2)
        if abs(theta[i] - theta[j]) > tuning.differ
    ]
    pairs = [pair for pair in pairs if pair[0] > tuning.off]
    return [(i, j) for _, i, j in sorted(pairs, key=lambda pair: -pair[0])]


def _with_exchanged(theta, i, j):
    theta = theta.copy()
    theta[[i, j]] = theta[[j, i]]
    return theta
