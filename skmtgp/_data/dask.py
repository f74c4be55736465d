"""Rows in the partitions of Dask collections, which stay where they are.

What is done with rows is done with each part of them: an array in memory is one part,
a Dask collection has its partitions. Dask is imported only where data are Dask's.
"""

import numpy as np

from skmtgp._support.guide import PARALLEL

LARGE = "distributed.admin.large-graph-warning-threshold"


def is_dask(*data):
    """Whether any of the data is a Dask collection."""
    return any(_has_graph(part) for part in data)


def _has_graph(part):
    if not hasattr(part, "__dask_graph__"):
        return False
    if type(part).__module__.startswith("dask"):
        return True
    return part.__dask_graph__() is not None  # of xarray's, which may be in memory


def refuse_dask(name, data, advice):
    """Raise a TypeError where data are a Dask collection, which numpy would collect.

    Parameters
    ----------
    name : str
        Of the data.
    data : object
        What the user passed.
    advice : str
        What to do instead.
    """
    if is_dask(data):
        kind = f"{type(data).__module__.partition('.')[0]} {type(data).__name__}"
        raise TypeError(
            f"{name} is a collection of Dask's ({kind}), whose rows would be collected "
            f"here. {advice} {PARALLEL}"
        )


def partitions(collection):
    """The parts of the rows of a Dask array, dataframe or series, as Delayed objects.

    Parameters
    ----------
    collection : dask.array.Array, dask.dataframe.DataFrame or dask.dataframe.Series
        Its columns are put together.

    Returns
    -------
    parts : list of dask.delayed.Delayed
        In the order of the rows.
    """
    if not hasattr(collection, "rechunk"):
        return list(collection.to_delayed())
    whole = dict.fromkeys(range(1, collection.ndim), -1)
    return collection.rechunk(whole).to_delayed().ravel().tolist()


def held(array):
    """The array computed where it lies: a Dask array on the workers."""
    return array.persist() if is_dask(array) else np.ascontiguousarray(array)


def map_parts(function, array, *others):
    """``function(part, *other)`` of each part of the rows of an array.

    Parameters
    ----------
    function : callable
        Its results are small.
    array : ndarray or dask.array.Array
        Rows.
    *others : list
        More arguments, one for each part.

    Returns
    -------
    results : sequence
        One for each part.
    """
    if not is_dask(array):
        return [function(array, *(of_part for [of_part] in others))]
    import dask

    do, parts = dask.delayed(function), zip(partitions(array), *others, strict=True)
    return dask.compute(*(do(*part) for part in parts))


def sum_parts(function, arguments, arrays):
    """``function(arguments, *arrays)`` of all rows, whose results add up.

    Parameters
    ----------
    function : callable
        Is called where the rows are.
    arguments : sequence
        Sent to one worker, from which the others have them.
    arrays : sequence of ndarray, or of dask.array.Array
        Rows, in the same parts.

    Returns
    -------
    total : object
        The results of the parts, added in pairs, the sums in pairs again, and so on.
        The order does not depend on which worker is done first.
    """
    if not is_dask(*arrays):
        return function(arguments, *arrays)
    import dask

    do, sent = dask.delayed(function), dask.delayed(arguments, traverse=False)
    sums = [do(sent, *part) for part in zip(*map(partitions, arrays), strict=True)]
    while len(sums) > 1:
        pairs = zip(sums[::2], sums[1::2], strict=False)
        sums = [one + other for one, other in pairs] + sums[len(sums) & ~1 :]
    with dask.config.set({LARGE: "1 TB"}):  # the arguments are as large as they are
        return sums[0].compute()
