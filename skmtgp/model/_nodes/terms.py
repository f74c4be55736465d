"""Nodes of the kernels that have a formula of their own."""

from copy import copy

import numpy as np
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp.kernels import ARDLinear, Spherical
from skmtgp.model._nodes.differences import Differences, append


def allocate():
    """No array: numpy is to make it.

    What :class:`Bound` kernels take for `new` where nobody keeps arrays for them.

    Returns
    -------
    array : None
        For numpy to make one.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.model import allocate
    >>> np.add([1.0], [2.0], out=allocate())
    array([3.])
    """
    return None


class Node:
    """A kernel in its fast form: which of its hyperparameters theta sets.

    A subclass has a method ``bind(theta, X)``, which gives the :class:`Bound` kernel
    between the rows of X, and an entry in ``NODES`` under the kernel's type.

    Parameters
    ----------
    kernel : Kernel
        scikit-learn's kernel.

    Attributes
    ----------
    n_dims : int
        Length of theta.
    n_slices : int
        Of the largest tensor that a kernel within is asked for.
    free : dict
        Numbers of elements of the hyperparameters that theta sets, by name.
    fixed : dict
        Values of the others, by name.

    Examples
    --------
    >>> from sklearn.gaussian_process.kernels import RBF
    >>> from skmtgp.model import Node
    >>> node = Node(RBF(2.0))
    >>> node.n_dims, float(node.values([0.0])["length_scale"])
    (1, 1.0)
    """

    n_slices = 0

    def __init__(self, kernel):
        self.kernel = kernel
        self.n_dims = kernel.n_dims
        named = [(h, getattr(kernel, h.name)) for h in kernel.hyperparameters]
        self.free = {h.name: h.n_elements for h, _ in named if not h.fixed}
        self.fixed = {h.name: np.asarray(value) for h, value in named if h.fixed}

    def values(self, theta):
        """Hyperparameters by name, the free ones from theta.

        Parameters
        ----------
        theta : ndarray of shape (n_dims,)
            Logarithms of the free hyperparameters.

        Returns
        -------
        values : dict
            A number, or an array where there are several elements, for each name.
        """
        values, start = dict(self.fixed), 0
        for name, size in self.free.items():
            value = np.exp(theta[start : start + size])
            values[name] = value if size > 1 else value[0]
            start += size
        return values

    def derivatives(self, theta, X, parts):
        """The values and their derivatives, if that is faster than the kernel's own.

        Parameters
        ----------
        theta : ndarray of shape (n_dims,)
            Logarithms of the free hyperparameters.
        X : ndarray of shape (n_samples, n_features)
            Rows.
        parts : Parts
            Of the rows: those of different parts have none.

        Returns
        -------
        values : ndarray of shape (n_parts, size, size)
            k between the rows of each part.
        derivatives : ndarray of shape (n_dims, n_parts, size, size)
            By each element of theta. What is padded is any number. None instead of both
            where the kernel is to be asked.
        """
        return None

    def stack(self, gradients):
        """The gradient in the order of theta, from one by name.

        Parameters
        ----------
        gradients : dict
            For each name that by the logarithm of the hyperparameter. Those of fixed
            ones are left out.

        Returns
        -------
        gradient : ndarray of shape (n_dims,)
            The gradient.
        """
        of_free = [gradients[name] for name in self.free]
        return np.concatenate(of_free, axis=None) if of_free else np.empty(0)


class Bound:
    """A kernel with its hyperparameters set, between two sets of rows.

    Notes
    -----
    A subclass has three methods:

    - ``against(Z)``: the same between the rows of Z and those of X, which it was bound
      to.
    - ``block(rows, cols, new=allocate)``: the values of a tile, and a tape, which is
      whatever the gradient can use again. ``new()`` gives an array for the tile that
      lasts as long, or None.
    - ``contract(W, tape, rows, cols)``: the sum over the tile of W times the derivative
      by each element of theta. It leaves W as it is.

    The rows of a tile are none of its columns, or its first columns: the diagonal is
    where ``rows.start == cols.start``, unless it was bound against others.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.gaussian_process.kernels import RBF
    >>> from skmtgp.model import compile_kernel
    >>> bound = compile_kernel(RBF()).bind(np.zeros(1), np.array([[0.0], [1.0]]))
    >>> everywhere = slice(0, 2)
    >>> values, tape = bound.block(everywhere, everywhere)
    >>> values.round(2)
    array([[1.  , 0.61],
           [0.61, 1.  ]])
    >>> bound.contract(np.ones((2, 2)), tape, everywhere, everywhere).round(2)
    array([1.21])
    """

    def times(self, rows, cols, B):
        """The tile times B, which has a row for each of its columns.

        Parameters
        ----------
        rows, cols : slice
            The tile.
        B : ndarray of shape (n_columns, n_vectors)
            A matrix.

        Returns
        -------
        product : ndarray of shape (n_rows, n_vectors)
            Without a tape.
        """
        K, _ = self.block(rows, cols)
        shape = rows.stop - rows.start, cols.stop - cols.start
        return np.broadcast_to(K, shape) @ B

    def blocks(self, parts):
        """The values between the rows of each part, stacked, and a tape.

        Parameters
        ----------
        parts : Parts
            Of the rows that it is bound to.

        Returns
        -------
        values : ndarray of shape parts.shape
            Where nothing is, they are any.
        tape : object
            For `contract_blocks`.
        """
        found, stacked = [self.block(of, of) for of in parts.slices], parts.zeros()
        for tile, n, (values, _) in zip(stacked, parts.counts, found, strict=True):
            tile[:n, :n] = values
        return stacked, [tape for _, tape in found]

    def contract_blocks(self, W, tape, parts):
        """The sum over all parts of W times the derivative, as `contract`.

        Parameters
        ----------
        W : ndarray of shape parts.shape
            Numbers, zeros where nothing is.
        tape : object
            What `blocks` gave.
        parts : Parts
            Of the rows.

        Returns
        -------
        gradient : ndarray of shape (n_dims,)
            In the order of theta.
        """
        of_parts = zip(W, parts.counts, tape, parts.slices, strict=True)
        return sum(self.contract(w[:n, :n], t, of, of) for w, n, t, of in of_parts)


