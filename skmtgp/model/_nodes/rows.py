"""Kernels of one input at a time, in the fewest steps: for predictions that are due.

What ``bound.against(z)`` prepares anew for each set of rows is prepared once. Numpy's
calls take longer than the arithmetic here, so kernels that differ in their
hyperparameters alone, as those of a robot's joints do, are computed together: arrays
have a leading axis of kernels. One that has no function here is asked for its tiles.
"""

from collections import defaultdict
from functools import reduce, singledispatch

import numpy as np

from skmtgp.model._nodes.differences import FAR
from skmtgp.model._nodes.expressions import (
    BoundColumns,
    BoundPower,
    BoundProduct,
    BoundSum,
)
from skmtgp.model._nodes.terms import (
    BoundConstant,
    BoundLinear,
    BoundStationary,
    BoundWhite,
)


def row_of(bounds, n):
    """The values k(z, x_i), as a function of one input z.

    Parameters
    ----------
    bounds : list of n_kernels Bound
        Kernels of one form, between the same rows x_i.
    n : int
        How many rows there are.

    Returns
    -------
    row : callable
        ``row(z)`` has shape (n_kernels, n), or (n_kernels, 1) where all are the same.
        It can be pickled.
    """
    return _row_of(bounds[0], bounds, n)


@singledispatch
def _row_of(first, bounds, n):
    return RowOfTile(first, n)


@_row_of.register
def _(first: BoundConstant, bounds, n):
    return Constant(constants_of(bounds))


@_row_of.register
def _(first: BoundWhite, bounds, n):
    return Constant(np.zeros((len(bounds), 1)))  # z is none of the rows


@_row_of.register
def _(first: BoundLinear, bounds, n):
    return LinearRow(bounds)


@_row_of.register
def _(first: BoundStationary, bounds, n):
    return RowOfTile(first, n) if is_careful(first) else StationaryRow(bounds)


@_row_of.register
def _(first: BoundColumns, bounds, n):
    return OfColumns(first.columns, row_of([bound.inner for bound in bounds], n))


@_row_of.register
def _(first: BoundSum, bounds, n):
    return total_of([row_of(of_part, n) for of_part in parts_of(bounds)])


@_row_of.register
def _(first: BoundPower, bounds, n):
    return Power(row_of([bound.inner for bound in bounds], n), first.exponent)


@_row_of.register
def _(first: BoundProduct, bounds, n):
    others, constant = without_constants(bounds)
    alike, rows = defaultdict(list), []  # a robot has a linear factor for each joint
    for of_part in others:
        inner, exponent = _power_of(of_part[0])
        if isinstance(inner, BoundColumns) and isinstance(inner.inner, BoundLinear):
            inner = [_power_of(bound)[0] for bound in of_part]
            alike[len(inner[0].columns), exponent].append(inner)
        else:
            rows.append(row_of(of_part, n))
    for (_, exponent), factors in alike.items():
        row = LinearFactors(factors)
        rows.append(row if exponent == 1 else Power(row, exponent))
    if not rows or (constant != 1.0).any():
        rows.append(Constant(constant))
    return Times(rows) if len(rows) > 1 else rows[0]


def _power_of(bound):
    """What a kernel is a power of, and which."""
    if isinstance(bound, BoundPower):
        return bound.inner, bound.exponent
    return bound, 1


class RowOfTile:
    """A row by the kernel's tiles."""

    def __init__(self, bound, n):
        self.bound, self.rows, self.cols = bound, slice(0, 1), slice(0, n)

    def __call__(self, z):
        K, _ = self.bound.against(z[None]).block(self.rows, self.cols)
        return K if np.ndim(K) else np.array([[K]])


class Constant:
    """The same number for all rows."""

    def __init__(self, c):
        self.c = c

    def __call__(self, z):
        return self.c


