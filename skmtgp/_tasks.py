"""The task column: found, and cut from the features, which are checked."""

import difflib
import numbers
from datetime import date, timedelta

import numpy as np
import pandas as pd
from sklearn.utils import check_array
from sklearn.utils.validation import validate_data

from skmtgp._labels import check_labels


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
    if isinstance(task_feature, str):
        return _locate_name(task_feature, feature_names)
    if isinstance(task_feature, (bool, np.bool_)) or not isinstance(
        task_feature, numbers.Integral
    ):
        raise TypeError(
            f"task_feature={task_feature!r} must be the position (int) or the name "
            f"(str) of the task column, not {type(task_feature).__name__}."
        )
    if not -n_features <= task_feature < n_features:
        raise ValueError(
            f"task_feature={task_feature} is out of range: X has {n_features} columns."
        )
    return int(task_feature) % n_features


def _locate_name(name, names):
    """Position of a name among those of the columns."""
    if names is None:
        raise ValueError(
            f"task_feature={name!r} names a column, but X has no column names. Pass a "
            "DataFrame, which a pipeline makes after set_output(transform='pandas'), "
            "or the position of the column."
        )
    names = list(names)
    if name not in names:
        advice = _advise(name, names)
        raise ValueError(f"task_feature={name!r} is not a column: {names}.{advice}")
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
        A frame of pandas stays one: as an array it might lose the labels' type.

    Raises
    ------
    ValueError
        If X has one column, in fit, or not those of fit.
    """
    if isinstance(X, pd.DataFrame):
        table = validate_data(estimator, X, reset=reset, skip_check_array=True)
    else:
        options = {"dtype": None, "ensure_all_finite": False}
        table = validate_data(estimator, _keep_types(X), reset=reset, **options)
    if reset and table.shape[1] < 2:
        raise ValueError(
            f"X has {table.shape[1]} feature(s) (shape={table.shape}) while a minimum "
            f"of 2 is required by {type(estimator).__name__}: the task's column and at "
            "least one feature. If the columns of y are the tasks, stack them into one "
            "column with a task label for each row: DataFrame.melt."
        )
    return table


def _keep_types(X):
    """Lists whose numbers would become text, as an array of objects.

    NaN and 1 would be the names of tasks otherwise.
    """
    if isinstance(X, (list, tuple)) and np.asarray(X).dtype.kind in "SU":
        return np.asarray(X, dtype=object)
    return X


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
    labels : ndarray of shape (n_samples,)
        The task of each row; int, str or bool, as in a frame.

    Raises
    ------
    ValueError
        If a feature is missing, infinite or not a number, or if a label is missing or
        is a number that is not an integer. Text and dates are named with their column.
    """
    if table.shape[1] < 2:
        raise ValueError("X has 0 feature(s) beside the task column; give at least 1.")
    columns = table.iloc if isinstance(table, pd.DataFrame) else table
    features = _without(table, position)
    names = _names(table, estimator)
    if _has_dates(features):  # alone, they would become numbers of some unit
        _check_values(features, names, position)
    try:
        features = check_array(
            features, dtype=np.float64, input_name="X", estimator=estimator
        )
    except (TypeError, ValueError):
        _check_values(features, names, position)
        raise
    features, labels = by_rows(features), columns[:, position]
    if not hasattr(estimator, "task_feature"):
        return features, check_labels(labels)
    return features, _labels_of(
        labels, names[position], estimator.task_feature, estimator
    )


def by_rows(values):
    """The values, row after row in memory, as those of a frame are not.

    Sums over them are then rounded alike, and what is learned from a frame is what is
    learned from an array.
    """
    by_columns = values.ndim == 2 and values.strides[0] < values.strides[1]
    return np.ascontiguousarray(values) if by_columns else values


def _names(table, estimator):
    """Names of the columns, or their positions."""
    if isinstance(table, pd.DataFrame):
        return table.columns.tolist()
    return list(getattr(estimator, "feature_names_in_", range(table.shape[1])))


def _has_dates(features):
    frame = isinstance(features, pd.DataFrame)
    return frame and any(dtype.kind in "mM" for dtype in features.dtypes)


def _check_values(features, names, position):
    """Raise a ValueError that names the first feature with text or dates, if any."""
    task, others = names[position], names[:position] + names[position + 1 :]
    for name, values in zip(others, np.asarray(features, object).T, strict=True):
        for value in values:
            _check_value(value, name, task)


def _check_value(value, name, task):
    if isinstance(value, (date, timedelta)):
        raise ValueError(
            f"Features must be numbers, but column {name!r} holds dates or times such "
            f"as {value}. Convert it, to days since the first for example."
        )
    if isinstance(value, str) and not _is_number(value):
        raise ValueError(
            f"Features must be numbers, but column {name!r} holds strings such as "
            f"{value!r}. If it is the task column, set task_feature={name!r} (it is "
            f"column {task!r} now); else encode it, with a OneHotEncoder in a "
            "ColumnTransformer with remainder='passthrough' for example."
        )


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True


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
    labels : ndarray of shape (n_samples,)
        Int, str or bool.

    Raises
    ------
    ValueError
        If X is not two-dimensional, has no such column, or a label is missing or is a
        number that is not an integer.
    """
    names = getattr(X, "columns", None)  # of pandas or polars, say
    if not isinstance(X, pd.DataFrame) and not hasattr(X, "dtype"):
        X = np.asarray(X, dtype=object)
    if X.ndim != 2:
        raise ValueError(f"X must be two-dimensional, but has {X.ndim} dimensions.")
    position = locate_task_column(task_feature, X.shape[1], names)
    name = position if names is None else list(names)[position]
    columns = X.iloc if isinstance(X, pd.DataFrame) else X
    return _labels_of(columns[:, position], name, task_feature, owner)


def _labels_of(column, name, task_feature, owner):
    """Labels of a column; an error names it and whose parameter chose it."""
    try:
        return check_labels(column)
    except ValueError as error:
        of = "" if owner is None else f" of {type(owner).__name__}"
        raise ValueError(
            f"Column {name!r} (task_feature={task_feature!r}{of}) cannot hold the "
            f"tasks: {error}"
        ) from error


def rows_of_tasks(codes):
    """The rows of each task that has any, in one pass over all.

    Parameters
    ----------
    codes : ndarray of shape (n_samples,)
        Task of each row.

    Yields
    ------
    task : int
        Ascending.
    rows : ndarray of shape (n_rows,)
        Positions of its rows, ascending.
    """
    order = np.argsort(codes, kind="stable")
    tasks, starts = np.unique(codes[order], return_index=True)
    yield from zip(tasks.tolist(), np.split(order, starts)[1:], strict=True)
