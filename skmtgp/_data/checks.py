"""Training and test data as the estimators get them: checked and encoded."""

import re
from numbers import Integral

import numpy as np
import pandas as pd
from sklearn.preprocessing import StandardScaler
from sklearn.utils import (
    check_array,
    check_consistent_length,
    check_scalar,
    gen_batches,
)

from skmtgp._data.dask import is_dask, refuse_dask
from skmtgp._data.labels import alike, encode_tasks
from skmtgp._data.numbers import check_numbers, column_names
from skmtgp._data.order import refuse_another_order
from skmtgp._data.task_column import locate_task_column, read_table, split_table
from skmtgp._support.guide import NOISE, PARALLEL
from skmtgp._support.warnings import warn
from skmtgp.exceptions import (
    BinaryTargetWarning,
    ConstantTargetWarning,
    FarLevelsWarning,
    RepeatedRowsWarning,
    TaskColumnWarning,
    UnderflowWarning,
    UnidentifiedNoiseWarning,
)

LARGEST = 1e75  # the square of a feature times that of a target is finite
SMALLEST = 1e-150  # its square is not rounded, nor are small parts of it
VERY_FAR = 1e4  # deviations: noise may be a hundredth of the variance within tasks
FEW_COPIES = 2  # of rows: so many may be there by chance
FEW_ROWS = 20  # so many may well be equal, or each of a task of its own
# Last words of names of columns that are integers, and seldom name tasks
TIMES = {"year", "month", "week", "day", "weekday", "hour", "minute", "time"}
QUANTITIES = {*TIMES, "age", "count", "depth", "distance", "height", "temperature"}
# Words in names of columns that tell tasks
PLACES = {"site", "station", "shop", "store", "school"}
TASKS = {*PLACES, "task", "patient", "subject", "person", "machine", "sensor"}
AT_ONCE = 100_000  # of which the standard deviation is taken at once
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
    _warn_of_last(estimator, table, features, tasks, codes)
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
        raise ValueError(
            f"Task {label!r} is known already. add_task takes new tasks; for more "
            "samples of a known one use partial_fit."
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
    shape = getattr(estimator, "y_train_", y).shape[1:]  # of Dask's rows none is kept
    if y.shape[1:] != shape:
        raise ValueError(
            f"y has shape {y.shape}; the model was fitted to targets of shape "
            f"{('n_samples', *shape)}.".replace("'", "")
        )
    return features, labels, y.reshape(len(y), -1)


def check_test(estimator, X, *, unseen=False):
    """Features and positions of the tasks in `tasks_`, from what the user passed.

    If other tasks may be `unseen`, theirs are beyond.
    """
    refuse_dask("X", X, BY_PARTITIONS)
    features, labels = _split(estimator, read_table(estimator, X, reset=False))
    _check_descriptors(estimator, features, labels)
    can_join = hasattr(estimator, "add_task")
    options = {"can_join": can_join, "unseen": unseen}
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
    column = _task_column(estimator)
    return f" Tasks are those of the last column, {column!r}, by task_feature=-1."


def _task_column(estimator):
    """Name of the task column, or its position."""
    position, _ = locate(estimator)
    names = getattr(estimator, "feature_names_in_", None)
    return position if names is None else names[position]


def _check_descriptors(estimator, features, labels):
    """Raise a ValueError where those of a task differ, by themselves or from fit."""
    descriptors = getattr(estimator, "_descriptors", None)
    if descriptors is not None:
        descriptors.check(features, labels, estimator.tasks_)


def _split(estimator, table):
    return cut_table(table, *locate(estimator), estimator)


def locate(estimator):
    """Position of the task column, and the names or positions of the others."""
    n, names = estimator.n_features_in_, getattr(estimator, "feature_names_in_", None)
    position = locate_task_column(estimator.task_feature, n, names)
    columns = range(n) if names is None else names.tolist()
    return position, np.delete(np.array(columns, object), position)


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


def largest_of(values):
    """The largest absolute value of each column, without an array of them all."""
    return np.asarray(np.maximum(values.max(axis=0), -values.min(axis=0)))


def mean_of(values):
    """Mean of each column; of many rows, a part at a time."""
    if len(values) <= AT_ONCE or is_dask(values):
        return np.asarray(values.mean(axis=0))
    return _scaler_of(values).mean_


def deviation_of(values):
    """Standard deviation of each column; of many rows, a part at a time."""
    if len(values) <= AT_ONCE or is_dask(values):
        return np.asarray(values.std(axis=0))
    return np.sqrt(_scaler_of(values).var_)


def _scaler_of(values):
    scaler = StandardScaler()
    for rows in gen_batches(len(values), AT_ONCE):
        scaler.partial_fit(values[rows])
    return scaler


def check_theta(theta, learned):
    """Parameters of the shape of the learned ones, which None stands for."""
    theta = learned if theta is None else check_array(theta, ensure_2d=False)
    if theta.shape != learned.shape:
        raise ValueError(
            f"theta has shape {theta.shape}; the model has {learned.shape}."
        )
    return theta


def warn_of_training(estimator, features, tasks, y):
    """Say what is odd about training data that can be used.

    Parameters
    ----------
    estimator : estimator
        Names the task column.
    features : ndarray or dask.array.Array of shape (n_samples, n_features - 1)
        Numbers.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    y : ndarray or dask.array.Array of shape (n_samples,) or (n_samples, n_outputs)
        Numbers.
    """
    _warn_of_underflow(features, "feature")
    _warn_of_underflow(
        y.reshape(len(y), -1), "output", ", and standard deviations mean nothing"
    )
    _warn_of_alike(tasks)
    column = _task_column(estimator)
    _warn_of_default(estimator, column, tasks, features)
    if len(y) > FEW_ROWS and len(tasks) > len(y) / 2:
        warn(
            f"{len(tasks)} tasks of {len(y)} rows: does task_feature name the task "
            f"column? It is column {column!r}. The first tasks are "
            f"{tasks[:5].tolist()}.",
            TaskColumnWarning,
        )


def _warn_of_default(estimator, column, tasks, features):
    """Say where the last column, taken by default, may be another one than that.

    Integers of a column "hour" or "age" look like labels. Only its name tells that they
    may be none, or that of another column of integers that it has the tasks.
    """
    by_default = estimator.task_feature == -1 and isinstance(column, str)
    if not by_default or tasks.dtype.kind not in "iu":
        return
    better, words = _named_like_tasks(estimator, features), _words(column)
    told = not better or TASKS.intersection(words)
    if told and not QUANTITIES.intersection(words[-1:]):
        return
    such = f", {better[0]!r} for example" if better else ""
    warn(
        f"task_feature=-1 takes the last column, {column!r}, for the tasks: "
        f"{len(tasks)} of them, such as {_few(tasks)}. If these are no tasks, set "
        f"task_feature to the name of the column that has them{such}, or add a column "
        "with one label where all rows are of one task. If they are, set "
        f"task_feature={column!r}.",
        TaskColumnWarning,
    )


def _words(name):
    return re.findall("[a-z]+", name.lower())


def _named_like_tasks(estimator, features):
    """Names of columns that tell tasks, by integers that repeat."""
    if is_dask(features):
        return []
    names = locate(estimator)[1].tolist()
    found = [j for j, name in enumerate(names) if TASKS.intersection(_words(name))]
    return [names[j] for j in found if _repeat(features[:, j])]


def _repeat(values):
    """Whether these are integers, each of two rows on average or more."""
    integers = (np.mod(values, 1.0) == 0.0).all()
    return integers and 2 * len(np.unique(values)) <= len(values)


def _few(tasks):
    return ", ".join(map(repr, tasks[:3].tolist()))


def _warn_of_alike(tasks):
    """Say which labels may be the same task, written in several ways."""
    groups = alike(tasks.tolist())
    if groups:
        first = ", ".join(map(repr, groups[0]))
        more = f", and {len(groups) - 1} more such groups" * (len(groups) > 1)
        warn(
            f"Tasks {first} differ in spaces or case alone{more}: they are learned as "
            "different tasks. If they are one, give them one label, by .str.strip() "
            "and .str.lower() of the column for example.",
            TaskColumnWarning,
        )


def _warn_of_last(estimator, table, features, tasks, codes):
    """Say where the column before the last one looks more like the tasks'.

    A RegressorChain appends outputs to X. Integers that were measured or counted may be
    negative, and the lowest and the highest are rare; labels seldom are either.
    """
    last = table.iloc[:, -1] if isinstance(table, pd.DataFrame) else table[:, -1]
    by_default = estimator.task_feature == -1 and last.dtype.kind == "f"
    if not by_default or len(codes) <= FEW_ROWS:
        return
    counts = np.bincount(codes)
    odd = [tasks[end].item() for end in (0, -1) if counts[end] == 1 or tasks[end] < 0]
    if odd and _look_like_labels(features[:, -1]):
        n = table.shape[1]
        why = "a negative number" if odd[0] < 0 else "of one row alone"
        warn(
            "task_feature=-1 takes the last column for the tasks, whose label "
            f"{odd[0]} is {why}, and the column before it looks more like labels. Was "
            "something appended to X, as a RegressorChain appends outputs? Then name "
            f"the task column, or count from the left: task_feature={n - 2}. If the "
            f"last column is meant, set task_feature={n - 1}.",
            TaskColumnWarning,
        )


def _look_like_labels(values):
    """Whether they are integers, none negative, each of several rows."""
    if (values < 0.0).any() or (np.mod(values, 1.0) != 0.0).any():
        return False
    counts = np.unique(values, return_counts=True)[1]
    return len(counts) > 1 and counts.min() > 1


def _warn_of_underflow(values, kind, more=""):
    """Say which columns have values so small that their squares may vanish."""
    largest = largest_of(values)
    small = np.flatnonzero((largest > 0.0) & (largest < SMALLEST))
    if small.size:
        which = f"{kind} {(small + 1).tolist()}" if len(largest) > 1 else f"the {kind}"
        warn(
            f"The values of {which} are below {SMALLEST:.0e}: their squares lose "
            f"digits or vanish, so they may count as constant{more}. Choose another "
            "unit.",
            UnderflowWarning,
        )


def warn_of_constants(constant):
    """Say which outputs are constant, from whether each is."""
    if constant.any():
        which = f" {(np.flatnonzero(constant) + 1).tolist()}" * (len(constant) > 1)
        warn(
            f"Output{which} is constant in training: the standard deviations of its "
            "predictions mean nothing. Check y, or leave it out.",
            ConstantTargetWarning,
        )


def is_binary(Y):
    """Whether each column of Y has two values alone. Few rows are not asked."""
    lowest, highest = Y.min(axis=0), Y.max(axis=0)
    between = (lowest < Y) & (highest > Y)
    return (len(Y) > FEW_ROWS) & (lowest < highest) & ~between.any(axis=0)


def warn_of_binary(binary):
    """Say which outputs have two values alone, from whether each has."""
    if binary.any():
        which = f" {(np.flatnonzero(binary) + 1).tolist()}" * (len(binary) > 1)
        warn(
            f"Output{which} has only two values in training. Its noise is not normal: "
            "predictions are of the mean, and intervals may go beyond both values. For "
            "probabilities of a class take a classifier, such as scikit-learn's "
            "GaussianProcessClassifier.",
            BinaryTargetWarning,
        )


def warn_of_far_levels(far, reason):
    """Say that levels may hide functions, if they are very far apart.

    Parameters
    ----------
    far : float
        Deviation of the means of tasks, in deviations of targets around them.
    reason : str
        Why they are not subtracted.
    """
    if far > VERY_FAR:
        warn(
            f"The means of tasks differ by {far:.0e} deviations of their targets, and "
            f"are not subtracted, because {reason}. Noise is learned relative to all "
            "targets, so functions may be taken for noise. Subtract a typical value of "
            "each task from y before fit.",
            FarLevelsWarning,
        )


def warn_of_constant_tasks(tasks, *, own_noise):
    """Say which tasks, if any, have targets that do not vary, and what that does."""
    if len(tasks):
        harm = "which makes the noise of all tasks, and their intervals, too small"
        if own_noise:
            harm = "and the kernel may follow these rows alone. Set noise='shared'"
        warn(
            f"T{name_tasks(tasks)[1:]}: all targets are equal, as if there were no "
            f"noise, {harm}. Check y, or leave these rows out.",
            ConstantTargetWarning,
        )


def warn_of_copies(n_copies):
    """Say how many rows are there twice, if they are not few."""
    if n_copies > FEW_COPIES:
        warn(
            f"{n_copies} rows repeat another one, with the same target, as if y had no "
            "noise. If it has some, the noise that is learned may be far too small, "
            "and so may the standard deviations of predictions. Take the copies out, "
            "for example by drop_duplicates of a DataFrame with X and y.",
            RepeatedRowsWarning,
        )


def warn_of_counts(n_repeats):
    """Say that measurements agree exactly with others, if they are not few."""
    if n_repeats > FEW_COPIES:
        warn(
            "sample_weight counts rows more than once. Without repeat_variance their "
            "measurements agree exactly, as if y had no noise. If it has some, the "
            "noise that is learned may be far too small, and so may the standard "
            "deviations of predictions. Give repeat_variance, as average_repeats "
            "returns it. To a BaggingRegressor give bootstrap=False and max_samples "
            "below 1.",
            RepeatedRowsWarning,
        )


def warn_of_noise(told, tasks=None, lower=""):
    """Say which noise variances were learned from next to nothing.

    Parameters
    ----------
    told : ndarray of bool of shape (n_outputs, n_noise)
        Whether the rows tell each.
    tasks : ndarray of shape (n_noise,), default=None
        Labels of the tasks, if they have one each.
    lower : str, default=""
        A lower rank, in words; none without one.
    """
    if told.all():
        return
    outputs, unknown = np.flatnonzero(~told.all(axis=1)) + 1, ~told.all(axis=0)
    which = f" of output {outputs.tolist()}" * (len(told) > 1)
    same = ""
    if tasks is not None:
        which += f" of {name_tasks(tasks[unknown])}"
        same = "set noise='shared' if all tasks are measured with the same precision, "
    warn(
        f"The rows do not tell the noise variance{which}: the model follows them so "
        "closely that a variance many times as large would be as likely. The learned "
        "variance may be far too small, and so may the standard deviations of "
        f"predictions. Give more rows, {same}{lower and f'choose {lower}, '}raise the "
        "lower bound in noise_variance_bounds, a share of the variance of y, or fix "
        f"the noise variance if you know it. {NOISE}",
        UnidentifiedNoiseWarning,
    )


def name_tasks(labels):
    """The tasks by their labels, or by some of them."""
    named = ", ".join(map(repr, labels[:3].tolist()))
    more = f" and {len(labels) - 3} more" if len(labels) > 3 else ""
    return f"task{'s' * (len(labels) > 1)} {named}{more}"
