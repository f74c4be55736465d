"""The candidates of a search over the ranks of several terms."""

from copy import copy
from numbers import Integral

import numpy as np

from skmtgp._estimators.posing import pose
from skmtgp._estimators.terms import OF_TERMS
from skmtgp.learning.summarised import exact_part, learn_bounds
from skmtgp.learning.terms import nest_terms
from skmtgp.model.task_covariance import low_rank


def ranks_to_compare(ranks, n_terms, n_tasks):
    """The ranks of the terms of each candidate, simple ones first.

    Parameters
    ----------
    ranks : sequence of int or of sequences of int
        As the user gave them. A shorter sequence is of the first terms alone, a number
        is that of each term.
    n_terms, n_tasks : int
        How many there are.

    Returns
    -------
    ranks : list of tuple of int
        Not above the number of tasks, each once.

    Raises
    ------
    ValueError
        If one of them cannot be.
    """
    found = set()
    for of_terms in ranks:
        listed = [of_terms] * n_terms if isinstance(of_terms, Integral) else of_terms
        listed = tuple(listed)
        if not (0 < len(listed) <= n_terms and all(map(_is_rank, listed))):
            raise ValueError(
                f"ranks={ranks!r} has the candidate {of_terms!r}. A candidate must be "
                f"a tuple with a rank of 0 or more for each of the {n_terms} kernels, "
                f"or for the first of them, such as {(1,) * n_terms}."
            )
        found.add(tuple(min(int(rank), n_tasks) for rank in listed))
    if not found:
        raise ValueError(f"ranks={ranks!r} has no candidate. Give one or more.")
    return sorted(found, key=lambda of: (len(of), sum(of), of))


def _is_rank(value):
    return isinstance(value, Integral) and not isinstance(value, bool) and value >= 0


def usual_ranks(n_terms, n_tasks, n, *, most, rows):
    """The same where nobody gave any: equal ranks of one term, of two, and so on.

    Parameters
    ----------
    n_terms, n_tasks, n : int
        Terms, tasks and samples.
    most : int
        The highest sum of the ranks.
    rows : int
        Samples for each number of the task covariances.

    Returns
    -------
    ranks : list of tuple of int
    """
    return [
        (rank,) * q
        for q in range(1, n_terms + 1)
        for rank in range(1, min(n_tasks, max(1, most // q)) + 1)
        if rank == 1 or rows * q * low_rank(n_tasks, rank).n_free <= n
    ]


def settings_of_terms(model, ranks):
    """Parameters of the model with some of its terms, of given ranks.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        With a list of kernels.
    ranks : tuple of int
        Of the first terms. Rank 0 is one function of all tasks, unless the term has a
        diagonal "equal".

    Returns
    -------
    settings : dict
    """
    terms = model._terms()[: len(ranks)]
    shared = [
        bool(term.shared) or (rank == 0 and not isinstance(term.diagonal, str))
        for term, rank in zip(terms, ranks, strict=True)
    ]
    values = list(ranks), shared, [term.diagonal for term in terms]
    kernels = [term.kernel for term in terms]
    return {"kernel": kernels, **dict(zip(OF_TERMS, values, strict=True))}


def learn_candidates(model, settings, progress, training):
    """Learn all candidates; those that are part of another are no better than it.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        Whose other parameters count.
    settings : list of dict
        Parameters of each candidate, simple ones first.
    progress : callable
        See :func:`skmtgp._support.progress.fitting`.
    training : Training
        With units and noise.

    Returns
    -------
    problems : list of list of Problem
        For each candidate and output.
    modes : list of list of Mode
        The same.
    """
    found = [
        _learned(copy(model).set_params(**of_candidate), training, progress)
        for of_candidate in settings
    ]
    problems, parts, modes = (
        list(map(list, zip(*of, strict=True))) for of in zip(*found, strict=True)
    )
    modes = list(map(nest_terms, parts, modes))
    running = {"nest": nest_terms, "n_jobs": model.n_jobs, "progress": progress}
    modes = learn_bounds(problems, modes, **running)
    return [list(zip(*of, strict=True)) for of in (problems, modes)]


def _learned(candidate, training, progress):
    """Of each output the problem, its exact part, and what that tells."""
    problems = pose(candidate, training)
    [form] = candidate._forms(problems[0])
    problems = [problem.with_form(form) for problem in problems]
    parts = exact_part(problems, [form])
    [modes] = candidate._learn_ranks(parts, [form], progress)
    return problems, parts, list(modes)


def rank_column(ranks):
    """The column of ranks in a table: numbers, or tuples of those of the terms."""
    if not any(isinstance(rank, list | tuple) for rank in ranks):
        return np.asarray(ranks)
    column = np.empty(len(ranks), dtype=object)
    for k, rank in enumerate(ranks):
        column[k] = tuple(rank) if isinstance(rank, list | tuple) else (rank,)
    return column