class ConstantNode(Node):
    """k = c."""

    def bind(self, theta, X):
        return BoundConstant(self, **self.values(theta))


class BoundConstant(Bound):
    def __init__(self, node, constant_value):
        self.n_dims, self.c = node.n_dims, float(constant_value)

    def against(self, Z):
        return self

    def block(self, rows, cols, new=allocate):
        return self.c, None

    def contract(self, W, tape, rows, cols):
        return np.full(self.n_dims, self.c * W.sum())


class WhiteNode(Node):
    """k = s for a sample and itself, 0 otherwise."""

    def bind(self, theta, X):
        return BoundWhite(self, **self.values(theta))


class BoundWhite(Bound):
    def __init__(self, node, noise_level):
        self.n_dims, self.s = node.n_dims, float(noise_level)

    def against(self, Z):
        return BoundZero()

    def block(self, rows, cols, new=allocate):
        if rows.start != cols.start:
            return 0.0, None
        return self.s * np.eye(rows.stop - rows.start, cols.stop - cols.start), None

    def contract(self, W, tape, rows, cols):
        same = rows.start == cols.start
        return np.full(self.n_dims, self.s * np.trace(W) if same else 0.0)


class BoundZero(Bound):
    def block(self, rows, cols, new=allocate):
        return 0.0, None


class LinearNode(Node):
    """k = b + sum_d w_d (x - c)_d (x' - c)_d, with a weight or one for each feature."""

    def bind(self, theta, X):
        return BoundLinear(self, X, self.kernel.center, **self.values(theta))


class BoundLinear(Bound):
    def __init__(self, node, X, center, weights, bias):
        self.node, self.is_ard = node, np.ndim(weights) > 0
        self.center = np.broadcast_to(np.asarray(center, dtype=float), X.shape[1])
        X = X - self.center
        # the bias is the weight of a further feature, which is one
        self.w = append(np.full(X.shape[1], weights), bias)
        self.right = append(X, 1.0)
        self.left, self.across = self.right * self.w, np.ascontiguousarray(self.right.T)

    def against(self, Z):
        other = object.__new__(type(self))  # copy() asks how to make one, each time
        vars(other).update(vars(self), left=append(Z - self.center, 1.0) * self.w)
        return other

    def block(self, rows, cols, new=allocate):
        return self.left[rows] @ self.across[:, cols], None

    def times(self, rows, cols, B):
        return self.left[rows] @ (self.right[cols].T @ B)

    def contract(self, W, tape, rows, cols):
        per_weight = np.einsum("id,id->d", self.left[rows], W @ self.right[cols])
        weights, bias = per_weight[:-1], per_weight[-1]
        return self.node.stack(
            {"bias": bias, "weights": weights if self.is_ard else weights.sum()}
        )


class DotProductNode(Node):
    """k = sigma_0^2 + x . x', scikit-learn's."""

    def bind(self, theta, X):
        return BoundLinear(self, X, 0.0, 1.0, self.values(theta)["sigma_0"] ** 2)

    def stack(self, gradients):
        return np.full(self.n_dims, 2.0 * gradients["bias"])  # b = sigma_0^2


def _rbf(e, out=None):
    K = np.exp(e, out=out)
    return K, K


def _matern12(e, out=None):
    r = _root(e, 2.0)
    K = np.exp(-r)
    return K, np.divide(K, _no_pole(r), out=out)


def _matern32(e, out=None):
    r = _root(e, 6.0)
    decay, K = _decay(r), 1.0 + r
    K *= decay
    return K, np.multiply(decay, 3.0, out=out)


def _matern52(e, out=None):
    r = _root(e, 10.0)
    decay, K = _decay(r), r * r
    K /= 3.0
    r += 1.0
    K += r
    K *= decay
    decay *= 5.0 / 3.0
    return K, np.multiply(r, decay, out=out)


