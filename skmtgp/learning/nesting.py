"""Modes of models that are part of each other: a rank's is one of the next rank too.

Where a rank ends below a lower one, it is learned again from that mode, with columns
added; where a higher rank has found more, its mode is cut to the lower rank and learned
on.
"""

import numpy as np

from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.climbing import climb
from skmtgp.learning.problem import best_of


def descend(problems, modes):
    """Learn each rank again from the next higher one's mode, cut to its rank.

    Parameters
    ----------
    problems : list of Problem
        With forms of K^rho of ascending rank.
    modes : list of Mode
        The mode of each.

    Returns
    -------
    modes : list of Mode
        None is worse than before.
    """
    modes = list(modes)
    for k in reversed(range(len(problems) - 1)):
        higher, problem = modes[k + 1], problems[k]
        if modes[k].value + problem.budget.tol < higher.value:
            start = problem.with_noise(_cut(problem.prior, problems[k + 1], higher))
            again = climb(problem, start)
            modes[k] = best_of([modes[k], higher.led_to(again)])
    return modes


def _cut(prior, higher, mode):
    """Theta of a prior of a lower rank, nearest to a mode of a higher one."""
    K_rho = higher.prior.K_rho_at(mode.theta)
    return prior.with_rho(mode.theta, prior.task_covariance.parameters(K_rho))


def nest(problems, modes):
    """Learn a rank again from a lower one's mode where it ended below it.

    Parameters are those of :func:`descend`. The values of the modes that it returns do
    not fall as the rank grows.
    """
    modes = list(modes)
    for k in range(1, len(problems)):
        lower = modes[k - 1]
        if modes[k].value < lower.value:
            embedded, grown = _embed(*problems[k - 1 : k + 1], lower)
            regrown = lower.led_to(climb(problems[k], grown))
            same = lower._replace(theta=embedded, rivals=())
            same = same._replace(n_evaluations=0, seconds=0.0)
            modes[k] = best_of([modes[k], regrown, same])
    return modes


def _embed(lower, higher, mode):
    """A mode as one of the next rank: with empty columns, and with better ones.

    The best new columns are along the leading eigenvectors of dL / dK^rho; their
    length is the best of a few.
    """
    form, prior = lower.prior.task_covariance, higher.prior
    if form.shared != prior.task_covariance.shared:  # 1 1^T is of rank 1
        K_rho = lower.prior.K_rho_at(mode.theta)
        same = prior.with_rho(mode.theta, prior.task_covariance.parameters(K_rho))
        return same, same
    D = lower.likelihood().task_gradient(mode.theta)
    added = prior.task_covariance.rank - form.rank
    with limit_threads(len(D)):
        columns = np.linalg.eigh(D)[1][:, -added:]
    rho = lower.prior.values(mode.theta).rho
    size = np.sqrt(np.trace(form.matrix(rho)))

    def with_columns(length):
        return prior.with_rho(mode.theta, form.grown(rho, length * columns))

    likelihood = higher.likelihood()
    candidates = [with_columns(size * 10.0**-k) for k in range(1, 9)]
    return with_columns(0.0), max(candidates, key=likelihood.value)
