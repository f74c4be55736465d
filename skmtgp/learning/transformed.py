"""Whether targets that are never negative are likelier on another scale."""

from dataclasses import replace

import numpy as np

from skmtgp._numerics.linalg import RESOLVED
from skmtgp.learning.climbing import climb

LEAST, MOST = 30, 2000  # rows that are asked: few gain as much by chance
SPAN = 4.0  # of the largest target over the smallest, beyond which it can matter
SURE = 10.0  # nats that another scale must gain to be told of
# How to give them to `target_transform`, functions, and logarithms of derivatives. Each
# is learned on from the one before: roots are halfway to logarithms.
POSITIVE = {
    "(np.sqrt, np.square)": (np.sqrt, lambda y: -0.5 * np.log(4.0 * y)),
    "(np.log, np.exp)": (np.log, lambda y: -np.log(y)),
}
WITH_ZEROS = {"(np.log1p, np.expm1)": (np.log1p, lambda y: -np.log1p(y))}


def likelier_scale(problem, mode, y, groups):
    """The scale on which targets are far likelier, if there is one.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.
    y : ndarray of shape (n_samples,)
        Its targets before they were centred and scaled.
    groups : ndarray of int of shape (n_samples,)
        Of each row the group that was centred and scaled by itself.

    Returns
    -------
    scale : str
        For `target_transform`. Empty if none is far likelier.
    """
    asks = problem.engine.exact and LEAST <= len(y) <= MOST and np.isfinite(mode.value)
    if not (asks and y.min() >= 0.0 and y.max() > SPAN * y.min()):
        return ""
    scales = WITH_ZEROS
    if y.min() > 0.0:
        y, scales = y / y.max(), POSITIVE  # their squares do not vanish
    gains, theta = {}, mode.theta
    for name, scale in scales.items():
        gains[name], theta = _gain(problem, mode, theta, y, groups, *scale)
    best = max(gains, key=gains.get)
    return best if gains[best] > SURE else ""


def _gain(problem, mode, theta, y, groups, function, log_derivative):
    """Nats that a function of the targets gains, learned on from theta, and where.

    Each group keeps its mean and its deviation. The density is that of y. Equal targets
    of a group have none, and stay as they are; so does the target of a group with one.
    """
    z, before, moved = function(y), problem.data.y, problem.data.y.copy()
    log_ratio, equal = np.full(len(y), np.nan), np.zeros(len(y), dtype=bool)
    for own in (groups == group for group in np.unique(groups)):
        if min(_spread(y[own]), _spread(z[own])) > RESOLVED:
            ratio = before[own].std() / z[own].std()
            moved[own] = before[own].mean() + ratio * (z[own] - z[own].mean())
            log_ratio[own] = np.log(y[own].std() / z[own].std())
        else:
            equal[own] = own.sum() > 1
    if np.isnan(log_ratio).all():
        return -np.inf, theta
    log_ratio[np.isnan(log_ratio)] = np.nanmean(log_ratio)  # as units of tasks are
    log_jacobian = np.where(equal, 0.0, log_derivative(y) + log_ratio)
    other = problem.with_data(replace(problem.data, y=moved)).quickly()
    found = climb(other, theta)
    return found.value - mode.value + log_jacobian.sum(), found.theta


def _spread(values):
    """Their range, relative to the largest."""
    return np.ptp(values) / max(np.abs(values).max(), np.finfo(np.float64).tiny)
