"""Inducing points of the sparse models, of inputs and tasks, for the other packages.

Their kernels are of inputs with a task, and so are their inducing points. Two choices
are compared with the m inducing inputs of skmtgp, which serve all latent functions:

- "points": m points, each an input with one task: as many rows as skmtgp has;
- "inputs": skmtgp's m inputs with r tasks each, r m points. Where K^rho has rank r, and
  is regular between these tasks, what f is there tells what the r latent functions are:
  the bound is skmtgp's own.
"""

import numpy as np
from scipy.linalg import qr

SETTINGS = ("points", "inputs")


def inducing_points(problem, settings):
    """The points of a choice, the tasks in the last column.

    Parameters
    ----------
    problem : Problem
        With `Z` and `points`.
    settings : {"points", "inputs"}
        Which.
    """
    if settings == "points":
        return problem.points
    return with_tasks(problem.Z, spanning_tasks(problem.F))


def with_tasks(Z, tasks):
    """All pairs of an input and a task."""
    return np.column_stack([np.tile(Z, (len(tasks), 1)), np.repeat(tasks, len(Z))])


def spanning_tasks(F):
    """As many tasks as F has columns, whose rows of F are far from dependent."""
    return np.sort(qr(F.T, mode="r", pivoting=True)[1][: F.shape[1]])
