"""Nodes of kernels made of others, and the node of any kernel."""

from functools import reduce
from itertools import accumulate, pairwise, product
from math import isqrt, prod

import numpy as np
from sklearn.gaussian_process.kernels import Exponentiation, Matern, Product, Sum

from skmtgp.kernels import Columns
from skmtgp.model._nodes.terms import (
    MATERN,
    TERMS,
    Bound,
    BoundConstant,
    Node,
    allocate,
)

TENSOR = 2**19  # elements of the largest that a kernel is asked for


class ColumnsNode(Node):
    """A kernel of some of the features."""

    def __init__(self, kernel):
        self.columns = np.asarray(kernel.columns)
        self.inner = compile_kernel(kernel.kernel)
        self.n_dims, self.n_slices = kernel.n_dims, self.inner.n_slices

    def bind(self, theta, X):
        return BoundColumns(self.columns, self.inner.bind(theta, X[:, self.columns]))

    def derivatives(self, theta, X, parts):
        return self.inner.derivatives(theta, X[:, self.columns], parts)


class BoundColumns(Bound):
    def __init__(self, columns, inner):
        self.columns, self.inner = columns, inner
        self.block, self.contract = inner.block, inner.contract

    def against(self, Z):
        return self.inner.against(Z[:, self.columns])


class JoinedNode(Node):
    """A sum or a product, of all kernels that are summed or multiplied.

    Attributes
    ----------
    parts : list of Node
        The terms or the factors, in the order of theta.
    """

    def __init__(self, kernel, bound):
        self.bound, self.n_dims, self.parts = bound, kernel.n_dims, []
        for node in map(compile_kernel, (kernel.k1, kernel.k2)):
            is_same = isinstance(node, JoinedNode) and node.bound is bound
            self.parts += node.parts if is_same else [node]
        self.n_slices = max(part.n_slices for part in self.parts)

    def bind(self, theta, X):
        parts, start = [], 0
        for part in self.parts:
            parts.append(part.bind(theta[start : start + part.n_dims], X))
            start += part.n_dims
        return self.bound(parts)


class BoundJoined(Bound):
    def __init__(self, parts):
        self.parts = parts

    def against(self, Z):
        return type(self)([part.against(Z) for part in self.parts])


class BoundSum(BoundJoined):
    def block(self, rows, cols, new=allocate):
        first, *others = self.parts
        total, tape = first.block(rows, cols, new)
        tapes, out = [tape], new()
        for part in others:  # values that are on no tape are not kept
            K, tape = part.block(rows, cols, new)
            total = np.add(total, K, out=out)
            tapes.append(tape)
        return total, tapes

    def times(self, rows, cols, B):
        return sum(part.times(rows, cols, B) for part in self.parts)

    def contract(self, W, tapes, rows, cols):
        pairs = zip(self.parts, tapes, strict=True)
        return np.concatenate([part.contract(W, t, rows, cols) for part, t in pairs])


class BoundProduct(BoundJoined):
    def block(self, rows, cols, new=allocate):
        blocks = [part.block(rows, cols, new) for part in self.parts]
        values, tapes = zip(*blocks, strict=True)
        return reduce(np.multiply, values), (values, tapes)

    def times(self, rows, cols, B):
        others = [part for part in self.parts if not isinstance(part, BoundConstant)]
        if len(others) != 1:
            return super().times(rows, cols, B)
        constants = (part.c for part in self.parts if part is not others[0])
        return prod(constants) * others[0].times(rows, cols, B)

    def split(self, tape):
        """Each factor, its tape, and the values of the product of the others."""
        values, tapes = tape
        yield from zip(self.parts, tapes, _products_of_others(values), strict=True)

    def contract(self, W, tape, rows, cols):
        return np.concatenate(
            [_contract_factor(*split, W, rows, cols) for split in self.split(tape)]
        )


def _products_of_others(values):
    """For each value the product of the others: of those before it and those after.

    A robot has a factor for each joint: to multiply all others anew for each of them
    would take a time that grows with the square of their number.
    """
    after = list(accumulate(values[:0:-1], np.multiply))
    yield after.pop()
    before = values[0]
    for value in values[1:-1]:
        yield before * after.pop()
        before = before * value
    yield before


def _contract_factor(factor, tape, other, W, rows, cols):
    """Contraction of a factor of a product, `other` being the values of the others."""
    if np.ndim(other) == 0:  # contractions are linear in W
        return other * factor.contract(W, tape, rows, cols)
    if isinstance(factor, BoundConstant):
        return np.full(factor.n_dims, factor.c * np.vdot(W, other))
    return factor.contract(W * other, tape, rows, cols)


class PowerNode(Node):
    """A kernel to a fixed power."""

    def __init__(self, kernel):
        self.exponent, self.inner = kernel.exponent, compile_kernel(kernel.kernel)
        self.n_dims, self.n_slices = kernel.n_dims, self.inner.n_slices

    def bind(self, theta, X):
        return BoundPower(self.inner.bind(theta, X), self.exponent)


