"""Whether the targets repeat in time, as seasons, days and tides do.

A smooth kernel follows a season from row to row, but does not go on with it where there
are no rows. So a second kernel with a period is added at the mode that was learned. It
is asked of inputs in which the rows of each task are in order, as those of a recording
or of a table of months are. A periodogram says which periods there may be.
"""

from dataclasses import replace
from itertools import product
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import ExpSineSquared, Kernel

from skmtgp._data.statistics import shortest_period
from skmtgp._numerics.parallel import limit_threads
from skmtgp._numerics.periodogram import frequencies
from skmtgp.inference.engines import Dense
from skmtgp.kernels import Columns
from skmtgp.learning.climbing import climb
from skmtgp.learning.own_kernels import (
    MOST_ROWS,
    is_of_one_smooth_kernel,
    with_terms,
)
from skmtgp.model.task_covariance import leading_eigenvectors, low_rank

MOST, SOME = 3000, 300  # rows, and of how many it is asked where that takes long
MOST_STEPS = 50  # of the climb: the gain is clear before
FEWEST = 20  # values of an input
LEAST_CYCLES = 2.0  # in the width of the data
LEAST_GAPS = 2.0  # in a period, times those of the shortest that is looked for
WITHIN = 1.5  # times the period that the periodogram found, or a part of it
# Bounds of the length-scale of the periodic kernel: with less than 0.2 seven days of a
# week have nothing in common, nor with those of the next week if they are not as long.
SHAPES = 0.2, 10.0
APERIODIC = 50.0  # times the width of the data: a constant
HOPE = 30.0  # nats that a climb may gain over where it begins
SHARES = 0.3, 1.0  # of the variance of functions, that repeats at first
SCALES = np.log([1.0, 4.0, 16.0])  # by which the others may be slower
OTHERS = 0.1  # of the variance of tasks, that they need not have in common at first


class Repeating(NamedTuple):
    """What a function that repeats gains.

    Attributes
    ----------
    gain : float
        Nats of BIC, less the logarithm of how many periods as long there may be.
    feature : int
        Position of the input.
    others : Kernel
        That of the other functions, as it was learned beside this one.
    kernel : ExpSineSquared
        Of that input alone, as it was learned.
    shared : bool
        Whether all tasks have the same function; otherwise each a multiple of one.
    """

    gain: float
    feature: int
    others: Kernel
    kernel: ExpSineSquared
    shared: bool


NO_PERIOD = Repeating(-np.inf, -1, None, None, False)
NO_START = -np.inf, None, None, -1, False


def function_that_repeats(problem, mode, enough=-np.inf):
    """What one more function gains that repeats in an input.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.
    enough : float, default=-inf
        What must be gained to be of use: the climb ends where it cannot hope for that.

    Returns
    -------
    found : Repeating
        `NO_PERIOD` where no input is in order, or has a period that may repeat, rows
        are many, or k^x or K^rho are not as those of `gain_of_own_kernels`.
    """
    data = problem.data
    if len(data) > MOST or not is_of_one_smooth_kernel(problem):
        return NO_PERIOD
    inputs = [j for j in range(data.X.shape[1]) if _is_in_order(data, j)]
    if not inputs:
        return NO_PERIOD
    some = problem
    if len(data) > MOST_ROWS:  # of complete data few inputs would be left
        few = replace(data, design=None).thinned(SOME)
        some = replace(problem, data=few, engine=Dense())
    with limit_threads(len(some.data)):
        if some is not problem:  # else a few rows alone would gain by other parameters
            mode = climb(some, mode.theta, noisy=True)
        mode = mode._replace(value=some.likelihood().value(mode.theta))
        return _likeliest(some, mode, inputs, enough)


def _likeliest(problem, mode, inputs, enough):
    """The same, of some inputs and all rows of a problem."""
    found = [begun for j in inputs for begun in _begun(problem, mode.theta, j)]
    value, both, theta, feature, shared = max(
        found, key=itemgetter(0), default=NO_START
    )
    if value < mode.value + enough - HOPE:
        return NO_PERIOD
    least = mode.value + _price(both, problem) + enough
    best = climb(both, theta, least=least, noisy=True)
    gain = _gain(problem, mode, both, best)
    kernels = both.prior.kernel_at(best.theta)
    periodic, width = kernels[1].kernel, np.ptp(problem.data.X[:, feature])
    if gain > enough:  # but for what a function without a period gains
        same = _same_without(problem, mode, both, best, feature)
        gain = min(gain, _gain(*same, both, best))
    gain -= np.log(width / periodic.periodicity)
    return Repeating(gain, feature, kernels[0], periodic, shared)


