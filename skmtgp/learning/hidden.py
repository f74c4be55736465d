r"""Starts for functions that the levels of the tasks hide.

Where levels differ by far more than the functions vary around them, the functions look
like noise from most starts, and climbs end where they are taken for it. Here the levels
are taken off first, by the mean of each task:

1. theta^x and sigma^2 are learned from what is left, with K_0^rho = I and with 1 1^T,
   each from the likeliest of several theta_0^x.
2. K_1^rho is computed from the targets as they are, section 3.2.
3. All parameters are learned from there, at first with no more noise than step 1 found.

Steps 1 and 2 do not depend on the rank.
"""

from dataclasses import replace

import numpy as np

from skmtgp.learning.climbing import DOUBT, climb, held_first, shake
from skmtgp.learning.problem import best_of, spent_on
from skmtgp.learning.stages import Start, augmented_task_covariance

FEWEST = 3  # rows of each task, on average
NOISES = 1e-1, 1e-2  # in variances of what is left
FASTER = -1.5, -3.0  # steps of log parameters: a length-scale a fifth, a twentieth
SLOWER = 2.0  # of all of them
UNUSED = 3.0  # of those of all features but one


def may_hide(data, settings, modes):
    """Whether levels may hide functions: from modes of step 1 without these starts."""
    told = len(data.y) >= FEWEST * data.n_tasks and settings.max_iter > 0
    return told and all(settings.is_noisy(mode) for mode in modes)


def hidden_start(data, settings, form):
    """Steps 1 and 2, with K_0^rho of the given form.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Kernel, bounds and budget.
    form : FixedTaskCovariance
        Form of K_0^rho.

    Returns
    -------
    start : Start
        Where step 3 begins, with the noise that step 1 found.
    """
    rest = _without_levels(data)
    likelihood = settings.likelihood(rest, form)
    theta = max(_candidates(settings, np.square(rest.y).mean()), key=likelihood.value)
    likelihood.release()
    mode = climb(rest, settings, form, theta)
    kernel, _, log_noise = settings.split(mode.theta)
    K_rho = augmented_task_covariance(
        data, settings.likelihood(data, form).posterior(mode.theta)
    )
    return Start(kernel, K_rho, mode, log_noise)


def _without_levels(data):
    """The targets, each off the mean of its task."""
    n = np.maximum(np.bincount(data.tasks, minlength=data.n_tasks), 1)
    level = np.bincount(data.tasks, data.y, data.n_tasks) / n
    return replace(data, y=data.y - level[data.tasks])


def _candidates(settings, variance):
    """Where step 1 may begin: faster and slower functions, of all or of one feature."""
    start, bounds = settings.kernel.theta, settings.kernel.bounds.reshape(-1, 2).T
    kernels = [start, *(start + step for step in (*FASTER, SLOWER))]
    if len(start) > 1:
        for step in FASTER:
            alone = np.eye(len(start), dtype=bool)
            kernels += list(np.where(alone, start + step, start + UNUSED))
    smallest = np.exp(settings.log_noise_bounds[0])
    noises = np.log(np.maximum(np.multiply(NOISES, variance), smallest))
    noises = np.minimum(noises, settings.log_noise_bounds[1])
    n_noise = len(settings.log_noise)
    return [
        np.concatenate([np.clip(kernel, *bounds), np.full(n_noise, noise)])
        for kernel in kernels
        for noise in noises
    ]


def reveal(data, settings, form, mode, starts):
    """The better of a mode and those to which hidden starts lead.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Kernel, bounds and budget.
    form : LowRank or WithDiagonal
        Form of K^rho.
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
    found = best_of([_step_3(data, settings, form, start) for start in starts])
    gains = found.value > mode.value + DOUBT
    if gains:
        found = shake(data, settings, form, found, 1)
    return spent_on(found if gains else mode, [mode, found])


def _step_3(data, settings, form, start):
    theta = start.theta(settings, form)
    return held_first("down", data, settings, form, theta)
