"""Statistics of the columns of many rows."""

import numpy as np
from sklearn.preprocessing import StandardScaler
from sklearn.utils import gen_batches

from skmtgp._data.dask import is_dask
from skmtgp._numerics.linalg import RESOLVED

AT_ONCE = 100_000  # of which the standard deviation is taken at once
# Values are evenly spread if more than this share of gaps is off a multiple by less.
EVEN, OFF = 0.8, 0.1
TOLD = 5.0  # shortest periods, of values that are not, in the mean gap


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
    values = np.unique(column)
    gaps = np.diff(values)
    gaps = gaps[gaps > RESOLVED * np.abs(values).max(initial=0.0)]
    return float(gaps.min(initial=np.inf)) if len(gaps) else 0.0


def shortest_period(column):
    """The shortest period to look for in the values of a column.

    It is two of the smallest gaps: where values are evenly spread, but for some that
    are missing, shorter ones repeat what longer ones do. Others tell shorter ones, too.
    """
    gap, gaps = least_gap(column), np.diff(np.unique(column))
    if gap == 0.0:
        return 0.0
    steps = gaps / np.median(gaps[gaps < 1.5 * gap])
    if np.mean(np.abs(steps - np.rint(steps)) < OFF) > EVEN:
        return 2.0 * gap
    return min(2.0 * gap, gaps.mean() / TOLD)


def varying(values, deviation):
    """Which columns, of such standard deviations, vary by more than rounding."""
    return deviation > RESOLVED * largest_of(values)


def _scaler_of(values):
    scaler = StandardScaler()
    for rows in gen_batches(len(values), AT_ONCE):
        scaler.partial_fit(values[rows])
    return scaler
