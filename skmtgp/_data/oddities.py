"""What is odd about training data that can be used, and is said by a warning."""

import re

import numpy as np
import pandas as pd

from skmtgp._data.dask import is_dask
from skmtgp._data.labels import alike, listed, name_tasks
from skmtgp._data.statistics import largest_of
from skmtgp._data.task_column import locate, name_of_task_column
from skmtgp._support.warnings import warn
from skmtgp.exceptions import (
    BinaryTargetWarning,
    ConstantTargetWarning,
    FarLevelsWarning,
    RepeatedRowsWarning,
    TaskColumnWarning,
    UnderflowWarning,
)

SMALLEST = 1e-150  # its square is not rounded, nor are small parts of it
VERY_FAR = 1e4  # deviations: noise may be a hundredth of the variance within tasks
FEW_COPIES = 2  # of rows: so many may be there by chance
FEW_MORE = 5  # rows beside the first of each task
FEW_ROWS = 20  # so many may well be equal, or each of a task of its own
# Last words of names of columns that are integers, and seldom name tasks
TIMES = {"year", "month", "week", "day", "weekday", "hour", "minute", "time"}
QUANTITIES = {*TIMES, "age", "count", "depth", "distance", "height", "temperature"}
# Words in names of columns that tell tasks
PLACES = {"site", "station", "shop", "store", "school"}
PEOPLE = {"patient", "subject", "person", "player", "athlete", "team"}
TASKS = {*PLACES, *PEOPLE, "task", "machine", "sensor", "dataset"}


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
    warn_of_alike(alike(tasks.tolist()))
    column = name_of_task_column(estimator)
    _warn_of_default(estimator, column, tasks, features)
    if len(y) > FEW_ROWS and len(tasks) > len(y) / 2:
        warn(
            f"{len(tasks)} tasks of {len(y)} rows: does task_feature name the task "
            f"column? It is column {column!r}. The first tasks are "
            f"{tasks[:5].tolist()}.{_little_told(estimator, len(y) - len(tasks))}",
            TaskColumnWarning,
        )


def _little_told(estimator, n_more):
    """What so few rows beside the first of each task do not tell, in words.

    A model without levels takes what a task has of its own for noise.
    """
    if n_more >= FEW_MORE or not getattr(estimator, "task_levels", False):
        return ""
    return (
        " If it does, hardly any task has a second row, and the rows do not tell noise "
        "from what each task has of its own: intervals may hold far too little. "
        "PooledGP takes both for noise."
    )


def _warn_of_default(estimator, column, tasks, features):
    """Say where the last column, taken by default, may be another one than that.

    Integers of a column "hour" or "age" look like labels. Only its name tells that they
    may be none, or that of another column of integers that it has the tasks.
    """
    by_default = estimator.task_feature == -1 and isinstance(column, str)
    if not by_default or tasks.dtype.kind not in "iu":
        return
    better, words = _named_like_tasks(estimator, features), _words(column) or [""]
    told = not better or TASKS.intersection(words)
    if told and words[-1].removesuffix("s") not in QUANTITIES:
        return
    such = f", {better[0]!r} for example" if better else ""
    warn(
        f"task_feature=-1 takes the last column, {column!r}, for the tasks: "
        f"{len(tasks)} of them, such as {listed(tasks, 3, more='')}. If these are no "
        f"tasks, set task_feature to the name of the column that has them{such}, or "
        "add a column with one label where all rows are of one task. If they are, set "
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


def warn_of_alike(groups):
    """Say which labels may be the same task, written in several ways."""
    if groups:
        first = ", ".join(map(repr, groups[0]))
        more = f", and {len(groups) - 1} more such groups" * (len(groups) > 1)
        warn(
            f"Tasks {first} differ in spaces or case alone{more}: they are learned as "
            "different tasks. If they are one, give them one label, by .str.strip() "
            "and .str.lower() of the column for example.",
            TaskColumnWarning,
        )


def warn_of_last(estimator, table, features, tasks, codes):
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


def warn_of_constant_tasks(tasks, *, told):
    """Say which tasks, if any, have targets that do not vary, and what that does.

    `told` is whether learning takes no noise from them; None where noise is fixed.
    """
    if len(tasks):
        hidden = ", which makes the noise of all tasks, and their intervals, too small"
        spared = ", so the other tasks alone tell how much there is"
        harms = {None: "", False: hidden, True: spared}
        warn(
            f"{name_tasks(tasks, begins=True)}: all targets are equal, as if there "
            f"were no noise{harms[told]}. Check y, or leave these rows out, which is "
            "best.",
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


def warn_of_counts(n_repeats, *, whole=True, inference=None):
    """Say that measurements agree exactly with others, if they are not few.

    `whole` is whether weights are whole numbers, as counts are. `inference` is one that
    has no counts: each measurement is a row.
    """
    if n_repeats > FEW_COPIES:
        others = "To a BaggingRegressor give bootstrap=False and max_samples below 1."
        if not whole:
            others = (
                "Inverse variances of the noise are no counts: instead of them give "
                "alpha=1 / sample_weight."
            )
        instead = "Give repeat_variance, as average_repeats returns it."
        rows = ""
        if inference is not None:
            instead = f"Set inference='dense'. {instead}"
            rows = (
                f" inference={inference!r} has a row for each of them, and loo_predict "
                "leaves out one of these rows at a time."
            )
        warn(
            "sample_weight counts rows more than once. Without repeat_variance their "
            "measurements agree exactly, as if y had no noise. If it has some, the "
            "noise that is learned may be far too small, and so may the standard "
            f"deviations of predictions.{rows} {instead} {others}",
            RepeatedRowsWarning,
        )
