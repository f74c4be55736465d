import numpy as np
import pytest
import textbook
from sklearn.base import clone
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Matern,
    WhiteKernel,
)

from skmtgp import PooledGP
from skmtgp.kernels import ARDLinear, Columns, Spherical, inverse_dynamics_kernel

FIXED = "fixed"
KERNELS = [
    ARDLinear(2.0, 0.7),
    ARDLinear([2.0], 0.7),
    ARDLinear([0.5, 1.5, 3.0], 0.7),
    ARDLinear(np.array([0.5, 1.5, 3.0]), 0.7, (1e-3, 1e2), (1e-2, 1e1)),
    ARDLinear([0.5, 1.5, 3.0], 0.7, center=[0.3, -2.0, 40.0]),
    ARDLinear(2.0, 0.7, center=1.5),
    ARDLinear([0.5, 1.5, 3.0], 0.0, bias_bounds=FIXED),
    ARDLinear([0.5, 1.5, 3.0], 0.7, weights_bounds=FIXED),
    ARDLinear(2.0, 0.7, FIXED, FIXED),
    Columns(RBF(0.8), [2]),
    Columns(RBF([0.8, 1.3]), (0, 2)),
    Columns(RBF([0.8, 1.3]), range(2)),
    Columns(RBF(0.8, FIXED), np.array([1])),
    Columns(ARDLinear([2.0, 1.0], 0.7, bias_bounds=FIXED), [1, 0]),
    Columns(ConstantKernel(2.0) * Columns(RBF([0.8, 1.3]), [1, 0]), [2, 1]),
    Spherical(2.5),
    Spherical([2.5, 1.5, 3.0]),
    Spherical(2.5, FIXED),
    ARDLinear() + ConstantKernel(1.5, FIXED) * Columns(Matern(nu=1.5), [1, 2]),
]
every_kernel = pytest.mark.parametrize("kernel", KERNELS, ids=repr)


@pytest.fixture
def X():
    return np.random.default_rng(0).standard_normal((6, 3))


@pytest.fixture
def Z():
    return np.random.default_rng(1).standard_normal((4, 3))


@pytest.mark.parametrize("weights", [2.0, [0.5, 1.5, 3.0]])
def test_linear_value(X, Z, weights):
    w = np.broadcast_to(weights, 3)
    expected = [[0.7 + sum(w * x * z) for z in Z] for x in X]
    np.testing.assert_allclose(ARDLinear(weights, 0.7)(X, Z), expected, rtol=1e-14)


@pytest.mark.parametrize("center", [1.5, [0.3, -2.0, 40.0]])
def test_centre_of_linear(X, Z, center):
    """It is the linear kernel of centred features."""
    centred, plain = (ARDLinear([0.5, 1.5, 3.0], 0.7, center=c) for c in (center, 0.0))
    X_0, Z_0 = X - np.array(center), Z - np.array(center)
    np.testing.assert_allclose(centred(X, Z), plain(X_0, Z_0), rtol=1e-14)
    np.testing.assert_allclose(centred.diag(X), plain.diag(X_0), rtol=1e-14)
    pairs = zip(centred(X, None, True), plain(X_0, None, True), strict=True)
    for found, expected in pairs:
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    assert centred.n_dims == plain.n_dims


def test_linear_is_dot_product(X, Z):
    linear, dot = ARDLinear(1.0, 1.3**2), DotProduct(1.3)
    np.testing.assert_allclose(linear(X, Z), dot(X, Z), rtol=1e-14)
    np.testing.assert_allclose(linear.diag(X), dot.diag(X), rtol=1e-14)


def test_columns_see_some_features_only(X, Z):
    rbf = RBF([0.8, 1.3])
    expected = rbf(X[:, [2, 0]], Z[:, [2, 0]])
    np.testing.assert_array_equal(Columns(rbf, [2, 0])(X, Z), expected)


def test_columns_may_count_from_the_end(X):
    np.testing.assert_array_equal(Columns(RBF(), [-1, 0])(X), RBF()(X[:, [2, 0]]))


