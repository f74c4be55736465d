"""Labels of tasks: checked, and encoded as positions."""

import numbers

import numpy as np
import pandas as pd

EXACT = np.float64(2.0**53)  # the integers up to here are exact in float64


def check_labels(labels):
    """Task labels as an array without missing ones.

    Parameters
    ----------
    labels : array-like of shape (n_samples,)
        Integers, strings or bools; floats that are integers.

    Returns
    -------
    labels : ndarray of shape (n_samples,)
        Int, str or bool.

    Raises
    ------
    TypeError
        If a label is neither a string nor a number.
    ValueError
        If a label is missing or is a number that is not an integer, or if strings and
        numbers are mixed.
    """
    index = labels.index if isinstance(labels, pd.Series) else None
    labels = _flatten(labels)
    missing = pd.isna(labels)
    if np.any(missing):
        first = int(np.flatnonzero(missing)[0])
        where = "" if index is None else f", index {index[first]}"
        raise ValueError(
            f"The task column has {int(np.sum(missing))} missing labels (NaN, None or "
            f"NA), the first in row {first}{where}. Every row needs its task."
        )
    if labels.dtype.kind in "OT":
        labels = _unify(labels)
    if labels.dtype.kind == "f":
        return _as_integers(labels)
    if labels.dtype.kind not in "iubU":
        raise ValueError(
            f"Task labels must be integers or strings, not {labels.dtype}. Does "
            "task_feature name the task column?"
        )
    return labels


def _flatten(labels):
    kept = hasattr(labels, "dtype")  # a list ["a", NaN] would become strings
    labels = np.asarray(labels, dtype=None if kept else object)
    if labels.ndim != 1:
        raise ValueError(
            f"Task labels must be one-dimensional, but have shape {labels.shape}."
        )
    return labels


def _unify(labels):
    """An object array of labels of one type, as an array of that type."""
    if all(isinstance(label, str) for label in labels):
        return np.array(labels.tolist(), dtype=str)
    if all(isinstance(label, (bool, np.bool_)) for label in labels):
        return labels.astype(bool)
    if all(isinstance(label, numbers.Integral) for label in labels):
        return _as_int64(labels)
    if all(isinstance(label, numbers.Real) for label in labels):
        return labels.astype(np.float64)
    kinds = sorted({type(label).__name__ for label in labels})
    if not all(isinstance(label, (str, numbers.Real)) for label in labels):
        raise TypeError(
            f"A task label as an argument must be a string or a number, not {kinds}."
        )
    raise ValueError(
        f"Task labels must all be integers or all be strings, not a mixture: {kinds}."
    )


def _as_int64(labels):
    try:
        return labels.astype(np.int64)
    except OverflowError as error:
        raise ValueError(
            "Task labels that are integers must lie within 2**63, but "
            f"{max(labels, key=abs)} does not. Pass them as strings."
        ) from error


def _as_integers(labels):
    """Labels that came as floats, as integers."""
    inexact = ~(np.abs(labels) <= EXACT)
    if inexact.any():
        raise ValueError(
            "Task labels that are floats must lie within 2**53, where integers are "
            f"exact, but {inexact.sum()} of {len(labels)} do not, such as "
            f"{labels[inexact][0]!s}. Pass them as integers or as strings."
        )
    fractional = np.mod(labels, 1.0) != 0.0
    if fractional.any():
        raise ValueError(
            f"Task labels must be integers or strings, but {fractional.sum()} of "
            f"{len(labels)} are fractional numbers such as {labels[fractional][0]!s}. "
            "Does task_feature name the task column? A ColumnTransformer moves it: set "
            "remainder='passthrough', and task_feature to where it ends up."
        )
    return labels.astype(np.int64)


def encode_tasks(labels, tasks, *, can_join=False):
    """Index in `tasks` of each label.

    Parameters
    ----------
    labels : ndarray of shape (n_samples,)
        Task of each row.
    tasks : ndarray of shape (n_tasks,)
        Known tasks, sorted.
    can_join : bool, default=False
        Whether the model has a method ``add_task``, which the error then names.

    Returns
    -------
    codes : ndarray of shape (n_samples,)
        0 to n_tasks - 1.

    Raises
    ------
    ValueError
        Naming up to five labels that are not known, and those that are.
    """
    kinds = ["strings" if of.dtype.kind == "U" else "numbers" for of in (labels, tasks)]
    differ = kinds[0] != kinds[1]
    unknown = np.unique(labels) if differ else np.setdiff1d(labels, tasks)
    if not unknown.size:
        return np.searchsorted(tasks, labels)
    what = f"Unknown task{'s' * (unknown.size > 1)} {_enumerate(unknown)}"
    why = f" These labels are {kinds[0]}, the model's are {kinds[1]}." * differ
    join = ", or let it join with add_task" * can_join
    raise ValueError(
        f"{what}: the model knows {_enumerate(tasks)}.{why} Fit with samples of every "
        f"task{join}; in cross-validation cv=TaskStratifiedKFold(task_feature=...) of "
        "skmtgp.model_selection does."
    )


def _enumerate(labels, most=5):
    listed = ", ".join(repr(label) for label in labels[:most].tolist())
    return listed + (f", ... ({len(labels)} in all)" if len(labels) > most else "")