def _gain(problem, mode, both, best):
    """Nats of BIC that a mode of a larger problem gains."""
    gain = both.log_likelihood(best) - problem.log_likelihood(mode)
    return float(gain) - _price(both, problem)


def _same_without(problem, mode, both, best, feature):
    """The problem with a constant in place of what repeats, and a mode from there."""
    of_others, (_, rho) = both.prior.theta_of_terms(best.theta)
    _, form = both.prior.terms[-1]
    endless = APERIODIC * np.ptp(problem.data.X[:, feature])
    constant = Columns(ExpSineSquared(1.0, endless, "fixed", "fixed"), [feature])
    constant = with_terms(problem, [*problem.prior.terms, (constant, form)], MOST_STEPS)
    of_terms = of_others, (np.empty(0), rho)
    theta = constant.prior.with_theta_of_terms(best.theta, of_terms)
    return constant, climb(constant, theta, noisy=True)


def _is_in_order(data, feature):
    """Whether rows of each task are in the order of an input."""
    x = data.X[:, feature]
    if len(np.unique(x)) < FEWEST:
        return False
    steps = np.diff(x)[np.diff(data.tasks) == 0]
    return bool((steps >= 0.0).all() or (steps <= 0.0).all())


def _periods(data, feature):
    """Periods that an input may have, by a periodogram of the targets."""
    x = data.X[:, feature]
    width, shortest = np.ptp(x), LEAST_GAPS * shortest_period(x)
    cycles = frequencies((x - x.min()) / width, data.tasks, data.y, width / shortest)
    periods = width / cycles
    return periods[(cycles >= LEAST_CYCLES) & (periods >= shortest)]


def _begun(problem, theta, feature):
    """Problems with a function that repeats, where each begins, and how likely."""
    for period, shared in product(_periods(problem.data, feature), (False, True)):
        both = _with_period(problem, feature, period, shared)
        price, value = _price(both, problem), both.likelihood().value
        for start in _starts(both, problem, theta, shared):
            yield value(start) - price, both, start, feature, shared


def _with_period(problem, feature, period, shared):
    """The problem with a second kernel, of one period."""
    bounds = period / WITHIN, period * WITHIN
    kernel = Columns(ExpSineSquared(1.0, period, SHAPES, bounds), [feature])
    form = low_rank(problem.prior.n_tasks, 0 if shared else 1, shared=shared)
    return with_terms(problem, [*problem.prior.terms, (kernel, form)], MOST_STEPS)


def _price(both, problem):
    """Nats of BIC that the parameters of the second kernel cost."""
    price = both.prior.n_hyperparameters - problem.prior.n_hyperparameters
    return 0.5 * price * np.log(len(problem.data))


def _starts(both, problem, theta, shared):
    """Where learning may begin: shares of what repeats, and slower other functions."""
    prior = problem.prior
    [(of_kernel, rho)] = prior.theta_of_terms(theta)
    K_rho, is_scale = prior.K_rho_at(theta), prior.n_length_scales[prior.of_kernel] > 0
    K_rho = K_rho + OTHERS * np.diag(np.diagonal(K_rho))  # so that none has nothing
    size = np.trace(K_rho) / len(K_rho)
    _, (periodic, _) = both.prior.theta_of_terms(both.theta())
    for share, scale in product(SHARES, SCALES):
        of_tasks = np.sqrt(share) * leading_eigenvectors(K_rho, 1).ravel()
        of_tasks = np.array([np.log(share * size)]) if shared else of_tasks
        of_terms = (of_kernel + scale * is_scale, rho), (periodic, of_tasks)
        start = both.prior.with_theta_of_terms(theta, of_terms)
        yield np.clip(start, *both.prior.bounds())
