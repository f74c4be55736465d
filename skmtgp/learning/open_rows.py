r"""Rows of F that the data leave open, and where that widens intervals.

At the mode F counts as known. But a few samples, or samples in a corner of the inputs,
say little of how their task is related to the others, from which predictions elsewhere
follow. Given the others a task is :math:`f(x) = l^T g(x)`, and a row l of which a
covariance C is open adds about :math:`g(x)^T C g(x)` to the variance of f. Where that
is much beside the variance that is known, it counts, see
:class:`~skmtgp.inference.leeway.OfRow`.
"""

from dataclasses import replace

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.engines import Dense
from skmtgp.learning.novel import leeway_of, posed_again, shares_of, with_columns
from skmtgp.learning.settling import LEAST, has_rows


def with_open_rows(problem, mode, posterior):
    """The mode with what is open of rows of F, of those tasks where it matters.

    Parameters
    ----------
    problem : Problem
        What was learned.
    mode : Mode
        What was found. Tasks whose row is known to be open stay as they are.
    posterior : Posterior
        At this mode.

    Returns
    -------
    mode : Mode
        The same but for its leeway.
    """
    if not _are_asked(problem):
        return mode
    data, tuning, found = problem.data, problem.tuning, []
    noise = np.broadcast_to(problem.prior.values(mode.theta).noise, data.n_tasks)
    X = _sampled(data.X, tuning.open_inputs)
    settled = {of.task for of in mode.leeway}
    with limit_threads(len(data)):
        for task in set(data.tasks) - settled:
            leeway, g = open_row(problem, mode.theta, task, X)
            share = _share(posterior, noise[task], leeway, g, X)
            if share > tuning.open_share:
                found.append((share, *leeway))
    found = [of for _, of in sorted(found, key=lambda of: -of[0])]
    # each end of an axis takes a posterior
    work = np.cumsum([2.0 * len(of.axes[0]) for of in found]) * len(data) ** 3
    n_affordable = np.count_nonzero(work < tuning.open_work)
    return mode._replace(leeway=mode.leeway + tuple(found[:n_affordable]))


def _are_asked(problem):
    """Whether rows of F were learned exactly, from rows that are not too many."""
    data, prior = problem.data, problem.prior
    learned = problem.budget.max_iter and problem.engine.exact and has_rows(prior)
    if not learned or is_dask(data.X) or len(set(data.tasks)) <= LEAST:
        return False
    return data.n_tasks * len(data) ** 3 < problem.tuning.open_work


def _sampled(X, n):
    """Some of the inputs of all tasks, the same in any order of the rows."""
    X = np.unique(X, axis=0)
    return X[np.linspace(0, len(X) - 1, min(n, len(X))).astype(int)]


def _share(posterior, noise, leeway, g, X):
    """Mean of what is open of a row over the variance that is known, at X."""
    if not leeway:
        return 0.0
    [of] = leeway
    known = posterior.variance(X, np.full(len(X), of.task)) + noise
    return np.mean(np.square(np.hstack(of.axes) @ g).sum(axis=0) / known)


def open_row(problem, theta, task, X):
    """What is open of a task's row of F, given all else at a mode.

    Parameters
    ----------
    problem : Problem
        What was learned.
    theta : ndarray of shape (n_theta,)
        Its parameters.
    task : int
        Position of the task, which has rows.
    X : ndarray of shape (n_samples, n_features)
        Where the latent functions are asked for.

    Returns
    -------
    leeway : tuple of OfRow
        One, or none, see :func:`~skmtgp.learning.novel.leeway_of`.
    g : ndarray of shape (rank, n_samples)
        Latent functions at X, as the other tasks tell them.
    """
    prior, data = problem.prior, problem.data
    others = np.arange(data.n_tasks) != task
    of_others = replace(problem, data=data.of_tasks(others), engine=Dense())
    posterior = of_others.likelihood().posterior(theta)
    of_task, _, y, known = data.some(np.flatnonzero(~others[data.tasks]))
    posed, alone = posed_again(prior, posterior, theta, of_task, y, task, known)
    rows, own, latent = [], [], []
    for q, (F, of_own) in enumerate(
        zip(shares_of(prior, theta)[0], alone, strict=True)
    ):
        rows.append(F[task, ~of_own])
        own.append(_own(prior, theta, q, task, F[task, of_own]))
        term = {"term": q} if len(alone) > 1 else {}
        latent.append(posterior.latent(X, F, **term)[0])
    leeway = leeway_of(posed, np.concatenate(rows + own), task)
    return with_columns(leeway, alone), np.concatenate(latent)


def _own(prior, theta, q, task, column):
    """What a task has of its own in a term: of a diagonal, or of a column, or none."""
    form, (_, rho) = prior.terms[q][1], prior.theta_of_terms(theta)[q]
    if form.n_own > 1:
        return [np.exp(0.5 * rho[len(rho) - form.n_own + task])]
    return column
