"""Complete data: every task observed at the same inputs, once each, or nearly so.

A cell is an input of a task.
"""

import numpy as np
import pandas as pd
from sklearn.utils import gen_batches

from skmtgp._support.guide import INFERENCE

BLOCK = 2**14  # rows that are looked at together
FEW = 0.25  # of the cells that are missing or repeated, for it to be worth saying
# Of the cells that may be missing for Kronecker products to be faster than the Cholesky
# decomposition of the others, from three tasks on
SHARE = 0.1


def complete_design(features, codes):
    """Where each task is observed at each input, if all are at all, once each.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Inputs, in any order.
    codes : ndarray of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1.

    Returns
    -------
    rows : ndarray of shape (n_inputs, n_tasks), or None
        The row of each distinct input and task; None if the data are not complete.
    """
    rows = _cells(features, codes)
    if rows is None:
        return None
    ascending = np.lexsort(features[rows[:, 0]].T[::-1])
    return rows[ascending]


def design_of(features, codes):
    """Where each task is observed at each input, if they are at most of them.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Inputs, in any order.
    codes : ndarray of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1.

    Returns
    -------
    rows : ndarray of shape (n_inputs, n_tasks), or None
        The row of each distinct input and task, -1 where it is missing; None if a cell
        has several rows, or half of the cells are missing.
    """
    rows = complete_design(features, codes)
    return _incomplete_design(features, codes) if rows is None else rows


def count_missing(design):
    """Cells without a row."""
    return 0 if design is None else int((design < 0).sum())


def few_missing(design):
    """Whether no cell has several rows, and so few have none that it costs little."""
    return design is not None and count_missing(design) <= SHARE * design.size


def _incomplete_design(features, codes):
    n_tasks, n = codes.max() + 1, len(codes)
    if 2 * n <= len(np.unique(features[:, 0])) * n_tasks:  # most often, and quickly
        return None
    _, first, which = np.unique(
        row_keys(features), return_index=True, return_inverse=True
    )
    if 2 * n <= len(first) * n_tasks:
        return None
    rows = np.full((len(first), n_tasks), -1)
    rows[which, codes] = np.arange(n)
    if (rows >= 0).sum() < n or not _all_equal(features, first[which]):
        return None
    return rows[np.lexsort(features[first].T[::-1])]


def _all_equal(features, others):
    """Whether each row is the same as another one."""
    return all(
        np.array_equal(features[batch], features[others[batch]])
        for batch in gen_batches(len(features), BLOCK)
    )


def _cells(features, codes):
    """The rows of `complete_design`, of inputs in no order."""
    n_tasks = codes.max() + 1
    n_inputs, rest = divmod(len(codes), n_tasks)
    if rest or (np.bincount(codes) != n_inputs).any():
        return None
    if len(np.unique(features[:, 0])) > n_inputs:  # most often, and quickly
        return None
    keys = row_keys(features)
    rows = np.lexsort((codes, keys)).reshape(n_inputs, n_tasks)
    first = keys[rows[:, 0]]
    if (first[1:] == first[:-1]).any() or (codes[rows] != np.arange(n_tasks)).any():
        return None
    size = max(1, BLOCK // n_tasks)
    equal = (
        (features[some] == features[some[:, :1]]).all()
        for some in (rows[batch] for batch in gen_batches(n_inputs, size))
    )
    return rows if all(equal) else None


def row_keys(features):
    """A number for each row, the same for equal rows, and others for others.

    Two of n rows that differ have the same one with a probability of n^2 / 2^65.
    """
    keys = np.empty(len(features), dtype=np.uint64)
    for rows in gen_batches(len(features), BLOCK):
        block = pd.DataFrame(features[rows] + 0.0)  # zero has no sign
        keys[rows] = pd.util.hash_pandas_object(block, index=False)
    return keys


def count_places(features, codes):
    """How many rows differ in their inputs or tasks."""
    return len(np.unique(row_keys(np.column_stack([features, codes]))))


def count_copies(features, codes, Y):
    """How many rows repeat another one; 0 if equal inputs have different targets.

    Targets that have few values may be equal by chance.
    """
    n_inputs = count_places(features, codes)
    if n_inputs == len(Y):
        return 0
    n_rows = count_places(np.column_stack([features, Y]), codes)
    return len(Y) - n_rows if n_rows == n_inputs else 0


def nearly_complete(features, codes):
    """What keeps data from inference by Kronecker products, where it is little.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Inputs, in any order.
    codes : ndarray of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1.

    Returns
    -------
    what : str
        How many cells are missing or observed repeatedly. Empty where there is one
        task, or none are, or most.
    """
    n_tasks = codes.max() + 1
    most = len(codes) / (1.0 - FEW) / n_tasks  # inputs
    if n_tasks == 1 or len(np.unique(features[:, 0])) > most:
        return ""
    distinct, which = np.unique(row_keys(features), return_inverse=True)
    if len(distinct) > most:
        return ""
    count = np.bincount(which * n_tasks + codes, minlength=len(distinct) * n_tasks)
    missing, repeated = (count == 0).sum(), (count > 1).sum()
    if not 0 < missing + repeated <= FEW * len(count):
        return ""
    cells = "1 cell is" if missing == 1 else f"{missing} cells are"
    return (
        f"{cells} missing of {len(distinct)} inputs of {n_tasks} tasks, {repeated} "
        f"observed repeatedly. With none repeated and at most {SHARE:.0%} missing, "
        "inference would be by Kronecker products, as inference='kronecker' is with "
        "less than half of them missing."
    )


def check_complete(features, codes, tasks):
    """Raise a ValueError where most cells are missing, or one has several rows.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Inputs, in any order.
    codes : ndarray of shape (n_samples,)
        Task of each row.
    tasks : ndarray of shape (n_tasks,)
        Labels of the tasks.

    Raises
    ------
    ValueError
        Naming up to five tasks that lack inputs or have one repeatedly.
    """
    distinct, which = np.unique(features, axis=0, return_inverse=True)
    count = np.zeros((len(distinct), len(tasks)), dtype=int)
    np.add.at(count, (which.reshape(-1), codes), 1)
    lacking, repeated = (count == 0).sum(axis=0), (count > 1).sum(axis=0)
    too_many = 2 * lacking.sum() >= count.size
    faults = [
        f"task {label!r} {verb} {number} of the {len(distinct)} inputs{end}"
        for verb, numbers, end in [
            ("lacks", lacking * too_many, ""),
            ("has", repeated, " more than once"),
        ]
        for label, number in zip(tasks.tolist(), numbers.tolist(), strict=True)
        if number
    ]
    if not faults:
        return
    more = f" and {len(faults) - 5} more" if len(faults) > 5 else ""
    raise ValueError(
        "inference='kronecker' needs the tasks observed at the same inputs, once each, "
        "with less than half of these cells missing, but "
        f"{', '.join(faults[:5])}{more}. Complete the data, or set inference='auto', "
        f"which takes any data. {INFERENCE}"
    )