@pytest.mark.parametrize(
    "columns", [["x"], [], 0, "x", None, [0.0], [True, False], [0, True], [[0]]]
)
def test_columns_that_are_no_indices(columns, X):
    with pytest.raises(ValueError, match=r"must be a list of indices \(int\) of feat"):
        Columns(RBF(), columns)(X)


@pytest.mark.parametrize("column", [3, -4])
def test_columns_that_are_not_there(column, X):
    with pytest.raises(ValueError, match=rf"name column {column}, but X has 3 featu"):
        Columns(RBF(), [0, column]).diag(X)


def test_nested_columns_count_within_the_outer_ones(X):
    nested = Columns(Columns(RBF(), [1]), [0, 2])
    np.testing.assert_array_equal(nested(X), RBF()(X[:, [2]]))


@every_kernel
def test_rows_may_be_lists(kernel, X, Z):
    np.testing.assert_array_equal(kernel(X.tolist(), Z.tolist()), kernel(X, Z))


@every_kernel
def test_diagonal(kernel, X):
    np.testing.assert_allclose(kernel.diag(X), np.diagonal(kernel(X)), rtol=1e-14)


@every_kernel
def test_values_without_second_argument(kernel, X):
    np.testing.assert_allclose(kernel(X), kernel(X, X), rtol=1e-14)


@every_kernel
def test_gradient(kernel, X):
    K, gradient = kernel(X, eval_gradient=True)
    np.testing.assert_array_equal(K, kernel(X))
    assert gradient.shape == (6, 6, kernel.n_dims)
    expected = textbook.derivative(
        lambda theta: kernel.clone_with_theta(theta)(X), kernel.theta
    )
    expected = expected.reshape(-1, 6, 6)
    np.testing.assert_allclose(np.moveaxis(gradient, 2, 0), expected, atol=1e-10)


@pytest.mark.parametrize(
    ("kernel", "n_dims"),
    list(
        zip(
            KERNELS,
            [2, 2, 4, 4, 4, 2, 3, 1, 0, 1, 2, 2, 0, 2, 3, 1, 3, 0, 3],
            strict=True,
        )
    ),
)
def test_number_of_free_hyperparameters(kernel, n_dims):
    assert kernel.n_dims == len(kernel.theta) == n_dims
    assert kernel.bounds.reshape(-1, 2).shape == (n_dims, 2)


def test_theta_and_bounds_are_logarithms_bias_first():
    kernel = ARDLinear([0.5, 1.5], 0.7, (1e-3, 1e2), (1e-2, 1e1))
    np.testing.assert_array_equal(kernel.theta, np.log([0.7, 0.5, 1.5]))
    bounds = np.log([[1e-2, 1e1], [1e-3, 1e2], [1e-3, 1e2]])
    np.testing.assert_array_equal(kernel.bounds, bounds)
    np.testing.assert_array_equal(Columns(kernel, [0, 1]).theta, kernel.theta)
    np.testing.assert_array_equal(Columns(kernel, [0, 1]).bounds, bounds)


@every_kernel
def test_clone(kernel, X):
    copy = clone(kernel)
    assert copy is not kernel
    assert copy == kernel
    np.testing.assert_array_equal(copy(X), kernel(X))


@every_kernel
def test_clone_with_theta(kernel, X):
    before, theta = kernel(X), kernel.theta + 0.1 * np.arange(1, kernel.n_dims + 1)
    other = kernel.clone_with_theta(theta)
    np.testing.assert_allclose(other.theta, theta, rtol=1e-14)
    np.testing.assert_array_equal(kernel(X), before)
    assert (other == kernel) is (kernel.n_dims == 0)


def test_setting_theta_of_columns_sets_the_kernel_inside():
    kernel = Columns(RBF([0.8, 1.3]), [0, 2])
    kernel.theta = np.log([2.0, 3.0])
    np.testing.assert_allclose(kernel.kernel.length_scale, [2.0, 3.0], rtol=1e-15)


