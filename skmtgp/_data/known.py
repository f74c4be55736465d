r"""What is known of the noise of each row: variances, and repeats that it stands for.

A row may be the mean of n measurements at the same input of the same task, which have
the noise variance :math:`v = \sigma_m^2 + \alpha` each, what is learned and what is
known. It then has the noise variance v / n, and the n measurements have a log density
beside that of their mean:

.. math::
    -\tfrac12 \bigl[(n - 1) \log 2\pi v + \log n + n s^2 / v\bigr],

with their variance s^2 about their mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from reprlib import repr as shorten

import numpy as np
from sklearn.utils import _safe_indexing
from sklearn.utils.validation import _num_features, _num_samples

from skmtgp._data.numbers import as_array
from skmtgp._data.order import (
    PANDAS,
    are_of_the_same_rows,
    refuse_another_order,
)
from skmtgp._numerics.memory import check_available

ARGUMENTS = "alpha", "sample_weight", "repeat_variance"


@dataclass(frozen=True)
class Known:
    """What is known of the noise of rows of one output, or of several in columns.

    Attributes
    ----------
    variance : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Known part of the noise variance of one measurement.
    counts : ndarray of shape (n_samples,)
        How many measurements a row is the mean of.
    spread : ndarray of the shape of `variance`
        Their variance about their mean, of the population.
    """

    variance: np.ndarray
    counts: np.ndarray
    spread: np.ndarray

    def part(self, rows):
        """That of some of the rows."""
        parts = (self.variance, self.counts, self.spread)
        return Known(*(part[rows] for part in parts))

    def arguments(self):
        """Those of `fit`: alpha, sample_weight and repeat_variance."""
        return self.variance, self.counts, self.spread

    def refuse_transform(self, target_transform):
        """Raise a ValueError where y is not what is learned."""
        if target_transform is not None:
            raise ValueError(
                "alpha and sample_weight are in units of y, but with target_transform "
                "the model learns transformed targets. Transform y before fit, or "
                "leave alpha and sample_weight out."
            )

    def output(self, j):
        """That of one output."""
        return replace(self, variance=self.variance[:, j], spread=self.spread[:, j])

    def scaled(self, scale):
        """In units of `scale`, of shape (n_samples or 1, n_outputs)."""
        square = np.square(scale)
        return replace(
            self, variance=self.variance / square, spread=self.spread / square
        )

    def beside(self, deviations):
        """Deviations of measurements, of each output, with what is known on average."""
        variance = np.average(self.variance, axis=0, weights=self.counts)
        return np.hypot(deviations, np.sqrt(variance))

    def noise(self, learned):
        """Noise variance of each row, from what is learned of each."""
        return (learned + self.variance) / self.counts

    def log_density(self, learned):
        """Log density of the measurements beside that of their means."""
        v = learned + self.variance
        more, n = self.counts - 1.0, self.counts
        of_repeats = more * np.log(2.0 * np.pi * v) + n * self.spread / v
        return -0.5 * float((of_repeats + np.log(n)).sum())

    def slope(self, learned):
        """Derivative of that by what is learned of each row."""
        v = learned + self.variance
        return -0.5 * ((self.counts - 1.0) - self.counts * self.spread / v) / v

    def information(self, learned):
        """Fisher information of the logarithm of what is learned, in repeats."""
        share = learned / (learned + self.variance)
        return 0.5 * (self.counts - 1.0) * np.square(share)


def noise_of(known, learned):
    """Noise variance of each row, whether or not something is known of it."""
    return learned if known is None else known.noise(learned)


def followed_by(known, new, shape, shape_of_new):
    """What is known of rows and of new ones below; None where that is nothing.

    Parameters
    ----------
    known, new : Known or None
        Of each; None is nothing.
    shape, shape_of_new : tuple of (n_samples, n_outputs)
        Of their targets.

    Returns
    -------
    known : Known or None
    """
    if known is None and new is None:
        return None
    known = _nothing_of(shape) if known is None else known
    new = _nothing_of(shape_of_new) if new is None else new
    pairs = zip(known.arguments(), new.arguments(), strict=True)
    return Known(*map(np.concatenate, pairs))


def _nothing_of(shape):
    """That nothing is known of rows with such targets."""
    return Known(np.zeros(shape), np.ones(shape[0]), np.zeros(shape))


def weighed_rows(X, y, given, *, repeats):
    """The rows of some weight, and what is known of their noise.

    A meta-estimator such as bagging counts in `sample_weight` how often it has drawn
    each row.

    Parameters
    ----------
    X, y : array-like
        All rows.
    given : tuple of (alpha, sample_weight, repeat_variance)
        See `fit`.
    repeats : bool
        Whether rows are repeated as often as they count, since that is all that is
        known and the engine takes no counts.

    Returns
    -------
    X, y, given
        Without rows of weight 0. Nothing is known where all weights are 1 then.
    """
    refuse_orders(X, y, given)  # before rows are left out or repeated
    alpha, weights, variance = given
    weights = None if weights is None else _weights(weights, X)
    if weights is None:
        return X, y, given  # reading says what is wrong, if anything is
    counts = (weights != 0).astype(int)
    alone = alpha is None and variance is None
    if repeats and alone and (weights == np.floor(weights)).all():
        counts, weights = _as_often(weights, X), np.ones(len(weights))
    if (counts != 1).any():
        rows = np.repeat(np.arange(len(counts)), counts)
        X, y, weights = (_safe_indexing(of, rows) for of in (X, y, weights))
        alpha, variance = (
            of if of is None or np.ndim(of) == 0 else _safe_indexing(of, rows)
            for of in (alpha, variance)
        )
    known = not (alone and (weights == 1).all())
    return X, y, (alpha, weights if known else None, variance)


def refuse_orders(X, y, given):
    """Raise a ValueError where an index has the labels of the rows in another order.

    These are those of X, or those of y where X has none of them; y may be None.
    """
    refuse_another_order(X, y)
    indices = [of.index for of in (X, y) if isinstance(of, PANDAS)]
    for name, part in zip(ARGUMENTS, given, strict=True):
        own = part.index if isinstance(part, PANDAS) else None
        others = [] if own is None else indices
        same = (index for index in others if are_of_the_same_rows(own, index))
        rows = next(same, own)
        if own is not None and not own.equals(rows):
            raise ValueError(
                f"{name} has the labels of the rows in another order: it begins with "
                f"{own[0]}, X or y with {rows[0]}, and what belongs together "
                f"is told by position. Give {name}.loc[X.index], or {name}.to_numpy() "
                "if the positions are right."
            )


def _weights(given, X):
    """Weights of the rows, of shape (n_samples,); None where they cannot be used."""
    try:
        weights = _as_floats(given)
    except (TypeError, ValueError):
        return None
    n = _num_samples(X)
    if weights.shape == (n, 1) or weights.ndim == 0:
        weights = np.broadcast_to(weights.ravel(), n)
    usable = weights.shape == (n,) and np.isfinite(weights).all() and weights.any()
    return weights if usable and weights.min() >= 0.0 else None


def _as_often(weights, X):
    """The weights as counts of rows, if memory has room for as many."""
    try:
        columns = _num_features(X)
    except TypeError:  # the check of X says what is wrong
        columns = 1
    check_available(
        8.0 * (columns + 2) * weights.sum(),
        f"sample_weight, as {weights.sum():g} rows that are repeated,",
        "Set inference='dense', which takes counts.",
    )
    return weights.astype(int)


def read_known(alpha, sample_weight, repeat_variance, shape):
    """What is known, from the arguments of `fit`; None where that is nothing.

    Parameters
    ----------
    alpha, sample_weight, repeat_variance : array-like, float or None
        See `fit`.
    shape : tuple of (n_samples, n_outputs)
        Of the targets.

    Returns
    -------
    known : Known or None
        In squared units of y, in the columns of the outputs.
    """
    if alpha is None and sample_weight is None and repeat_variance is None:
        return None
    if repeat_variance is not None and sample_weight is None:
        raise ValueError(
            "repeat_variance needs sample_weight, the number of measurements that each "
            "row is the mean of."
        )
    counts = _numbers("sample_weight", sample_weight, (shape[0], 1), default=1.0)[:, 0]
    if not (counts >= 1.0).all():
        raise ValueError(
            f"sample_weight has {counts.min():g}, but must be the number of "
            "measurements that a row is the mean of, 1 or more, or zero weight for "
            "rows that do not count, but not for all. For less exact rows give their "
            "noise variance in alpha."
        )
    variance = _numbers("alpha", alpha, shape, default=0.0)
    spread = _numbers("repeat_variance", repeat_variance, shape, default=0.0)
    of_one = spread[counts == 1.0]
    if of_one.any():
        raise ValueError(
            f"repeat_variance has {of_one[of_one > 0.0][0]:g} in a row of "
            "sample_weight 1: one measurement is its own mean, with a variance of 0 "
            "about it. What is known of its noise is its alpha."
        )
    return Known(variance, counts, spread)


def _numbers(name, value, shape, *, default):
    """An argument as an array of the shape, or a ValueError."""
    value = default if value is None else value
    try:
        given = _as_floats(value)
    except (TypeError, ValueError) as error:
        shown = " ".join(shorten(value).split())
        raise ValueError(
            f"{name}={shown} must be real numbers, of which none is missing."
        ) from error
    if given.ndim == 1:
        given = given[:, None]
    fits = given.ndim == 0 or given.shape in {shape, (shape[0], 1)}
    if not fits:
        several = f" or {shape}" if shape[1] > 1 else ""
        raise ValueError(
            f"{name} has shape {np.shape(value)}, but X has {shape[0]} samples: give "
            f"a number for each, of shape ({shape[0]},){several}, or one number."
        )
    bad = ~(np.isfinite(given) & (given >= 0.0))
    if bad.any():
        raise ValueError(
            f"{name} has {given[bad][0]:g}, and must be finite numbers of 0 or more."
        )
    return np.array(np.broadcast_to(given, shape))


def _as_floats(value):
    given = as_array(value)
    if given.dtype.kind == "c":  # NumPy would drop what is imaginary
        raise TypeError("complex numbers")
    return given.astype(np.float64)
