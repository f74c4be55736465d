"""Whether a model of each task by itself is likelier than one of all tasks."""

from dataclasses import replace

import numpy as np

from skmtgp._data.complete import count_copies
from skmtgp._data.data import Data
from skmtgp._numerics.linalg import RESOLVED, correlation
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.engines import Dense
from skmtgp.learning.climbing import climb
from skmtgp.model.task_covariance import LowRank

MOST_TASKS, MOST_ROWS = 12, 2000  # that are asked: of more it would take long
TOLD = 2  # rows of each task for each of its hyperparameters, to learn it by itself
CLOSE = 0.9  # correlation from which tasks are surely related


def gain_of_separate_models(problem, mode):
    """Nats of BIC that models of each task by itself gain.

    They have the same kind of k^x, with hyperparameters of each task, and its mean.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.

    Returns
    -------
    gain : float
        Minus infinity where it is not asked: the tasks are surely related, or many, or
        their rows are too few or too many, or one of them is constant. Also where rows
        of a task repeat others with their targets, and noise of the task alone
        vanishes. With few values of y that is by chance, and the likelihood is as high
        as the least noise lets it be.
    """
    if not (_can_be_asked(problem) and _may_be_unrelated(problem.prior, mode.theta)):
        return -np.inf
    data, prior = problem.data, problem.prior
    gain = 0.5 * prior.n_hyperparameters * np.log(len(data))
    gain -= problem.log_likelihood(mode)
    owns = [data.tasks == task for task in range(data.n_tasks)]
    if min(np.ptp(data.y[own]) for own in owns) <= RESOLVED * np.abs(data.y).max():
        return -np.inf  # a constant alone is certain
    for own in owns:
        of_task, found = _learned(problem, own)
        if not of_task.is_noisy(found) and _has_copies(of_task.data):
            return -np.inf
        n_parameters = of_task.prior.n_hyperparameters + 1  # the mean
        gain += of_task.log_likelihood(found)
        gain -= 0.5 * n_parameters * np.log(len(of_task.data))
    return float(gain)


def _has_copies(data):
    """Whether rows repeat others, with their targets, so that noise may vanish."""
    return count_copies(data.X, data.tasks, data.y[:, None]) > 0


def _can_be_asked(problem):
    data, prior = problem.data, problem.prior
    if not problem.engine.exact or len(data) > MOST_ROWS or data.Q is not None:
        return False
    if prior.n_terms > 1 or prior.noise_is_fixed or prior.trend or data.known:
        return False
    if not prior.task_covariance.n_parameters:  # relations are not learned
        return False
    counts = np.bincount(data.tasks, minlength=data.n_tasks)
    least = TOLD * (prior.kernel.n_dims + 3)  # an amplitude, the mean, and noise
    return 1 < data.n_tasks <= MOST_TASKS and counts.min() >= least


def _may_be_unrelated(prior, theta):
    """Whether no task is closely related to another."""
    among = correlation(prior.K_rho_at(theta)) - np.eye(prior.n_tasks)
    return np.abs(among).max() < CLOSE


def _learned(problem, own):
    """The problem of some rows as one task, and its mode."""
    y, X = problem.data.y[own], problem.data.X[own]
    data = Data(X, np.zeros(len(y), dtype=int), y - y.mean(), 1)
    of_all = problem.prior
    unit = 2.0 * np.log((data.deviation or 1.0) / (problem.data.deviation or 1.0))
    prior = replace(
        of_all,
        task_covariance=LowRank(1, 1),
        n_noise=1,
        levels=False,
        scale=data.size or 1.0,
        within=np.inf,
        log_noise=of_all.log_noise + unit,
        log_noise_bounds=tuple(np.add(of_all.log_noise_bounds, unit)),
    )
    alone = replace(
        problem,
        data=data,
        prior=prior,
        engine=Dense(),
        budget=replace(problem.budget, verbose=0),
        log_little=problem.log_little + unit,
    ).quickly()
    theta = alone.theta(K_rho=np.full((1, 1), prior.scale**2))
    with limit_threads(len(y)):
        return alone, climb(alone, theta)
