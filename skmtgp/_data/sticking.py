"""Sensors that stick: long runs of equal targets of a task whose others differ."""

from typing import NamedTuple

import numpy as np

from skmtgp._data.labels import rows_by_code
from skmtgp._support.warnings import warn
from skmtgp.exceptions import ConstantTargetWarning

LONG = 10  # rows in succession, and at least as many others
TIED = 0.05  # share of the others that may equal the one before
NAMED = 3  # in a warning


class Run(NamedTuple):
    """Rows of a task in succession, and the target that all of them have.

    Attributes
    ----------
    task : int
        Position among the tasks.
    n_equal, n_rows : int
        How many rows these are, and how many the task has.
    value : float
        Target.
    where : str
        Which rows, in words.
    """

    task: int
    n_equal: int
    n_rows: int
    value: float
    where: str


def stuck_runs(features, codes, y):
    """Long runs of equal targets, each the only one of its task.

    Zeros, the lowest and the highest targets of a task are not asked: they may be rest,
    a detection limit or a range that ends. Nor are runs that more than half of the
    tasks have, which are of their nature.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_inputs)
        Inputs.
    codes : ndarray of shape (n_samples,)
        Task of each row, from 0.
    y : ndarray of shape (n_samples,)
        Targets.

    Returns
    -------
    runs : list of Run
    """
    one = features.shape[1] == 1
    order = np.argsort(features[:, 0], kind="stable") if one else np.arange(len(y))
    present, of_tasks = rows_by_code(codes[order])
    found = []
    for task, rows in zip(present.tolist(), of_tasks, strict=True):
        run = _longest(y[order[rows]]) if len(rows) >= 2 * LONG else None
        if run is not None:
            x = features[order[rows[[run.start, run.stop - 1]]], 0]
            if one and x[0] == x[1]:  # repeated measurements have no order
                continue
            where = f"where the input is from {x[0]:.10g} to {x[1]:.10g}"
            if not one:
                where = (
                    f"its rows {run.start} to {run.stop - 1}, counted from 0 among "
                    "those that have a target"
                )
            value = float(y[order[rows[run.start]]])
            found.append(Run(task, run.stop - run.start, len(rows), value, where))
    return found if 2 * len(found) <= len(present) else []


def _longest(y):
    """Where the longest run of equal numbers is, None unless it is odd."""
    starts = np.flatnonzero(np.append(True, y[1:] != y[:-1]))
    lengths = np.diff(np.append(starts, len(y)))
    longest = lengths.argmax()
    n_others = len(y) - lengths[longest]
    n_ties = n_others - (len(lengths) - 1)
    value = y[starts[longest]]
    if min(lengths[longest], n_others) < LONG or n_ties > TIED * n_others:
        return None
    if value == 0.0 or not y.min() < value < y.max():
        return None
    return slice(starts[longest], starts[longest] + lengths[longest])


def warn_of_sticking(runs, tasks, which=""):
    """Say which tasks have long runs of equal targets, and what that does.

    Parameters
    ----------
    runs : list of Run
        See `stuck_runs`; there are some.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    which : str, default=""
        The output in words, if there are several.
    """
    named = "; ".join(
        f"{run.n_equal} of {run.n_rows} targets of task {tasks[run.task].item()!r}"
        f"{which} are {run.value:.10g}, {run.where}"
        for run in runs[:NAMED]
    )
    more = f"; and so on in {len(runs) - NAMED} more" * (len(runs) > NAMED)
    warn(
        f"{named}{more}. These rows follow each other, and hardly any others of the "
        "task are equal. Is a sensor stuck, or were gaps filled? The model takes such "
        "rows for exact, which spoils predictions and intervals of all tasks. Leave "
        "them out, unless the values are right.",
        ConstantTargetWarning,
    )
