"""Kernels that estimators take by name, scaled to the features as the default is."""

from functools import reduce
from operator import mul

import numpy as np
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared, Kernel, Matern

from skmtgp._data.dask import is_dask
from skmtgp._data.statistics import (
    deviation_of,
    least_gap,
    mean_of,
    shortest_period,
    varying,
)
from skmtgp._data.task_column import locate_column
from skmtgp._support.sklearn_compat import StrOptions
from skmtgp.kernels import ARDLinear, Columns

DEFAULT, LINEAR = "rbf", "linear"
SMOOTHNESS = [DEFAULT, "matern52", "matern", "exponential"]  # ever less, default first
BOUNDS = np.array([1e-2, 1e3])  # of a length-scale, relative to where it starts
# A period starts at half the width of features that are spread evenly. It is never
# shorter than twice the smallest gap, which repeats whatever a longer one does.
PERIOD, LONGEST, SHORTEST = np.sqrt(3.0), 1e2, 1e-3
LEAST = 3e-153  # scale whose square has an inverse


def _rbf(scale, features):
    return RBF(scale, np.multiply.outer(scale, BOUNDS))


def _matern(nu):
    def make(scale, features):
        return Matern(scale, np.multiply.outer(scale, BOUNDS), nu=nu)

    return make


def _periodic(scale, features):
    """A product of one for each feature, for it is a covariance on one alone."""
    parts = [_along(scale, features, d) for d in range(len(scale))]
    if len(parts) == 1:
        return parts[0]
    return reduce(mul, (Columns(part, [d]) for d, part in enumerate(parts)))


def _along(scale, features, d):
    """Periodic along a feature, unless that has no three different values."""
    root, period = np.sqrt(len(scale)), PERIOD / np.sqrt(len(scale)) * scale[d]
    shortest = SHORTEST * period
    if not is_dask(features):
        column = np.asarray(features[:, d])
        gap = least_gap(column)
        if np.ptp(column) < 1.5 * gap or gap == 0.0:
            return RBF(scale[d], scale[d] * BOUNDS)
        shortest = max(shortest_period(column), shortest)
    period = max(period, shortest)
    return ExpSineSquared(root, period, root * BOUNDS, (shortest, LONGEST * period))


def _linear(scale, features):
    """Slopes of the size of a deviation, and a value at the mean."""
    weights, wide = np.maximum(scale, LEAST) ** -2.0, np.array([1e-7, 1e3])
    center = mean_of(features)
    return ARDLinear(
        weights, 1.0, np.multiply.outer(weights, wide), tuple(wide), center
    )


KERNELS = {
    "rbf": _rbf,
    "exponential": _matern(0.5),
    "matern": _matern(1.5),
    "matern52": _matern(2.5),
    "periodic": _periodic,
    "linear": _linear,
}
KERNEL = Kernel, StrOptions(set(KERNELS)), None  # what a parameter `kernel` may be


def with_positions(kernel, names):
    """A kernel that has positions of columns where the user gave names.

    Parameters
    ----------
    kernel : Kernel
        Is changed, where it has `Columns` with names.
    names : callable
        Gives the names of the features, without the task column; None without names.

    Returns
    -------
    kernel : Kernel
        The one that was passed.

    Raises
    ------
    ValueError
        If there is no such feature.
    """
    for part in [kernel, *kernel.get_params().values()]:
        if isinstance(part, Columns) and _has_names(part.columns):
            known = names()
            part.columns = [_position(one, known) for one in part.columns]
    return kernel


def _position(column, names):
    if not isinstance(column, str):
        return column
    return locate_column(column, None, names, "columns of the kernel")


def _has_names(columns):
    listed = isinstance(columns, (list, tuple, np.ndarray))
    return listed and any(isinstance(one, str) for one in columns)


def named_kernel(name, features, *, alike=False):
    """A kernel scaled to the features.

    Parameters
    ----------
    name : str
        One of `KERNELS`.
    features : ndarray of shape (n_samples, n_features)
        Training inputs.
    alike : bool, default=False
        Whether all features have one length-scale. Not of a periodic kernel.

    Returns
    -------
    kernel : Kernel
        Length-scales start at the square root of n_features times the standard
        deviation of their feature, between a hundredth and a thousand times that. A
        common one starts at the root of the sum of all variances.
    """
    deviation = deviation_of(features)
    varies = varying(features, deviation)
    if alike:
        scale = float(np.linalg.norm(deviation[varies])) or 1.0
    else:
        scale = np.where(varies, deviation, 1.0) * np.sqrt(features.shape[1])
    return KERNELS[name](scale, features)
