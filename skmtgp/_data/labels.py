"""Labels of tasks: checked, and encoded as positions.

Labels are compared as what they are, never as floats and never cut to a width.
"""

import numbers
from typing import NamedTuple

import numpy as np
import pandas as pd

from skmtgp._data.numbers import as_array

FIRST_INEXACT = np.float64(
    2.0**53
)  # float64 tells the integers below it from all others
CONVERT = (
    "Does task_feature name the task column? If so, make its labels strings, with "
    ".astype(str) for example."
)


class Labels(NamedTuple):
    """The tasks of some rows.

    Attributes
    ----------
    tasks : ndarray of shape (n_tasks,)
        The distinct labels, sorted; int, str or bool.
    codes : ndarray of shape (n_samples,)
        Position in `tasks` of each row's task.
    """

    tasks: np.ndarray
    codes: np.ndarray

    def of_rows(self):
        """The label of each row, without a copy of a string for each."""
        text = self.tasks.dtype.kind == "U"
        return (self.tasks.astype(object) if text else self.tasks)[self.codes]


def check_labels(labels):
    """The tasks of rows that have labels, of which none may be missing.

    Parameters
    ----------
    labels : array-like of shape (n_samples,) or (n_samples, 1)
        Integers, strings or bools; floats that are integers. Those of a subclass of
        them, as members of an enumeration may be, are what they are equal to.

    Returns
    -------
    labels : Labels
        Distinct labels and positions among them.

    Raises
    ------
    TypeError
        If a label is neither a string nor a number.
    ValueError
        If a label is missing, is a number that is not an integer or cannot be held
        exactly, or if strings and numbers are mixed.
    """
    index = labels.index if isinstance(labels, pd.Series) else None
    labels = _flatten(labels)
    _check_missing(labels, index)
    kind = labels.dtype.kind
    if kind in "OT":
        return _encode(_plain(labels.astype(object)))
    if kind not in "fiubU":
        raise ValueError(
            f"Task labels must be integers or strings, not {labels.dtype}, such as "
            f"{next(map(str, labels), 'none')}. {CONVERT}"
        )
    labels = _as_integers(labels) if kind == "f" else labels
    return Labels(*np.unique(labels, return_inverse=True))


def _flatten(labels):
    """One axis of labels, each of its own type."""
    if isinstance(getattr(labels, "dtype", None), pd.CategoricalDtype):
        labels = pd.Categorical(labels)  # as objects: strings may be long
        names = np.asarray(labels.categories, dtype=object)
        labels = pd.api.extensions.take(names, labels.codes, allow_fill=True)
    if hasattr(labels, "dtype"):
        labels = as_array(labels)
    else:  # a list ["a", NaN] would become strings
        labels = np.asarray(labels, dtype=object)
    if labels.ndim == 2 and labels.shape[1] == 1:
        labels = labels[:, 0]
    if labels.ndim != 1:
        raise ValueError(
            f"Task labels must be one-dimensional, but have shape {labels.shape}."
        )
    return labels


def _check_missing(labels, index):
    """Raise a ValueError where there are missing labels."""
    missing = pd.isna(labels)
    if np.any(missing):
        first, n = int(np.flatnonzero(missing)[0]), int(np.sum(missing))
        where = "" if index is None else f", index {index[first]}"
        raise ValueError(
            f"{n} missing label{'s' * (n > 1)} of {len(labels)} (NaN, None or NA), the "
            f"first in row {first}{where}. Every row needs its task: leave rows out, "
            "or make the missing label a task of its own."
        )


def _plain(labels):
    """Labels that are objects, as Python's own str, bool or int."""
    kinds = set(map(type, labels))
    if _are(kinds, str):
        return list(map(str.__str__, labels))  # a member of a str Enum is its text
    if _are(kinds, (bool, np.bool_)):
        return list(map(bool, labels))
    if _are(kinds, (numbers.Integral, np.bool_)):
        return list(map(int, labels))
    if _are(kinds, numbers.Real):
        others = [not isinstance(label, numbers.Integral) for label in labels]
        _check_whole(labels[others], 53, len(labels))
        return list(map(int, labels))
    if not _are(kinds, (str, numbers.Real)):
        _refuse_objects(labels)
    names = sorted(kind.__name__ for kind in kinds)
    raise ValueError(
        "Task labels must all be integers or all be strings, not a mixture: "
        f"{names}. Make all of them strings, with .astype(str) for example."
    )


