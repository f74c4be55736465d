r"""Starts for functions that the levels of the tasks hide.

Where levels differ by far more than the functions vary around them, the functions look
like noise from most starts, and climbs end where they are taken for it, even if levels
are in the model. Here they are taken off first, by the mean of each task:

1. theta^x and sigma^2 are learned from what is left, with K_0^rho = I and with 1 1^T,
   each from the likeliest of several theta_0^x.
2. K_1^rho is computed from the targets as they are, section 3.2.
3. All parameters are learned from there, at first with no more noise than step 1 found.

Steps 1 and 2 do not depend on the rank.
"""

from dataclasses import replace

import numpy as np

from skmtgp.learning.climbing import climb, held_first, shake
from skmtgp.learning.problem import best_of, spent_on
from skmtgp.learning.stages import Start, augmented_task_covariance

FEWEST = 3  # rows of each task, on average
NOISES = 1e-1, 1e-2  # in variances of what is left
FASTER = -1.5, -3.0  # steps of log parameters: a length-scale a fifth, a twentieth
SLOWER = 2.0  # of all of them
UNUSED = 3.0  # of those of all features but one


def may_hide(problem, modes):
    """Whether levels may hide functions: from modes of step 1 without these starts."""
    if problem.budget.max_iter == 0:
        return False
    told = len(problem.data) >= FEWEST * problem.data.n_tasks
    return told and all(problem.is_noisy(mode) for mode in modes)


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
    theta = max(_candidates(problem.prior, variance), key=likelihood.value)
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


def _candidates(prior, variance):
    """Where step 1 may begin: faster and slower functions, of all or of one feature."""
    start, bounds = prior.kernel.theta, prior.kernel.bounds.reshape(-1, 2).T
    kernels = [start, *(start + step for step in (*FASTER, SLOWER))]
    if len(start) > 1:
        for step in FASTER:
            alone = np.eye(len(start), dtype=bool)
            kernels += list(np.where(alone, start + step, start + UNUSED))
    smallest = np.exp(prior.log_noise_bounds[0])
    noises = np.log(np.maximum(np.multiply(NOISES, variance), smallest))
    noises = np.minimum(noises, prior.log_noise_bounds[1])
    return [
        prior.theta(kernel=np.clip(kernel, *bounds), log_noise=noise)
        for kernel in kernels
        for noise in noises
    ]


def reveal(problem, mode, starts):
    """The better of a mode and those to which hidden starts lead.

    Parameters
    ----------
    problem : Problem
        What to learn.
    mode : Mode
        The best from other starts.
    starts : list of Start
        Hidden ones, or none.

    Returns
    -------
    mode : Mode
        Another one only if it gains more than a nat.
    """
    if not starts:
        return mode
    found = best_of([_step_3(problem, start) for start in starts])
    gains = found.value > mode.value + problem.tuning.doubt
    if gains:
        found = shake(problem, found, 1)
    return spent_on(found if gains else mode, [mode, found])


def _step_3(problem, start):
    return held_first("down", problem, start.theta(problem))
