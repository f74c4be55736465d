"""Targets that are transformed before they are learned, and the way back to y."""

from collections.abc import Callable
from contextlib import contextmanager

import numpy as np
from sklearn import config_context
from sklearn.base import TransformerMixin, clone
from sklearn.preprocessing import FunctionTransformer

from skmtgp._data.dask import is_dask
from skmtgp._numerics.mixtures import moments
from skmtgp._support.warnings import quiet

TargetTransform = TransformerMixin | tuple[Callable, Callable] | None

LOST = 1e-4  # of the targets' range, that a way there and back may be off
ROUNDING = 1e-12  # of the transformed targets' range
LARGEST = 1e150  # the squares of larger numbers overflow
# How far beyond the transformed targets, in multiples of their range, it is looked
# where the inverse ends; and how far beyond the targets, in multiples of theirs, it
# ends at a pole, beside which there is no deviation.
BEYOND, FAR, STEPS = 10.0, 20.0, 400
NEAR, HALVINGS = 1e-6, 60
# Of differences that tell slopes, in multiples of the transformed range, and how large
# a part of a value that is taken to be at least
STEP, LEAST_STEP = 1e-5, 1e-3


class AsGiven:
    """Targets that are learned as they are: what is predicted is in their units."""

    def forward(self, Y):
        """Targets as they are learned, (n_samples, n_outputs)."""
        return Y

    def with_slopes(self, Y):
        """Targets as they are learned, and log slopes of the way there.

        These are what a log density has more in units of y.
        """
        return Y, np.zeros_like(Y)

    def back(self, values):
        """Values of f or of observations in units of y, (..., n_outputs)."""
        return values

    def variances(self, model, features, codes, include_noise):
        """Variances of f or of observations, (n_samples, n_outputs)."""
        return model._variances(features, codes, include_noise)

    def covariances(self, model, features, codes, include_noise):
        """Covariances, (n_samples, n_samples, n_outputs)."""
        return model._covariances(features, codes, include_noise)

    def left_out(self, model, include_noise):
        """Training samples given the others: predictions and standard deviations."""
        return model._leave_out(include_noise)


AS_GIVEN = AsGiven()


class Transformed(AsGiven):
    """Targets that are learned through a monotone map of each output.

    Parameters
    ----------
    columns : list of n_outputs Column
        The maps.
    """

    def __init__(self, columns):
        self.columns = columns

    def forward(self, Y):
        pairs = zip(self.columns, Y.T, strict=True)
        return np.column_stack([column.forward(y) for column, y in pairs])

    def with_slopes(self, Y):
        pairs = zip(self.columns, Y.T, strict=True)
        found = np.array([column.with_slopes(y) for column, y in pairs])
        return found.transpose(1, 2, 0)

    def back(self, values):
        pairs = zip(self.columns, np.moveaxis(values, -1, 0), strict=True)
        return np.stack([column.back(z) for column, z in pairs], axis=-1)

    def variances(self, model, features, codes, include_noise):
        return self._variances(*model._components(features, codes, include_noise))

    def covariances(self, model, features, codes, include_noise):
        raise ValueError(
            "return_cov=True has no closed form with target_transform. Take the "
            "covariance of draws, np.cov(model.sample_y(X, 1000)), or return_std=True "
            "or predict_interval."
        )

    def left_out(self, model, include_noise):
        means, variances, weights = model._left_out(include_noise)
        deviations = np.sqrt(self._variances(means, variances, weights))
        return self.back((weights * means).mean(axis=0)), deviations

    def _variances(self, means, variances, weights=1.0):
        """Those of y of mixtures of normals, (n_components, n_samples, n_outputs)."""
        of_columns = np.broadcast_arrays(means, np.sqrt(variances), weights)
        found = [
            moments(mean, deviation, column.back, weight)[1]
            for column, mean, deviation, weight in zip(
                self.columns,
                *(np.moveaxis(of, -1, 0) for of in of_columns),
                strict=True,
            )
        ]
        return np.stack(found, axis=-1)