def _are(kinds, wanted):
    return all(issubclass(kind, wanted) for kind in kinds)


def _refuse_objects(labels):
    row, label = next(
        (i, label)
        for i, label in enumerate(labels)
        if not isinstance(label, (str, numbers.Real))
    )
    raise TypeError(  # in the words that scikit-learn's checks ask for
        "Task labels in a column or an argument must be all strings or all numbers, "
        f"not {type(label).__name__}, such as {label!r} in row {row}. {CONVERT}"
    )


def _as_integers(labels):
    """Labels that came as floats, as integers."""
    _check_whole(labels, min(53, np.finfo(labels.dtype).nmant + 1), len(labels))
    return labels.astype(np.int64)


def _check_whole(labels, digits, total):
    """Raise a ValueError where a number is no integer, or may be rounded."""
    inexact = ~(np.abs(labels) < 2.0**digits)
    if inexact.any():
        raise ValueError(
            f"Task labels that are floats must lie within 2**{digits}, below which "
            f"they tell integers apart, but {inexact.sum()} of {total} do not, "
            f"such as {labels[inexact][0]!s}. Pass them as integers or as strings."
        )
    fractional = np.mod(labels, 1) != 0
    if fractional.any():
        raise ValueError(
            f"Task labels must be integers or strings, but {fractional.sum()} of "
            f"{total} are fractional numbers such as {labels[fractional][0]!s}. "
            "Does task_feature name the task column? Where all rows are of one task, "
            "add a column with its name. A ColumnTransformer moves it: set "
            "remainder='passthrough', and task_feature to where it ends up."
        )


def _encode(labels):
    """Tasks and codes of a list of Python's own str, bool or int."""
    tasks = sorted_tasks(labels)
    return Labels(tasks, _positions(labels, tasks))


def _positions(labels, tasks):
    """The position among `tasks` of each of a list of labels; -1 if there is none."""
    positions = {task: i for i, task in enumerate(tasks.tolist())}
    found = (positions.get(label, -1) for label in labels)
    return np.fromiter(found, dtype=np.intp, count=len(labels))


def sorted_tasks(labels):
    """Distinct labels in an array, which holds each of them exactly.

    Parameters
    ----------
    labels : iterable of str, bool or int
        Of one type, Python's own.

    Returns
    -------
    tasks : ndarray of shape (n_tasks,)
        Each label once, sorted.

    Raises
    ------
    ValueError
        If NumPy has no type that can hold one of them.
    """
    labels = sorted(set(labels))
    try:
        tasks = np.array(labels, dtype=_dtype(labels))
    except OverflowError as error:
        raise ValueError(
            "Task labels that are integers must lie within 2**63, but "
            f"{max(labels, key=abs)} does not. Pass them as strings."
        ) from error
    if tasks.tolist() != labels:
        label = next(label for label in labels if label.endswith("\0"))
        raise ValueError(
            f"The task label {label!r} ends with a NUL character, which NumPy's "
            "strings cannot hold. Write it without that character."
        )
    return tasks


def _dtype(labels):
    """Of an array of sorted labels; by itself NumPy may choose floats."""
    for kind in (str, bool):
        if all(isinstance(label, kind) for label in labels):
            return kind
    return np.uint64 if labels[0] >= 0 and labels[-1] >= 2**63 else np.int64


