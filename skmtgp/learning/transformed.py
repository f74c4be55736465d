"""Whether targets that are never negative are likelier on another scale."""

from dataclasses import replace

import numpy as np

from skmtgp.learning.climbing import climb

LEAST, MOST = 30, 2000  # rows that are asked: few gain as much by chance
SPAN = 4.0  # of the largest target over the smallest, beyond which it can matter
SURE = 10.0  # nats that another scale must gain to be told of
# How to give them to `target_transform`, functions, and logarithms of derivatives.
POSITIVE = {
    "(np.log, np.exp)": (np.log, lambda y: -np.log(y)),
    "(np.sqrt, np.square)": (np.sqrt, lambda y: -0.5 * np.log(4.0 * y)),
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
    scales = POSITIVE if y.min() > 0.0 else WITH_ZEROS
    gains = {
        name: _gain(problem, mode, y, groups, *scale) for name, scale in scales.items()
    }
    best = max(gains, key=gains.get)
    return best if gains[best] > SURE else ""


def _gain(problem, mode, y, groups, function, log_derivative):
    """Nats that a function of the targets gains, learned on from a mode.

    Each group keeps its mean and its deviation. The density is that of y.
    """
    moved, log_jacobian = problem.data.y.copy(), log_derivative(y)
    for own in (groups == group for group in np.unique(groups)):
        before, z = moved[own], function(y[own])
        if z.std() > 0.0:
            moved[own] = before.mean() + before.std() / z.std() * (z - z.mean())
            log_jacobian[own] += np.log(y[own].std() / z.std())
    other = problem.with_data(replace(problem.data, y=moved)).quickly()
    return climb(other, mode.theta).value - mode.value + log_jacobian.sum()