class Column:
    """A monotone map of the targets of one output.

    Parameters
    ----------
    transformer : transformer
        Is cloned, and fitted to the targets as a column.
    y : ndarray of shape (n_samples,)
        Targets.

    Raises
    ------
    ValueError
        If it gives no finite numbers, or is not monotone, or if its inverse does not
        lead back.
    """

    def __init__(self, transformer, y):
        self.transformer = clone(transformer)
        with naming_transform():
            self.transformer.fit(y[:, None])
        self.ends = -np.inf, np.inf
        z = self.forward(y)
        check_monotone(y, z)
        self.sizes, self.inside = (_size(y), _size(z)), z[0]
        with quiet():  # PowerTransformer warns of what is no number, sought here
            self.ends = [self._end(z, _size(y), side) for side in (-1.0, 1.0)]

    def forward(self, y):
        """Transformed targets, checked."""
        z = _column(self.transformer.transform, y)
        bad = np.flatnonzero(~np.isfinite(z))
        if bad.size:
            raise ValueError(
                f"target_transform makes {z[bad[0]]} of y[{bad[0]}] = {y[bad[0]]}. "
                "Give one that is finite for all targets, such as (np.log1p, np.expm1) "
                "where some are 0."
            )
        again = self._inverse(z)
        lost = ~(np.abs(again - y) <= LOST * _size(y))
        if lost.any():
            i = np.flatnonzero(lost)[0]
            raise ValueError(
                f"target_transform does not lead back: y[{i}] = {y[i]} becomes "
                f"{z[i]}, and the inverse turns that into {again[i]}. Give a strictly "
                "monotone function and its inverse, such as (np.log, np.exp). A "
                "QuantileTransformer needs subsample=None, and in add_task and "
                "partial_fit targets within the range that it was fitted to."
            )
        return z

    def with_slopes(self, y):
        """Transformed targets, also new ones, and the log of |dz/dy| there.

        This is -inf where the inverse does not lead: y is impossible, and z any other.
        It is inf where the inverse ends or is flat: many z are the same y.
        """
        z = self._where_taken(y)
        z = np.where(np.isfinite(z), z, self.inside)
        step = STEP * np.maximum(self.sizes[1], LEAST_STEP * np.abs(z))
        below, above = z - step, z + step
        here, lower, upper = map(self._inverse, (z, below, above))
        many = (lower == here) | (upper == here)
        many |= (below <= self.ends[0]) | (above >= self.ends[1])
        rises = np.where(many, 1.0, np.abs(upper - lower))
        slopes = np.where(many, np.inf, np.log(above - below) - np.log(rises))
        possible = np.abs(here - y) <= LOST * np.maximum(self.sizes[0], np.abs(y))
        return z, np.where(possible, slopes, -np.inf)

    def _where_taken(self, y):
        """Transformed targets, NaN where the transformer refuses one."""
        try:
            return _column(self.transformer.transform, y)
        except ValueError:
            if len(y) == 1:
                return np.array([np.nan])
            return np.concatenate([self._where_taken(y[[i]]) for i in range(len(y))])

    def back(self, z):
        """Values in units of y, of any shape."""
        y = self._inverse(z)
        bad = ~(np.abs(y) < LARGEST)
        if bad.any():
            raise ValueError(
                f"The inverse of target_transform makes {y[bad][0]} of {z[bad][0]}, "
                f"and fails for {bad.sum()} of {bad.size} predicted values. The model "
                "is so uncertain there that values exceed the range of the inverse. "
                "Give a transform whose inverse grows more slowly, or predict closer "
                "to the training rows."
            )
        return y

    def _inverse(self, z):
        """The inverse up to its ends, beyond which it stays as it is there."""
        inside = np.clip(z, *self.ends).ravel()
        return _column(self.transformer.inverse_transform, inside).reshape(z.shape)

    def _end(self, z, size, side):
        """Where the inverse ends below (-1) or above (1) the transformed targets.

        Squares end at 0, as the inverse of roots; 1 / z is cut off before its pole.
        """
        width, rises = _size(z), side * self._slope(z)
        begin = z.min() if side < 0.0 else z.max()
        grid = begin + side * width * BEYOND * np.linspace(0.0, 1.0, STEPS)

        def goes_on(of, since):
            """Whether the inverse is there, be it infinite, and goes on as inside."""
            y, near = self._inverse(of), self._inverse(of - side * NEAR * width)
            back = rises * y < rises * np.array([near, self._inverse(since)])
            return ~np.isnan(y) & ~back.any(axis=0)

        ended = np.flatnonzero(~goes_on(grid[1:], grid[:-1]))
        if not ended.size:
            return side * np.inf
        inside, outside = grid[:1], grid[ended[:1] + 1]
        farthest = self._inverse(inside) + rises * FAR * size
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + outside)
            near = rises * (self._inverse(middle) - farthest) <= 0.0
            there = near & goes_on(middle, inside)
            inside = np.where(there, middle, inside)
            outside = np.where(there, outside, middle)
        return inside.item()

    def _slope(self, z):
        """1 where the map rises, -1 where it falls."""
        margin = 0.0 if np.ptp(z) else NEAR * _size(z)
        ends = self._inverse(np.array([z.min() - margin, z.max() + margin]))
        return -1.0 if ends[1] < ends[0] else 1.0


