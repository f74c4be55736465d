"""Measurements that were repeated at the same inputs."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from skmtgp._data.dask import refuse_dask
from skmtgp._data.numbers import as_frame, check_numbers
from skmtgp._data.order import refuse_another_order

__all__ = ["average_repeats"]


def average_repeats(
    X: ArrayLike, y: ArrayLike
) -> tuple[
    NDArray | pd.DataFrame,
    NDArray[np.float64] | pd.Series | pd.DataFrame,
    NDArray[np.float64],
    NDArray[np.float64],
]:
    """Average all measurements of a task at the same inputs into one row.

    A Gaussian process needs only the mean, the number and the variance of repeated
    measurements. ``fit(X, y, sample_weight=..., repeat_variance=...)`` has the same
    likelihood and posterior as a fit to all rows, and takes less time.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_features)
        Inputs, with the task column. Rows are repeats if all columns are equal.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Targets.

    Returns
    -------
    X : ndarray or DataFrame of shape (n_distinct, n_features)
        The distinct rows, in the order in which they come first.
    y : ndarray, Series or DataFrame of shape (n_distinct[, n_outputs])
        Means of their targets.
    sample_weight : ndarray of shape (n_distinct,)
        How many rows each stands for.
    repeat_variance : ndarray of the shape of y
        Variance of their targets, the sum of squares divided by their number.

    Raises
    ------
    TypeError
        If X or y is a Dask collection.
    ValueError
        If X is no table, or has no rows, or if y has another number of rows, or is not
        finite.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import PooledGP, average_repeats
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.integers(0, 7, 200), rng.integers(0, 2, 200)
    >>> X, y = np.column_stack([x, task]), np.sin(x) + 0.3 * rng.standard_normal(200)
    >>> X_few, y_few, counts, variance = average_repeats(X, y)
    >>> len(X_few), int(counts.sum())
    (14, 200)
    >>> model = PooledGP(normalize_y="shared")
    >>> few = model.fit(X_few, y_few, sample_weight=counts, repeat_variance=variance)
    >>> value = few.log_marginal_likelihood_value_
    >>> all_rows = model.fit(X, y)
    >>> bool(np.isclose(value, all_rows.log_marginal_likelihood(few.theta_)))
    True
    """
    for name, data in (("X", X), ("y", y)):
        refuse_dask(name, data, "Collect them first, with compute().")
    refuse_another_order(X, y)
    X = as_frame(X)
    table = _table(X)
    Y = check_numbers(y, "y")
    if Y.ndim not in (1, 2) or len(Y) != len(table):
        raise ValueError(
            f"y has shape {Y.shape}, but X has {len(table)} rows: give a target, or a "
            "row of them, for each."
        )
    columns = list(range(table.shape[1]))
    codes = table.set_axis(columns, axis=1).groupby(columns, sort=False, dropna=False)
    codes = codes.ngroup().to_numpy()
    first = np.unique(codes, return_index=True)[1]
    counts = np.bincount(codes).astype(np.float64)
    means = _means(codes, Y, counts)
    variances = _means(codes, np.square(Y - means[codes]), counts)
    X = X.iloc[first] if table is X else np.asarray(X)[first]
    return X, _like(y, first, means), counts, variances


def _table(X):
    """X as a frame."""
    if isinstance(X, pd.DataFrame) and len(X):
        return X
    array = np.asarray(X)
    if array.ndim != 2 or not len(array):
        raise ValueError(
            f"X has shape {array.shape}: give a table of one row or more, with the "
            "column of the tasks."
        )
    return pd.DataFrame(array)


def _means(codes, Y, counts):
    """Means of the rows of each code."""
    sums = [np.bincount(codes, of) for of in Y.reshape(len(Y), -1).T]
    return (np.array(sums) / counts).T.reshape(len(counts), *Y.shape[1:])


def _like(y, first, means):
    """The means as pandas' object where y is one, with the index of the first rows."""
    if isinstance(y, pd.Series):
        return pd.Series(means, y.index[first], name=y.name)
    if isinstance(y, pd.DataFrame):
        return pd.DataFrame(means, y.index[first], y.columns)
    return means
