"""Measurements that were repeated at the same inputs."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

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
    ValueError
        If y has another number of rows than X, or is not finite.

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
    table = pd.DataFrame(np.asarray(X) if not hasattr(X, "iloc") else X)
    Y = np.asarray(y, dtype=np.float64)
    if Y.ndim not in (1, 2) or len(Y) != len(table):
        raise ValueError(
            f"y has shape {Y.shape}, but X has {len(table)} rows: give a target, or a "
            "row of them, for each."
        )
    if not np.isfinite(Y).all():
        raise ValueError("y must be finite: leave out rows that were not measured.")
    columns = list(range(table.shape[1]))
    codes = table.set_axis(columns, axis=1).groupby(columns, sort=False, dropna=False)
    codes = codes.ngroup().to_numpy()
    first = np.unique(codes, return_index=True)[1]
    counts = np.bincount(codes).astype(np.float64)
    means = _means(codes, Y, counts)
    variances = _means(codes, np.square(Y - means[codes]), counts)
    X = X.iloc[first] if hasattr(X, "iloc") else np.asarray(X)[first]
    return X, _like(y, first, means), counts, variances


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
