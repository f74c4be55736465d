"""The task column: found, and cut from the features, which are checked."""

import difflib
import numbers
from functools import partial

import numpy as np
import pandas as pd
from sklearn.utils.validation import validate_data

from skmtgp._data.labels import FIRST_INEXACT, check_labels
from skmtgp._data.numbers import (
    as_frame,
    check_numbers,
    column_names,
    refuse_empty,
)


def locate_task_column(task_feature, n_features, feature_names=None):
    """Position of the task column.

    Parameters
    ----------
    task_feature : int or str
        Position, negative ones from the right, or name of the column.
    n_features : int
        Number of columns, the task column counted.
    feature_names : sequence of str, default=None
        Names of the columns, if they have any.

    Returns
    -------
    position : int
        0 to n_features - 1.

    Raises
    ------
    TypeError
        If `task_feature` is neither an int nor a str.
    ValueError
        If there is no such column.
    """
    return locate_column(task_feature, n_features, feature_names)


def locate(estimator):
    """Position of the task column, and the names or positions of the others."""
    n, names = estimator.n_features_in_, getattr(estimator, "feature_names_in_", None)
    position = locate_task_column(estimator.task_feature, n, names)
    columns = range(n) if names is None else names.tolist()
    return position, np.delete(np.array(columns, object), position)


def name_of_task_column(estimator):
    """Name of the task column, or its position."""
    position, _ = locate(estimator)
    names = getattr(estimator, "feature_names_in_", None)
    return position if names is None else names[position]


def locate_column(
    column, n_features, names=None, parameter="task_feature", what="task column"
):
    """Position of a column, of which errors tell the parameter and what it is for."""
    if isinstance(column, str):
        return _locate_name(column, names, parameter)
    if isinstance(column, (bool, np.bool_)) or not isinstance(column, numbers.Integral):
        raise TypeError(
            f"{parameter}={column!r} must be the position (int) or the name "
            f"(str) of the {what}, not {type(column).__name__}."
        )
    if not -n_features <= column < n_features:
        raise ValueError(
            f"{parameter}={column} is out of range: X has {n_features} columns."
        )
    return int(column) % n_features


def locate_columns(given, parameter, position, n_features, names, why):
    """Positions of columns among those without that of the task.

    Parameters
    ----------
    given : sequence of int or str
        Positions or names of columns of X.
    parameter : str
        That of the estimator, for errors.
    position : int
        That of the task column.
    n_features : int
        Number of columns, the task column counted.
    names : sequence of str or None
        Names of the columns, if they have any.
    why : str
        Why the task column cannot be one of them.

    Returns
    -------
    columns : ndarray of shape (n_given,)

    Raises
    ------
    TypeError
        If one is neither an int nor a str.
    ValueError
        If there is none or no such column, if one is the task column or given twice.
    """
    of = f"an element of {parameter}"
    columns = [locate_column(one, n_features, names, of, "column") for one in given]
    given = list(given)
    if not given:
        raise ValueError(f"{parameter} is empty: name a column, or set it to None.")
    if position in columns:
        raise ValueError(
            f"{parameter}={given!r} has the task column, "
            f"{given[columns.index(position)]!r}: {why}"
        )
    twice = [one for one, k in zip(given, columns, strict=True) if columns.count(k) > 1]
    if twice:
        raise ValueError(f"{parameter}={given!r} names a column twice: {twice}.")
    columns = np.array(columns)
    return columns - (columns > position)


def _locate_name(name, names, parameter):
    """Position of a name among those of the columns."""
    if names is None:
        raise ValueError(
            f"{parameter}={name!r} names a column, but X has no column names. Pass a "
            "DataFrame, or the position of the column. Meta-estimators such as "
            "BaggingRegressor pass arrays, where only positions count. Before the "
            "last step of a pipeline make one by set_output(transform='pandas') of the "
            "pipeline, with verbose_feature_names_out=False of a ColumnTransformer and "
            "sparse_output=False of a OneHotEncoder."
        )
    names = list(names)
    if name not in names:
        advice = _advise(name, names)
        raise ValueError(f"{parameter}={name!r} is not a column: {names}.{advice}")
    return names.index(name)


def _advise(name, names):
    """Which column a name that is none of them may mean."""
    names = [other for other in names if isinstance(other, str)]
    prefixed = [other for other in names if other.endswith(f"__{name}")]
    similar = {other.lower(): other for other in names}
    close = difflib.get_close_matches(name.lower(), similar, n=1)
    if prefixed:
        return (
            f" Did you mean {prefixed[0]!r}? With verbose_feature_names_out=False a "
            "ColumnTransformer keeps the names."
        )
    return f" Did you mean {similar[close[0]]!r}?" if close else ""