def _size(values):
    """The range of some numbers or, of equal ones, how large they are."""
    return np.ptp(values) or np.abs(values).max() or 1.0


def fit_target(transform, Y):
    """How the targets are learned.

    Parameters
    ----------
    transform : transformer, pair of functions or None
        The user's `target_transform`.
    Y : ndarray or dask.array.Array of shape (n_samples, n_outputs)
        Targets.

    Returns
    -------
    target : AsGiven or Transformed
        The way there and back.

    Raises
    ------
    ValueError
        If the targets cannot be transformed, or not back.
    """
    if transform is None:
        return AS_GIVEN
    if is_dask(Y):
        raise ValueError(
            "target_transform needs the targets in memory, and y is a Dask collection. "
            "Give arrays, or transform y before."
        )
    if isinstance(transform, tuple):
        transform = FunctionTransformer(*check_pair(transform), check_inverse=False)
    n = Y.shape[1]
    columns = [_column_of(transform, y, j, n) for j, y in enumerate(Y.T, 1)]
    return Transformed(columns)


def _column_of(transform, y, j, n):
    """The j-th of n outputs; an error says which it is of."""
    try:
        return Column(transform, y)
    except ValueError as error:
        if n == 1:
            raise
        raise ValueError(f"Output {j} of {n}: {error}") from error


def check_pair(transform):
    """A function and its inverse."""
    if len(transform) != 2 or not all(map(callable, transform)):
        raise ValueError(
            f"target_transform={transform!r} must be a function and its inverse, such "
            "as (np.log, np.exp), or a transformer with inverse_transform."
        )
    return transform


def check_monotone(y, z):
    """Raise a ValueError where the transformed targets are in another order."""
    order = np.argsort(y)
    steps = np.diff(z[order])
    steps[np.abs(steps) <= ROUNDING * np.ptp(z)] = 0.0
    if (steps > 0.0).any() and (steps < 0.0).any():
        rare = 1.0 if (steps > 0.0).sum() < (steps < 0.0).sum() else -1.0
        i = np.flatnonzero(rare * steps > 0.0)[0]
        pair = order[i], order[i + 1]
        raise ValueError(
            "target_transform is not monotone: of y = "
            + " and ".join(f"{y[k]}" for k in pair)
            + " it makes "
            + " and ".join(f"{z[k]}" for k in pair)
            + ", while elsewhere it goes the other way. Give one that only rises or "
            "only falls over the targets."
        )


def _column(method, values):
    """What a method of a transformer makes of numbers, which it takes as a column."""
    with naming_transform():
        return np.array(method(values[:, None]), dtype=float).reshape(len(values))


@contextmanager
def naming_transform():
    """Context in which errors of the user's transformer say whose they are.

    It makes arrays, whatever the configuration of scikit-learn asks of others.
    """
    try:
        with np.errstate(all="ignore"), config_context(transform_output="default"):
            yield
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"target_transform does not take the targets: {error} Give a transformer "
            "of numbers in a column, such as PowerTransformer(), or a pair such as "
            "(np.log, np.exp), whose functions work element by element."
        ) from error
