import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import building
import hypothesis.strategies as st
import numpy as np
import pytest
import textbook
from hypothesis import given, settings
from sklearn.base import clone
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp._numerics import linalg as _linalg
from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError
from skmtgp.inference import tiles
from skmtgp.kernels import ARDLinear, Columns, inverse_dynamics_kernel
from skmtgp.model.task_covariance import identity, low_rank, ones

M, D = 4, 4
COUNTS = (6, 1, 9, 7)  # rows of each task
ARD = (0.7, 1.1, 1.9, 0.9)
LOG_2_PI = np.log(2.0 * np.pi)


class OwnRBF(RBF):
    """A user's kernel, which takes the slow path."""


KERNELS = {
    "paper": inverse_dynamics_kernel(1),
    "rbf": RBF(1.2),
    "fixed": ConstantKernel(1.3, "fixed") * RBF(ARD, "fixed"),
    "matern": ConstantKernel(0.6) * Matern(ARD, nu=1.5) + DotProduct(0.8),
    "columns": Columns(RationalQuadratic(1.2, 0.6), [0, 2]) + WhiteKernel(0.1),
    "unknown": Columns(ExpSineSquared(1.2, 2.0), [1]) + ARDLinear(ARD, 0.4),
    "user's": ConstantKernel(0.6) * OwnRBF(ARD),
}
FORMS = {
    "identity": identity(M),
    "ones": ones(M),
    "rank 1": low_rank(M, 1),
    "rank 2, diagonal": low_rank(M, 2, diagonal=True),
    "full rank": low_rank(M, M),
}
every_kernel = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS.keys())
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
every_noise = pytest.mark.parametrize("n_noise", [1, M], ids=["shared", "per task"])


class Sample(NamedTuple):
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray


def draw(seed=0, counts=COUNTS):
    rng = np.random.default_rng(seed)
    tasks = np.repeat(np.arange(len(counts)), counts)
    X = rng.standard_normal((len(tasks), D))
    X[-3:] = X[:3]  # tasks that share inputs
    return Sample(X, tasks, np.sin(X.sum(axis=1)) + tasks + rng.standard_normal(len(X)))


def parameters(kernel, form, n_noise=1, seed=0):
    rng = np.random.default_rng(seed)
    rho = rng.standard_normal(form.n_parameters)
    return np.concatenate([kernel.theta + 0.2, rho, np.log(0.05 + rng.random(n_noise))])


def parts(likelihood, theta):
    """What theta stands for: the kernel, K^rho and the noise variances."""
    n_kernel = likelihood.kernel.n_dims
    n_rho = likelihood.task_covariance.n_parameters
    kernel = likelihood.kernel.clone_with_theta(theta[:n_kernel])
    K_rho = likelihood.task_covariance.matrix(theta[n_kernel : n_kernel + n_rho])
    return kernel, K_rho, np.exp(theta[n_kernel + n_rho :])


def textbook_covariance(likelihood, theta):
    return textbook.covariance(*parts(likelihood, theta), *draw()[:2])


def textbook_value(likelihood, theta):
    K = textbook_covariance(likelihood, theta)
    return textbook.log_marginal_likelihood(K, likelihood.y)


@pytest.fixture(params=[7, 288], ids=["small tiles", "one tile"])
def tile(request, monkeypatch):
    monkeypatch.setattr(tiles, "TILE", request.param)


@pytest.mark.usefixtures("tile")
@every_kernel
@every_form
@every_noise
def test_value(kernel, form, n_noise):
    likelihood = building.dense(kernel, form, *draw(), n_noise)
    theta = parameters(kernel, form, n_noise)
    value, _ = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, textbook_value(likelihood, theta), rtol=1e-11)
    assert likelihood.value(theta) == value


@pytest.mark.usefixtures("tile")
@every_kernel
@every_form
@every_noise
def test_gradient(kernel, form, n_noise):
    likelihood = building.dense(kernel, form, *draw(), n_noise)
    theta = parameters(kernel, form, n_noise)
    gradient = likelihood.value_and_grad(theta)[1]
    expected = textbook.derivative(lambda t: textbook_value(likelihood, t), theta)
    np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-7)


