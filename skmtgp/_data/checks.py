"""Training and test data as the estimators get them: checked and encoded."""

from numbers import Integral

from sklearn.utils import check_array, check_consistent_length, check_scalar

from skmtgp._data.dask import is_dask, refuse_dask
from skmtgp._data.labels import encode_tasks
from skmtgp._data.numbers import check_numbers, column_names
from skmtgp._data.oddities import warn_of_last, warn_of_training
from skmtgp._data.order import refuse_another_order
from skmtgp._data.statistics import largest_of
from skmtgp._data.task_column import (
    locate,
    name_of_task_column,
    read_table,
    split_table,
)
from skmtgp._support.guide import PARALLEL

LARGEST = 1e75  # the square of a feature times that of a target is finite
BY_PARTITIONS = (
    "Predict where they are: X.map_partitions(model.predict, meta=('output', float)), "
    "or of an array X.map_blocks(model.predict, drop_axis=1, dtype=float). Otherwise "
    "pass X.compute(), or a partition of it."
)


def check_training(estimator, X, y):
    """Features without the task column, tasks and targets from what the user passed.

    Parameters
    ----------
    estimator : estimator
        Gets n_features_in_ and feature_names_in_; names the task column.
    X : array-like of shape (n_samples, n_features)
        Inputs with the task column.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Targets.

    Returns
    -------
    features : ndarray of shape (n_samples, n_features - 1)
        Numbers.
    codes : ndarray of shape (n_samples,)
        Position in `tasks` of each row's task.
    tasks : ndarray of shape (n_tasks,)
        Labels, sorted.
    y : ndarray of the shape of y
        Numbers.
    """
    if is_dask(X, y):
        raise ValueError(
            f"{type(estimator).__name__} would collect the rows of a Dask collection "
            "here. MultiTaskGPRegressor, IndependentGP, PooledGP and RankSearchIC "
            "learn from them where they are: set inference='sparse'. Otherwise pass "
            f"X.compute() and y.compute(). {PARALLEL}"
        )
    table = read_table(estimator, X, reset=True)
    check_given(estimator, y)
    refuse_another_order(X, y)
    y = check_target(table, y)
    features, (tasks, codes) = _split(estimator, table)
    warn_of_training(estimator, features, tasks, y)
    warn_of_last(estimator, table, features, tasks, codes)
    return features, codes, tasks, y


def check_given(estimator, y):
    """Raise a ValueError where there are no targets."""
    if y is None:
        raise ValueError(
            f"{type(estimator).__name__} requires y to be passed, but the target y is "
            "None."
        )


def check_new_task(estimator, X, y):
    """Features, label and targets of a task that the estimator does not know.

    Parameters
    ----------
    estimator : estimator
        Fitted.
    X : array-like of shape (n_samples, n_features)
        Inputs with the task column, which holds one new label.
    y : array-like of the other dimensions of the training targets
        Targets.

    Returns
    -------
    features : ndarray of shape (n_samples, n_features - 1)
        Numbers.
    label : str, int or bool
        The new task.
    Y : ndarray of shape (n_samples, n_outputs)
        Numbers.
    """
    _refuse_dask_rows(X, y, "a task that joins is small.")
    features, (tasks, _), Y = _check_joining(estimator, X, y)
    known = estimator.tasks_
    if len(tasks) != 1:
        raise ValueError(
            f"The task column holds {len(tasks)} labels, {tasks[:5].tolist()}. Call "
            "add_task once for each new task."
        )
    label = tasks[0].item()
    if (tasks.dtype.kind == "U") != (known.dtype.kind == "U"):
        raise ValueError(
            f"The new task {label!r} is not of the type of the known ones, such as "
            f"{known[0].item()!r}."
        )
    if label in known.tolist():  # not as floats
        more = "fit the model to all samples"
        if hasattr(estimator, "partial_fit"):
            more = "use partial_fit"
        raise ValueError(
            f"Task {label!r} is known already. add_task takes new tasks; for more "
            f"samples of a known one {more}."
        )
    return features, label, Y


def check_more(estimator, X, y):
    """Features, labels, tasks and targets of rows that join a fitted estimator.

    Parameters
    ----------
    estimator : estimator
        Fitted.
    X : array-like of shape (n_samples, n_features)
        Inputs with the task column.
    y : array-like of the other dimensions of the training targets
        Targets.

    Returns
    -------
    features : ndarray of shape (n_samples, n_features - 1)
        Numbers.
    labels : Labels
        Of the rows.
    codes : ndarray of shape (n_samples,)
        Positions of the tasks in `tasks_`; those of new tasks are beyond.
    Y : ndarray of shape (n_samples, n_outputs)
        Numbers.
    """
    features, labels, Y = _check_joining(estimator, X, y)
    codes = encode_tasks(labels, estimator.tasks_, unseen=True)
    return features, labels, codes, Y


