"""The columns of a trend: columns of X, or what a transformer makes of them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, TransformerMixin, clone

from skmtgp._data.task_column import locate_columns

NAMED = "constant", "linear"


@dataclass(frozen=True)
class TrendColumns:
    """How the columns h(x) of a trend are made of inputs.

    Attributes
    ----------
    columns : ndarray of shape (n_trend,), default=None
        Which inputs they are; the others come from the transformer.
    transformer : transformer, default=None
        Fitted.
    constant : bool, default=False
        Whether a column of ones comes first.
    names : tuple of str
        Names of the columns.
    inputs : tuple of str, default=None
        Names of the inputs that the transformer was fitted with, if it was with any.
    """

    columns: np.ndarray | None = None
    transformer: Any = None
    constant: bool = False
    names: tuple = ()
    inputs: tuple | None = None

    def __len__(self):
        return len(self.names)

    def __call__(self, X):
        """h(x) of rows of inputs, of shape (n_samples, n_trend)."""
        if self.transformer is not None:
            return _transformed(self.transformer, _named(X, self.inputs))
        found = X[:, self.columns]
        return np.column_stack([np.ones(len(X)), found]) if self.constant else found


class ReadTrend(TransformerMixin, BaseEstimator):
    """A trend that was read already, in the form that estimators take it.

    Parameters
    ----------
    columns : TrendColumns
        How its columns are made of inputs.
    """

    def __init__(self, columns):
        self.columns = columns

    def fit(self, X, y=None):
        """Nothing is left to learn."""
        return self

    def transform(self, X):
        """h(x) of rows of inputs, of shape (n_samples, n_trend)."""
        return self.columns(X)

    def get_feature_names_out(self, input_features=None):
        """Names of the columns."""
        return np.array(self.columns.names, dtype=object)


def read_trend(trend, X, position, names, feature_names, descriptors=None):
    """The columns that the user asks for.

    Parameters
    ----------
    trend : {"constant", "linear"}, sequence of int or str, or transformer
        The parameter.
    X : ndarray of shape (n_samples, n_inputs)
        X without the task column and the descriptors.
    position : int
        That of the task column.
    names : ndarray of shape (n_features - 1,)
        Names or positions of the columns of X without the task's.
    feature_names : ndarray of shape (n_features,) or None
        Names of all, if they have any.
    descriptors : ndarray of shape (n_descriptors,), default=None
        Positions of the descriptors among `names`.

    Returns
    -------
    columns : TrendColumns

    Raises
    ------
    TypeError, ValueError
        If a column cannot be one of the trend, or the transformer cannot be used.
    """
    kept = np.arange(len(names))
    if descriptors is not None:
        kept = np.delete(kept, descriptors)
    called = np.array([_called(name) for name in names.tolist()], dtype=object)
    inputs = tuple(called[kept])
    if isinstance(trend, str):
        columns = kept if trend == "linear" else kept[:0]
        named = "1", *called[columns]
        return TrendColumns(np.searchsorted(kept, columns), None, True, named)
    if hasattr(trend, "transform"):
        return _fitted(trend, X, inputs, feature_names is not None)
    why = "a label has no trend. With trend_per_task=True each task has its own."
    found = locate_columns(trend, "trend", position, len(names) + 1, feature_names, why)
    described = ~np.isin(found, kept)
    if described.any():
        raise ValueError(
            f"trend={list(trend)!r} has {names[found[described][0]]!r}, which is one "
            "of the task_descriptors, and no input. Name it in one of the two."
        )
    return TrendColumns(np.searchsorted(kept, found), names=tuple(called[found]))


def _called(name):
    """The name of a column, or of one at a position, as scikit-learn calls it."""
    return name if isinstance(name, str) else f"x{name}"


def _fitted(transformer, X, called, named):
    """Columns that a clone of the transformer makes, fitted to the inputs."""
    fitted, inputs = clone(transformer), called if named else None
    with_names = _named(X, inputs)
    try:
        fitted.fit(with_names)
        found = _transformed(fitted, with_names)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"trend={transformer!r} does not take the inputs, which are X without the "
            f"task column: {error}"
        ) from error
    try:
        names = fitted.get_feature_names_out(called)
    except (AttributeError, TypeError, ValueError):
        names = range(found.shape[1])
    return TrendColumns(transformer=fitted, names=tuple(map(str, names)), inputs=inputs)


def _named(X, names):
    return X if names is None else pd.DataFrame(X, columns=list(names))


def _transformed(transformer, X):
    """What the transformer makes of inputs, checked."""
    found = transformer.transform(X)
    found = found.toarray() if hasattr(found, "toarray") else found
    found = np.asarray(found, dtype=np.float64)
    if found.ndim != 2 or len(found) != len(X) or not found.shape[1]:
        raise ValueError(
            f"trend={transformer!r} makes an array of shape {found.shape} of "
            f"{len(X)} rows; it must be (n_samples, n_trend)."
        )
    bad = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if bad.size:
        raise ValueError(
            f"trend={transformer!r} makes {found[bad[0]].tolist()} of row {bad[0]}; "
            "the columns of a trend must be finite."
        )
    return found
