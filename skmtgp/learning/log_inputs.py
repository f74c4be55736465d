"""Whether functions are likelier along the logarithms of skewed inputs."""

from dataclasses import replace

import numpy as np

from skmtgp._data.skewness import is_skewed, logarithm
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.climbing import climb
from skmtgp.learning.problem import best_of
from skmtgp.learning.screening import with_kernel
from skmtgp.learning.transformed import LEAST, MOST


def gains_of_logarithms(problem, mode, smooth=None):
    """Nats that the logarithm of each skewed input gains, learned on from a mode.

    The logarithm gets the mean and the deviation of the input, so the hyperparameters
    that were learned are a start. A kernel that is rough along the input may be smooth
    along its logarithm.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory, of one term.
    mode : Mode
        Its mode.
    smooth : Kernel, default=None
        Another k^x that may be taken.

    Returns
    -------
    gains : dict of int to float
        Of positions of inputs. Empty where rows are few or very many.
    """
    X = problem.data.X
    asks = problem.engine.exact and LEAST <= len(X) <= MOST and np.isfinite(mode.value)
    if not asks:
        return {}
    with limit_threads(len(X)):
        return {
            k: _gain(problem, mode, k, smooth)
            for k in range(X.shape[1])
            if is_skewed(X[:, k])
        }


def _gain(problem, mode, k, smooth):
    """Nats that the logarithm of an input gains, with k^x or another."""
    X = problem.data.X.copy()
    X[:, k] = logarithm(X[:, k])
    other = problem.with_data(replace(problem.data, X=X)).quickly()
    found = best_of([climb(other, theta) for theta in _starts(other, mode.theta, k)])
    best = found.value
    if smooth is not None:
        best = max(best, with_kernel(other, found, smooth)[1].value)
    return float(best - mode.value)


def _starts(problem, theta, k):
    """What was learned, and the same with the usual length-scale of an input.

    A length-scale that suits small values alone hides the logarithm's gain.
    """
    scales = np.flatnonzero(problem.prior.of_length_scales)
    again = scales[[k]] if len(scales) == problem.data.X.shape[1] else scales
    usual = theta.copy()
    usual[again] = problem.theta()[again]
    return theta, usual
