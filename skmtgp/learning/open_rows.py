"""Whose rows of F count as open, see :mod:`skmtgp.inference.open_rows`."""

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp.inference.open_rows import with_open
from skmtgp.learning.settling import has_rows


def with_open_rows(problem, mode):
    """The mode with open rows of F, of all tasks that have rows of data.

    Parameters
    ----------
    problem : Problem
        What was learned.
    mode : Mode
        What was found.

    Returns
    -------
    mode : Mode
        As it was if nothing was learned, or no other task tells what tasks are like.
    """
    data = problem.data
    if not (problem.budget.max_iter and has_rows(problem.prior)):
        return mode
    tasks = np.arange(data.n_tasks) if is_dask(data.X) else np.unique(data.tasks)
    if len(tasks) < 2:
        return mode
    return mode._replace(leeway=with_open(mode.leeway, tasks, data.n_tasks))
