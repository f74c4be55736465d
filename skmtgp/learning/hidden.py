r"""Functions that a mode takes for noise.

Where levels differ by far more than the functions vary around them, or one function
varies by far more than another, the lesser ones look like noise from most starts, and
climbs end where they are taken for it. The noise of a mode is tested for that: would a
little of a faster or slower function, of all tasks or of each, gain? The derivative of
the log likelihood by its variance is, if the model is right, random with mean zero and
known variance. Only where it is many deviations above zero the data are learned again:

- from the mode, with the noise held down at first;
- with the levels taken off first, by the mean of each task. theta^x and sigma^2 are
  learned from what is left, with K_0^rho = I and with 1 1^T, each from the likeliest of
  several theta_0^x; K_1^rho is computed from the targets as they are, section 3.2; all
  parameters are learned from there, at first with no more noise than was found.

A mode may also have no functions at all: they have vanished beside much noise, and no
length-scale has a gradient. Then they begin again, small.
"""

from dataclasses import replace

import numpy as np

from skmtgp._data.known import noise_of
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.climbing import climb, lower, lowered_first
from skmtgp.learning.problem import best_of, spent_on
from skmtgp.learning.stages import Start, augmented_task_covariance
from skmtgp.model.task_covariance import identity, ones

ROUNDING = 1e-9  # of the trace of A over the noise


def reveal(problem, mode):
    """The better of a mode and those that explain what it may take for noise.

    Parameters
    ----------
    problem : Problem
        What to learn.
    mode : Mode
        The best so far.

    Returns
    -------
    mode : Mode
        Another one only if it gains more than a nat.
    """
    modes = [mode]
    for starts in (_hidden_starts, None, None):  # there may be several, one by one
        if not may_hide(problem, mode):
            break
        found = lower(problem, mode)
        for start in starts(problem) if starts else []:
            begin, best = start.theta(problem), best_of([mode, *found])
            found.append(start.mode.then(lowered_first(problem, begin, [best])))
        modes += found
        best = max([mode, *found], key=lambda of: of.value)
        if best.value <= mode.value + problem.tuning.doubt:
            break
        mode = best
    return spent_on(mode, modes)


def awaken(problem, mode):
    """The better of a mode that has no functions and those that begin with some.

    Much noise is held up in learning at first, and functions may vanish beside it.
    Then no length-scale matters, and none has a gradient. They begin again small, at
    several length-scales. Rough ones do not count: of several inputs they explain pure
    noise.

    Parameters
    ----------
    problem : Problem
        What to learn.
    mode : Mode
        The best so far.

    Returns
    -------
    mode : Mode
        Another one only if it gains more than functions of pure noise do.
    """
    prior, tuning = problem.prior, problem.tuning
    learned = problem.budget.max_iter and np.isfinite(mode.value)
    if not (learned and prior.n_terms == 1 and problem.is_noisy(mode)):
        return mode
    noise = np.mean(prior.values(mode.theta).noise)
    K_rho, usual = prior.K_rho_at(problem.theta()), _size(problem, problem.theta())
    if not usual or _size(problem, mode.theta) > tuning.asleep * noise:
        return mode  # usual is 0 of a kernel that is 0 at all rows
    begin = problem.theta(
        K_rho=tuning.awake * noise / usual * K_rho,
        log_noise=prior.log_noise_at(mode.theta) + np.log1p(-tuning.awake),
        log_level=prior.log_level_at(mode.theta),
    )
    scales, modes = prior.of_length_scales, [mode]
    for step in tuning.awake_at if scales.any() else (0.0,):
        theta = np.clip(np.where(scales, begin + step, begin), *prior.bounds())
        modes.append(climb(problem, theta, known=modes))
    shortest = begin[scales] + tuning.awake_beyond
    smooth = [of for of in modes[1:] if (of.theta[scales] > shortest).all()]
    best = max(smooth, key=lambda of: of.value, default=mode)
    if best.value > mode.value + tuning.awakened:
        return spent_on(best, modes)
    return mode.counting(modes[1:])


def _size(problem, theta):
    """Variance of functions, without levels: the average over tasks and rows."""
    prior = problem.prior
    of_rows = prior.kernel_at(theta).diag(problem.data.X).mean()
    return of_rows * np.diagonal(prior.K_rho_at(theta)).mean()