@every_kernel
def test_tiles_do_not_matter(kernel, monkeypatch):
    form, results = low_rank(M, 2), []
    for size in (1, 2, 7, 22, 23, 24):
        monkeypatch.setattr(tiles, "TILE", size)
        likelihood = building.dense(kernel, form, *draw())
        value, gradient = likelihood.value_and_grad(parameters(kernel, form))
        results.append(np.r_[value, gradient])
    expected = np.tile(results[-1], (6, 1))
    np.testing.assert_allclose(results, expected, rtol=1e-10, atol=1e-10)


def test_rows_of_a_task_in_several_tiles(monkeypatch):
    # tile edges within tasks, a tile with several tasks, and tasks without rows
    monkeypatch.setattr(tiles, "TILE", 16)
    kernel, form = inverse_dynamics_kernel(1), low_rank(9, 3)
    rng = np.random.default_rng(3)
    tasks = np.repeat([1, 2, 3, 4, 8], [21, 1, 3, 2, 40])
    X, y = rng.standard_normal((67, D)), rng.standard_normal(67)
    likelihood = building.dense(kernel, form, X, tasks, y)
    theta = parameters(kernel, form)

    def expected(theta):
        K = textbook.covariance(*parts(likelihood, theta), X, tasks)
        return textbook.log_marginal_likelihood(K, y)

    value, gradient = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, expected(theta), rtol=1e-11)
    by_differences = textbook.derivative(expected, theta)
    np.testing.assert_allclose(gradient, by_differences, rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(likelihood.task_gradient(theta)[[0, 5, 6, 7]], 0.0)


class TestMemory:
    """Memory that an evaluation leaves to the next one."""

    @pytest.fixture(params=KERNELS)
    def likelihood(self, request, monkeypatch):
        monkeypatch.setattr(tiles, "TILE", 7)
        return building.dense(KERNELS[request.param], low_rank(M, 2), *draw())

    def test_evaluations_do_not_disturb_each_other(self, likelihood):
        theta = parameters(likelihood.kernel, likelihood.task_covariance)
        value, gradient = likelihood.value_and_grad(theta)
        kept = gradient.copy()
        factor = likelihood.posterior(theta).cholesky.factor
        before = factor.copy()
        other = likelihood.value_and_grad(theta + 0.1)
        assert likelihood.value(theta + 0.1) == other[0] != value
        np.testing.assert_array_equal(gradient, kept)
        np.testing.assert_array_equal(factor, before)
        again = likelihood.value_and_grad(theta)
        assert again[0] == value
        np.testing.assert_array_equal(again[1], gradient)

    def test_evaluations_at_once(self, likelihood):
        theta = parameters(likelihood.kernel, likelihood.task_covariance)
        thetas = [theta + 0.01 * k for k in range(8)]
        expected = [likelihood.value_and_grad(t) for t in thetas]
        with ThreadPoolExecutor(4) as pool:
            results = list(pool.map(likelihood.value_and_grad, thetas * 5))
        for result, (value, gradient) in zip(results, expected * 5, strict=True):
            assert result[0] == value
            np.testing.assert_array_equal(result[1], gradient)

    def test_is_kept_after_a_failure(self, singular):
        likelihood, theta = singular
        for _ in range(3):
            assert likelihood.value(theta) == -np.inf
            assert likelihood.value_and_grad(theta)[0] == -np.inf
        assert len(likelihood._spare) == 1

    def test_is_not_pickled_and_can_be_released(self, likelihood):
        size = len(pickle.dumps(likelihood))
        theta = parameters(likelihood.kernel, likelihood.task_covariance)
        value = likelihood.value(theta)
        assert len(pickle.dumps(likelihood)) == size
        assert pickle.loads(pickle.dumps(likelihood)).value(theta) == value
        likelihood.release()
        assert not likelihood._spare
        assert likelihood.value(theta) == value


@every_kernel
@every_noise
def test_task_gradient(kernel, n_noise):
    class Symmetric:
        """K^rho whose parameters are its entries."""

        n_parameters = M * M

        def matrix(self, entries):
            A = entries.reshape(M, M)
            return 0.5 * (A + A.T)

    form = low_rank(M, M)
    likelihood = building.dense(kernel, form, *draw(), n_noise)
    theta = parameters(kernel, form, n_noise)
    n = kernel.n_dims
    K_rho = form.matrix(theta[n : n + M * M])
    by_entries = building.dense(kernel, Symmetric(), *draw(), n_noise)

    def value(entries):
        return textbook_value(by_entries, np.r_[theta[:n], entries, theta[n + M * M :]])

    expected = textbook.derivative(value, K_rho.ravel()).reshape(M, M)
    actual = likelihood.task_gradient(theta)
    np.testing.assert_array_equal(actual, actual.T)
    np.testing.assert_allclose(actual, expected, rtol=1e-6, atol=1e-7)


def test_split():
    likelihood = building.dense(RBF(ARD), low_rank(M, 2), *draw(), M)
    lengths = [len(part) for part in building.parts(likelihood, np.zeros(4 + 8 + 4))]
    assert lengths == [4, 8, 4]


@every_kernel
@every_form
@every_noise
def test_fisher_information(kernel, form, n_noise):
    likelihood = building.dense(kernel, form, *draw(), n_noise)
    theta = parameters(kernel, form, n_noise)
    inverse = np.linalg.inv(textbook_covariance(likelihood, theta))
    dK = textbook.derivative(lambda t: textbook_covariance(likelihood, t), theta)
    expected = [[0.5 * np.trace(inverse @ p @ inverse @ q) for q in dK] for p in dK]
    actual = likelihood.fisher_information(theta)
    atol = 1e-8 * np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=1e-8, atol=atol)


