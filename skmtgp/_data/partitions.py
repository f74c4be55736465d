"""Training data in a Dask collection: checked and encoded where its partitions are."""

from functools import partial
from itertools import chain

import numpy as np
import pandas as pd
from sklearn.utils.validation import validate_data

from skmtgp._data.checks import check_given, check_target, cut_table
from skmtgp._data.dask import is_dask, partitions
from skmtgp._data.labels import encode_tasks, sorted_tasks
from skmtgp._data.oddities import warn_of_training
from skmtgp._data.task_column import locate
from skmtgp._support.guide import PARALLEL


def check_partitions(estimator, X, y):
    """Features, tasks and targets, of which only the tasks' labels come here.

    Parameters
    ----------
    estimator : estimator
        Gets n_features_in_ and feature_names_in_; names the task column.
    X : dask.array.Array or dask.dataframe.DataFrame of shape (n_samples, n_features)
        Inputs with the task column.
    y : Dask collection of shape (n_samples,) or (n_samples, n_outputs)
        Targets, in the same partitions.

    Returns
    -------
    features : dask.array.Array of shape (n_samples, n_features - 1)
        Numbers, held by the workers, as are the codes and the targets.
    codes : dask.array.Array of shape (n_samples,)
        Position in `tasks` of each row's task.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    y : dask.array.Array of the shape of y
        Numbers.

    Raises
    ------
    ValueError
        If something in a partition cannot be used, which it names.
    """
    import dask

    check_given(estimator, y)
    pairs = _pair(X, y)
    frame = hasattr(X, "columns")
    header = pd.DataFrame(columns=X.columns) if frame else X
    validate_data(estimator, header, reset=True, skip_check_array=True)
    check = partial(_check_partition, type(estimator).__name__, *locate(estimator))
    parts = [dask.delayed(check)(i, *pair) for i, pair in enumerate(pairs)]
    parts = dask.persist(*parts)
    described = dask.compute(*map(dask.delayed(_describe), parts))
    kept = [(part, n) for part, (n, _) in zip(parts, described, strict=True) if n]
    if not kept:
        raise ValueError("X has no rows: give at least 1.")
    tasks = _union({i: of_part for i, (n, of_part) in enumerate(described) if n})
    arrays = _assemble(kept, tasks, header.shape[1] - 1, y.shape[1:])
    features, codes, Y = dask.persist(*arrays)
    warn_of_training(estimator, features, tasks, Y)
    return features, codes, tasks, Y


def _pair(X, y):
    """The parts of X and y."""
    for name, part in [("X", X), ("y", y)]:
        if not is_dask(part):
            raise ValueError(
                f"{name} is of type {type(part).__name__}, but the other one a Dask "
                "collection. Give both as Dask arrays, dataframes or series, in the "
                f"same partitions. {PARALLEL}"
            )
    if X.ndim != 2:
        raise ValueError(
            f"Expected 2D array, got {X.ndim}D {type(X).__name__} instead: the columns "
            "of X are the features and the task."
        )
    if hasattr(X, "rechunk") and hasattr(y, "rechunk") and X.shape[:1] == y.shape[:1]:
        y = y.rechunk({0: X.chunks[0]})
    parts = partitions(X), partitions(y)
    if len(parts[0]) != len(parts[1]):
        raise ValueError(
            f"X has {len(parts[0])} partitions and y {len(parts[1])}: they must be the "
            "same, with the same rows. Repartition one of them, or rechunk it. "
            f"{PARALLEL}"
        )
    return zip(*parts, strict=True)


def _check_partition(name, position, columns, number, table, y):
    """Features, labels and targets of a partition; none of one without rows."""
    if not len(table):
        return np.empty((0, len(columns))), None, None
    try:
        _check_index(table, y)
        y = check_target(table, y)
        return *cut_table(table, position, columns, name), y
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(f"In partition {number}: {error}") from error


def _check_index(table, y):
    """Raise a ValueError where both have an index and they are not of the same rows."""
    if not (
        isinstance(table, pd.DataFrame) and isinstance(y, pd.Series | pd.DataFrame)
    ):
        return
    if len(table) == len(y) and not table.index.equals(y.index):
        raise ValueError(
            "The rows of X and y differ in their index, or in its order: y must be a "
            "column of the dataframe that X is of, or made from it row by row. If the "
            f"rows are the same, pass y.to_dask_array(lengths=True). {PARALLEL}"
        )


def _describe(part):
    features, labels, _ = part
    return len(features), labels and labels.tasks


def _union(tasks):
    """The tasks of all partitions, sorted; `tasks` has each partition's."""
    first = {}
    for i, of_part in tasks.items():
        kind = {"U": "strings", "b": "booleans"}.get(of_part.dtype.kind, "integers")
        first.setdefault(kind, (i, of_part[0].item()))
    if len(first) > 1:
        where = " and ".join(
            f"{kind} in partition {i}, such as {label!r}"
            for kind, (i, label) in first.items()
        )
        raise ValueError(
            f"Task labels must all be integers or all be strings, but are {where}. "
            "Convert the column of the task."
        )
    return sorted_tasks(chain.from_iterable(of.tolist() for of in tasks.values()))


def _assemble(parts, tasks, n_features, shape):
    """Lazy arrays of features, codes and targets."""
    import dask
    import dask.array as da

    encode = dask.delayed(_encode, nout=3)
    columns = zip(*(encode(part, tasks) for part, _ in parts), strict=True)
    kinds = [((n_features,), float), ((), int), (shape, float)]
    for column, (shape, dtype) in zip(columns, kinds, strict=True):
        blocks = zip(column, parts, strict=True)
        yield da.concatenate(
            [da.from_delayed(block, (n, *shape), dtype) for block, (_, n) in blocks]
        )


def _encode(part, tasks):
    features, labels, y = part
    return features, encode_tasks(labels, tasks), y
