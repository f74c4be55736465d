"""Inputs with many small values and a few large ones, such as doses and times."""

import numpy as np
from scipy.stats import skew

LARGE = 1.1  # skewness, of which logarithms must take away half
FEWEST = 5  # values that differ


def is_skewed(x):
    """Whether an input is positive and skewed, and its logarithm much less so.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Values of an input. A few may be zero.

    Returns
    -------
    skewed : bool
    """
    values = np.unique(x)
    if len(values) < FEWEST or values[0] < 0.0 or not np.isfinite(values[-1]):
        return False
    scaled = _from_zero(x)
    if scaled.min() == 0.0:  # too small beside the largest
        return False
    raw, of_log = skew(x / values[-1]), skew(np.log(scaled))
    return bool(raw > LARGE and abs(of_log) < 0.5 * raw)


def logarithm(x):
    """The logarithm of a skewed input, with its mean and deviation.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        See :func:`is_skewed`.

    Returns
    -------
    z : ndarray of shape (n_samples,)
    """
    z = np.log(_from_zero(x))
    return x.mean() + (z - z.mean()) * (x.std() / z.std())


def _from_zero(x):
    """Over the largest value; if there are zeros, the least above them is added."""
    least = x[x > 0.0].min() if x.min() == 0.0 else 0.0
    return x / x.max() + least / x.max()


def share_far(x, distance):
    """Share of the range of an input that is farther than a distance from all rows.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Values that differ.
    distance : float
        In the units of x.

    Returns
    -------
    share : float
        Between 0 and 1.
    """
    gaps = np.diff(np.unique(x))
    return float(np.maximum(gaps - 2.0 * distance, 0.0).sum() / gaps.sum())
