"""Noise that is there at least, where learning would lose it.

Rounding adds an error to targets, but makes the noise vanish: the less there is, the
likelier are targets that are equal.
"""

from dataclasses import replace

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._data.rounding import variance_of_rounding
from skmtgp.inference.left_out import errors_left_out

NOISE_BOUNDS = (1e-10, 1e3)  # the default; other bounds hold alone
EXACT = 0.1  # of the variance of rounding: errors of rows that are left out are larger


def with_least_noise(model, training, learn):
    """The training data with the noise variance that each output has at least.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Nothing is asked if it is the paper's, or has other bounds than the default's.
    training : Training
        With units.
    learn : callable
        Returns the problem and the mode of each output of a small model of them, from
        which tasks that are constant are left out.

    Returns
    -------
    training : Training
        The same if there is nothing to say.
    """
    given = not np.array_equal(model.noise_variance_bounds, NOISE_BOUNDS)
    of_paper = getattr(model, "learning", "annealed") != "annealed"
    if given or of_paper or model.max_iter == 0 or is_dask(training.Y):
        return training
    rounding = np.zeros(training.Y.shape[1])
    if training.known is None:  # means of measurements are no multiples of a step
        rows = training.features, training.codes, training.Y
        rounding = variance_of_rounding(*rows)
    if not rounding.any():
        return training
    least, scales = np.zeros_like(rounding), training.units.scale.max(axis=1)
    for j, (problem, mode) in enumerate(learn()):
        if rounding[j] and not _is_exact(problem, mode, rounding[j] / scales[j] ** 2):
            least[j] = rounding[j]
    return replace(training, least_noise=least) if least.any() else training


def _is_exact(problem, mode, variance):
    """Whether rows that are left out are predicted better than rounding would let."""
    errors = errors_left_out(problem, mode.theta, np.arange(len(problem.data)))
    return np.square(errors).mean() < EXACT * variance