@pytest.mark.parametrize("n_rows", [1, 5, 10])
def test_fisher_information_of_some_rows(n_rows, monkeypatch):
    form, X, tasks, y = low_rank(M, 2), *draw()
    rows = np.linspace(0, len(y) - 1, n_rows).astype(int)
    theta = parameters(RBF(ARD), form, M)
    few = building.dense(RBF(ARD), form, X[rows], tasks[rows], y[rows], M)
    expected = len(y) / n_rows * few.fisher_information(theta)
    monkeypatch.setattr("skmtgp.inference.likelihood.FISHER_ROWS", n_rows)
    actual = building.dense(RBF(ARD), form, *draw(), M).fisher_information(theta)
    np.testing.assert_allclose(actual, expected, rtol=1e-12)


def test_fisher_information_is_the_covariance_of_the_score():
    kernel, form, n = ConstantKernel(1.3) * RBF(1.2), low_rank(M, 1), 3000
    likelihood = building.dense(kernel, form, *draw())
    theta = parameters(kernel, form)
    rng = np.random.default_rng(0)
    C = np.linalg.cholesky(textbook_covariance(likelihood, theta))
    scores = []
    for noise in rng.standard_normal((n, len(C))):
        likelihood.y = C @ noise
        scores.append(likelihood.value_and_grad(theta)[1])
    information = likelihood.fisher_information(theta)
    scale = np.sqrt(np.diagonal(information))
    standardised = np.array(scores) / scale
    mean_error = np.abs(standardised.mean(axis=0)).max()
    assert mean_error < 4.0 / np.sqrt(n)
    covariance = np.cov(standardised.T)
    expected = information / scale / scale[:, None]
    assert np.abs(covariance - expected).max() < 12.0 / np.sqrt(n)


def new_rows():
    rng = np.random.default_rng(5)
    Z = rng.standard_normal((8, D))
    Z[0] = draw().X[0]
    return Z, np.array([2, 0, 0, 3, 1, 2, 3, 3])


@pytest.mark.usefixtures("tile")
@every_kernel
@every_form
@every_noise
def test_posterior(kernel, form, n_noise):
    likelihood, (Z, tasks) = building.dense(kernel, form, *draw(), n_noise), new_rows()
    theta = parameters(kernel, form, n_noise)
    posterior = likelihood.posterior(theta)
    mean, covariance = textbook.posterior(*parts(likelihood, theta), *draw(), Z, tasks)
    close = {"rtol": 1e-10, "atol": 1e-11}
    np.testing.assert_allclose(posterior.mean(Z, tasks), mean, **close)
    np.testing.assert_allclose(posterior.covariance(Z, tasks), covariance, **close)
    np.testing.assert_allclose(
        posterior.variance(Z, tasks), np.diagonal(covariance), **close
    )
    value = textbook_value(likelihood, theta)
    np.testing.assert_allclose(posterior.log_likelihood, value, rtol=1e-11)


def test_mean_of_tasks():
    form, (Z, _) = low_rank(M, 2), new_rows()
    posterior = building.dense(RBF(ARD), form, *draw()).posterior(
        parameters(RBF(ARD), form)
    )
    means = posterior.mean_of_tasks(Z, np.array([3, 0]))
    for column, task in enumerate([3, 0]):
        one = posterior.mean(Z, np.full(len(Z), task))
        np.testing.assert_allclose(means[:, column], one, rtol=1e-13)