def encode_tasks(
    labels, tasks, *, can_join=False, may_share=False, unseen=False, beside=""
):
    """Index in `tasks` of each row's label.

    Parameters
    ----------
    labels : Labels
        Task of each row.
    tasks : ndarray of shape (n_tasks,)
        Known tasks, sorted.
    can_join : bool, default=False
        Whether the model has a method ``add_task``, which the error then names.
    may_share : bool, default=False
        Whether it has an option ``shared``, likewise.
    unseen : bool, default=False
        Whether the model knows what to say of other tasks.
    beside : str, default=""
        What else to say of those that are not known.

    Returns
    -------
    codes : ndarray of shape (n_samples,)
        0 to n_tasks - 1, and from n_tasks on those of other tasks.

    Raises
    ------
    ValueError
        Naming up to five labels that are not known, and those that are.
    """
    found = _positions(labels.tasks.tolist(), tasks)
    if (found >= 0).all():
        return found[labels.codes]
    unknown = labels.tasks[found < 0]
    kinds = [
        "strings" if of.dtype.kind == "U" else "numbers" for of in (unknown, tasks)
    ]
    differ = kinds[0] != kinds[1]
    if unseen and not differ:
        found[found < 0] = len(tasks) + np.arange(len(unknown))
        return found[labels.codes]
    what = f"Unknown task{'s' * (unknown.size > 1)} {listed(unknown)}"
    why = f" These labels are {kinds[0]}, the model's are {kinds[1]}." * differ
    why = why or _meant(unknown.tolist(), tasks.tolist())
    join = ", or let it join with add_task" * can_join
    share = (
        " To predict tasks that it never saw, set the parameter shared=True, or "
        "task_descriptors, before fit; normalize_y_ must be 'shared', and levels must "
        "not be hundreds of deviations apart."
    ) * may_share
    raise ValueError(
        f"{what}: the model knows {listed(tasks)}.{why}{beside} Fit with "
        f"samples of every task{join}. In cross-validation set "
        "cv=TaskStratifiedKFold(task_feature=...) of skmtgp.model_selection, or "
        "TaskTimeSeriesSplit for forecasts."
        f"{share}"
    )


def alike(tasks):
    """Labels that differ in spaces or case alone.

    Parameters
    ----------
    tasks : list
        Distinct labels. Only text can be alike.

    Returns
    -------
    groups : list of lists of str
        Those of two or more, in the order of the labels.
    """
    groups = {}
    for task in tasks:
        if isinstance(task, str):
            groups.setdefault(_plain_text(task), []).append(task)
    return [group for group in groups.values() if len(group) > 1]


def _plain_text(label):
    return " ".join(label.split()).casefold()


def _meant(unknown, tasks):
    """Which known task an unknown label may mean."""
    known = {_plain_text(task): task for task in tasks if isinstance(task, str)}
    for label in unknown:
        if isinstance(label, str) and _plain_text(label) in known:
            return f" Did you mean {known[_plain_text(label)]!r}?"
    return ""


def listed(values, most=5, more=", ... ({n} in all)"):
    """Labels or names in words, or the first of them if they are many.

    Parameters
    ----------
    values : ndarray, list or tuple
        What is listed.
    most : int, default=5
        How many are shown.
    more : str
        Follows if there are more, where {n} is how many there are in all.

    Returns
    -------
    words : str
    """
    some = values[:most]
    some = some.tolist() if isinstance(some, np.ndarray) else some
    end = more.format(n=len(values)) if len(values) > most else ""
    return ", ".join(map(repr, some)) + end


def rows_by_code(codes):
    """The rows that have each of the codes that there are, in ascending order.

    Parameters
    ----------
    codes : ndarray of shape (n_samples,)
        Integers from 0.

    Returns
    -------
    present : ndarray of shape (n_present,)
        The codes that there are, ascending.
    rows : list of n_present ndarrays of int
        Positions of the rows that have each of them.
    """
    order = np.argsort(codes, kind="stable")
    present, starts = np.unique(codes[order], return_index=True)
    return present, np.split(order, starts[1:])


def name_input(k, names):
    """Name of an input in a message.

    Parameters
    ----------
    k : int
        Its position.
    names : list of str or None
        Of all inputs.

    Returns
    -------
    name : str
    """
    return f"column {k} of the inputs" if names is None else repr(names[k])


def name_tasks(labels, *, begins=False):
    """The tasks by their labels, or by some of them; perhaps they begin a sentence."""
    word = "Task" if begins else "task"
    named = listed(labels, 3, f" and {len(labels) - 3} more")
    return f"{word}{'s' * (len(labels) > 1)} {named}"
