import pickle
from concurrent.futures import ThreadPoolExecutor

import building
import numpy as np
import pytest
import textbook
from dense_models import (
    ARD,
    KERNELS,
    D,
    M,
    draw,
    every_kernel,
    every_model,
    every_model_and_tile,
    every_noise,
    parameters,
    parts,
    textbook_covariance,
    textbook_value,
)
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.inference import dense, tiles
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model.task_covariance import low_rank, ones

LOG_2_PI = np.log(2.0 * np.pi)


@every_model_and_tile
def test_value(kernel, form, n_noise, tile):
    likelihood = building.dense(kernel, form, *draw(), n_noise)
    theta = parameters(kernel, form, n_noise)
    value, _ = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, textbook_value(likelihood, theta), rtol=1e-11)
    assert likelihood.value(theta) == value


@every_model_and_tile
def test_gradient(kernel, form, n_noise, tile):
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


@pytest.mark.parametrize("n", [1, 2, 5, 12, 31, 200])
@pytest.mark.parametrize("size", [1, 4, 10, 240])
def test_tiles_are_those_of_the_triangle(n, size, monkeypatch):
    monkeypatch.setattr(tiles, "TILE", size)
    side = tiles.side_of(n)
    assert size <= side <= max(size, min(n // 5, int(1.4 * size)))
    met, heights = np.zeros((n, n)), []
    for rows, cols in tiles.blocks_of(n):
        met[rows, cols] += 1
        height, width = rows.stop - rows.start, cols.stop - cols.start
        assert width <= max(tiles.WIDE * side, height)
        assert rows.start == cols.start or rows.stop <= cols.start
        heights.append(height)
    assert (met[np.triu_indices(n)] == 1.0).all()
    assert met.max() == 1.0
    assert met.sum() <= 0.5 * n * (n + max(heights))


@pytest.mark.parametrize("call", [0, 10**9])
def test_rows_of_a_task_in_several_tiles(call, monkeypatch):
    monkeypatch.setattr(dense, "CALL", call)
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
        theta = parameters(likelihood.prior.kernel, likelihood.prior.task_covariance)
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
        theta = parameters(likelihood.prior.kernel, likelihood.prior.task_covariance)
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
        theta = parameters(likelihood.prior.kernel, likelihood.prior.task_covariance)
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


@every_model
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
    monkeypatch.setattr("skmtgp.inference.likelihood.FISHER_ROWS_PER_TASK", 0)
    actual = building.dense(RBF(ARD), form, *draw(), M).fisher_information(theta)
    np.testing.assert_allclose(actual, expected, rtol=1e-12)


def test_fisher_information_knows_each_of_many_tasks():
    rng, n_tasks = np.random.default_rng(0), 150
    tasks = np.repeat(np.arange(n_tasks), 6)
    X, y = rng.standard_normal((2, len(tasks), len(ARD)))
    form = low_rank(n_tasks, 1)
    likelihood = building.dense(RBF(ARD), form, X, tasks, y[:, 0])
    theta = parameters(RBF(ARD), form)
    information = likelihood.fisher_information(theta)
    assert (np.diagonal(information) > 0.0).all()


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


def test_one_sample():
    X, tasks, y = np.ones((1, 2)), np.zeros(1, dtype=int), np.array([2.0])
    likelihood = building.dense(ConstantKernel(3.0), ones(1), X, tasks, y)
    value, gradient = likelihood.value_and_grad(np.log([3.0, 0.5]))
    expected = -0.5 * (4.0 / 3.5 + np.log(3.5) + LOG_2_PI)
    np.testing.assert_allclose(value, expected, rtol=1e-14)
    slope = 0.5 * (4.0 / 3.5**2 - 1.0 / 3.5)
    np.testing.assert_allclose(gradient, [3.0 * slope, 0.5 * slope], rtol=1e-13)