@every_kernel
@pytest.mark.parametrize("size", [1, 5, 300])
def test_mean_in_tiles(kernel, size, monkeypatch):
    monkeypatch.setattr(tiles, "TILE", size)
    form, rng = low_rank(M, 2), np.random.default_rng(7)
    Z, tasks = rng.standard_normal((31, D)), rng.integers(0, M, 31)
    likelihood = building.dense(kernel, form, *draw())
    theta = parameters(kernel, form)
    mean, _ = textbook.posterior(*parts(likelihood, theta), *draw(), Z, tasks)
    posterior = likelihood.posterior(theta)
    close = {"rtol": 1e-10, "atol": 1e-11}
    np.testing.assert_allclose(posterior.mean(Z, tasks), mean, **close)
    means = posterior.mean_of_tasks(Z, np.arange(M))
    np.testing.assert_allclose(means[np.arange(31), tasks], mean, **close)


def test_mean_factorises_nothing(monkeypatch):
    form, (Z, tasks) = low_rank(M, 2), new_rows()
    likelihood = building.dense(RBF(ARD), form, *draw())
    posterior = likelihood.posterior(parameters(RBF(ARD), form))
    expected = posterior.mean(Z, tasks)
    again = pickle.loads(pickle.dumps(posterior))

    def fail(*args, **kwargs):
        raise AssertionError("a mean needs no factor")

    for name in ("dpotrf", "dtrsv", "solve_triangular"):
        monkeypatch.setattr(_linalg, name, fail)
    np.testing.assert_array_equal(again.mean(Z, tasks), expected)
    with pytest.raises(AssertionError, match="a mean needs no factor"):
        again.variance(Z, tasks)


def test_posterior_describes_itself():
    form = low_rank(M, 2)
    theta = parameters(RBF(ARD), form)
    posterior = building.dense(RBF(ARD), form, *draw()).posterior(theta)
    assert posterior.kernel == RBF(ARD).clone_with_theta(theta[:4])
    np.testing.assert_array_equal(posterior.K_rho, form.matrix(theta[4:12]))


def test_variance_is_never_negative(monkeypatch):
    X, tasks = np.linspace(0.0, 9.0, 30)[:, None], np.zeros(30, dtype=int)
    likelihood = building.dense(RBF(), ones(1), X, tasks, np.sin(X[:, 0]))
    posterior = likelihood.posterior(np.array([-1.0, np.log(1e-15)]))
    variance = posterior.variance(X, tasks)
    assert (variance >= 0.0).all()
    assert variance.max() < 1e-14
    half = posterior._half(X, tasks)  # as rounding may make it
    monkeypatch.setattr(posterior, "_half", lambda *args: half * (1.0 + 1e-12))
    np.testing.assert_array_equal(posterior.variance(X, tasks), 0.0)


def textbook_left_out(likelihood, theta):
    """Mean and variance of f at each row, given the others."""
    X, tasks, y = draw()
    found = []
    for i in range(len(y)):
        rest = [part[np.arange(len(y)) != i] for part in (X, tasks, y)]
        at_row = X[i : i + 1], tasks[i : i + 1]
        found.append(textbook.posterior(*parts(likelihood, theta), *rest, *at_row))
    return np.transpose([(mean.item(), cov.item()) for mean, cov in found])


@every_kernel
@every_form
@every_noise
def test_leave_one_out(kernel, form, n_noise):
    likelihood = building.dense(kernel, form, *draw(), n_noise)
    theta = parameters(kernel, form, n_noise)
    posterior = likelihood.posterior(theta)
    factor = posterior.cholesky.factor.copy()
    mean, expected = textbook_left_out(likelihood, theta)
    residual, variance = posterior.leave_one_out()
    close = {"rtol": 1e-10, "atol": 1e-11}
    np.testing.assert_allclose(residual, likelihood.y - mean, **close)
    np.testing.assert_allclose(variance, expected, **close)
    residual, variance = posterior.leave_one_out(include_noise=True)
    noise = np.exp(theta[-n_noise:])[likelihood.noise_of_row]
    np.testing.assert_allclose(residual, likelihood.y - mean, **close)
    np.testing.assert_allclose(variance, expected + noise, **close)
    np.testing.assert_array_equal(posterior.cholesky.factor, factor)