class BoundPower(Bound):
    def __init__(self, inner, exponent):
        self.inner, self.exponent = inner, exponent

    def against(self, Z):
        return BoundPower(self.inner.against(Z), self.exponent)

    def block(self, rows, cols, new=allocate):
        K, tape = self.inner.block(rows, cols, new)
        if self.exponent == 2 and np.ndim(K):  # of polynomials, in memory that is kept
            return np.square(K, out=new()), (K, tape)
        return K**self.exponent, (K, tape)

    def contract(self, W, tape, rows, cols):
        K, inner_tape = tape
        W = self.exponent * W * self._slope(K)
        return self.inner.contract(W, inner_tape, rows, cols)

    def _slope(self, K):
        if self.exponent == 2:
            return K
        if self.exponent >= 1:
            return K ** (self.exponent - 1)
        # a value that has underflown to 0 has a derivative that has, too
        return np.power(K, self.exponent - 1, out=np.zeros_like(K), where=K != 0.0)


class UnknownNode(Node):
    """Any other kernel: its own values and its own gradient, of parts of each tile."""

    def __init__(self, kernel):
        self.kernel, self.n_dims, self.n_slices = kernel, *[kernel.n_dims] * 2

    def bind(self, theta, X):
        return BoundUnknown(self.kernel.clone_with_theta(theta), X, X)


class BoundUnknown(Bound):
    def __init__(self, kernel, Z, X):
        self.kernel, self.Z, self.X = kernel, Z, X

    def against(self, Z):
        return BoundUnknown(self.kernel, Z, self.X)

    def _is_same(self, rows, cols):
        """Whether rows and columns are the same samples, which may be special."""
        return self.Z is self.X and rows == cols

    def _apart(self, rows, cols):
        """Columns that are the rows, and those after them."""
        if self.Z is self.X and rows.start == cols.start and rows.stop < cols.stop:
            return [rows, slice(rows.stop, cols.stop)]
        return [cols]

    def block(self, rows, cols, new=allocate):
        parts = [self._values(rows, of) for of in self._apart(rows, cols)]
        return (np.hstack(parts) if len(parts) > 1 else parts[0]), None

    def _values(self, rows, cols):
        if self._is_same(rows, cols):
            return self.kernel(self.X[rows])
        return self.kernel(self.Z[rows], self.X[cols])

    def contract(self, W, tape, rows, cols):
        total = np.zeros(self.kernel.n_dims)
        for of in self._apart(rows, cols) if len(total) else ():
            of_part = W[:, of.start - cols.start : of.stop - cols.start]
            # a tensor is that of a square: of rows and columns, all of their pairs
            side = min(side_of_tensor(len(total)), len(W))
            for i, j in product(*(_cut(n, side) for n in of_part.shape)):
                total += self._contract(of_part[i, j], _within(rows, i), _within(of, j))
        return total

    def _contract(self, W, rows, cols):
        if self._is_same(rows, cols):
            gradient = self.kernel(self.X[rows], eval_gradient=True)[1]
        else:  # a kernel has no gradient between two sets of rows, but of their union
            both, n = np.vstack([self.Z[rows], self.X[cols]]), len(W)
            gradient = self.kernel(both, eval_gradient=True)[1][:n, n:]
        return np.einsum("ij,ijp->p", W, gradient)


def side_of_tensor(n_slices):
    """Rows of a part of a tile whose gradient is one tensor."""
    return max(1, isqrt(TENSOR // max(1, n_slices)) // 2)


def _cut(n, most):
    """So many rows in parts of at most some, all of about the same size."""
    edges = np.linspace(0, n, -(-n // most) + 1).astype(int).tolist()
    return [slice(a, b) for a, b in pairwise(edges)]


def _within(rows, part):
    return slice(rows.start + part.start, rows.start + part.stop)


NODES = TERMS | {
    Columns: ColumnsNode,
    Exponentiation: PowerNode,
    Product: lambda kernel: JoinedNode(kernel, BoundProduct),
    Sum: lambda kernel: JoinedNode(kernel, BoundSum),
}


def compile_kernel(kernel):
    """The node of a kernel.

    Parameters
    ----------
    kernel : Kernel
        Any kernel of scikit-learn's kind.

    Returns
    -------
    node : Node
        Its fast form, or one that calls the kernel where its type is not known.

    Examples
    --------
    >>> from sklearn.gaussian_process.kernels import RBF
    >>> from skmtgp.model import compile_kernel
    >>> compile_kernel(RBF() + RBF()).n_dims
    2
    """
    if type(kernel) is Matern and kernel.nu in MATERN:
        return MATERN[kernel.nu](kernel)
    return NODES.get(type(kernel), UnknownNode)(kernel)


def is_foreign(node):
    """Whether a kernel has a part that is evaluated by itself, such as a user's.

    Parameters
    ----------
    node : Node
        Its fast form.
    """
    if type(node) is UnknownNode:
        return True
    inner = [node.inner] if hasattr(node, "inner") else []
    return any(map(is_foreign, [*getattr(node, "parts", ()), *inner]))
