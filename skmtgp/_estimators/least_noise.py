"""Noise that is there at least, where learning would lose it.

Rounding adds an error to targets. A task whose targets are all equal looks as if there
were no noise at all. Both make the noise of all tasks vanish: the less there is, the
likelier are targets that are equal.
"""

from dataclasses import replace

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._data.rounding import variance_of_rounding
from skmtgp.inference.left_out import errors_left_out
from skmtgp.learning.climbing import climb

NOISE_BOUNDS = (1e-10, 1e3)  # the default; other bounds hold alone
EXACT = 0.1  # of the variance of rounding: errors of rows that are left out are larger
SURE = 8.0  # nats that noise gains, if it is there
SURELY = 0.25  # of what a small model takes for noise
FASTER = np.log([1.0, 0.5, 0.25])  # length-scales of functions that explain the noise


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
    hidden = training.constants.any(axis=0) & ~training.constants.all(axis=0)
    hidden &= training.noise == "shared"
    if not (rounding.any() or hidden.any()):
        return training
    least, scales = np.zeros_like(rounding), training.units.scale.max(axis=1)
    for j, (problem, mode) in enumerate(learn()):
        if rounding[j] and not _is_exact(problem, mode, rounding[j] / scales[j] ** 2):
            least[j] = rounding[j]
        if hidden[j]:
            least[j] = max(least[j], _noise_of_others(problem, mode) * scales[j] ** 2)
    return replace(training, least_noise=least) if least.any() else training


def _is_exact(problem, mode, variance):
    """Whether rows that are left out are predicted better than rounding would let."""
    errors = errors_left_out(problem, mode.theta, np.arange(len(problem.data)))
    return np.square(errors).mean() < EXACT * variance


def _noise_of_others(problem, mode):
    """Part of the noise variance of the other tasks; zero if it may be a function."""
    prior, likelihood = problem.prior, problem.likelihood()
    low, is_scale = prior.log_noise_bounds[0], prior.n_length_scales > 0
    theta = np.where(prior.of_noise, low, mode.theta)
    starts = [np.clip(theta + log * is_scale, *prior.bounds()) for log in FASTER]
    none = replace(prior, log_noise=low, log_noise_bounds=(low, low))
    none = replace(problem, prior=none)
    exact = climb(none, max(starts, key=likelihood.value), relaxed=True)
    if problem.log_likelihood(mode) < none.log_likelihood(exact) + SURE:
        return 0.0
    return SURELY * float(np.exp(prior.log_noise_at(mode.theta)).mean())
