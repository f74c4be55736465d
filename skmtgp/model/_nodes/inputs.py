"""Gradients of tiles of a kernel by the inputs of their rows.

For the inducing inputs, which are rows of tiles k^x(Z, X): as with the hyperparameters,
only contractions with a weight matrix are needed.
"""

from functools import singledispatch

import numpy as np

from skmtgp._support.guide import INFERENCE
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


@singledispatch
def contract_inputs(bound, W, tape, rows, cols, n_features):
    """Sum over a tile of W times the derivative by the inputs of the tile's rows.

    Parameters
    ----------
    bound : Bound
        The kernel between inputs.
    W : ndarray of shape (n_rows, n_columns)
        Weights.
    tape : object
        What ``bound.block(rows, cols)`` returned with the values.
    rows, cols : slice
        The tile.
    n_features : int
        Number of features of the inputs.

    Returns
    -------
    gradient : ndarray of shape (n_rows, n_features)
        sum_j W_ij d k(x_i, x'_j) / d x_i, where x'_j is held fixed.

    Raises
    ------
    ValueError
        If no function is registered for the bound kernel.
    """
    known = hasattr(bound, "kernel")
    name = f"kernel={bound.kernel!r}" if known else type(bound).__name__
    raise ValueError(
        "inducing_inputs='optimised' needs the derivative of the kernel by its inputs, "
        f"which is not known of {name}. Set inducing_inputs='greedy' "
        "or 'k-means', or make the kernel of RBF, RationalQuadratic, Matern with "
        f"nu=0.5, 1.5 or 2.5, DotProduct, ARDLinear and Columns. {INFERENCE}"
    )


@contract_inputs.register(BoundConstant)
@contract_inputs.register(BoundWhite)
def _(bound, W, tape, rows, cols, n_features):
    return np.zeros((len(W), n_features))


@contract_inputs.register
def _(bound: BoundLinear, W, tape, rows, cols, n_features):
    return W @ bound.right[cols, :-1] * bound.w[:-1]


@contract_inputs.register
def _(bound: BoundStationary, W, tape, rows, cols, n_features):
    _, slope, near = tape
    return bound.differences.contract_rows(W * slope, near, rows, cols) / bound.l


@contract_inputs.register
def _(bound: BoundColumns, W, tape, rows, cols, n_features):
    gradient, columns = np.zeros((len(W), n_features)), bound.columns
    inner = contract_inputs(bound.inner, W, tape, rows, cols, len(columns))
    np.add.at(gradient.T, columns, inner.T)  # a column may be named twice
    return gradient


@contract_inputs.register
def _(bound: BoundSum, W, tape, rows, cols, n_features):
    pairs = zip(bound.parts, tape, strict=True)
    return sum(contract_inputs(part, W, t, rows, cols, n_features) for part, t in pairs)


@contract_inputs.register
def _(bound: BoundProduct, W, tape, rows, cols, n_features):
    return sum(
        contract_inputs(part, W * others, of_part, rows, cols, n_features)
        for part, of_part, others in bound.split(tape)
    )


@contract_inputs.register
def _(bound: BoundPower, W, tape, rows, cols, n_features):
    K, inner_tape = tape
    W = bound.exponent * W * K ** (bound.exponent - 1)
    return contract_inputs(bound.inner, W, inner_tape, rows, cols, n_features)
