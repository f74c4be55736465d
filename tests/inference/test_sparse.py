import pickle

import building
import numpy as np
import pytest
import textbook
from pairs import in_pairs
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sparse_bounds import (
    ARD,
    EVERY,
    FORMS,
    KERNELS,
    D,
    M,
    Sample,
    dense,
    draw,
    make,
    new_rows,
    parameters,
)

from skmtgp.inference import likelihood
from skmtgp.model.task_covariance import low_rank, ones

LEARNABLE = [name for name in EVERY if "unknown" not in name]
every_kernel = pytest.mark.parametrize("kernel", EVERY.values(), ids=EVERY.keys())
NOISES = {"shared": 1, "per task": M}
every_noise = pytest.mark.parametrize("n_noise", NOISES.values(), ids=NOISES)
every_model = in_pairs(kernel=EVERY, form=FORMS, n_noise=NOISES)
every_noise_free_model = in_pairs(kernel=KERNELS, form=FORMS, n_noise=NOISES)


def parts(bound, theta):
    """What theta stands for: the kernel, K^rho and the noise of each row."""
    kernel, rho, log_noise = building.parts(bound, theta)
    noise = np.broadcast_to(np.exp(log_noise), M)[bound.tasks]
    K_rho = bound.prior.task_covariance.matrix(rho)
    return bound.prior.kernel.clone_with_theta(kernel), K_rho, noise


def explained(kernel, K_rho, X, tasks, Z, *other):
    """Q = K_fu K_uu^{-1} K_uf."""
    Y, others = other or (X, tasks)
    Q = kernel(X, Z) @ np.linalg.solve(kernel(Z), kernel(Z, Y))
    return K_rho[np.ix_(tasks, others)] * Q


def textbook_bound(kernel, K_rho, noise, sample, Z):
    """Titsias (2009), eq. 9, with n x n matrices."""
    X, tasks, y = sample
    Q = explained(kernel, K_rho, X, tasks, Z)
    rest = K_rho[tasks, tasks] * kernel.diag(X) - np.diagonal(Q)
    value = textbook.log_marginal_likelihood(Q + np.diag(noise), y)
    return value - 0.5 * (rest / noise).sum()


def textbook_posterior(kernel, K_rho, noise, sample, Z, X_new, tasks_new):
    """Titsias (2009), eq. 6: Q for all covariances with training rows."""
    X, tasks, y = sample
    K = explained(kernel, K_rho, X, tasks, Z) + np.diag(noise)
    cross = explained(kernel, K_rho, X, tasks, Z, X_new, tasks_new)
    prior = textbook.prior_covariance(kernel, K_rho, X_new, tasks_new)
    return cross.T @ np.linalg.solve(K, y), prior - cross.T @ np.linalg.solve(K, cross)


