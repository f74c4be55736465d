"""A kernel of one input at a time, in the fewest steps: for predictions that are due.

What ``bound.against(z)`` prepares anew for each set of rows is prepared once. A bound
kernel without a function here is asked for its tiles.
"""

from collections import defaultdict
from functools import reduce, singledispatch
from math import prod

import numpy as np

from skmtgp.model._nodes.differences import FAR
from skmtgp.model._nodes.expressions import (
    BoundColumns,
    BoundPower,
    BoundProduct,
    BoundSum,
)
from skmtgp.model._nodes.terms import BoundConstant, BoundLinear, BoundStationary


@singledispatch
def fold(bound, B):
    """Sums over rows x_i of B_ij k(z, x_i), as a function of one input z.

    Parameters
    ----------
    bound : Bound
        The kernel between the rows x_i.
    B : ndarray of shape (n_rows, n_sums)
        Weights.

    Returns
    -------
    folded : callable
        ``folded(z)``, of shape (n_sums,), for z of shape (n_features,). It can be
        pickled.
    """
    return FoldedRow(row_of(bound, len(B)), B)


@fold.register
def _(bound: BoundConstant, B):
    return Affine(None, bound.c * B.sum(axis=0))


@fold.register
def _(bound: BoundLinear, B):
    V = bound.w[:, None] * (bound.right.T @ B)
    return Affine(V[:-1], V[-1])


@fold.register
def _(bound: BoundColumns, B):
    return OfColumns(bound.columns, fold(bound.inner, B))


@fold.register
def _(bound: BoundSum, B):
    return Total([fold(part, B) for part in bound.parts])


@fold.register
def _(bound: BoundProduct, B):
    others = [part for part in bound.parts if not isinstance(part, BoundConstant)]
    if len(others) != 1:
        return FoldedRow(row_of(bound, len(B)), B)
    constants = (part.c for part in bound.parts if part is not others[0])
    return fold(others[0], prod(constants) * B)


@singledispatch
def row_of(bound, n):
    """The values k(z, x_i), as a function of one input z.

    Parameters
    ----------
    bound : Bound
        The kernel between the rows x_i.
    n : int
        How many there are.

    Returns
    -------
    row : callable
        ``row(z)`` has shape (n,), or is a number where all are the same. It can be
        pickled.
    """
    return RowOfTile(bound, n)


@row_of.register
def _(bound: BoundConstant, n):
    return Affine(None, bound.c)


@row_of.register
def _(bound: BoundLinear, n):
    return LinearRow(bound.right[:, :-1] * bound.w[:-1], bound.w[-1])


@row_of.register
def _(bound: BoundStationary, n):
    of = bound.differences
    careful = of.near or len(of.wide)
    return RowOfTile(bound, n) if careful else StationaryRow(bound)


@row_of.register
def _(bound: BoundColumns, n):
    return OfColumns(bound.columns, row_of(bound.inner, n))


@row_of.register
def _(bound: BoundSum, n):
    return Total([row_of(part, n) for part in bound.parts])


@row_of.register
def _(bound: BoundProduct, n):
    alike, rows = defaultdict(list), []  # a robot has a linear factor for each joint
    for part in bound.parts:
        inner, exponent = _power_of(part)
        if isinstance(inner, BoundColumns) and isinstance(inner.inner, BoundLinear):
            alike[len(inner.columns), exponent].append(inner)
        else:
            rows.append(row_of(part, n))
    for (_, exponent), factors in alike.items():
        row = LinearFactors(factors)
        rows.append(row if exponent == 1 else Power(row, exponent))
    return Times(rows)


def _power_of(bound):
    """What a kernel is a power of, and which."""
    if isinstance(bound, BoundPower):
        return bound.inner, bound.exponent
    return bound, 1


@row_of.register
def _(bound: BoundPower, n):
    return Power(row_of(bound.inner, n), bound.exponent)


class RowOfTile:
    """A row by the kernel's tiles."""

    def __init__(self, bound, n):
        self.bound, self.rows, self.cols = bound, slice(0, 1), slice(0, n)

    def __call__(self, z):
        K, _ = self.bound.against(z[None]).block(self.rows, self.cols)
        return K[0] if np.ndim(K) else K


class LinearRow:
    """A matrix times z, and a bias."""

    def __init__(self, W, bias):
        self.W, self.bias = W, bias

    def __call__(self, z):
        row = self.W @ z
        row += self.bias
        return row


class LinearFactors:
    """The product of linear kernels of as many features each."""

    def __init__(self, factors):
        self.columns = np.array([factor.columns for factor in factors])
        bounds = [factor.inner for factor in factors]
        self.W = np.stack([bound.right[:, :-1] * bound.w[:-1] for bound in bounds])
        self.bias = np.array([bound.w[-1] for bound in bounds])[:, None, None]

    def __call__(self, z):
        rows = self.W @ z[self.columns][..., None]
        rows += self.bias
        return np.multiply.reduce(rows, axis=0)[:, 0]


class StationaryRow:
    """A function of the scaled distance, see `Differences`."""

    def __init__(self, bound):
        of = bound.differences
        self.center, self.l, self.shape = of.center, of.l, bound.shape
        self.Z, self.halves = np.ascontiguousarray(of.left[:, :-2]), of.left[:, -2]
        self.profile = bound.node.profile

    def __call__(self, z):
        z = (z - self.center) / self.l
        e = self.Z @ z
        e += self.halves
        e -= min(0.5 * float(z @ z), FAR)
        np.minimum(e, 0.0, out=e)
        return self.profile(e, **self.shape)[0]


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
        first, *others = self.parts
        return sum((part(z) for part in others), first(z))


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


class Affine:
    """z V + c; without V the constant c."""

    def __init__(self, V, c):
        self.V, self.c = V, c

    def __call__(self, z):
        return self.c if self.V is None else z @ self.V + self.c


class FoldedRow:
    """A row times weights."""

    def __init__(self, row, B):
        self.row, self.B, self.total = row, B, B.sum(axis=0)

    def __call__(self, z):
        row = self.row(z)
        return row @ self.B if np.ndim(row) else row * self.total
