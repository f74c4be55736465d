"""Drawing some of the rows at random, wherever they lie."""

from functools import partial

import numpy as np

from skmtgp._data.dask import map_parts


def draw_rows(tasks, n_tasks, size):
    """About `size` of the rows, of each task its share and at least one.

    It takes memory for the rows that are drawn, not for all, and gives the same ones
    however the rows are divided into partitions.

    Parameters
    ----------
    tasks : ndarray or dask.array.Array of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1.
    n_tasks : int
        Number of tasks.
    size : int
        How many rows are wanted.

    Returns
    -------
    rows : ndarray of shape (n_drawn,)
        Their numbers, ascending.
    """
    counts = np.array(map_parts(partial(np.bincount, minlength=n_tasks), tasks))
    of_task, rng = counts.sum(axis=0), np.random.default_rng(0)
    n = of_task.sum()
    drawn = [rng.choice(k, -(-k * size // n), replace=False) for k in of_task]
    task = np.repeat(np.arange(n_tasks), [len(places) for places in drawn])
    place, begin = np.concatenate(drawn), np.cumsum(counts, axis=0) - counts
    wanted = [
        _of_part(task, place, *of_part) for of_part in zip(begin, counts, strict=True)
    ]
    found = map_parts(_positions, tasks, wanted)
    return np.concatenate(
        [a + rows for a, rows in zip(begin.sum(1), found, strict=True)]
    )


def _of_part(task, place, begin, count):
    """What is drawn from a part: tasks, and which of their rows in it."""
    here = (begin[task] <= place) & (place < (begin + count)[task])
    return task[here], place[here] - begin[task[here]]


def _positions(tasks, wanted):
    """Where the rows are that are the first, second, ... of their task."""
    task, place = wanted
    order = np.argsort(tasks, kind="stable")
    return np.sort(order[np.searchsorted(tasks, task, sorter=order) + place])