def may_hide(problem, mode):
    """Whether the noise of a mode looks like functions, or the rows are too few to say.

    All noise of a few rows may be functions, and they are quickly learned again.
    """
    tuning, n = problem.tuning, len(problem.data)
    told = n >= tuning.least_rows * problem.data.n_tasks
    learned = problem.budget.max_iter and np.isfinite(mode.value)
    if not (told and learned and problem.is_noisy(mode)):
        return False
    return n <= tuning.quick or any(z > tuning.hint for z in _scores(problem, mode))


def _scores(problem, mode):
    r"""Derivatives by the variance of functions that are added, over their deviations.

    With :math:`W = K^{-1}` and the covariance A of what is added, it is
    :math:`\tfrac12 (y^T W A W y - \mathrm{tr}\,WA)`, whose variance is
    :math:`\tfrac12 \mathrm{tr}\,WAWA`.
    """
    prior, data = problem.prior, problem.data
    n = min(len(data), problem.tuning.tested + prior.n_coefficients)
    rows = np.linspace(0, len(data) - 1, n)
    rows = rows.astype(int)
    X, tasks, y, known = data.some(rows)
    noise = np.broadcast_to(prior.values(mode.theta).noise, data.n_tasks)[tasks]
    noise = noise_of(known, noise)
    with limit_threads(len(rows)):
        K = prior.covariance(mode.theta, X, tasks) + np.diag(noise)
        W = prior.precision(K, X, tasks)
        alpha, of_each = W @ y, np.equal.outer(tasks, tasks)
        for kernel in _kernels(problem):
            K_x = prior.kernel.clone_with_theta(kernel)(X)
            for A in (K_x, K_x * of_each):
                WA = W @ A
                slope = 0.5 * (alpha @ A @ alpha - np.trace(WA))
                deviation = np.sqrt(0.5 * max(np.sum(WA * WA.T), 0.0))
                # of what a trend explains, such as lines, rounding alone is left
                least = ROUNDING * np.sum(np.diagonal(A) / noise)
                yield slope / max(deviation, least, 1e-150)


def _hidden_starts(problem):
    """Where step 3 begins, after I and 1 1^T; of one task these are the same."""
    M = problem.data.n_tasks
    fixed = [identity(M), ones(M)][: min(M, 2)]
    return [hidden_start(problem.with_form(form)) for form in fixed]


def hidden_start(problem):
    """Steps 1 and 2, with K_0^rho as the problem has it.

    Parameters
    ----------
    problem : Problem
        Whose tasks may have levels.

    Returns
    -------
    start : Start
        Where step 3 begins, with the noise that step 1 found.
    """
    rest = problem.with_data(_without_levels(problem.data))
    likelihood = rest.likelihood()
    variance = np.square(rest.data.y).mean()
    theta = max(_candidates(problem, variance), key=likelihood.value)
    likelihood.release()
    mode, prior = climb(rest, theta), problem.prior
    kernel, log_noise = prior.values(mode.theta).kernel, prior.log_noise_at(mode.theta)
    # the rest has no levels: where they are in the model, they begin anew
    mode = mode._replace(theta=problem.theta(kernel=kernel, log_noise=log_noise))
    posterior = problem.likelihood().posterior(mode.theta)
    K_rho = augmented_task_covariance(problem.data, posterior)
    return Start(kernel, K_rho, mode, log_noise)


def _without_levels(data):
    """The targets, each off the mean of its task."""
    n = np.maximum(np.bincount(data.tasks, minlength=data.n_tasks), 1)
    level = np.bincount(data.tasks, data.y, data.n_tasks) / n
    return replace(data, y=data.y - level[data.tasks])


def _candidates(problem, variance):
    """Where step 1 may begin."""
    prior, part = problem.prior, problem.tuning.noise_of_rest
    smallest = np.exp(prior.log_noise_bounds[0])
    noises = np.log(np.maximum(np.multiply(part, variance), smallest))
    noises = np.minimum(noises, prior.log_noise_bounds[1])
    return [
        prior.theta(kernel=kernel, log_noise=noise)
        for kernel in _kernels(problem)
        for noise in noises
    ]


def _kernels(problem):
    """Theta of k^x of faster and slower functions, of all features or of one."""
    kernel, tuning = problem.prior.kernel, problem.tuning
    start, bounds = kernel.theta, kernel.bounds.reshape(-1, 2).T
    kernels = [start, *(start + step for step in (*tuning.faster, tuning.slower))]
    if len(start) > 1:
        for step in tuning.faster:
            alone = np.eye(len(start), dtype=bool)
            kernels += list(np.where(alone, start + step, start + tuning.unused))
    return [np.clip(kernel, *bounds) for kernel in kernels]
