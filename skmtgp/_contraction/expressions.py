"""Nodes of kernels made of others, and the node of any kernel."""

import numpy as np
from sklearn.gaussian_process.kernels import Exponentiation, Matern, Product, Sum

from skmtgp._contraction.terms import (
    MATERN,
    TERMS,
    Bound,
    BoundConstant,
    Node,
    allocate,
)
from skmtgp.kernels import Columns


class ColumnsNode(Node):
    """A kernel of some of the features."""

    def __init__(self, kernel):
        self.select, self.inner = kernel.select, compile_kernel(kernel.kernel)
        self.n_dims = kernel.n_dims

    def bind(self, theta, X):
        return BoundColumns(self.select, self.inner.bind(theta, self.select(X)))


class BoundColumns(Bound):
    def __init__(self, select, inner):
        self.select, self.inner = select, inner
        self.block, self.contract = inner.block, inner.contract

    def against(self, Z):
        return self.inner.against(self.select(Z))


class PairNode(Node):
    """A sum or a product of two kernels."""

    def __init__(self, kernel, bound):
        self.bound, self.n_dims = bound, kernel.n_dims
        self.left, self.right = compile_kernel(kernel.k1), compile_kernel(kernel.k2)

    def bind(self, theta, X):
        n = self.left.n_dims
        return self.bound(self.left.bind(theta[:n], X), self.right.bind(theta[n:], X))


class BoundSum(Bound):
    def __init__(self, left, right):
        self.left, self.right = left, right

    def against(self, Z):
        return BoundSum(self.left.against(Z), self.right.against(Z))

    def block(self, rows, cols, new=allocate):
        left, left_tape = self.left.block(rows, cols, new)
        right, right_tape = self.right.block(rows, cols, new)
        return np.add(left, right, out=new()), (left_tape, right_tape)

    def times(self, rows, cols, B):
        return self.left.times(rows, cols, B) + self.right.times(rows, cols, B)

    def contract(self, W, tape, rows, cols):
        left = self.left.contract(W, tape[0], rows, cols)
        return np.concatenate([left, self.right.contract(W, tape[1], rows, cols)])


class BoundProduct(Bound):
    def __init__(self, left, right):
        self.left, self.right = left, right

    def against(self, Z):
        return BoundProduct(self.left.against(Z), self.right.against(Z))

    def block(self, rows, cols, new=allocate):
        left, left_tape = self.left.block(rows, cols, new)
        right, right_tape = self.right.block(rows, cols, new)
        return left * right, (left, right, left_tape, right_tape)

    def times(self, rows, cols, B):
        if isinstance(self.left, BoundConstant):
            return self.left.c * self.right.times(rows, cols, B)
        return super().times(rows, cols, B)

    def contract(self, W, tape, rows, cols):
        left, right, left_tape, right_tape = tape
        d_left = _contract_factor(self.left, W, left_tape, right, rows, cols)
        d_right = _contract_factor(self.right, W, right_tape, left, rows, cols)
        return np.concatenate([d_left, d_right])


def _contract_factor(factor, W, tape, other, rows, cols):
    """Contraction of one factor of a product, `other` being the values of the other."""
    if np.ndim(other) == 0:  # contractions are linear in W
        return other * factor.contract(W, tape, rows, cols)
    if isinstance(factor, BoundConstant):
        return np.full(factor.n_dims, factor.c * np.vdot(W, other))
    return factor.contract(W * other, tape, rows, cols)


class PowerNode(Node):
    """A kernel to a fixed power."""

    def __init__(self, kernel):
        self.exponent, self.inner = kernel.exponent, compile_kernel(kernel.kernel)
        self.n_dims = kernel.n_dims

    def bind(self, theta, X):
        return BoundPower(self.inner.bind(theta, X), self.exponent)


class BoundPower(Bound):
    def __init__(self, inner, exponent):
        self.inner, self.exponent = inner, exponent

    def against(self, Z):
        return BoundPower(self.inner.against(Z), self.exponent)

    def block(self, rows, cols, new=allocate):
        K, tape = self.inner.block(rows, cols, new)
        return K**self.exponent, (K, tape)

    def contract(self, W, tape, rows, cols):
        K, inner_tape = tape
        W = self.exponent * W * K ** (self.exponent - 1)
        return self.inner.contract(W, inner_tape, rows, cols)


class UnknownNode(Node):
    """Any other kernel: its own values and its own gradient, of each tile."""

    def __init__(self, kernel):
        self.kernel, self.n_dims = kernel, kernel.n_dims

    def bind(self, theta, X):
        return BoundUnknown(self.kernel.clone_with_theta(theta), X, X)


class BoundUnknown(Bound):
    def __init__(self, kernel, Z, X):
        self.kernel, self.Z, self.X = kernel, Z, X

    def against(self, Z):
        return BoundUnknown(self.kernel, Z, self.X)

    def block(self, rows, cols, new=allocate):
        if self.Z is self.X and rows == cols:  # a sample and itself may be special
            return self.kernel(self.X[rows]), None
        return self.kernel(self.Z[rows], self.X[cols]), None

    def contract(self, W, tape, rows, cols):
        if rows == cols:
            gradient = self.kernel(self.X[rows], eval_gradient=True)[1]
        else:  # a kernel has no gradient between two sets of rows, but of their union
            both, n = np.vstack([self.X[rows], self.X[cols]]), len(W)
            gradient = self.kernel(both, eval_gradient=True)[1][:n, n:]
        return np.einsum("ij,ijp->p", W, gradient)


NODES = TERMS | {
    Columns: ColumnsNode,
    Exponentiation: PowerNode,
    Product: lambda kernel: PairNode(kernel, BoundProduct),
    Sum: lambda kernel: PairNode(kernel, BoundSum),
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
    """
    if type(kernel) is Matern and kernel.nu in MATERN:
        return MATERN[kernel.nu](kernel)
    return NODES.get(type(kernel), UnknownNode)(kernel)
