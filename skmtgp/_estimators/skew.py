"""Which inputs might better be logarithms: doses, times after an event, incomes."""

from itertools import permutations

import numpy as np
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, Product

from skmtgp._data.dask import is_dask
from skmtgp._data.labels import name_input
from skmtgp._data.skewness import is_skewed, share_far
from skmtgp._estimators.named_kernels import DEFAULT, LINEAR
from skmtgp._estimators.smoothness import as_named
from skmtgp._support.warnings import warn
from skmtgp.exceptions import SkewedInputWarning
from skmtgp.learning.log_inputs import gains_of_logarithms
from skmtgp.learning.transformed import SURE

MUCH = 0.2  # of the range of an input, that is far from all rows


def warn_of_skew(model, training, problems, modes, names):
    """Say which inputs might better be logarithms.

    Where the likelihood says clearly that one is not, nothing is said of it.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameter `kernel` says whether k^x may be another.
    training : Training
        What was learned from.
    problems : sequence of Problem
        Of each output.
    modes : sequence of Mode
        Their modes.
    names : list of str or None
        Of the inputs.
    """
    skewed, gained = set(), {}
    for problem, mode in zip(problems, modes, strict=True):
        X = problem.data.X
        if not (mode.converged and mode.n_iter) or is_dask(X):
            continue
        gains = _gains(model, training, problem, mode)
        far = inputs_far_apart(problem.prior, mode.theta, X)
        worse = {k for k, gain in gains.items() if gain < -SURE}
        skewed |= {k for k in far if is_skewed(X[:, k])} - worse
        if gains and max(gains.values()) > SURE:
            best = max(gains, key=gains.get)
            gained[best] = max(gains[best], gained.get(best, 0.0))
    for k in sorted(gained):
        _tell_gain(name_input(k, names), gained[k])
    tell_skewed(skewed - gained.keys(), names)


def _gains(model, training, problem, mode):
    """Nats that the logarithm of each skewed input gains; empty if it is not asked."""
    prior, n_inputs = problem.prior, problem.data.X.shape[1]
    if prior.n_terms > 1 or prior.trend is not None:
        return {}
    is_open, smooth = model._kernels() == [None], None
    if not is_open and _length_scales(prior, mode.theta, n_inputs) is None:
        return {}
    if is_open and training.kernel not in (DEFAULT, LINEAR):
        smooth = as_named(model, training, DEFAULT)
    return gains_of_logarithms(problem, mode, smooth)


def tell_skewed(skewed, names):
    """Say that the logarithms of these inputs might be better.

    Parameters
    ----------
    skewed : set of int
        Positions.
    names : list of str or None
        Of the inputs.
    """
    for k in sorted(skewed):
        name = name_input(k, names)
        warn(
            f"Rows are dense at small values of {name} and sparse at large ones. The "
            f"length-scale follows the small ones. So more than {MUCH:.0%} of its "
            "range is farther than a length-scale from all rows, and predictions there "
            f"return to the mean. Try the logarithm of {name}.",
            SkewedInputWarning,
        )


def _tell_gain(name, gain):
    """Say that the logarithm of an input is likelier."""
    warn(
        f"Along {name}, functions change fast at small values and slowly at large "
        "ones. One length-scale does not suit both: along its logarithm the functions "
        f"are likelier by {gain:.0f} nats. Try the logarithm of {name}.",
        SkewedInputWarning,
    )


def inputs_far_apart(prior, theta, X):
    """Inputs of which much of the range is farther than a length-scale from all rows.

    Parameters
    ----------
    prior : Prior
        The model. If its k^x has no length-scales, or a trend goes on, there are none.
    theta : ndarray of shape (n_theta,)
        Its parameters.
    X : ndarray of shape (n_samples, n_features)
        Training inputs.

    Returns
    -------
    far : list of int
        Their positions.
    """
    scales = _length_scales(prior, theta, X.shape[1])
    if scales is None:
        return []
    return [
        k
        for k, (x, scale) in enumerate(zip(X.T, scales, strict=True))
        if np.ptp(x) > 0.0 and share_far(x, scale) > MUCH
    ]


def _length_scales(prior, theta, n_features):
    """Of each input; None where k^x has no such numbers, or a trend goes on."""
    if prior.n_terms > 1 or prior.trend is not None:
        return None
    kernel = prior.kernel_at(theta)
    if isinstance(kernel, Product):
        for amplitude, other in permutations((kernel.k1, kernel.k2)):
            kernel = other if isinstance(amplitude, ConstantKernel) else kernel
    if type(kernel) not in (RBF, Matern):
        return None
    return np.broadcast_to(kernel.length_scale, n_features)
