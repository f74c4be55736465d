"""Forms of K^rho: those that a user asks for, and those to choose from."""

import numpy as np

from skmtgp.model.described import task_covariance
from skmtgp.model.task_covariance import low_rank

# Rows for each number of K^rho, of a rank that nobody asked for. Two functions are
# worth a look with fewer, if the evidence chooses, and if they are not so many numbers
# that it cannot be had with those of k^x. Three explain few rows without any noise, and
# so does one where most tasks have a single row.
ROWS, ROWS_OF_TWO, MOST_OF_TWO, ROWS_OF_ONE = 4, 3, 250, 2
MOST_RANK = 6  # of a ladder: the work grows with its square, and BIC seldom takes more
# Independent tasks and compound symmetry, as parameters of MultiTaskGPRegressor.
SIMPLER = tuple(
    {"rank": 0, "shared": shared, "diagonal": "equal"} for shared in (False, True)
)


def form_of(term, data, rank):
    """The form of K^rho of a term, at a rank.

    Parameters
    ----------
    term : Term
        What the user asks for.
    data : Data
        Observations.
    rank : int
        Rank. 0 is one function of all tasks, unless the user asked for independent
        tasks.

    Returns
    -------
    form : LowRank, WithShared, WithDiagonal or Described
    """
    # as the user asked for: what tasks have of their own, of the same variance for all
    alone = term.rank == 0 and isinstance(term.diagonal, str)
    shared = bool(term.shared) or (rank == 0 and not alone)
    options = {"diagonal": term.diagonal, "shared": shared}
    return task_covariance(data.n_tasks, rank, data.Q, **options)


def rows_for(n_tasks, rank, *, compared=True):
    """Rows that tell a rank of K^rho that nobody asked for: with fewer it is not tried.

    Parameters
    ----------
    n_tasks : int
        Tasks.
    rank : int
        Rank.
    compared : bool, default=True
        Whether it is compared with lower ones by the evidence.

    Returns
    -------
    rows : int
    """
    n_free = low_rank(n_tasks, rank).n_free if rank else 0
    if rank == 1:
        return ROWS_OF_ONE * n_free
    few = compared and rank == 2 and n_free <= MOST_OF_TWO
    return (ROWS_OF_TWO if few else ROWS) * n_free


def usual_ladder(n_tasks, n, *, compared=False):
    """Ranks to compare one after another: from none up, as far as n rows may tell.

    Parameters
    ----------
    n_tasks, n : int
        Tasks and samples.
    compared : bool, default=False
        See `rows_for`.

    Returns
    -------
    ranks : list of int
    """
    ranks = range(min(n_tasks, MOST_RANK) + 1)
    return [r for r in ranks if rows_for(n_tasks, r, compared=compared) <= n]


def candidates(term, data, highest):
    """Forms to choose from, where the user gave no rank.

    Parameters
    ----------
    term, data
        See `form_of`.
    highest : int
        Rank.

    Returns
    -------
    forms : list of LowRank, WithShared or WithDiagonal
        Those that are not part of the next one first, then ascending ranks.
    """
    ladder = [form_of(term, data, rank) for rank in range(highest + 1)]
    diagonal = {"diagonal": term.diagonal}
    simpler = [{"shared": False} | diagonal] if term.diagonal else SIMPLER
    names = {str(form) for form in ladder}
    forms = [
        task_covariance(data.n_tasks, **{"rank": 0} | of)
        for of in simpler
        if of["shared"] or not term.shared
    ]
    return [*(form for form in forms if str(form) not in names), *ladder]


def diagonal_of(form):
    """Which diagonal a form of K^rho has, as the user's parameter."""
    return "equal" if getattr(form, "equal", False) else bool(getattr(form, "n_own", 0))


def lower_rank(model):
    """A rank below the learned one, in words to the user; none where there is none."""
    rank = np.max(getattr(model, "rank_", 0))  # of several terms, the highest
    if rank > 1:
        return "a lower rank"
    return "rank=0 with shared=True" if rank else ""
