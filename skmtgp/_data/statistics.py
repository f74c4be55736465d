"""Statistics of the columns of many rows."""

import numpy as np
from sklearn.preprocessing import StandardScaler
from sklearn.utils import gen_batches

from skmtgp._data.dask import is_dask
from skmtgp._numerics.linalg import RESOLVED

AT_ONCE = 100_000  # of which the standard deviation is taken at once


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


def varying(values, deviation):
    """Which columns, of such standard deviations, vary by more than rounding."""
    return deviation > RESOLVED * largest_of(values)


def _scaler_of(values):
    scaler = StandardScaler()
    for rows in gen_batches(len(values), AT_ONCE):
        scaler.partial_fit(values[rows])
    return scaler
