"""What looks like a mistake in rows and tasks that join a fitted model.

They cannot be taken out again. Where a warning is an error, the call changes nothing.
"""

import numpy as np

from skmtgp._data.complete import count_places
from skmtgp._data.labels import alike
from skmtgp._data.oddities import warn_of_alike, warn_of_copies
from skmtgp._data.outliers import FAR, FEWEST, warn_of_outliers
from skmtgp._support.guide import LEVELS
from skmtgp._support.warnings import warn
from skmtgp.exceptions import TaskUnitWarning

FEW = 5  # rows: fewer may well repeat others, or vary little
TOLD = 3  # rows that tell a deviation
LARGE = 10.0  # times the deviation of the others: another unit


def tell_rows(training, features, codes, Y):
    """Say what is odd about rows of tasks that the model knows.

    Parameters
    ----------
    training : Training
        The rows so far.
    features, codes, Y : ndarray
        The new ones, see :meth:`Training.with_rows`.
    """
    new = training.target.forward(Y)
    far = _are_far(training, codes, new)
    if far.any():
        warn_of_outliers(far, Y, codes, training.tasks)
    if len(Y) >= FEW:
        n_copies = _count_copies(training, features, codes, new)
        warn_of_copies(n_copies if 2 * n_copies > len(Y) else 0)


def _are_far(training, codes, Y):
    """Whether targets are many times as far from the median as all those so far."""
    far = np.zeros(Y.shape, dtype=bool)
    for task in np.unique(codes):
        known, rows = training.Y[training.codes == task], codes == task
        if len(known) < FEWEST:
            continue
        median = np.median(known, axis=0)
        distances = np.abs(known - median)
        varies = np.median(distances, axis=0) > 0.0
        far[rows] = varies & (np.abs(Y[rows] - median) > FAR * distances.max(axis=0))
    return far


def _count_copies(training, features, codes, Y):
    """How many new rows are there already, with the same target."""
    before = np.column_stack([training.features, training.Y])
    both = np.vstack([before, np.column_stack([features, Y])])
    n_before = count_places(before, training.codes)
    n_both = count_places(both, np.append(training.codes, codes))
    return len(Y) - (n_both - n_before)


def tell_label(label, tasks):
    """Say where a new label differs from one of the tasks in spaces or case alone."""
    warn_of_alike([of for of in alike([*tasks.tolist(), label]) if label in of])


def tell_unit(label, Y, usual, noise):
    """Say where a task seems to be in another unit than those that the model knows.

    Parameters
    ----------
    label : str or int
        Of the task.
    Y : ndarray of shape (n_samples, n_outputs)
        Its targets.
    usual : ndarray of shape (n_outputs,)
        Deviation of targets of the others around the level of their task.
    noise : ndarray of shape (n_outputs,)
        That of the noise alone.
    """
    if len(Y) < TOLD:
        return
    spread = Y.std(axis=0, ddof=1)
    ratio, small = (spread / usual).max(), (spread > 0.0) & (spread < noise / LARGE)
    if ratio <= LARGE and not (small.any() and len(Y) >= FEW):
        return
    what = f"varies {ratio:.2g} times as much as the other tasks"
    if ratio <= LARGE:
        what = (
            f"varies less than a tenth of the noise of the other tasks ({noise[0]:.2g})"
        )
    warn(
        f"Task {label!r} {what}, and the model has one unit for all tasks. Is it "
        "measured in another unit? Then convert its targets before it joins, or fit a "
        "model with normalize_y='per_task' to all rows. Otherwise its intervals hold "
        f"far too much or too little. {LEVELS}",
        TaskUnitWarning,
    )
