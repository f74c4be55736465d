"""Complete data: every task observed at the same inputs, once each."""

import numpy as np


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
    n_tasks = codes.max() + 1
    n_inputs, rest = divmod(len(codes), n_tasks)
    if rest or (np.bincount(codes) != n_inputs).any():
        return None
    if len(np.unique(features[:, 0])) > n_inputs:  # most often, and quickly
        return None
    distinct, which = np.unique(features, axis=0, return_inverse=True)
    if len(distinct) != n_inputs:
        return None
    rows = np.full((n_inputs, n_tasks), -1)
    rows[which.reshape(-1), codes] = np.arange(len(codes))
    return None if (rows < 0).any() else rows


def check_complete(features, codes, tasks):
    """Raise a ValueError where not each task is observed at each input, once.

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
    if (count == 1).all():
        return
    lacking, repeated = (count == 0).sum(axis=0), (count > 1).sum(axis=0)
    faults = [
        f"task {label!r} {verb} {number} of the {len(distinct)} inputs{end}"
        for verb, numbers, end in [
            ("lacks", lacking, ""),
            ("has", repeated, " more than once"),
        ]
        for label, number in zip(tasks.tolist(), numbers.tolist(), strict=True)
        if number
    ]
    more = f" and {len(faults) - 5} more" if len(faults) > 5 else ""
    raise ValueError(
        "inference='kronecker' needs every task observed at the same inputs, once "
        f"each, but {', '.join(faults[:5])}{more}. Complete the data, or set "
        "inference='auto', which takes any."
    )
