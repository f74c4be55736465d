"""Drawing some of the rows at random, wherever they lie."""

from functools import partial

import numpy as np

from skmtgp._data.dask import map_parts

FEW = 4  # rows of a task, with which learning starts better than with one of each


def draw_rows(tasks, n_tasks, size):
    """`size` of the rows, of each task its share, or of some tasks a few.

    It takes memory for the rows that are drawn, not for all, and gives the same ones
    however the rows are divided into partitions. See `shares_of`.

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
    shares = zip(of_task, shares_of(of_task, size), strict=True)
    drawn = [rng.choice(k, share, replace=False) for k, share in shares]
    task = np.repeat(np.arange(n_tasks), [len(places) for places in drawn])
    place, begin = np.concatenate(drawn), np.cumsum(counts, axis=0) - counts
    wanted = [
        _of_part(task, place, *of_part) for of_part in zip(begin, counts, strict=True)
    ]
    found = map_parts(_positions, tasks, wanted)
    return np.concatenate(
        [a + rows for a, rows in zip(begin.sum(1), found, strict=True)]
    )


def shares_of(counts, size):
    """How many rows of each task are drawn.

    Where they are too few for four of each they tell nothing of single tasks, and are
    four of each of some: what they tell of k^x and the noise, they tell within tasks.

    Parameters
    ----------
    counts : ndarray of shape (n_tasks,)
        How many there are, one or more.
    size : int
        How many are wanted in all, 1 to as many as there are.

    Returns
    -------
    shares : ndarray of shape (n_tasks,)
        One of each, and the others in proportion to what is left. Where these are no
        whole numbers the largest fractions are rounded up. Of equal ones, and of tasks
        that have none, chance says which, by the positions of the tasks alone.
    """
    chance = np.random.default_rng(0).permutation(len(counts))
    few = np.minimum(counts, FEW)
    if few.sum() > size:
        shares, before = np.zeros_like(few), np.cumsum(few[chance]) - few[chance]
        shares[chance] = np.clip(size - before, 0, few[chance])
        return shares
    others, size = counts - 1, size - len(counts)
    shares, fractions = np.divmod(others * size, max(1, others.sum()))
    rounded_up = np.lexsort([chance, -fractions])[: size - shares.sum()]
    shares[rounded_up] += 1
    return 1 + shares


def _of_part(task, place, begin, count):
    """What is drawn from a part: tasks, and which of their rows in it."""
    here = (begin[task] <= place) & (place < (begin + count)[task])
    return task[here], place[here] - begin[task[here]]


def _positions(tasks, wanted):
    """Where the rows are that are the first, second, ... of their task."""
    task, place = wanted
    order = np.argsort(tasks, kind="stable")
    return np.sort(order[np.searchsorted(tasks, task, sorter=order) + place])
