"""Sums of a kernel over rows, of one input at a time: what a prediction is.

Kernels that differ in their hyperparameters alone, as those of a robot's joints do, are
folded together, see `rows`.
"""

from functools import singledispatch

import numpy as np

from skmtgp.model._nodes.expressions import (
    BoundColumns,
    BoundPower,
    BoundProduct,
    BoundSum,
)
from skmtgp.model._nodes.rows import (
    OfColumns,
    constants_of,
    is_careful,
    parts_of,
    row_of,
    total_of,
    without_constants,
)
from skmtgp.model._nodes.terms import (
    BoundConstant,
    BoundLinear,
    BoundStationary,
    BoundWhite,
)


@singledispatch
def form_of(bound):
    """What kernels that are folded together have in common, beside their rows.

    Parameters
    ----------
    bound : Bound
        A kernel between rows.

    Returns
    -------
    form : hashable
        Equal where nothing but hyperparameters differs; unique where that cannot be
        told.
    """
    return id(bound)


@form_of.register(BoundConstant)
@form_of.register(BoundWhite)
def _(bound):
    return type(bound)


@form_of.register
def _(bound: BoundLinear):
    return type(bound), *bound.center.tolist()


@form_of.register
def _(bound: BoundStationary):
    if is_careful(bound):
        return id(bound)
    return type(bound), bound.node.profile, *bound.shape


@form_of.register
def _(bound: BoundColumns):
    return type(bound), *bound.columns.tolist(), form_of(bound.inner)


@form_of.register(BoundSum)
@form_of.register(BoundProduct)
def _(bound):
    return type(bound), *map(form_of, bound.parts)


@form_of.register
def _(bound: BoundPower):
    return type(bound), bound.exponent, form_of(bound.inner)


def fold(bounds, B):
    """Sums over rows x_i of B_ij k(z, x_i), as a function of one input z.

    Parameters
    ----------
    bounds : list of n_kernels Bound
        Kernels of one form, between the same rows x_i.
    B : ndarray of shape (n_kernels, n_rows, n_sums)
        Weights.

    Returns
    -------
    folded : callable
        ``folded(z)``, of shape (n_kernels, n_sums), for z of shape (n_features,). It
        can be pickled.
    """
    return _fold(bounds[0], bounds, B)


@singledispatch
def _fold(first, bounds, B):
    return FoldedRow(row_of(bounds, B.shape[1]), B)


@_fold.register
def _(first: BoundConstant, bounds, B):
    return Affine(None, constants_of(bounds) * B.sum(axis=1))


@_fold.register
def _(first: BoundLinear, bounds, B):
    weights = np.stack([bound.w for bound in bounds])
    V = weights[..., None] * (first.right.T @ B)
    return Affine(V[:, :-1], V[:, -1], first.center)


@_fold.register
def _(first: BoundColumns, bounds, B):
    inner = fold([bound.inner for bound in bounds], B)
    if isinstance(inner, FoldedRow):
        return FoldedRow(OfColumns(first.columns, inner.row), B)
    return OfColumns(first.columns, inner)


@_fold.register
def _(first: BoundSum, bounds, B):
    parts = [fold(of_part, B) for of_part in parts_of(bounds)]
    rows = [part.row for part in parts if isinstance(part, FoldedRow)]
    parts = [part for part in parts if not isinstance(part, FoldedRow)]
    if rows:  # which are added before they are multiplied by the weights
        rows = FoldedRow(total_of(rows), B)
        parts.append(rows)
    return rows if len(parts) == 1 and rows else total_of(parts)


@_fold.register
def _(first: BoundProduct, bounds, B):
    others, factor = without_constants(bounds)
    if len(others) == 1:
        folded = fold(others[0], factor[..., None] * B)
        if not isinstance(folded, FoldedRow):
            return folded
    return FoldedRow(row_of(bounds, B.shape[1]), B)


class Affine:
    """(z - center) V + c of each kernel; without V the constant c."""

    def __init__(self, V, c, center=0.0):
        self.c, self.center = c, center if np.any(center) else None
        self.V = None if V is None else np.hstack(V)

    def __call__(self, z):
        if self.V is None:
            return self.c
        if self.center is not None:
            z = z - self.center
        return (z @ self.V).reshape(self.c.shape) + self.c


class FoldedRow:
    """A row times weights."""

    def __init__(self, row, B):
        self.row, self.B, self.total = row, B, B.sum(axis=1)

    def __call__(self, z):
        row = self.row(z)
        if row.shape[1] < self.B.shape[1]:
            return row * self.total
        return np.matmul(row[:, None], self.B)[:, 0]
