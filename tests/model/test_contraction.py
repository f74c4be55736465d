import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from sklearn.gaussian_process.kernels import (
    RBF,
    CompoundKernel,
    ConstantKernel,
    DotProduct,
    Exponentiation,
    ExpSineSquared,
    Matern,
    PairwiseKernel,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp.kernels import (
    ARDLinear,
    Columns,
    Spherical,
    geometric_inverse_dynamics_kernel,
    inverse_dynamics_kernel,
)
from skmtgp.model._nodes import UnknownNode, compile_kernel
from skmtgp.model._nodes.differences import NARROW
from skmtgp.model._nodes.expressions import _products_of_others

EPS = np.finfo(float).eps
FIXED = "fixed"
ARD, CENTER = (0.7, 1.1, 1.9, 0.9), (0.5, -3.0, 0.0, 20.0)


class TwiceRBF(RBF):
    """A user's kernel, which only its type tells from an RBF."""

    def __call__(self, X, Y=None, eval_gradient=False):
        if eval_gradient:
            K, gradient = super().__call__(X, eval_gradient=True)
            return 2.0 * K, 2.0 * gradient
        return 2.0 * super().__call__(X, Y)


class OwnWhite(WhiteKernel):
    """A user's kernel to which a sample and itself are special."""


KNOWN = {
    "constant": ConstantKernel(1.3),
    "white": WhiteKernel(0.3),
    "linear": ARDLinear(0.6, 0.4),
    "linear, list of one": ARDLinear([0.6], 0.4),
    "linear ARD": ARDLinear(ARD, 0.4),
    "linear ARD, centred": ARDLinear(ARD, 0.4, center=CENTER),
    "linear, one centre": ARDLinear(0.6, 0.4, center=1.5),
    "linear ARD, fixed bias": ARDLinear(ARD, 0.0, bias_bounds=FIXED),
    "linear ARD, fixed weights": ARDLinear(ARD, 0.4, weights_bounds=FIXED),
    "dot product": DotProduct(0.8),
    "dot product, fixed": DotProduct(0.8, FIXED),
    "rbf": RBF(1.2),
    "rbf, list of one": RBF([1.2]),
    "rbf ARD": RBF(ARD),
    "rbf ARD, fixed": RBF(ARD, FIXED),
    "matern 1/2": Matern(1.2, nu=0.5),
    "matern 1/2 ARD": Matern(ARD, nu=0.5),
    "matern 3/2": Matern(1.2, nu=1.5),
    "matern 3/2 ARD": Matern(ARD, nu=1.5),
    "matern 5/2": Matern(1.2, nu=2.5),
    "matern 5/2 ARD": Matern(ARD, nu=2.5),
    "matern inf ARD": Matern(ARD, nu=np.inf),
    "rational quadratic": RationalQuadratic(1.2, 0.6),
    "rational quadratic, fixed alpha": RationalQuadratic(1.2, 0.6, alpha_bounds=FIXED),
    "rational quadratic, fixed scale": RationalQuadratic(1.2, 0.6, FIXED),
    "spherical": Columns(Spherical(2.2), [2, 0, 3]),
    "spherical ARD": Columns(Spherical((1.7, 2.1, 1.4)), [2, 0, 3]),
    "spherical, fixed": Columns(Spherical(2.2, FIXED), [1]),
    "power": Exponentiation(RBF(ARD) + ConstantKernel(0.5), 3.0),
    "power of a constant": ConstantKernel(1.3) ** 2,
    "root": (RBF(ARD) + ConstantKernel(0.5)) ** 0.5,
    "root of a constant": ConstantKernel(1.3) ** 0.5,
    "sum": RBF(ARD) + DotProduct(0.8),
    "sum of scalars": ConstantKernel(1.3) + WhiteKernel(0.3),
    "product": RBF(ARD) * ARDLinear(ARD, 0.4),
    "constant times": ConstantKernel(1.3) * RBF(1.2),
    "times constant": RBF(1.2) * ConstantKernel(1.3),
    "fixed constant times": ConstantKernel(1.3, FIXED) * RBF(1.2),
    "constants": ConstantKernel(1.3) * ConstantKernel(0.4),
    "white times": WhiteKernel(0.3) * RBF(1.2),
    "times white": RBF(1.2) * WhiteKernel(0.3),
    "constant times white": ConstantKernel(1.3) * WhiteKernel(0.3),
    "three factors": ConstantKernel(1.3) * RBF(1.2) * Matern(ARD, nu=2.5),
    "nested": (RBF(1.2) + ConstantKernel(0.3)) * (DotProduct(0.8) + WhiteKernel(0.1)),
    "columns": Columns(RBF([0.7, 1.9]), [2, 0]),
    "columns of columns": Columns(Columns(RBF(1.2), [1]) * ARDLinear(), [0, 2, 3]),
    "columns, fixed": Columns(RBF(0.7, FIXED), [1]),
    "square of a sum": (ARDLinear(ARD, 0.4) + RBF(1.2)) ** 2,
    "four factors": RBF(1.2) * ConstantKernel(0.7) * ARDLinear(ARD, 0.4) * RBF(ARD),
    "inverse dynamics": inverse_dynamics_kernel(1),
    "geometric, two joints that slide": Columns(
        geometric_inverse_dynamics_kernel("PP"), [0, 1, 2, 3, 1, 0, 3, 2]
    ),
    "geometric, one of two joints turns": Columns(
        geometric_inverse_dynamics_kernel("RP"), [0, 1, 2, 3, 1, 0, 3, 2, 1]
    ),
}
UNKNOWN = {
    "matern 0.9": Matern(1.2, nu=0.9),
    "sine": Columns(ExpSineSquared(1.2, 2.0), [1]),
    "sine, fixed": Columns(ExpSineSquared(1.2, 2.0, FIXED), [1]),
    "pairwise": PairwiseKernel(0.3, metric="rbf"),
    "user's": TwiceRBF(ARD),
    "unknown in a sum": ConstantKernel(1.3) * TwiceRBF(1.2) + ARDLinear(ARD),
    "unknown in a power": TwiceRBF(ARD) ** 2,
}
KERNELS = KNOWN | UNKNOWN
every_kernel = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS.keys())


