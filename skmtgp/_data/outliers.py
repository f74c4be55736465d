"""Targets that are far from all others of their task: codes for gaps, other units."""

import numpy as np

from skmtgp._data.labels import rows_by_code
from skmtgp._support.guide import NOISE
from skmtgp._support.warnings import warn
from skmtgp.exceptions import OutlierWarning

FEWEST = 10  # rows of a task: of fewer, one may well be far from the others
FAR = 20.0  # times as far from the median as the next one
SHARE = 10  # at most one row of so many is an outlier
CODES = 2  # values that may be in more rows, up to half of them, if they repeat
NAMED = 3  # in a warning
LOOK = (
    "Look at the rows where mean, std = loo_predict(include_noise=True) has "
    "abs(y - mean) > 4 * std. "
)


def far_off(Y, codes):
    """Whether each target is far from all others of its task, but a few like it.

    Distances from the median say so: they have a gap, beyond which they are many times
    as large. A failing sensor may give its code in up to half of the rows: many are
    beyond the gap only if they have one or two values that repeat. Where most targets
    of a task are equal, there is no scale to measure by.

    Parameters
    ----------
    Y : ndarray of shape (n_samples, n_outputs)
        Targets.
    codes : ndarray of shape (n_samples,)
        Task of each row, from 0.

    Returns
    -------
    far : ndarray of bool of shape (n_samples, n_outputs)
    """
    far = np.zeros(Y.shape, dtype=bool)
    for rows in rows_by_code(codes)[1]:
        if len(rows) >= FEWEST:
            distances = np.abs(Y[rows] - np.median(Y[rows], axis=0))
            far[rows] = distances > _reach(distances, Y[rows])
    return far


def _reach(distances, values):
    """The last distance before the gap, of each output; infinity without one."""
    order = np.lexsort((values, distances), axis=0)
    distances, values = (
        np.take_along_axis(of, order, axis=0) for of in (distances, values)
    )
    n, most = len(distances), (len(distances) - 1) // 2
    inner, outer = distances[n - most - 1 : -1], distances[n - most :]
    n_rows = np.arange(most, 0, -1)[:, None]  # from each distance on
    new = values[n - most :] != np.append(values[n - most + 1 :], [values[0]], axis=0)
    n_values = np.cumsum(new[::-1], axis=0)[::-1]
    few = (n_rows <= n // SHARE) | (n_values <= np.minimum(CODES, n_rows // 2))
    gap = (distances[n // 2] > 0.0) & few & (outer > FAR * inner)
    return np.where(gap, inner, np.inf).min(axis=0)


def warn_of_outliers(far, targets, codes, tasks):
    """Say which targets are far from all others, and what that does.

    Parameters
    ----------
    far : ndarray of bool of shape (n_samples, n_outputs)
        See `far_off`; there are some.
    targets : ndarray of the same shape
        As the user gave them.
    codes : ndarray of shape (n_samples,)
        Task of each row.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    """
    n, values = int(far.sum()), _listed(targets[far], codes[np.nonzero(far)[0]], tasks)
    subject = "targets are" if n > 1 else "target is"
    warn(
        f"{n} {subject} more than {FAR:g} times as far from the median of the task as "
        f"the others: {values}. The noise is assumed to be "
        "Gaussian, so the model may learn hardly anything else of the task. Is it a "
        "code for a missing value, another unit, or a sensor that failed? Leave such "
        "rows out, unless the values are right, as of a machine that is on or off. "
        "Where right values span several orders of magnitude, learn their "
        f"logarithms: target_transform=(np.log, np.exp). {NOISE}",
        OutlierWarning,
    )


def warn_of_unforeseen(values, codes, tasks, sizes, name, *, transformed=False):
    """Say which targets are far from what all other rows say, and what that does.

    Parameters
    ----------
    values : ndarray of shape (n_found,)
        As the user gave them, the farthest first.
    codes : ndarray of shape (n_found,)
        Task of each.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    sizes : ndarray of shape (n_found,)
        Standard deviations that each is off.
    name : str
        Of the output.
    transformed : bool, default=False
        Whether targets are learned on another scale, which `loo_predict` has not.
    """
    n = len(values)
    subject = f"{n} targets of {name} are" if n > 1 else f"A target of {name} is"
    most = f"up to {sizes[0]:.1f}" if n > 1 else f"{sizes[0]:.1f}"
    warn(
        f"{subject} {most} standard deviations from what all other rows say: "
        f"{_listed(values, codes, tasks)}. The noise is assumed to be Gaussian, so "
        "such rows raise it, and pull functions towards themselves. They may also hide "
        f"others. {'' if transformed else LOOK}Leave out those that are wrong, fit "
        f"again, and repeat that until there are none. {NOISE}",
        OutlierWarning,
    )


def _listed(values, codes, tasks):
    """Some targets in words, each with its task if there are several."""
    names = [f" of task {label!r}" for label in tasks[codes].tolist()]
    found = zip(values, names, strict=True)
    words = [f"{value:.10g}{name * (len(tasks) > 1)}" for value, name in found]
    words = list(dict.fromkeys(words))
    more = f" and {len(words) - NAMED} more" * (len(words) > NAMED)
    return f"{', '.join(words[:NAMED])}{more}"