def read_table(estimator, X, *, reset):
    """X as a table whose features and labels are still to be checked.

    Parameters
    ----------
    estimator : estimator
        Has n_features_in_ and feature_names_in_, or gets them.
    X : array-like of shape (n_samples, n_features)
        What the user passed.
    reset : bool
        Whether the estimator gets them, in fit, or X is compared with them.

    Returns
    -------
    table : ndarray or DataFrame of shape (n_samples, n_features)
        Frames are pandas' own: as an array they might lose the labels' type.

    Raises
    ------
    ValueError
        If X has one column, in fit, or not those of fit.
    """
    X = as_frame(X)
    refuse_empty("X", X)
    options = {"dtype": None, "ensure_all_finite": False}
    if isinstance(X, pd.DataFrame):
        _refuse_levels(X, estimator.task_feature)
        _refuse_index(X, estimator.task_feature)
        options = {"skip_check_array": True}
    try:
        table = validate_data(estimator, _keep_types(X), reset=reset, **options)
    except ValueError as error:
        advice = "" if reset else _advise_task(estimator, X)
        if not advice:
            raise
        raise ValueError(f"{str(error).rstrip()}\n{advice}") from None
    if reset and table.shape[1] < 2:
        raise ValueError(
            f"X has {table.shape[1]} feature(s) (shape={table.shape}) while a minimum "
            f"of 2 is required by {type(estimator).__name__}: the task's column and at "
            "least one feature. If the columns of y are the tasks, let WideRegressor "
            "stack them into rows with a task, or do it by stack_tasks."
        )
    return table


def _refuse_levels(frame, column, parameter="task_feature"):
    """Raise a ValueError where a name is looked for among columns of several levels."""
    if isinstance(column, str) and frame.columns.nlevels > 1:
        raise ValueError(
            f"{parameter}={column!r} names a column, but the columns of X have "
            f"{frame.columns.nlevels} levels, such as {frame.columns[0]!r}. Make them "
            "one, by X.columns = ['_'.join(map(str, c)) for c in X.columns] for "
            "example, or give the position of the column."
        )


def _refuse_index(frame, column, parameter="task_feature"):
    """Raise a ValueError where a column is looked for that is in the index."""
    named = isinstance(column, str) and column in frame.index.names
    if named and column not in frame.columns:
        raise ValueError(
            f"{parameter}={column!r} is in the index of X, which is no column. "
            f"Make it one, by X.reset_index({column!r}) for example."
        )


def _advise_task(estimator, X):
    """What to do where X has all columns that `fit` saw but that of the task."""
    n, names = estimator.n_features_in_, getattr(estimator, "feature_names_in_", None)
    position = locate_task_column(estimator.task_feature, n, names)
    label = getattr(estimator, "tasks_", [0])[:1]
    label = label[0] if isinstance(label, list) else label[0].item()
    if isinstance(X, pd.DataFrame) and names is not None:
        name = names[position]
        others = np.delete(names, position).tolist()
        if list(X.columns) != others:
            return ""
        return (
            f"X lacks the task column {name!r}. Say which task each row is to be "
            f"predicted for, X.assign(**{{{name!r}: {label!r}}}) for example."
        )
    if np.ndim(X) != 2 or np.shape(X)[1] != n - 1:
        return ""
    return (
        f"Does X lack the task column, column {position}? Say there which task each "
        f"row is to be predicted for, such as {label!r}."
    )


def _keep_types(X):
    """Lists whose values would not keep their type or digits, as an array of objects.

    Beside text, NaN and 1 would be the names of tasks; beside 0.5, 2**53 + 1 a float.
    """
    if not isinstance(X, (list, tuple)):
        return X
    objects = np.asarray(X, dtype=object)
    kinds = set(map(type, objects.flat))
    if objects.ndim != 2:
        return X
    if not all(issubclass(kind, (numbers.Real, np.bool_)) for kind in kinds):
        return objects
    array = np.asarray(X)
    rounded = array.dtype.kind == "f" and (np.abs(array) >= FIRST_INEXACT).any()
    return objects if rounded else array