@every_model
def test_value_and_gradient(kernel, form, n_noise):
    bound, theta = make(kernel, form, n_noise), parameters(kernel, form, n_noise)

    def expected(theta):
        return textbook_bound(*parts(bound, theta), draw(), bound.Z)

    value, gradient = bound.value_and_grad(theta)
    np.testing.assert_allclose(value, expected(theta), rtol=1e-11)
    assert bound.value(theta) == value
    by_differences = textbook.derivative(expected, theta)
    np.testing.assert_allclose(gradient, by_differences, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("name", LEARNABLE)
@pytest.mark.parametrize("form", [low_rank(M, 2), ones(M, diagonal=True)])
def test_gradient_by_inducing_inputs(name, form):
    bound, theta = make(EVERY[name], form, M), parameters(EVERY[name], form, M)

    def expected(Z):
        return textbook_bound(*parts(bound, theta), draw(), Z.reshape(-1, D))

    value, gradient, d_Z = bound.value_and_grads(theta)
    by_differences = textbook.derivative(expected, bound.Z.ravel())
    np.testing.assert_allclose(d_Z.ravel(), by_differences, rtol=1e-7, atol=1e-6)
    without = bound.value_and_grad(theta)
    assert value == without[0]
    np.testing.assert_array_equal(gradient, without[1])


@pytest.mark.parametrize("name", ["unknown", "unknown, white"])
def test_no_gradient_by_inducing_inputs(name):
    bound = make(EVERY[name], ones(M))
    with pytest.raises(ValueError, match=r"not known of kernel=ExpSine.* See the user"):
        bound.value_and_grads(parameters(bound.prior.kernel, ones(M)))


@every_noise_free_model
def test_exact_where_all_inputs_are_inducing(kernel, form, n_noise):
    exact, theta = dense(kernel, form, n_noise), parameters(kernel, form, n_noise)
    bound = make(kernel, form, n_noise, Z=draw().X[:-3])
    value, gradient = exact.value_and_grad(theta)
    found = bound.value_and_grad(theta)
    np.testing.assert_allclose(found[0], value, rtol=1e-10)
    np.testing.assert_allclose(found[1], gradient, rtol=1e-7, atol=1e-7)
    D_rho, exact_D_rho = bound.task_gradient(theta), exact.task_gradient(theta)
    np.testing.assert_allclose(D_rho, exact_D_rho, rtol=1e-7, atol=1e-7)


@every_kernel
@every_noise
def test_task_gradient(kernel, n_noise):
    form = low_rank(M, 2, diagonal=True)
    bound, theta = make(kernel, form, n_noise), parameters(kernel, form, n_noise)
    at, K_rho, noise = parts(bound, theta)

    def value(entries):
        A = entries.reshape(M, M)
        return textbook_bound(at, 0.5 * (A + A.T), noise, draw(), bound.Z)

    expected = textbook.derivative(value, K_rho.ravel()).reshape(M, M)
    actual = bound.task_gradient(theta)
    np.testing.assert_array_equal(actual, actual.T)
    np.testing.assert_allclose(actual, expected, rtol=1e-6, atol=1e-6)


@every_model
def test_posterior(kernel, form, n_noise):
    bound, (X, tasks) = make(kernel, form, n_noise), new_rows()
    theta = parameters(kernel, form, n_noise)
    posterior = bound.posterior(theta)
    mean, covariance = textbook_posterior(
        *parts(bound, theta), draw(), bound.Z, X, tasks
    )
    close = {"rtol": 1e-9, "atol": 1e-10}
    np.testing.assert_allclose(posterior.mean(X, tasks), mean, **close)
    np.testing.assert_allclose(posterior.covariance(X, tasks), covariance, **close)
    np.testing.assert_allclose(
        posterior.variance(X, tasks), np.diagonal(covariance), **close
    )
    means = posterior.mean_of_tasks(X, np.array([3, 0]))
    for column, task in enumerate([3, 0]):
        one = posterior.mean(X, np.full(len(X), task))
        np.testing.assert_allclose(means[:, column], one, rtol=1e-12)
    assert posterior.log_likelihood == bound.value(theta)
    assert posterior.kernel == kernel.clone_with_theta(theta[: kernel.n_dims])
    np.testing.assert_array_equal(posterior.K_rho, parts(bound, theta)[1])


@every_noise
def test_task_without_rows(n_noise):
    kernel, (X, tasks, y) = KERNELS["paper"], draw()
    kept = tasks != 2
    sample = Sample(X[kept], tasks[kept], y[kept])
    form, (X_new, tasks_new) = low_rank(M, 2, diagonal=True), new_rows()
    bound = make(kernel, form, n_noise, sample=sample)
    theta = parameters(kernel, form, n_noise)

    def expected(theta):
        return textbook_bound(*parts(bound, theta), sample, bound.Z)

    value, gradient = bound.value_and_grad(theta)
    np.testing.assert_allclose(value, expected(theta), rtol=1e-11)
    by_differences = textbook.derivative(expected, theta)
    np.testing.assert_allclose(gradient, by_differences, rtol=1e-7, atol=1e-6)
    mean, covariance = textbook_posterior(
        *parts(bound, theta), sample, bound.Z, X_new, tasks_new
    )
    posterior = bound.posterior(theta)
    np.testing.assert_allclose(posterior.mean(X_new, tasks_new), mean, rtol=1e-9)
    variance = posterior.variance(X_new, tasks_new)
    np.testing.assert_allclose(variance, np.diagonal(covariance), rtol=1e-9)


def test_one_task():
    kernel, (X, _, y) = RBF(ARD), draw()
    X, y, tasks = X[:-3], y[:-3], np.zeros(len(y) - 3, dtype=int)
    theta = np.r_[kernel.theta, np.log(0.1)]
    bound = building.sparse(kernel, ones(1), X, tasks, y, X)
    expected = building.dense(kernel, ones(1), X, tasks, y).value(theta)
    np.testing.assert_allclose(bound.value(theta), expected, rtol=1e-12)


def test_one_sample():
    X, tasks, y = np.ones((1, 2)), np.zeros(1, dtype=int), np.array([2.0])
    bound = building.sparse(ConstantKernel(3.0), ones(1), X, tasks, y, X)
    value, gradient = bound.value_and_grad(np.log([3.0, 0.5]))
    expected = -0.5 * (4.0 / 3.5 + np.log(3.5) + np.log(2.0 * np.pi))
    np.testing.assert_allclose(value, expected, rtol=1e-14)
    slope = 0.5 * (4.0 / 3.5**2 - 1.0 / 3.5)
    np.testing.assert_allclose(gradient, [3.0 * slope, 0.5 * slope], rtol=1e-12)


@pytest.mark.parametrize("n_noise", [1, M])
def test_fisher_information(n_noise):
    kernel, form = KERNELS["paper"], low_rank(M, 2, diagonal=True)
    theta = parameters(kernel, form, n_noise)
    actual = make(kernel, form, n_noise).fisher_information(theta)
    expected = dense(kernel, form, n_noise).fisher_information(theta)
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-10)


