"""Kernels that are not computed again while their part of theta stays the same."""

from copy import copy

import numpy as np

from skmtgp.model._nodes.expressions import JoinedNode, PowerNode
from skmtgp.model._nodes.terms import Bound, Node, allocate
from skmtgp.model.several import SeveralNode


def remembered(node):
    """A node for values only, whose parts keep their last tiles.

    This saves time where a few rows are looked at with one theta after another that
    differ in a part of the kernel, or in the noise alone.

    Parameters
    ----------
    node : Node
        Is left as it was.

    Returns
    -------
    node : Node
        Of the same kernel.
    """
    node = copy(node)
    if isinstance(node, JoinedNode):
        node.parts = [remembered(part) for part in node.parts]
    elif isinstance(node, PowerNode):
        node.inner = remembered(node.inner)
    return node if isinstance(node, SeveralNode) else RememberedNode(node)


class RememberedNode(Node):
    """A node that keeps what it was bound to last."""

    def __init__(self, node):
        self.inner, self.n_dims, self.n_slices = node, node.n_dims, node.n_slices
        self.last = None, None, None

    def bind(self, theta, X):
        """The kernel at theta: what was bound before, if nothing has changed."""
        before, of, bound = self.last
        if not (np.array_equal(before, theta) and np.array_equal(of, X)):
            bound = BoundRemembered(self.inner.bind(theta, X))
            self.last = np.array(theta), X, bound
        return bound


class BoundRemembered(Bound):
    """A bound kernel that keeps its tiles."""

    def __init__(self, inner):
        self.inner, self.tiles = inner, {}

    def block(self, rows, cols, new=allocate):
        """The values of a tile, and no tape."""
        tile = rows.start, rows.stop, cols.start, cols.stop
        if tile not in self.tiles:
            self.tiles[tile] = self.inner.block(rows, cols)[0]
        return self.tiles[tile], None