def test_parameters_of_columns():
    inner = RBF(0.8)
    kernel = Columns(inner, [1])
    assert kernel.get_params(deep=False) == {"kernel": inner, "columns": [1]}
    assert kernel.get_params()["kernel__length_scale"] == 0.8
    kernel.set_params(kernel__length_scale=2.0)
    assert inner.length_scale == 2.0


def test_hyperparameters_of_columns():
    bounds = (1e-2, 1e2)
    (inner,) = RBF([0.8, 1.3], bounds).hyperparameters
    (outer,) = Columns(RBF([0.8, 1.3], bounds), [0, 2]).hyperparameters
    assert outer.name == "kernel__length_scale"
    np.testing.assert_array_equal(outer.bounds, inner.bounds)
    assert (outer.n_elements, outer.fixed) == (2, False)
    assert Columns(RBF(0.8, FIXED), [1]).hyperparameters[0].fixed


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (ARDLinear(1.0), ARDLinear(2.0)),
        (ARDLinear([1.0, 2.0]), ARDLinear([1.0, 3.0])),
        (ARDLinear(bias_bounds=FIXED), ARDLinear()),
        (ARDLinear(center=[0.0, 1.0]), ARDLinear()),
        (Columns(RBF(1.0), [0]), Columns(RBF(2.0), [0])),
        (Columns(RBF(1.0), [0]), Columns(RBF(1.0), [1])),
        (Columns(RBF(1.0), [0]), RBF(1.0)),
        (ARDLinear(), DotProduct()),
    ],
)
def test_different_kernels_are_not_equal(one, other):
    assert one != other
    assert one == clone(one)


@pytest.mark.parametrize(
    ("kernel", "text"),
    [
        (ARDLinear([0.5, 1.23456], 0.7), "ARDLinear(weights=[0.5   1.235], bias=0.7)"),
        (ARDLinear(2.0, 0.0), "ARDLinear(weights=2., bias=0)"),
        (
            ARDLinear(2.0, 0.5, center=[0.0, 1.5]),
            "ARDLinear(weights=2., bias=0.5, center=[0.  1.5])",
        ),
        (Columns(RBF(1.0), range(2)), "Columns(RBF(length_scale=1), [0, 1])"),
    ],
)
def test_repr(kernel, text):
    assert repr(kernel) == text


def test_stationarity():
    assert not ARDLinear().is_stationary()
    assert Columns(RBF(), [0]).is_stationary()
    assert not Columns(ARDLinear(), [0]).is_stationary()
    assert Columns(RBF(), [0]).requires_vector_input


def test_linear_regression_in_a_gaussian_process(X, Z):
    y, w, noise = np.sin(X.sum(axis=1)), np.array([0.5, 1.5, 3.0]), 0.1
    kernel = ARDLinear(w, 0.7)
    gp = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None).fit(X, y)
    U, V = np.c_[np.ones(6), X], np.c_[np.ones(4), Z]  # Bayesian: eq. 2.8 of RW2006
    A = U.T @ U / noise + np.diag(1.0 / np.r_[0.7, w])
    mean, std = gp.predict(Z, return_std=True)
    np.testing.assert_allclose(
        mean, V @ np.linalg.solve(A, U.T @ y) / noise, rtol=1e-11
    )
    variance = np.sum(V * np.linalg.solve(A, V.T).T, axis=1)
    np.testing.assert_allclose(std**2, variance, rtol=1e-11)


@pytest.mark.filterwarnings("ignore:The optimal value found:UserWarning")
def test_gaussian_process_learns_what_does_not_matter():
    rng = np.random.default_rng(0)
    X = rng.standard_normal((60, 3))
    y = 2.0 * X[:, 0] + np.sin(3.0 * X[:, 1]) + 0.1 * rng.standard_normal(60)
    bounds = (1e-4, 1e4)
    kernel = ARDLinear(np.ones(3), 0.5, bounds, bounds)
    kernel = kernel + Columns(RBF(1.0), [1]) + WhiteKernel(0.1)
    gp = GaussianProcessRegressor(kernel).fit(X, y)
    start = gp.log_marginal_likelihood(kernel.theta)
    assert gp.log_marginal_likelihood_value_ > start + 10.0
    weights = gp.kernel_.k1.k1.weights
    assert weights[0] > 100.0 * weights[2]
    assert gp.score(X, y) > 0.99


