r"""Kernels in tiles: values, and gradients contracted with a weight matrix.

The gradient of a likelihood needs, for each hyperparameter theta_p of k^x, the number
:math:`\sum_{ij} W_{ij}\, \partial K_{ij} / \partial \theta_p` only. It is summed here
tile by tile, so that the n x n x p tensor of scikit-learn's ``eval_gradient`` is never
built; kernels that are not known here are asked for the tensors of the tiles.

A *node* stands for a kernel of the expression. ``node.bind(theta, X)`` is that kernel
with its hyperparameters set, between the rows of X; ``bound.against(Z)`` is the same
between the rows of Z and those of X. Both give tiles, ``block(rows, columns) ->
(values, tape)``; from a tape, ``contract(W, tape, rows, columns)`` gives one number for
each element of theta. Arrays that last until then may be made by the caller, who passes
``new`` to ``block``: it returns one for the tile, or None where numpy is to make it.
``times(rows, columns, B)`` is the tile's product with a matrix, without a tape.
``contract_inputs`` is the contraction of the derivative by the inputs of the rows.
``fold`` is the product of one row, of any input, with a vector: what a prediction is;
``form_of`` says which kernels are folded together.
"""

from skmtgp.model._nodes.expressions import (
    NODES,
    UnknownNode,
    compile_kernel,
    is_foreign,
)
from skmtgp.model._nodes.folds import fold, form_of
from skmtgp.model._nodes.inputs import contract_inputs
from skmtgp.model._nodes.memory import count_arrays, count_elements
from skmtgp.model._nodes.parts import Parts
from skmtgp.model._nodes.terms import Bound, Node, allocate

__all__ = [
    "NODES",
    "Bound",
    "Node",
    "Parts",
    "UnknownNode",
    "allocate",
    "compile_kernel",
    "contract_inputs",
    "count_arrays",
    "count_elements",
    "fold",
    "form_of",
    "is_foreign",
]
