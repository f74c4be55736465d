"""Statistics of the columns of many rows."""

import numpy as np
from sklearn.preprocessing import StandardScaler
from sklearn.utils import gen_batches

from skmtgp._data.dask import is_dask
from skmtgp._numerics.linalg import RESOLVED

AT_ONCE = 100_000  # of which the standard deviation is taken at once
# Values are evenly spread if most gaps, at least this share, are multiples of one step,
EVEN = 0.8
OFF = 0.1  # but for this share of a step.
IN_A_GAP = 5.0  # periods in the mean gap that are looked for in values that are not


def largest_of(values):
    """The largest absolute value of each column, without an array of them all."""
    return np.asarray(np.maximum(values.max(axis=0), -values.min(axis=0)))


def mean_of(values):
    """Mean of each column; of many rows, a part at a time."""
    if len(values) <= AT_ONCE or is_dask(values):
        return np.asarray(values.mean(axis=0))
    return _scaler_of(values).mean_


def deviation_of(values):
    """Standard deviation of each column; of many rows, a part at a time."""
    if len(values) <= AT_ONCE or is_dask(values):
        return np.asarray(values.std(axis=0))
    return np.sqrt(_scaler_of(values).var_)


def least_gap(column):
    """The smallest gap between different values of a column; 0 if all are equal."""
    gaps = _gaps_between(column)
    return float(gaps.min()) if len(gaps) else 0.0


def _gaps_between(column):
    """Between neighbouring values that differ by more than rounding."""
    values = np.unique(column)
    gaps = np.diff(values)
    return gaps[gaps > RESOLVED * np.abs(values).max(initial=0.0)]


def shortest_period(column):
    """The shortest period to look for in the values of a column.

    It is two of the smallest gaps: where values are evenly spread, but for some that
    are missing, shorter ones repeat what longer ones do. Others tell shorter ones, too.
    """
    gaps = _gaps_between(column)
    if not len(gaps):
        return 0.0
    least = gaps.min()
    steps = gaps / np.median(gaps[gaps < 1.5 * least])
    if np.mean(np.abs(steps - np.rint(steps)) < OFF) >= EVEN:
        return float(2.0 * least)
    return float(min(2.0 * least, gaps.mean() / IN_A_GAP))


def varying(values, deviation):
    """Which columns, of such standard deviations, vary by more than rounding."""
    return deviation > RESOLVED * largest_of(values)


def _scaler_of(values):
    scaler = StandardScaler()
    for rows in gen_batches(len(values), AT_ONCE):
        scaler.partial_fit(values[rows])
    return scaler
