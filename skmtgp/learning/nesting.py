"""Modes of models that are part of each other: a rank's is one of the next rank too.

Where a rank ends below a lower one, it is learned again from that mode, with columns
added; where a higher rank has found more, its mode is cut to the lower rank and learned
on. A rank that is learned alone may take the next one along for that.
"""

import numpy as np

from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.learning.climbing import annealed, climb
from skmtgp.learning.problem import best_of

OWN = 0.3  # of the variance of tasks, where functions of their own begin


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
            # climbs without noise creep and sometimes leap: nothing ends those
            known = [modes[k]] if problem.is_noisy(modes[k]) else []
            start = problem.with_noise(_cut(problem.prior, problems[k + 1], higher))
            again = climb(problem, start, known=known)
            modes[k] = best_of([modes[k], higher.led_to(again)])
    return modes


def detour(problem, start, mode):
    """Learn the next rank from a start, and this one from its mode, cut.

    With one more column there are ways around poor modes of data without noise.

    Parameters
    ----------
    problem : Problem
        What to learn.
    start : Start
        The likeliest one.
    mode : Mode
        What it, and others, have led to.

    Returns
    -------
    mode : Mode
        Not worse. The same where the data are noisy, or where there is no next rank.
    """
    form, doubt = problem.prior.task_covariance, problem.tuning.doubt
    if problem.is_noisy(mode) or form.rank == form.factor_shape[0]:
        return mode
    higher = problem.with_form(form.with_rank(form.rank + 1))
    above = annealed(higher, start.theta(higher)).mode
    if above.value < mode.value + doubt:
        return mode.counting([above])
    cut = problem.with_noise(_cut(problem.prior, higher, above))
    return best_of([mode, above.led_to(climb(problem, cut))], doubt=doubt)


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
        lower, pair = modes[k - 1], problems[k - 1 : k + 1]
        if modes[k].value < lower.value and _is_part(*pair):
            modes[k] = best_of([modes[k], *_grown(*pair, lower)])
    return modes


def grow(lower, higher, mode):
    """The mode of a rank, learned from a lower one's alone.

    Parameters
    ----------
    lower, higher : Problem
        Of the same data, with forms of K^rho of which the first is part of the second.
    mode : Mode
        Of the first.

    Returns
    -------
    mode : Mode
        Not worse.
    """
    return best_of(_grown(lower, higher, mode))


def _grown(lower, higher, mode):
    """What a mode leads to with columns added, and the same mode with empty ones."""
    start = with_columns(lower, higher, mode)
    return [mode.led_to(climb(higher, start)), embedded(lower, higher, mode)]


def _is_part(lower, higher):
    """Whether all that a model of a rank can be the next one can be, too.

    Ranks ascend; but what tasks have of their own, one has and another has not.
    """
    if max(lower.prior.n_terms, higher.prior.n_terms) > 1:
        return False  # see `learning.terms`
    pair = lower.prior.task_covariance, higher.prior.task_covariance
    return pair[0].n_own <= pair[1].n_own


def has_columns_more(lower, higher):
    """Whether a model is another one with more columns, and nothing else."""
    form, other = lower.prior.task_covariance, higher.prior.task_covariance
    return (form.shared, form.n_own) == (other.shared, other.n_own)


def _has_diagonal_more(lower, higher):
    """Whether a model is another one with a diagonal, and nothing else."""
    form, other = lower.prior.task_covariance, higher.prior.task_covariance
    same = (form.shared, form.rank) == (other.shared, other.rank)
    return same and other.n_own > form.n_own == 0


def embedded(lower, higher, mode):
    """A mode as one of a higher rank, with empty columns.

    Parameters
    ----------
    lower, higher : Problem
        Of the same data, with forms of K^rho of which the first is part of the second.
    mode : Mode
        Of the first.

    Returns
    -------
    mode : Mode
        Of the second, for which nothing was spent.
    """
    theta = _with_more(lower, higher, mode, 0.0)
    same = mode._replace(theta=theta, n_evaluations=0, seconds=0.0, rivals=())
    if has_columns_more(lower, higher):
        return same
    return same._replace(value=higher.likelihood().value(theta))


def with_columns(lower, higher, mode):
    """Where a climb of a larger model begins, from a mode.

    The best new columns are along the leading eigenvectors of dL / dK^rho; their
    length is the best of a few.

    Parameters
    ----------
    lower, higher, mode
        See :func:`embedded`.

    Returns
    -------
    theta : ndarray of shape (n_theta,)
        Parameters of the higher rank.
    """
    if _has_diagonal_more(lower, higher):
        return _with_diagonal(lower, higher, mode)
    if not has_columns_more(lower, higher):  # as where 1 1^T is of rank 1
        return _with_more(lower, higher, mode, 0.0)
    try:
        D = lower.likelihood().task_gradient(mode.theta)
    except NotPositiveDefiniteError:  # a climb that failed from its start
        return _with_more(lower, higher, mode, 0.0)
    vectors = lower.prior.task_covariance.directions(D)
    size = np.sqrt(np.trace(lower.prior.K_rho_at(mode.theta)))
    candidates = [
        _with_more(lower, higher, mode, size * 10.0**-k * vectors) for k in range(1, 9)
    ]
    return max(candidates, key=higher.likelihood().value)


def _with_diagonal(lower, higher, mode):
    """The same, where functions of the tasks' own are all that the second has more.

    Their variance is large: from one that hardly matters a climb would see no gradient.
    """
    rho, form = lower.prior.values(mode.theta).rho, higher.prior.task_covariance
    kappa = OWN * np.trace(lower.prior.K_rho_at(mode.theta)) / form.n_tasks
    own = np.full(form.n_own, np.log(kappa))
    return higher.prior.with_rho(mode.theta, np.append(rho, own))


def _with_more(lower, higher, mode, vectors):
    """Theta of a higher rank, with the last of some columns added."""
    form, other = lower.prior.task_covariance, higher.prior.task_covariance
    if not has_columns_more(lower, higher):
        K_rho = lower.prior.K_rho_at(mode.theta)
        return higher.prior.with_rho(mode.theta, other.parameters(K_rho))
    columns = np.broadcast_to(vectors, (form.n_tasks, form.factor_shape[0]))
    columns = columns[:, form.factor_shape[0] - (other.rank - form.rank) :]
    rho = form.grown(lower.prior.values(mode.theta).rho, columns)
    return higher.prior.with_rho(mode.theta, rho)
