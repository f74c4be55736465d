import building
import numpy as np
import pytest
import textbook
from dense_models import KERNELS, M, draw, new_rows, parameters
from sklearn.base import clone
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError
from skmtgp.model.task_covariance import identity, low_rank, ones


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