def _decay(r):
    """exp(-r), in one new array: fresh memory takes longer than the numbers."""
    decay = np.negative(r)
    return np.exp(decay, out=decay)


def _spherical(e, out=None):
    h = _root(e, 2.0)
    K = np.where(h < 1.0, 1.0 - h * (1.5 - 0.5 * h * h), 0.0)
    slope = np.maximum(1.5 * (1.0 - h * h), 0.0)
    return K, np.divide(slope, _no_pole(h), out=out)


def _no_pole(r):
    """Infinity for zero, in the place of r: a slope counts as zero there."""
    np.putmask(r, r == 0.0, np.inf)
    return r


def _root(e, factor):
    """sqrt(-factor e), in the place of e."""
    return np.sqrt(np.multiply(e, -factor, out=e), out=e)


def _rational_quadratic(e, out=None, *, alpha):
    more = e / -alpha  # a large power of 1 + more has its digits in the logarithm alone
    K = np.exp(-alpha * np.log1p(more))
    return K, np.divide(K, 1.0 + more, out=out)


class StationaryNode(Node):
    """k = g(e), e = -1/2 sum_d (x_d - x'_d)^2 / l_d^2.

    ``profile(e, out)`` returns g(e) and g'(e), the factor of (x_d - x'_d)^2 / l_d^2 in
    the derivative with respect to log l_d. It may overwrite e. The second is in `out`,
    which may be e, if that is not None. `steep` says whether g' has a pole at 0.
    """

    def __init__(self, kernel, profile, *, steep=False):
        super().__init__(kernel)
        self.profile, self.steep = profile, steep

    def bind(self, theta, X):
        return BoundStationary(self, X, **self.values(theta))

    def derivatives(self, theta, X, parts):
        if list(self.free) != ["length_scale"]:
            return None
        shape = self.values(theta)
        length_scale = shape.pop("length_scale")
        with np.errstate(all="ignore"):  # of length-scales that are next to nothing
            z = (X / length_scale).T.take(parts.places, axis=1)
            apart = z[..., None] - z[..., None, :]
            squares = np.square(apart, out=apart)
            K, slope = self.profile(-0.5 * squares.sum(axis=0), **shape)
            squares *= slope
        alone = np.ndim(length_scale) == 0
        return K, squares.sum(axis=0, keepdims=True) if alone else squares


class BoundStationary(Bound):
    def __init__(self, node, X, length_scale, **shape):
        self.node, self.l, self.shape = node, length_scale, shape
        self.differences = Differences(X, length_scale, steep=node.steep)

    def against(self, Z):
        other = copy(self)
        other.differences = self.differences.against(Z)
        return other

    def block(self, rows, cols, new=allocate):
        e, near = self.differences.exponents(rows, cols)
        K, slope = self.node.profile(e, new(), **self.shape)
        return K, (K if "alpha" in self.shape else None, slope, near)

    def contract(self, W, tape, rows, cols):
        K, slope, near = tape
        sums = self.differences.contract(W * slope, near, rows, cols)
        return self._gradient(sums, W, K, slope)

    def _gradient(self, sums, W, K, slope):
        gradients = {"length_scale": sums if np.ndim(self.l) else sums.sum()}
        if "alpha" in self.shape:
            gradients["alpha"] = self._contract_alpha(W, K, slope)
        return self.node.stack(gradients)

    def blocks(self, parts):
        if not self.differences.are_products:
            return super().blocks(parts)
        e = self.differences.exponents_within(parts.places)
        K, slope = self.node.profile(e, **self.shape)
        return K, (K if "alpha" in self.shape else None, slope)

    def contract_blocks(self, W, tape, parts):
        if not self.differences.are_products:
            return super().contract_blocks(W, tape, parts)
        K, slope = tape
        sums = self.differences.contract_within(W * slope, parts.places)
        return self._gradient(sums, W, K, slope)

    def _contract_alpha(self, W, K, slope):
        """Derivative of base^-alpha by log alpha; base = 1 - e / alpha."""
        alpha = self.shape["alpha"]
        base = np.divide(K, slope, out=np.ones_like(K), where=slope > 0.0)
        return alpha * np.vdot(W, K * (1.0 - 1.0 / base - np.log(base)))


MATERN = {
    0.5: lambda kernel: StationaryNode(kernel, _matern12, steep=True),
    1.5: lambda kernel: StationaryNode(kernel, _matern32),
    2.5: lambda kernel: StationaryNode(kernel, _matern52),
    np.inf: lambda kernel: StationaryNode(kernel, _rbf),
}
TERMS = {
    ARDLinear: LinearNode,
    ConstantKernel: ConstantNode,
    DotProduct: DotProductNode,
    RBF: lambda kernel: StationaryNode(kernel, _rbf),
    RationalQuadratic: lambda kernel: StationaryNode(kernel, _rational_quadratic),
    Spherical: lambda kernel: StationaryNode(kernel, _spherical, steep=True),
    WhiteKernel: WhiteNode,
}