def check_stream(X, y, max_rows):
    """Raise an error where rows are Dask's, or no number of rows is to be kept."""
    _refuse_dask_rows(X, y, "the rows of a stream are few at a time.")
    if max_rows is not None:
        check_scalar(max_rows, "max_rows", Integral, min_val=1)


def _refuse_dask_rows(X, y, why):
    for name, data in [("X", X), ("y", y)]:
        refuse_dask(name, data, f"Pass {name}.compute(): {why}")


def _check_joining(estimator, X, y):
    """Features, labels and targets, of as many outputs as those of fit."""
    table = read_table(estimator, X, reset=False)
    check_given(estimator, y)
    refuse_another_order(X, y)
    features, labels = _split(estimator, table)
    _check_descriptors(estimator, features, labels)
    y = check_target(table, y)
    # Of Dask's rows none is kept
    y = _check_outputs(y, getattr(estimator, "y_train_", y).shape[1:])
    return features, labels, y


def check_observed(estimator, X, y, shape):
    """Targets of rows that are predicted, of shape (n_samples, n_outputs).

    `shape` is that of a row of the training targets.
    """
    refuse_dask("y", y, "Pass y.compute().")
    check_given(estimator, y)
    refuse_another_order(X, y)
    return _check_outputs(check_target(X, y), shape)


def _check_outputs(y, shape):
    """Targets in columns; a row must have the shape of one of fit."""
    if y.shape[1:] != shape:
        raise ValueError(
            f"y has shape {y.shape}; the model was fitted to targets of shape "
            f"{('n_samples', *shape)}.".replace("'", "")
        )
    return y.reshape(len(y), -1)


def check_test(estimator, X, *, unseen=False):
    """Features and positions of the tasks in `tasks_`, from what the user passed.

    If other tasks may be `unseen`, theirs are beyond.
    """
    refuse_dask("X", X, BY_PARTITIONS)
    features, labels = _split(estimator, read_table(estimator, X, reset=False))
    _check_descriptors(estimator, features, labels)
    can_join = hasattr(estimator, "add_task")
    may_share = hasattr(estimator, "shared")
    options = {"can_join": can_join, "unseen": unseen, "may_share": may_share}
    if getattr(estimator, "trend_per_task", False):
        options["beside"] = (
            " With trend_per_task=True a task needs rows that tell its coefficients."
        )
    options["beside"] = options.get("beside", "") + _by_default(estimator)
    return features, encode_tasks(labels, estimator.tasks_, **options)


def _by_default(estimator):
    """Which column holds the tasks, where the user has not said and may not know."""
    numbered = estimator.tasks_.dtype.kind != "U"
    if estimator.task_feature != -1 or not numbered:
        return ""
    column = name_of_task_column(estimator)
    return f" Tasks are those of the last column, {column!r}, by task_feature=-1."


def _check_descriptors(estimator, features, labels):
    """Raise a ValueError where those of a task differ, by themselves or from fit."""
    descriptors = getattr(estimator, "_descriptors", None)
    if descriptors is not None:
        descriptors.check(features, labels, estimator.tasks_)


def _split(estimator, table):
    return cut_table(table, *locate(estimator), estimator)


def cut_table(table, position, columns, estimator):
    """Features and labels of a table, checked; `columns` and `estimator` are named."""
    features, labels = split_table(table, position, estimator)
    check_magnitude(features, "X", columns)
    return features, labels


def check_target(table, y):
    """Targets of the rows of a table, as numbers whose squares do not overflow."""
    numbers = check_numbers(y, "y")
    check_consistent_length(table, numbers)
    columns = numbers.reshape(len(numbers), -1)
    names = column_names(y if hasattr(y, "columns") else columns)
    check_magnitude(columns, "y", names)
    return numbers


def check_magnitude(values, name, columns):
    """Raise a ValueError where squares of the values overflow."""
    largest = largest_of(values)
    if (largest > LARGEST).any():
        j = int(largest.argmax())
        raise ValueError(
            f"{name} has values as large as {largest[j]:.1e} in column {columns[j]!r}; "
            f"beyond {LARGEST:.0e} the squares overflow. Choose another unit, or "
            "standardise the column."
        )


def check_theta(theta, learned):
    """Parameters of the shape of the learned ones, which None stands for."""
    if theta is None:
        return learned
    theta = check_array(theta, ensure_2d=False, dtype=float)
    if theta.shape != learned.shape:
        raise ValueError(
            f"theta has shape {theta.shape}; the model has {learned.shape}."
        )
    return theta