def split_table(table, position, estimator=None):
    """Cut the task column from the features and check both.

    Parameters
    ----------
    table : ndarray or DataFrame of shape (n_samples, n_features)
        As `read_table` returns it.
    position : int
        Position of the task column.
    estimator : estimator or str, default=None
        Is named in errors; with its `task_feature`, if it has one.

    Returns
    -------
    features : ndarray of shape (n_samples, n_features - 1)
        The other columns, as float64.
    labels : Labels
        The task of each row.

    Raises
    ------
    TypeError
        If a value is neither text nor a number.
    ValueError
        If a feature is missing, infinite or not a number, or if a label is missing or
        is a number that is not an integer. The column is named.
    """
    if table.shape[1] < 2:
        raise ValueError("X has 0 feature(s) beside the task column; give at least 1.")
    names = _names(table, estimator)
    features = check_numbers(
        _without(table, position),
        "X",
        names[:position] + names[position + 1 :],
        advise=partial(_advise_text, names, position),
        estimator=estimator,
    )
    name = repr(names[position])
    if hasattr(estimator, "task_feature"):
        owner = type(estimator).__name__
        name += f" (task_feature={estimator.task_feature!r} of {owner})"
    return features, _labels_of(table, position, name)


def _names(table, estimator):
    """Names of the columns, or their positions."""
    return list(getattr(estimator, "feature_names_in_", column_names(table)))


def _advise_text(names, position, k):
    """What to do where the k-th of the columns but the task's holds text."""
    at = k + (k >= position)
    column, why = names[at], ""
    if not isinstance(column, str) and column != at:
        column, why = at, " (an integer is a position, not a column's name)"
    return (
        f" If it is the task column, set task_feature={column!r}{why} of the "
        f"MultiTaskGPRegressor or its like (it is column {names[position]!r} now); "
        "else encode it, with a OneHotEncoder in a ColumnTransformer with "
        "remainder='passthrough' for example."
    )


def _is_mapped(array):
    """Whether an array is a view of a file."""
    while isinstance(array, np.ndarray) and not isinstance(array, np.memmap):
        array = array.base
    return isinstance(array, np.memmap)


def _without(table, position):
    """A copy of the columns but one; of a file, a view if that is the first or last."""
    last = table.shape[1] - 1
    if _is_mapped(table) and position in (0, last):
        return table[:, 1:] if position == 0 else table[:, :last]
    others = np.delete(np.arange(last + 1), position)
    if isinstance(table, pd.DataFrame):
        return table.iloc[:, others]
    return np.asarray(table).take(others, axis=1)  # row after row in memory


def task_labels(X, task_feature=-1, owner=None):
    """The task of each row of X.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_features)
        Data as the user has them.
    task_feature : int or str, default=-1
        Position or name of the task column.
    owner : object, default=None
        Whose parameter `task_feature` is, to name in errors.

    Returns
    -------
    labels : Labels
        Distinct labels and the position of each row's.

    Raises
    ------
    TypeError
        If a label is neither a string nor a number.
    ValueError
        If X is not two-dimensional, has no such column, or a label is missing or is a
        number that is not an integer.
    """
    X, position, name = find_column(X, task_feature, owner)
    return _labels_of(X, position, name)


def find_column(X, column, owner, parameter="task_feature", what="task column"):
    """Where a column of the user's data is, and what errors call it.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_features)
        Data as the user has them.
    column : int or str
        Its position or name.
    owner : object or None
        Whose parameter that is.
    parameter, what : str
        The parameter, and what the column is for.

    Returns
    -------
    X : ndarray or DataFrame of shape (n_samples, n_features)
        The data; lists are an array of objects.
    position : int
        0 to n_features - 1.
    name : str
        Name or position, with the parameter.

    Raises
    ------
    TypeError
        If `column` is neither an int nor a str.
    ValueError
        If X is not two-dimensional or has no such column.
    """
    X = as_frame(X)
    if isinstance(X, pd.DataFrame):
        _refuse_levels(X, column, parameter)
        _refuse_index(X, column, parameter)
    elif not hasattr(X, "dtype"):
        X = np.asarray(X, dtype=object)
    if X.ndim != 2:
        raise ValueError(f"X must be two-dimensional, but has {X.ndim} dimensions.")
    names = getattr(X, "columns", None)
    position = locate_column(column, X.shape[1], names, parameter, what)
    of = "" if owner is None else f" of {type(owner).__name__}"
    return X, position, f"{column_names(X)[position]!r} ({parameter}={column!r}{of})"


def _labels_of(table, position, name):
    """Labels of a column, which errors name."""
    columns = table.iloc if isinstance(table, pd.DataFrame) else table
    try:
        return check_labels(columns[:, position])
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(f"Column {name} cannot hold the tasks: {error}") from error