def test_fisher_information_of_some_rows(monkeypatch):
    monkeypatch.setattr(likelihood, "FISHER_ROWS", 5)
    monkeypatch.setattr(likelihood, "FISHER_ROWS_PER_TASK", 0)
    kernel, form, (X, tasks, y) = RBF(ARD), low_rank(M, 2), draw()
    theta, rows = parameters(kernel, form), np.linspace(0, len(y) - 1, 5).astype(int)
    few = dense(kernel, form, sample=Sample(X[rows], tasks[rows], y[rows]))
    actual = make(kernel, form).fisher_information(theta)
    expected = few.fisher_information(theta) * len(y) / 5
    np.testing.assert_allclose(actual, expected, rtol=1e-10)


def test_pickles():
    bound = make(KERNELS["paper"], low_rank(M, 2, diagonal=True))
    theta = parameters(bound.prior.kernel, bound.prior.task_covariance)
    bound.release()
    assert pickle.loads(pickle.dumps(bound)).value(theta) == bound.value(theta)
    posterior = bound.posterior(theta)
    again = pickle.loads(pickle.dumps(posterior))
    for method in ("mean", "variance", "covariance"):
        expected = getattr(posterior, method)(*new_rows())
        np.testing.assert_array_equal(getattr(again, method)(*new_rows()), expected)


@pytest.mark.parametrize("block_size", [1, 4, 100])
def test_posterior_in_blocks(block_size):
    kernel, form, (X, tasks) = KERNELS["paper"], low_rank(M, 2), new_rows()
    theta = parameters(kernel, form)
    posterior = make(kernel, form, block_size=block_size).posterior(theta)
    expected = make(kernel, form, block_size=9).posterior(theta)
    for method in ("mean", "variance"):
        found = getattr(posterior, method)(X, tasks)
        whole = getattr(expected, method)(X, tasks)
        np.testing.assert_allclose(found, whole, rtol=1e-10)


@pytest.mark.parametrize("Z", [np.ones((3, D + 1)), np.ones(D), np.ones((0, D))])
def test_inducing_inputs_of_other_features(Z):
    with pytest.raises(ValueError, match=r"at least one row and the 4 features of X"):
        make(RBF(), ones(M), Z=Z)