def test_variance_left_out_is_never_negative(monkeypatch):
    form = low_rank(M, 2)
    likelihood = building.dense(RBF(ARD), form, *draw())
    theta = parameters(RBF(ARD), form)
    posterior, noise = likelihood.posterior(theta), np.exp(theta[-1])
    as_rounding_may_make_it = np.full(len(likelihood.y), (1.0 + 1e-14) / noise)
    monkeypatch.setattr(
        posterior.cholesky, "inverse_diagonal", lambda: as_rounding_may_make_it
    )
    np.testing.assert_array_equal(posterior.leave_one_out()[1], 0.0)
    np.testing.assert_allclose(posterior.leave_one_out(True)[1], noise, rtol=1e-15)


class TestAgainstScikitLearn:
    """One task, or tasks that cannot be told apart, are scikit-learn's GP."""

    @pytest.fixture(params=KERNELS)
    def kernel(self, request):
        return KERNELS[request.param]

    @pytest.fixture
    def gp(self, kernel):
        X, _, y = draw()
        gp = GaussianProcessRegressor(clone(kernel), alpha=0.1, optimizer=None)
        return gp.fit(X, y)

    @pytest.mark.parametrize("n_tasks", [1, M])
    def test_likelihood(self, kernel, gp, n_tasks):
        X, tasks, y = draw()
        likelihood = building.dense(kernel, ones(n_tasks), X, tasks % n_tasks, y)
        theta = kernel.theta + 0.1
        value, gradient = likelihood.value_and_grad(np.r_[theta, np.log(0.1)])
        expected = gp.log_marginal_likelihood(theta, eval_gradient=True)
        np.testing.assert_allclose(value, expected[0], rtol=1e-11)
        np.testing.assert_allclose(gradient[:-1], expected[1], rtol=1e-9, atol=1e-10)

    def test_posterior(self, kernel, gp):
        likelihood, (Z, tasks) = building.dense(kernel, ones(M), *draw()), new_rows()
        posterior = likelihood.posterior(np.r_[kernel.theta, np.log(0.1)])
        mean, std = gp.predict(Z, return_std=True)
        _, covariance = gp.predict(Z, return_cov=True)
        close = {"rtol": 1e-9, "atol": 1e-10}
        np.testing.assert_allclose(posterior.mean(Z, tasks), mean, **close)
        np.testing.assert_allclose(posterior.variance(Z, tasks), std**2, **close)
        np.testing.assert_allclose(posterior.covariance(Z, tasks), covariance, **close)

    def test_independent_tasks(self, kernel):
        X, tasks, y = draw()
        theta = np.r_[kernel.theta, np.log(0.1)]
        value = building.dense(kernel, identity(M), X, tasks, y).value(theta)
        gp = GaussianProcessRegressor(clone(kernel), alpha=0.1, optimizer=None)
        each = [
            gp.fit(X[tasks == m], y[tasks == m]).log_marginal_likelihood()
            for m in range(M)
        ]
        np.testing.assert_allclose(value, sum(each), rtol=1e-11)


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
def test_accuracy_of_small_noise(noise):
    # K's condition number is above 1 / noise: the likelihood loses as many digits, the
    # mean half of them (5e-11 at a noise of 1e-10)
    rng, tasks = np.random.default_rng(0), np.repeat([0, 1], 12)
    X = np.sort(rng.uniform(0.0, 4.0, (24, 1)), axis=0)
    F = np.array([[1.0], [0.7]])
    y = np.ravel(F[tasks, 0] * np.sin(2.0 * X[:, 0]))
    Z, tasks_of_Z = rng.uniform(0.0, 4.0, (4, 1)), np.array([0, 1, 0, 1])
    likelihood = building.dense(RBF(), low_rank(2, 1), X, tasks, y)
    theta = np.r_[0.0, F.ravel(), np.log(noise)]
    K_rho, noise = F @ F.T, np.exp(theta[-1])
    eps = np.finfo(float).eps
    exact = textbook.exact_log_marginal_likelihood(K_rho, noise, X, tasks, y)
    np.testing.assert_allclose(likelihood.value(theta), exact, rtol=0.2 * eps / noise)
    mean = textbook.exact_mean(K_rho, noise, X, tasks, y, Z, tasks_of_Z)
    actual = likelihood.posterior(theta).mean(Z, tasks_of_Z)
    np.testing.assert_allclose(actual, mean, rtol=0.0, atol=20.0 * eps / noise**0.5)


