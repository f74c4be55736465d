"""Stationary kernels of wide inputs, by differences with fifty digits."""

from decimal import Decimal

import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF, Matern, RationalQuadratic

from skmtgp.model._nodes import compile_kernel, contract_inputs
from skmtgp.model._nodes.differences import Differences
from skmtgp.model.task_covariance import low_rank

ATOL = 1e-10  # of variances of one
ALPHA = 0.3
ARD = (0.7, 1.3, 2.9)
WIDTHS = [1.0, 30.0, 100.0, 150.0, 1e4, 1e6, 1e9]
KERNELS = {
    "rbf": RBF,
    "matern 1/2": lambda length_scale: Matern(length_scale, nu=0.5),
    "matern 3/2": lambda length_scale: Matern(length_scale, nu=1.5),
    "matern 5/2": lambda length_scale: Matern(length_scale, nu=2.5),
    "matern inf": lambda length_scale: Matern(length_scale, nu=np.inf),
    "rational quadratic": lambda length_scale: RationalQuadratic(length_scale, ALPHA),
}
CASES = [(name, scale) for name in KERNELS for scale in (0.7, ARD)]
CASES.remove(("rational quadratic", ARD))  # scikit-learn's has one length-scale
each_case = pytest.mark.parametrize(("name", "length_scale"), CASES)
each_width = pytest.mark.parametrize("width", WIDTHS)
every = slice(None)


def profile(name, s):
    """k and -2 dk/ds at a squared distance."""
    if name == "matern 1/2":
        r = s.sqrt()
        return (-r).exp(), (-r).exp() / r if r else Decimal(0)
    if name == "matern 3/2":
        r = (3 * s).sqrt()
        return (1 + r) * (-r).exp(), 3 * (-r).exp()
    if name == "matern 5/2":
        r = (5 * s).sqrt()
        k, slope = 1 + r + r * r / 3, Decimal(5) / 3 * (1 + r)
        return k * (-r).exp(), slope * (-r).exp()
    if name == "rational quadratic":
        alpha = Decimal(float(np.exp(np.log(ALPHA))))
        base = 1 + s / (2 * alpha)
        k = (-alpha * base.ln()).exp()
        return k, k / base
    return (-s / 2).exp(), (-s / 2).exp()


def exact(name, Z, X, length_scale):
    """k, and its slope times z - z' and its square, of shape (n, m[, d])."""
    scales = [Decimal(u) for u in np.broadcast_to(length_scale, X.shape[1]).tolist()]
    K, (first, second) = np.empty((len(Z), len(X))), np.empty((2, len(Z), *X.shape))
    for i, j in np.ndindex(K.shape):
        row = zip(Z[i].tolist(), X[j].tolist(), scales, strict=True)
        z = [(Decimal(a) - Decimal(b)) / unit for a, b, unit in row]
        k, slope = profile(name, sum(v * v for v in z))
        K[i, j] = k
        first[i, j], second[i, j] = ([slope * v**p for v in z] for p in (1, 2))
    return K, first, second