@pytest.fixture
def X():
    return np.random.default_rng(0).standard_normal((9, 4))


@pytest.fixture
def Z():
    return np.random.default_rng(1).standard_normal((5, 4))


def moved(kernel):
    """Theta away from the kernel's own values, which must not be used."""
    return kernel.theta + np.linspace(-0.3, 0.4, kernel.n_dims)


def tiles(n, side=4):
    edges = [slice(a, min(a + side, n)) for a in range(0, n, side)]
    return [(rows, cols) for rows in edges for cols in edges]


class Counting(float):
    """A number that counts multiplications."""

    count = 0

    def __mul__(self, other):
        Counting.count += 1
        return Counting(float(self) * other)


@pytest.mark.parametrize("n", [2, 3, 4, 20])
def test_products_of_all_factors_but_one(n):
    numbers = np.random.default_rng(n).standard_normal(n)
    Counting.count = 0
    found = list(_products_of_others(tuple(map(Counting, numbers))))
    np.testing.assert_allclose(found, np.prod(numbers) / numbers)
    assert Counting.count <= 3 * n  # it was n^2


def test_root_of_values_that_underflow():
    X, rows = np.array([[0.0], [1.0], [1e3]]), slice(0, 3)
    kernel, other = RBF(1.0) ** 0.5, RBF(np.sqrt(2.0))
    found, expected = (
        bound.contract(W, bound.block(rows, rows)[1], rows, rows)
        for W in [np.random.default_rng(0).standard_normal((3, 3))]
        for bound in (compile_kernel(k).bind(k.theta, X) for k in (kernel, other))
    )
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("known", [RBF, Matern, ConstantKernel, ARDLinear, DotProduct])
def test_subclasses_are_unknown(known):
    subclass = type("Own", (known,), {})
    assert isinstance(compile_kernel(subclass()), UnknownNode)
    assert not isinstance(compile_kernel(known()), UnknownNode)


def test_compound_kernels_are_unknown():
    assert isinstance(compile_kernel(CompoundKernel([RBF()])), UnknownNode)


@every_kernel
def test_values(kernel, X):
    node, theta = compile_kernel(kernel), moved(kernel)
    bound, K = node.bind(theta, X), np.full((9, 9), np.nan)
    for rows, cols in tiles(9):
        K[rows, cols] = bound.block(rows, cols)[0]
    expected = kernel.clone_with_theta(theta)(X)
    np.testing.assert_allclose(K, expected, rtol=1e-13, atol=1e-14)


@every_kernel
def test_values_against_other_rows(kernel, X, Z):
    theta = moved(kernel)
    against = compile_kernel(kernel).bind(theta, X).against(Z)
    expected = kernel.clone_with_theta(theta)(Z, X)
    for rows in (slice(0, 5), slice(1, 4)):
        K = np.broadcast_to(against.block(rows, slice(2, 9))[0], (len(Z[rows]), 7))
        np.testing.assert_allclose(K, expected[rows, 2:], rtol=1e-13, atol=1e-14)


@every_kernel
def test_product_of_a_tile(kernel, X, Z):
    theta = moved(kernel)
    against = compile_kernel(kernel).bind(theta, X).against(Z)
    B = np.random.default_rng(3).standard_normal((7, 2))
    product = against.times(slice(1, 4), slice(2, 9), B)
    expected = kernel.clone_with_theta(theta)(Z, X)[1:4, 2:] @ B
    np.testing.assert_allclose(product, expected, rtol=1e-12, atol=1e-13)


@every_kernel
def test_white_noise_is_not_shared_with_equal_rows(kernel, X):
    theta = moved(kernel)
    K, _ = compile_kernel(kernel).bind(theta, X).against(X).block(*[slice(0, 9)] * 2)
    expected = kernel.clone_with_theta(theta)(X, X)
    np.testing.assert_allclose(np.broadcast_to(K, (9, 9)), expected, atol=1e-13)