class LinearRow:
    """Weighted products with each row, and a bias."""

    def __init__(self, bounds):
        w = np.stack([bound.w for bound in bounds])
        self.Z = np.ascontiguousarray(bounds[0].right[:, :-1].T)
        self.weights, self.bias = _weights_and_bias(w, bounds[0].center, self.Z)
        self.is_affine = bool(self.bias.any())

    def __call__(self, z):
        row = (self.weights * z) @ self.Z
        return row + self.bias if self.is_affine else row


class LinearFactors:
    """The product of linear kernels of as many features each."""

    def __init__(self, factors):
        self.columns = np.array([of[0].columns for of in factors])[:, None]
        w = np.array([[bound.inner.w for bound in of] for of in factors])
        self.Z = np.stack([of[0].inner.right[:, :-1].T for of in factors])
        center = np.array([[of[0].inner.center] for of in factors])
        self.weights, self.bias = _weights_and_bias(w, center, self.Z)

    def __call__(self, z):
        rows = (self.weights * z.take(self.columns)) @ self.Z
        rows += self.bias
        return np.multiply.reduce(rows, axis=0)


def _weights_and_bias(w, center, Z):
    """Of inputs that are not centred; the bias of each row, if the kernel's are."""
    weights, bias = w[..., :-1].copy(), w[..., -1:].copy()
    return weights, bias - (weights * center) @ Z if center.any() else bias


class StationaryRow:
    """A function of the scaled distance, see `Differences`."""

    def __init__(self, bounds):
        several = [bound.differences for bound in bounds]
        self.center, X = several[0].center, several[0].sets[1]
        self.Z = np.ascontiguousarray((X - self.center).T)
        self.l = np.stack([np.broadcast_to(of.l, X.shape[1]) for of in several])
        self.halves = np.stack([of.left[:, -2] for of in several])
        self.profile = bounds[0].node.profile
        self.shape = {
            name: np.array([[bound.shape[name]] for bound in bounds])
            for name in bounds[0].shape
        }

    def __call__(self, z):
        z = (z - self.center) / self.l
        e = (z / self.l) @ self.Z
        e += self.halves
        e -= np.minimum(0.5 * np.einsum("kd,kd->k", z, z), FAR)[:, None]
        np.minimum(e, 0.0, out=e)
        return self.profile(e, e, **self.shape)[0]


class OfColumns:
    """A function of some of the features."""

    def __init__(self, columns, inner):
        self.columns, self.inner = columns, inner

    def __call__(self, z):
        return self.inner(z.take(self.columns))


class Total:
    """The sum of functions."""

    def __init__(self, parts):
        self.parts = parts

    def __call__(self, z):
        return reduce(np.add, [part(z) for part in self.parts])


def total_of(parts):
    return Total(parts) if len(parts) > 1 else parts[0]


class Times:
    """The product of functions."""

    def __init__(self, parts):
        self.parts = parts

    def __call__(self, z):
        return reduce(np.multiply, [part(z) for part in self.parts])


class Power:
    """A power of a function."""

    def __init__(self, inner, exponent):
        self.inner, self.exponent = inner, exponent

    def __call__(self, z):
        row = self.inner(z)
        return np.square(row) if self.exponent == 2 else row**self.exponent


def parts_of(bounds):
    """Of each part of a sum or a product the kernels."""
    return list(map(list, zip(*(bound.parts for bound in bounds), strict=True)))


def constants_of(bounds):
    return np.array([[bound.c] for bound in bounds])


def without_constants(bounds):
    """Of each factor the kernels, and the product of those that are constant."""
    others, product = [], np.ones((len(bounds), 1))
    for of_part in parts_of(bounds):
        if isinstance(of_part[0], BoundConstant):
            product *= constants_of(of_part)
        else:
            others.append(of_part)
    return others, product


def is_careful(bound):
    """Whether distances need more than a product of matrices, see `Differences`."""
    return bool(bound.differences.near or len(bound.differences.wide))