def draw(width, n_features=3, seed=0):
    """Rows far apart, one length-scale apart, close to each other, and equal."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(0.0, width, (16, n_features))
    X[4:8] = X[:4] + rng.standard_normal((4, n_features))
    X[8:12] = X[:4] + np.geomspace(1e-9, 0.1, 4)[:, None]
    X[12] = X[0]
    Z = X[:6] + 0.3 * rng.standard_normal((6, n_features))
    Z[0], Z[1] = X[0], X[1] + 1e-6
    return X, Z


def bound_kernel(name, length_scale, X):
    """The kernel between the rows of X, and its length-scales after exp(log)."""
    kernel = KERNELS[name](length_scale)
    scales = np.exp(kernel.theta)[name == "rational quadratic" :]
    return compile_kernel(kernel).bind(kernel.theta, X), scales


def close(found, expected):
    """Errors of the sum of n independent entries grow with the root of n."""
    atol = ATOL * np.sqrt(16.0)
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=atol)


@each_width
@each_case
def test_values_and_gradients(name, length_scale, width):
    X, _ = draw(width)
    (bound, scales), tile = bound_kernel(name, length_scale, X), (slice(0, 16),) * 2
    K, first, second = exact(name, X, X, scales)
    values, tape = bound.block(*tile)
    np.testing.assert_allclose(values, K, rtol=0.0, atol=ATOL)
    W = np.random.default_rng(1).uniform(-1.0, 1.0, (16, 16))
    sums = np.einsum("ij,ijd->d", W, second)
    gradient = bound.contract(W, tape, *tile)[name == "rational quadratic" :]
    close(gradient, sums if np.ndim(length_scale) else [sums.sum()])
    rows = contract_inputs(bound, W, tape, *tile, 3) * scales
    close(rows, -np.einsum("ij,ijd->id", W, first))


@each_width
@each_case
def test_other_rows(name, length_scale, width):
    X, Z = draw(width)
    bound, scales = bound_kernel(name, length_scale, X)
    against, tile = bound.against(Z), (slice(1, 6), slice(0, 16))
    K, first, second = exact(name, Z[1:], X, scales)
    values, tape = against.block(*tile)
    np.testing.assert_allclose(values, K, rtol=0.0, atol=ATOL)
    W = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 16))
    close(against.times(*tile, W.T), K @ W.T)
    sums = np.einsum("ij,ijd->d", W, second)
    gradient = against.contract(W, tape, *tile)[name == "rational quadratic" :]
    close(gradient, sums if np.ndim(length_scale) else [sums.sum()])
    rows = contract_inputs(against, W, tape, *tile, 3) * scales
    close(rows, -np.einsum("ij,ijd->id", W, first))


@each_width
@pytest.mark.parametrize("name", KERNELS)
def test_scikit_learns_kernels(name, width):
    # where x / l is exact; elsewhere its rounding, eps x / l, is in their values
    X, Z = (np.round(16.0 * rows) / 16.0 for rows in draw(width))
    kernel = KERNELS[name](0.25)
    bound, tile = compile_kernel(kernel).bind(kernel.theta, X), (slice(0, 16),) * 2
    K, gradients = kernel(X, eval_gradient=True)
    values, tape = bound.block(*tile)
    np.testing.assert_allclose(values, K, rtol=0.0, atol=ATOL)
    cross = bound.against(Z).block(slice(0, 6), slice(0, 16))[0]
    np.testing.assert_allclose(cross, kernel(Z, X), rtol=0.0, atol=ATOL)
    W = np.random.default_rng(1).uniform(-1.0, 1.0, (16, 16))
    gradient = bound.contract(W, tape, *tile)
    close(gradient, np.einsum("ij,ijp->p", W, gradients))


@each_case
def test_rounding_of_scikit_learns_kernels_is_the_larger(name, length_scale):
    X, _ = draw(1e9)
    bound, scales = bound_kernel(name, length_scale, X)
    kernel = KERNELS[name](length_scale)
    K, everywhere = exact(name, X, X, scales)[0], slice(0, 16)
    error = np.abs(bound.block(everywhere, everywhere)[0] - K).max()
    assert error <= max(1e-14, np.abs(kernel(X) - K).max())


@pytest.mark.parametrize("distance", np.geomspace(1e-16, 10.0, 18))
def test_exponential_kernel_of_near_pairs(distance):
    # exp(-r): what rounding does to the square of r shows to its root
    X = np.random.default_rng(0).standard_normal((12, 6))
    X[6:] = X[:6] + distance
    X[:2] *= 30.0  # some outside
    bound, scale = bound_kernel("matern 1/2", 0.5, X)
    tile = (slice(0, 12),) * 2
    K, first, second = exact("matern 1/2", X, X, scale)
    values, tape = bound.block(*tile)
    np.testing.assert_allclose(values, K, rtol=0.0, atol=1e-13)
    gradient = bound.contract(np.ones((12, 12)), tape, *tile)
    np.testing.assert_allclose(gradient, second.sum(), rtol=1e-12)
    rows = contract_inputs(bound, np.ones((12, 12)), tape, *tile, 6) * scale
    np.testing.assert_allclose(rows, -first.sum(axis=1), rtol=0.0, atol=1e-11)


def test_pairs_that_are_all_near():
    # more of them than are computed at a time
    X = np.random.default_rng(0).standard_normal((140, 2)) * 1e-3
    X[70:] += 50.0
    (bound, _), tile = bound_kernel("matern 1/2", 1.0, X), (slice(0, 140),) * 2
    values, tape = bound.block(*tile)
    r = np.sqrt(np.square(X[:, None] - X).sum(axis=2))
    np.testing.assert_allclose(values, np.exp(-r), rtol=0.0, atol=1e-13)
    gradient = bound.contract(np.ones((140, 140)), tape, *tile)
    np.testing.assert_allclose(gradient, (r * np.exp(-r)).sum(), rtol=1e-12)


@pytest.mark.parametrize("name", KERNELS)
def test_products_serve_for_usual_data(name):
    X = np.random.default_rng(0).standard_normal((500, 18))
    bound, _ = bound_kernel(name, 0.5, X)
    assert not len(bound.differences.wide)


def test_wide_features_are_differenced_and_no_others():
    X = np.random.default_rng(0).standard_normal((20, 4))
    X[:, 2] *= 1e6
    differences = Differences(X, np.ones(4))
    assert differences.wide.tolist() == [2]
    assert differences.narrow.tolist() == [0, 1, 3]


@each_case
def test_squares_that_overflow(name, length_scale):
    X = np.repeat([[-1.0e75], [-0.9e75], [0.0], [0.8e75], [0.9e75]], 3, axis=1)
    X[:, 1] *= 0.1
    small = 1e-100 * np.ones_like(length_scale)[()]
    tile = (slice(0, 5),) * 2
    bound, _ = bound_kernel(name, small, X)  # without warnings, which are errors here
    values, tape = bound.block(*tile)
    cross = bound.against(X[1:]).block(slice(0, 4), slice(0, 5))[0]
    gradient = bound.contract(np.ones((5, 5)), tape, *tile)
    far = 1e-80  # the rational quadratic's, with alpha = 0.3
    np.testing.assert_allclose(values, np.eye(5), rtol=0.0, atol=far)
    np.testing.assert_allclose(cross, np.eye(5)[1:], rtol=0.0, atol=far)
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize("name", KERNELS)
def test_length_scales_that_underflow_are_no_length_scales(name):
    X, theta = np.arange(3.0)[:, None], np.array([-1e4])
    theta = np.append([0.0], theta) if name == "rational quadratic" else theta
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = compile_kernel(KERNELS[name](1.0)).bind(theta, X)
        values, _ = bound.block(slice(0, 3), slice(0, 3))
    assert np.isnan(values[0, 1:]).all()


@pytest.mark.parametrize("name", KERNELS)
def test_rows_far_from_all_others(name):
    X = np.random.default_rng(0).standard_normal((5, 3))
    bound, _ = bound_kernel(name, 1.0, X)
    Z = np.array([[1e200, 0.0, 0.0], [1e20, 1e20, 1e20]])
    values, _ = bound.against(Z).block(slice(0, 2), slice(0, 5))
    tail = (2.0 * ALPHA / 3e40) ** ALPHA if name == "rational quadratic" else 0.0
    np.testing.assert_allclose(values[1], tail, rtol=1e-12)
    assert (values[0] <= 1e-80).all()


M, UNIT = 3, 64.0


@pytest.fixture(params=[10, 100])
def seconds(request):
    """Times in seconds over so many years, in short bursts, the same for all tasks."""
    rng = np.random.default_rng(request.param)
    begin = rng.integers(0, request.param * 365 * 86_400, 4)
    times = (begin[:, None] + np.arange(0, 150, 30)).ravel().astype(float)[:, None]
    return np.tile(times, (M, 1)), np.repeat(np.arange(M), 20), times[::3] + 7.0


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("engine", ["dense", "kronecker", "sparse"])
def test_engines(seconds, engine, name):
    X, tasks, Z = seconds
    kernel, form = KERNELS[name](UNIT), low_rank(M, 2)
    y = np.sin(X[:, 0] / UNIT) + 0.1 * np.random.default_rng(1).standard_normal(len(X))
    arguments = kernel, form, X, tasks, y
    if engine == "sparse":
        likelihood = building.sparse(*arguments, X[:20])  # all inputs
    else:
        likelihood = getattr(building, engine)(*arguments)
    rho, noise = np.random.default_rng(0).standard_normal(form.n_parameters), 0.01
    theta = np.concatenate([kernel.theta, rho, [np.log(noise)]])
    K_rho, (k_x, dk_x) = form.matrix(rho), kernel(X, eval_gradient=True)
    between = K_rho[np.ix_(tasks, tasks)]
    K = between * k_x + noise * np.eye(len(X))
    G = np.outer(np.linalg.solve(K, y), np.linalg.solve(K, y)) - np.linalg.inv(K)
    value, gradient = likelihood.value_and_grad(theta)
    expected = textbook.log_marginal_likelihood(K, y)
    np.testing.assert_allclose(value, expected, rtol=1e-10)
    expected = 0.5 * np.einsum("ij,ij,ijp->p", G, between, dk_x)
    np.testing.assert_allclose(gradient[: kernel.n_dims], expected, rtol=1e-9)
    at = np.zeros(len(Z), dtype=int)
    mean, cov = textbook.posterior(kernel, K_rho, noise, X, tasks, y, Z, at)
    posterior = likelihood.posterior(theta)
    np.testing.assert_allclose(posterior.mean(Z, at), mean, rtol=0.0, atol=1e-9)
    variance = posterior.variance(Z, at)
    np.testing.assert_allclose(variance, np.diagonal(cov), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("alpha", [1.0, 1e3, 1e6])
def test_a_large_power_keeps_its_digits(alpha):
    """(1 + s / 2 alpha)^-alpha, of whose base rounding would count alpha times."""
    x, kernel = np.linspace(0.0, 3.0, 40)[:, None], RationalQuadratic(0.7, alpha)
    theta = np.exp(kernel.theta).tolist()
    power, scale = (Decimal(value) for value in theta)
    found, _ = compile_kernel(kernel).bind(kernel.theta, x).block(every, every)
    for z, value in zip(x[:, 0].tolist(), found[0], strict=True):
        base = 1 + (Decimal(z) / scale) ** 2 / (2 * power)
        assert value == pytest.approx(float((-power * base.ln()).exp()), rel=1e-13)
