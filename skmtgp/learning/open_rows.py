"""Whose rows of F count as open, see :mod:`skmtgp.inference.open_rows`."""

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.open_rows import open_rows
from skmtgp.learning.settling import has_rows


def with_open_rows(problem, mode, posterior):
    """The mode with open rows of F, of all tasks that have rows of data.

    Parameters
    ----------
    problem : Problem
        What was learned.
    mode : Mode
        What was found.
    posterior : Posterior
        At this mode.

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
    likelihood = problem.likelihood_at(mode)
    with limit_threads(likelihood.side):
        found = open_rows(posterior, likelihood, tasks.tolist())
    return mode._replace(leeway=mode.leeway + found)
