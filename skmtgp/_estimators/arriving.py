"""What looks like a mistake in rows and tasks that join a fitted model.

They cannot be taken out again. Where a warning is an error, the call changes nothing.
"""

import numpy as np

from skmtgp._data.complete import count_copies
from skmtgp._data.labels import alike
from skmtgp._data.oddities import warn_of_alike
from skmtgp._data.outliers import FAR, FEWEST, far_off, warn_of_outliers
from skmtgp._estimators.reading import looks_for_copies
from skmtgp._support.guide import LEVELS
from skmtgp._support.warnings import warn
from skmtgp.exceptions import RepeatedRowsWarning, TaskUnitWarning

FEW = 5  # rows: fewer may well repeat others, or vary little
TOLD = 3  # rows that tell a deviation
LARGE = 10.0  # times the deviation of the others: another unit


def tell_rows(model, training, features, codes, Y):
    """Say what is odd about rows of tasks that the model knows.

    Parameters
    ----------
    model : FittedGP
        Without these rows.
    training : Training
        Its rows.
    features, codes, Y : ndarray
        The new ones, see :meth:`Training.with_rows`.
    """
    new = training.target.forward(Y)
    far = _are_far(training, codes, new)
    if far.any():
        rows = far.any(axis=1)
        far[rows] &= _are_unforeseen(model, features[rows], codes[rows], new[rows])
    if far.any():
        warn_of_outliers(far, Y, codes, training.tasks)
    if len(Y) >= FEW and looks_for_copies(model, training.Y):
        if training.descriptors is not None:
            features = training.descriptors.inputs(features)
        n_copies = _count_known(training, features, codes, new)
        if 2 * n_copies > len(Y):
            _warn_of_batch(n_copies, len(Y))


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


def _are_unforeseen(model, features, codes, Y):
    """Whether targets are many deviations from what the model predicts."""
    variances = model._variances(features, codes, include_noise=True)
    return np.abs(Y - model._means(features, codes)) > FAR * np.sqrt(variances)


def _count_known(training, features, codes, Y):
    """How many new rows are there already; 0 if equal inputs have different targets."""
    before = training.features, training.codes, training.Y
    new = features, codes, Y
    both = [np.concatenate(pair) for pair in zip(before, new, strict=True)]
    n_copies = count_copies(*both)
    return n_copies - count_copies(*before) if n_copies else 0


def _warn_of_batch(n_copies, n):
    warn(
        f"{n_copies} of {n} rows are there already, with the same targets. Was the "
        "batch sent twice? Each then counts twice, and standard deviations of "
        "predictions become too small.",
        RepeatedRowsWarning,
    )


def tell_task(training, label, Y, known=None):
    """Say what is odd about a task that joins: its label, or some of its targets.

    Parameters
    ----------
    training : Training
        The rows so far.
    label : str or int
        Of the task.
    Y : ndarray of shape (n_samples, n_outputs)
        Targets of the task, not transformed.
    known : Known, default=None
        What is known of their noise: no targets are odd then.
    """
    tasks = training.tasks.tolist()
    warn_of_alike([of for of in alike([*tasks, label]) if label in of])
    alone = np.zeros(len(Y), dtype=int)
    far = far_off(training.target.forward(Y), alone)
    if known is None and far.any():
        warn_of_outliers(far, Y, alone, np.array([label]))


def tell_unit(label, Y, largest, least_noise):
    """Say where a task seems to be in another unit than those that the model knows.

    Parameters
    ----------
    label : str or int
        Of the task.
    Y : ndarray of shape (n_samples, n_outputs)
        Its targets.
    largest : ndarray of shape (n_outputs,)
        Deviation of targets around their level, of the task that varies most.
    least_noise : ndarray of shape (n_outputs,)
        That of the noise alone, of the task with the least.
    """
    if len(Y) < TOLD:
        return
    far = far_off(Y, np.zeros(len(Y), dtype=int))
    spread = np.nanstd(np.where(far, np.nan, Y), axis=0, ddof=1)
    large = spread > LARGE * largest
    small = (len(Y) >= FEW) & (spread > 0.0) & (spread < least_noise / LARGE)
    for j in np.flatnonzero(large | small):
        what = f"varies {spread[j] / largest[j]:.2g} times as much as any other task"
        if small[j]:
            what = f"varies less than a tenth of the noise, {least_noise[j]:.2g}"
        which = f" in output {j + 1}" * (len(spread) > 1)
        warn(
            f"Task {label!r} {what}{which}, and the model has one unit for all tasks. "
            "Is it measured in another unit? Then convert its targets before it joins, "
            "or fit a model with normalize_y='per_task' to all rows. Otherwise its "
            f"intervals hold far too much or too little. {LEVELS}",
            TaskUnitWarning,
        )