@pytest.mark.parametrize("noise", [1e-2, 1e-6, 1e-10])
def test_accuracy_of_small_noise_where_a_row_is_left_out(noise):
    # With w the weights of the others' targets, 1 / [K^{-1}]_ii is v^T K v for
    # v = (1, -w), which the factor's error of n eps |K| changes by that times |v|^2 at
    # most. In the mean it adds to that of alpha, n eps |K| |v| |alpha of the others|.
    rng, tasks = np.random.default_rng(0), np.repeat([0, 1], 8)
    X, F = np.sort(rng.uniform(0.0, 4.0, (16, 1)), axis=0), np.array([[1.0], [0.7]])
    y = np.ravel(F[tasks, 0] * np.sin(2.0 * X[:, 0]))
    likelihood = building.dense(RBF(), low_rank(2, 1), X, tasks, y)
    theta = np.r_[0.0, F.ravel(), np.log(noise)]
    noise = np.exp(theta[-1])  # as the likelihood has it
    K = textbook.covariance(RBF(), F @ F.T, noise, X, tasks)
    loss = len(y) * np.finfo(float).eps * np.linalg.norm(K, 2)
    residual, variance = likelihood.posterior(theta).leave_one_out()
    for i in range(len(y)):
        rest = [part[np.arange(len(y)) != i] for part in (X, tasks, y)]
        at_row = X[i : i + 1], tasks[i : i + 1]
        mean, exact, w, alpha = exactly(F @ F.T, noise, *rest, *at_row)
        v = np.append(1.0, -w)
        assert abs(variance[i] - exact) < loss * v @ v
        bound = np.linalg.norm(v) * np.linalg.norm(alpha)
        bound += v @ v * abs(residual[i]) / (exact + noise)
        assert abs(y[i] - residual[i] - mean) < loss * bound


def exactly(K_rho, noise, X, tasks, y, Z, tasks_of_Z):
    """Mean and variance of f(Z), the weights of y in the mean and K^{-1} y."""
    K = textbook.exact_covariance(K_rho, noise, X, tasks, X, tasks)
    (k,) = textbook.exact_covariance(K_rho, noise, Z, tasks_of_Z, X, tasks)
    ((prior,),) = textbook.exact_covariance(K_rho, 0.0, Z, tasks_of_Z, Z, tasks_of_Z)
    w, alpha = textbook.exact_solve(K, k)[0], textbook.exact_solve(K, y.tolist())[0]
    mean = sum(a * b for a, b in zip(k, alpha, strict=True))
    variance = prior - sum(a * b for a, b in zip(k, w, strict=True))
    return float(mean), float(variance), np.array(w, float), np.array(alpha, float)


@pytest.fixture
def singular():
    """A likelihood and parameters at which K = 1 1^T in floating point."""
    X, tasks, y = draw()
    return building.dense(ConstantKernel(), ones(M), X, tasks, y), np.array([0, -50.0])


def test_singular_covariance(singular):
    likelihood, theta = singular
    assert likelihood.value(theta) == -np.inf
    value, gradient = likelihood.value_and_grad(theta)
    assert value == -np.inf
    np.testing.assert_array_equal(gradient, [np.nan, np.nan])
    with pytest.raises(NotPositiveDefiniteError, match="is not positive"):
        likelihood.task_gradient(theta)


def test_posterior_with_singular_covariance(singular):
    likelihood, theta = singular
    with pytest.warns(JitterWarning, match=r"was added to its diagonal"):
        posterior = likelihood.posterior(theta)
    X, tasks, y = draw()
    loss = len(y) * np.finfo(float).eps / 1e-14  # of what is left of K's digits
    mean = posterior.mean(X, tasks)
    np.testing.assert_allclose(mean, y.mean(), rtol=0.0, atol=loss * y.std())