def test_gradient_needs_one_argument(X, Z):
    with pytest.raises(ValueError, match="only be evaluated when Y is None"):
        ARDLinear()(X, Z, eval_gradient=True)


def test_columns_beyond_the_features(X):
    message = r"columns=\[0, 3\] name column 3, but X has 3 features without the task"
    for call in (Columns(RBF(), [0, 3]), Columns(RBF(), [0, 3]).diag):
        with pytest.raises(ValueError, match=message):
            call(X)


@pytest.mark.parametrize("J", [1, 2, 6])
def test_inverse_dynamics_kernel(J):
    kernel = inverse_dynamics_kernel(J)
    assert kernel.n_dims == 4 * J + 1 + 1 + 3 * J
    rng = np.random.default_rng(J)
    b, w, a, scale = 0.7, rng.random(4 * J), 1.7, 0.5 + rng.random(3 * J)
    kernel = kernel.clone_with_theta(np.log(np.r_[b, w, a, scale]))
    x = rng.standard_normal((5, 3 * J))
    u = np.c_[x, np.sign(x[:, J : 2 * J])]
    expected = [
        [
            b
            + sum(w * u[i] * u[j])
            + a * np.exp(-0.5 * sum((x[i] - x[j]) ** 2 / scale**2))
            for j in range(5)
        ]
        for i in range(5)
    ]
    np.testing.assert_allclose(kernel(u), expected, rtol=1e-13)


def test_inverse_dynamics_kernel_starts_within_its_bounds():
    kernel = inverse_dynamics_kernel(3)
    lower, upper = kernel.bounds.T
    assert (lower < kernel.theta).all()
    assert (kernel.theta < upper).all()
    theta = kernel.theta
    assert len({*theta[:14]}) == len({*theta[14:]}) == 1  # equal weightings


@pytest.mark.parametrize("n_joints", [0, -1, 2.5, "6", None])
def test_number_of_joints(n_joints):
    with pytest.raises(ValueError, match=f"n_joints={n_joints!r} must be a positive"):
        inverse_dynamics_kernel(n_joints)


@pytest.mark.parametrize("scale", [1.7, [1.7, 0.6, 2.4]])
def test_spherical_value(X, Z, scale):
    a = np.broadcast_to(scale, 3)
    h = [[np.sqrt(sum((x - z) ** 2 / a**2)) for z in Z] for x in X]
    expected = [[1 - 1.5 * r + 0.5 * r**3 if r < 1 else 0.0 for r in row] for row in h]
    np.testing.assert_allclose(Spherical(scale)(X, Z), expected, rtol=0, atol=1e-14)
    assert np.count_nonzero(Spherical(scale)(X, Z)) < len(X) * len(Z)


def test_spherical_is_the_overlap_of_balls():
    """Of two balls of diameter a in space: where its name is from."""
    a, distance = 2.0, 0.7
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200_000, 3))
    inside = np.linalg.norm(points, axis=1) < a / 2
    both = inside & (np.linalg.norm(points - [distance, 0, 0], axis=1) < a / 2)
    k = Spherical(a)(np.zeros((1, 3)), np.array([[distance, 0.0, 0.0]]))
    assert both.sum() / inside.sum() == pytest.approx(k.item(), abs=0.01)


def test_spherical_finds_the_range():
    x = np.arange(400.0)[:, None]
    K = Spherical(12.0)(x) + 1e-6 * np.eye(400)
    y = np.linalg.cholesky(K) @ np.random.default_rng(0).standard_normal(400)
    X = np.column_stack([x, np.zeros(400)])
    model = PooledGP(Spherical(5.0), normalize_y=False).fit(X, y)
    assert model.kernel_.length_scale == pytest.approx(12.0, rel=0.2)
