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
    least = values[1] if values[0] == 0.0 else 0.0  # as zero has no logarithm
    scaled, least = x / values[-1], least / values[-1]
    if scaled.min() + least == 0.0:  # too small beside the largest
        return False
    raw, of_log = skew(scaled), skew(np.log(scaled + least))
    return bool(raw > LARGE and abs(of_log) < 0.5 * raw)


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