def test_jitter_is_noise_where_a_row_is_left_out(singular):
    likelihood, theta = singular
    with pytest.warns(JitterWarning, match=r"was added to its diagonal"):
        posterior = likelihood.posterior(theta)
    n, jitter = len(likelihood.y), posterior.cholesky.jitter
    assert 1e-13 < jitter < 1e-10
    lost = n**2 * np.finfo(float).eps  # n eps |K|, as K is 1 1^T
    (residual, variance), (_, noisy) = (posterior.leave_one_out(b) for b in (0, 1))
    # the others' mean, which has as much noise as the mean of n - 1 numbers
    np.testing.assert_allclose(variance, jitter / (n - 1), rtol=0.0, atol=lost)
    np.testing.assert_allclose(noisy, jitter * n / (n - 1), rtol=0.0, atol=lost)
    others = (likelihood.y.sum() - likelihood.y) / (n - 1)
    atol = lost / jitter * np.abs(likelihood.y).max()
    np.testing.assert_allclose(likelihood.y - residual, others, rtol=0.0, atol=atol)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("position", range(4))
def test_parameters_that_are_not_finite(bad, position):
    likelihood = building.dense(ConstantKernel(), low_rank(M, 2), *draw())
    theta = parameters(ConstantKernel(), low_rank(M, 2))
    theta[[0, 1, 5, 9][position]] = bad
    with np.errstate(invalid="ignore"):
        value, gradient = likelihood.value_and_grad(theta)
    assert value == -np.inf
    assert np.isnan(gradient).all()


seeds = st.integers(0, 2**32 - 1)
names = st.sampled_from(sorted(KERNELS))
quick = settings(max_examples=40, deadline=None)


def value_and_kernel_gradient(kernel, F, noise, X, tasks, y):
    form = low_rank(*F.shape)
    theta = np.concatenate([kernel.theta, F.ravel(), np.log(noise)])
    likelihood = building.dense(kernel, form, X, tasks, y, len(noise))
    value, gradient = likelihood.value_and_grad(theta)
    return np.r_[value, gradient[: kernel.n_dims]]


def random_model(seed):
    rng = np.random.default_rng(seed)
    return rng, rng.standard_normal((M, 2)), 0.05 + rng.random(M), draw(seed)


@given(names, seeds)
@quick
def test_order_within_a_task_does_not_matter(name, seed):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    order = np.lexsort([rng.random(len(y)), tasks])
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    actual = value_and_kernel_gradient(
        KERNELS[name], F, noise, X[order], tasks[order], y[order]
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(names, seeds)
@quick
def test_labels_of_tasks_do_not_matter(name, seed):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    label = rng.permutation(M)  # of each task
    order = np.argsort(label[tasks], kind="stable")
    new = np.argsort(label)  # the task of each label
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    actual = value_and_kernel_gradient(
        KERNELS[name], F[new], noise[new], X[order], label[tasks][order], y[order]
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(names, seeds, st.integers(0, M - 1))
@quick
def test_a_task_may_be_two_equal_ones(name, seed, task):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    twin = np.where((tasks == task) & (rng.random(len(y)) < 0.5), M, tasks)
    order = np.argsort(twin, kind="stable")
    actual = value_and_kernel_gradient(
        KERNELS[name],
        np.vstack([F, F[task]]),
        np.r_[noise, noise[task]],
        X[order],
        twin[order],
        y[order],
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(names, seeds, st.sampled_from([1e-6, 0.3, 1e5]))
@quick
def test_units_of_the_targets(name, seed, unit):
    _, F, noise, (X, tasks, y) = random_model(seed)
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    expected[0] -= len(y) * np.log(unit)
    actual = value_and_kernel_gradient(
        KERNELS[name], unit * F, unit**2 * noise, X, tasks, unit * y
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(seeds)
@quick
def test_rotations_of_the_factor_do_not_matter(seed):
    rng, F, noise, sample = random_model(seed)
    rotation = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    expected = value_and_kernel_gradient(RBF(ARD), F, noise, *sample)
    actual = value_and_kernel_gradient(RBF(ARD), F @ rotation, noise, *sample)
    np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-10)


def test_one_sample():
    X, tasks, y = np.ones((1, 2)), np.zeros(1, dtype=int), np.array([2.0])
    likelihood = building.dense(ConstantKernel(3.0), ones(1), X, tasks, y)
    value, gradient = likelihood.value_and_grad(np.log([3.0, 0.5]))
    expected = -0.5 * (4.0 / 3.5 + np.log(3.5) + LOG_2_PI)
    np.testing.assert_allclose(value, expected, rtol=1e-14)
    slope = 0.5 * (4.0 / 3.5**2 - 1.0 / 3.5)
    np.testing.assert_allclose(gradient, [3.0 * slope, 0.5 * slope], rtol=1e-13)