@every_kernel
@pytest.mark.parametrize("twins", [False, True])
def test_contraction(kernel, X, twins):
    if twins:  # tasks that share inputs
        X[5:8] = X[1:4]
    node, theta = compile_kernel(kernel), moved(kernel)
    bound, W = node.bind(theta, X), np.random.default_rng(2).standard_normal((9, 9))
    total = np.zeros(kernel.n_dims)
    for rows, cols in tiles(9):
        tape = bound.block(rows, cols)[1]
        part = bound.contract(W[rows, cols], tape, rows, cols)
        assert part.shape == total.shape
        total += part
    gradient = kernel.clone_with_theta(theta)(X, eval_gradient=True)[1]
    expected = np.einsum("ij,ijp->p", W, gradient)
    np.testing.assert_allclose(total, expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("kernel", [*KERNELS.values(), OwnWhite(0.3)], ids=str)
def test_columns_that_begin_with_the_rows(kernel, X):
    theta, rows, cols = moved(kernel), slice(2, 5), slice(2, 9)
    bound = compile_kernel(kernel).bind(theta, X)
    W = np.random.default_rng(2).standard_normal((3, 7))
    K, tape = bound.block(rows, cols)
    found = bound.contract(W, tape, rows, cols)
    K_x, gradient = kernel.clone_with_theta(theta)(X, eval_gradient=True)
    K = np.broadcast_to(K, (3, 7))
    np.testing.assert_allclose(K, K_x[rows, cols], rtol=1e-13, atol=1e-14)
    expected = np.einsum("ij,ijp->p", W, gradient[rows, cols])
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


def test_contraction_leaves_the_weights_alone(X):
    W = np.random.default_rng(2).standard_normal((9, 9))
    before, everything = W.copy(), slice(0, 9)
    for kernel in KERNELS.values():
        bound = compile_kernel(kernel).bind(kernel.theta, X)
        tape = bound.block(everything, everything)[1]
        bound.contract(W, tape, everything, everything)
        np.testing.assert_array_equal(W, before)


@pytest.mark.parametrize("spread", [1e2, 1e4, 1e10])
def test_far_rows_underflow_quietly(spread):
    X = spread * np.arange(4.0)[:, None] * np.ones(4)
    everything = slice(0, 4)
    for kernel in [RBF(ARD), Matern(ARD, nu=0.5), RationalQuadratic(1.0, 500.0)]:
        bound = compile_kernel(kernel).bind(kernel.theta, X)
        K, tape = bound.block(everything, everything)
        np.testing.assert_allclose(K, kernel(X), rtol=1e-10, atol=1e-40)
        gradient = bound.contract(np.ones((4, 4)), tape, everything, everything)
        expected = kernel(X, eval_gradient=True)[1].sum(axis=(0, 1))
        np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-40)


def rbf_by_differences(X, length_scale):
    difference = (X[:, None] - X[None]) / length_scale
    s = np.square(difference)
    K = np.exp(-0.5 * s.sum(axis=2))
    return K, K[:, :, None] * s


def largest_square(X, length_scale):
    return np.square((X - X.mean(axis=0)) / length_scale).sum(axis=1).max()


rows = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).standard_normal((8, 3))
)
offsets = st.sampled_from([0.0, 1.0, -1e3, 1e6, 1e12])
scales = st.sampled_from([1e-6, 1e-2, 1.0, 1e5])
lengths = st.floats(0.05, 20.0)


@given(rows, offsets, scales, lengths)
@settings(max_examples=60, deadline=None)
def test_rounding_of_distances(X, offset, scale, length):
    # |k - exact| < 10 eps max |z|^2, z = (x - mean) / l: the offset costs nothing, nor
    # do features that are many length-scales wide
    X, length_scale = offset + scale * X, scale * length * np.array([1.0, 2.0, 0.5])
    bound = compile_kernel(RBF(length_scale)).bind(np.log(length_scale), X)
    everything = slice(0, 8)
    K, tape = bound.block(everything, everything)
    expected, terms = rbf_by_differences(X, length_scale)
    size = 1.0 + min(largest_square(X, length_scale), NARROW)
    np.testing.assert_allclose(K, expected, rtol=0.0, atol=10.0 * EPS * size)
    W = np.ones((8, 8))
    gradient = bound.contract(W, tape, everything, everything)
    np.testing.assert_allclose(
        gradient, terms.sum(axis=(0, 1)), rtol=0.0, atol=64.0 * 10.0 * EPS * size
    )


@pytest.mark.parametrize(("nu", "digits"), [(0.5, 0.0), (1.5, 4.0), (2.5, 4.0)])
def test_twins_of_matern(nu, digits):
    # r = sqrt(s): where nu = 1/2 rounding of s by eps |z|^2 would show to its root
    X = np.random.default_rng(0).standard_normal((40, 6))
    X = np.repeat(X, 2, axis=0)
    bound = compile_kernel(Matern(0.5, nu=nu)).bind(np.log([0.5]), X)
    K = bound.block(slice(0, 80), slice(0, 80))[0]
    accuracy = digits * EPS * largest_square(X, 0.5)
    np.testing.assert_allclose(K[::2, 1::2].diagonal(), 1.0, rtol=0.0, atol=accuracy)
