import contextlib

import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sparse_bounds import (
    M,
    Sample,
    dense,
    inducing,
    make,
    new_rows,
    parameters,
)

from skmtgp.exceptions import JitterWarning
from skmtgp.inference import features, sparse
from skmtgp.inference.inducing import greedy_variance
from skmtgp.inference.sums import ResidualSums
from skmtgp.inference.weights import Covariances
from skmtgp.model.task_covariance import low_rank, ones


def small_noise_problem():
    rng, tasks = np.random.default_rng(0), np.repeat([0, 1], 12)
    X = rng.uniform(0.0, 4.0, (24, 2))
    F = np.array([[1.0], [0.7]])
    y = F[tasks, 0] * np.sin(2.0 * X[:, 0]) * np.cos(X[:, 1])
    return rng, F, Sample(X, tasks, y)


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("kappa", [0.0, 1e-6, 0.5])
def test_accuracy_of_small_noise(noise, kappa):
    # the trace term is a difference of numbers that agree to all digits but the last:
    # a few eps k(x, x) K^rho_mm / sigma^2 are lost for each row, in the mean nothing
    rng, F, (X, tasks, y) = small_noise_problem()
    form = low_rank(2, 1, diagonal=kappa > 0.0)
    rho = np.r_[F.ravel(), np.log(np.full(2, kappa)) if kappa else []]
    theta = np.r_[0.0, rho, np.log(noise)]
    bound = building.sparse(RBF(), form, X, tasks, y, X, block_size=5)
    value, gradient = bound.value_and_grad(theta)
    K_rho, noise = form.matrix(rho), np.exp(theta[-1])
    expected = textbook.exact_log_marginal_likelihood(K_rho, noise, X, tasks, y)
    loss = 10.0 * np.finfo(float).eps / noise  # 2e-5 at a noise of 1e-10
    np.testing.assert_allclose(value, expected, rtol=1e-13, atol=loss * len(y))
    exact = building.dense(RBF(), form, X, tasks, y).value_and_grad(theta)[1]
    atol = 30.0 * loss * np.abs(exact).max()
    np.testing.assert_allclose(gradient, exact, rtol=1e-8, atol=atol)
    X_new, tasks_new = rng.uniform(0.0, 4.0, (4, 2)), np.array([0, 1, 0, 1])
    mean = textbook.exact_mean(K_rho, noise, X, tasks, y, X_new, tasks_new)
    found = bound.posterior(theta).mean(X_new, tasks_new)
    np.testing.assert_allclose(found, mean, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("noise", [1e-4, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("length", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("variance", [1.0, 900.0])
def test_never_above_without_noise(noise, length, variance):
    """But for rounding, which is down: from fifty digits, and however smooth k^x is.

    The losses are those that the user guide states, with K_ZZ singular or not.
    """
    _, F, (X, tasks, _) = small_noise_problem()
    X[12:18], F = X[:6], np.sqrt(variance) * F  # some inputs are shared
    y = F[tasks, 0] * np.sin(2.0 * X[:, 0]) * np.cos(X[:, 1])
    X = X / length
    form, theta = low_rank(2, 1), np.r_[0.0, F.ravel(), np.log(noise)]
    noise = np.exp(theta[-1])
    exact = textbook.exact_log_marginal_likelihood(F @ F.T, noise, X, tasks, y)
    size = max(len(y), -2.0 * exact)  # where the model does not fit, the latter
    slack = size * np.finfo(float).eps * (1.0 + variance / noise)
    for Z in (greedy_variance(RBF(), X, len(X)), X, X[::2]):
        value = building.sparse(RBF(), form, X, tasks, y, Z).value(theta)
        assert value <= exact + slack
        if len(Z) != len(X[::2]):
            assert value >= exact - 500.0 * slack


def test_many_rows_without_noise():
    # the Gram matrices alone would give the quadratic form with 6 digits fewer
    n, m, rng = 4000, 40, np.random.default_rng(0)
    X, tasks = rng.uniform(0.0, 3.0, (n, 2)), rng.integers(0, 2, n)
    F, Z = np.array([[1.0], [0.7]]), rng.uniform(0.0, 3.0, (m, 2))
    y = F[tasks, 0] * np.sin(X[:, 0]) * np.cos(X[:, 1])
    theta = np.r_[np.log(1.5), F.ravel(), np.log(1e-10)]
    bound = building.sparse(RBF(), low_rank(2, 1), X, tasks, y, Z)
    at_theta, weights = bound.forward(theta)
    phi, noise = at_theta.tile(X).phi, np.exp(theta[-1])
    Psi = (F[tasks, 0] * phi).T / np.sqrt(noise)
    rows = np.block([[Psi, y[:, None] / np.sqrt(noise)], [np.eye(m, m + 1)]])
    by_qr = np.square(np.linalg.qr(rows, mode="r")[-1, -1])
    trace = (weights.K_diagonal * weights.sums.rest).sum() / noise
    log_det = weights.log_det + n * np.log(2.0 * np.pi * noise)
    expected = -0.5 * (log_det + by_qr + trace)
    np.testing.assert_allclose(bound.value(theta), expected, rtol=1e-9)


@pytest.fixture
def twice():
    """A bound whose inducing inputs are two of each."""
    return make(RBF(0.8), low_rank(M, 2), Z=np.repeat(inducing(), 2, axis=0))


def test_many_rows_and_few_inducing_inputs_take_one_thread(twice, monkeypatch):
    # more of them take several times as long, whatever the number of rows
    sizes = []

    def limit_threads(size):
        sizes.append(size)
        return contextlib.nullcontext()

    monkeypatch.setattr(sparse, "limit_threads", limit_threads)
    twice.value_and_grad(parameters(twice.prior.kernel, twice.prior.task_covariance))
    assert sizes == [len(twice.Z)]


def test_singular_inducing_covariance(twice):
    theta = parameters(twice.prior.kernel, twice.prior.task_covariance)
    once = make(RBF(0.8), low_rank(M, 2))
    value, gradient = twice.value_and_grad(theta)
    expected = once.value_and_grad(theta)
    np.testing.assert_allclose(value, expected[0], rtol=1e-9)
    np.testing.assert_allclose(gradient, expected[1], rtol=1e-5, atol=1e-6)
    mean = once.posterior(theta).mean(*new_rows())
    found = twice.posterior(theta).mean(*new_rows())
    np.testing.assert_allclose(found, mean, rtol=1e-6)


def test_more_jitter_than_usual_is_told(twice, monkeypatch):
    monkeypatch.setattr(
        features, "LEAST_JITTER", 1e-19
    )  # too little for a singular K_ZZ
    message = r"covariance of the 12 inducing inputs .* was added .* See the user guide"
    with pytest.warns(JitterWarning, match=message):
        twice.posterior(parameters(twice.prior.kernel, twice.prior.task_covariance))


@pytest.mark.parametrize("n_features", [1, 2])
def test_trace_term_is_not_negative(n_features):
    # whatever the kernel that has been learned since the inducing inputs were chosen:
    # the smoother it is, the nearer K_ZZ comes to a singular matrix
    n = 400
    X = np.random.default_rng(0).uniform(0.0, 6.0 / n_features**2, (n, n_features))
    Z = greedy_variance(RBF(), X, n)
    tasks, y = np.zeros(n, dtype=int), np.zeros(n)
    bound = building.sparse(RBF(), ones(1), X, tasks, y, Z)
    for length in np.linspace(1.0, 1.6, 60):
        _, weights = bound.forward(np.log([length, 1e-10]))
        assert weights.sums.rest.sum() >= 0.0


def test_inducing_inputs_that_are_all_alike():
    theta = parameters(ConstantKernel(), low_rank(M, 2))
    many, one = (make(ConstantKernel(), low_rank(M, 2), Z=inducing(m)) for m in (6, 1))
    value, gradient = many.value_and_grad(theta)
    expected = one.value_and_grad(theta)
    np.testing.assert_allclose(value, expected[0], rtol=1e-9)
    np.testing.assert_allclose(gradient, expected[1], rtol=1e-7, atol=1e-7)


def test_jitter_is_part_of_the_model(monkeypatch):
    # its derivative is in the gradient, and the bound remains one
    monkeypatch.setattr(features, "LEAST_JITTER", 0.02)
    bound = make(ConstantKernel(1.3) * RBF(0.8), low_rank(M, 2))
    theta = parameters(bound.prior.kernel, bound.prior.task_covariance)
    by_differences = textbook.derivative(bound.value, theta)
    value, gradient = bound.value_and_grad(theta)
    np.testing.assert_allclose(gradient, by_differences, rtol=1e-7, atol=1e-7)
    assert value < dense(bound.prior.kernel, bound.prior.task_covariance).value(theta)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("position", [0, 1, 5, 9])
def test_parameters_that_are_not_finite(bad, position):
    bound = make(ConstantKernel(), low_rank(M, 2))
    theta = parameters(bound.prior.kernel, bound.prior.task_covariance)
    theta[position] = bad
    with np.errstate(invalid="ignore"):
        value, gradient, d_Z = bound.value_and_grads(theta)
        assert bound.value(theta) == -np.inf
    assert value == -np.inf
    assert np.isnan(gradient).all()
    assert np.isnan(d_Z).all()


def test_weights_cannot_be_refined_without_their_factor():
    bound = make(RBF(1.2), low_rank(M, 2))
    theta = parameters(RBF(1.2), low_rank(M, 2))
    _, weights = bound.forward(theta)
    sums = ResidualSums(np.ones(M), np.ones_like(weights.own), np.ones(M))
    weights.refined(sums)
    Covariances(weights)
    with pytest.raises(RuntimeError, match="solve before `invert`"):
        weights.refined(sums)


def test_variance_is_never_negative(monkeypatch):
    _, F, (X, tasks, y) = small_noise_problem()
    bound = building.sparse(RBF(), low_rank(2, 1), X, tasks, y, X)
    posterior = bound.posterior(np.r_[0.0, F.ravel(), np.log(1e-15)])
    assert (posterior.variance(X, tasks) >= 0.0).all()
    less = 1.0 - 1e-12  # as rounding may make it
    monkeypatch.setattr(
        posterior.features.terms[0].kernel, "diag", lambda X: np.full(len(X), less)
    )
    np.testing.assert_array_equal(posterior.variance(X, tasks), 0.0)
    monkeypatch.setattr(posterior, "kernel", lambda X: less * RBF()(X))
    covariance = posterior.covariance(X, tasks)
    np.testing.assert_array_equal(np.diagonal(covariance), 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_leaves_no_digits(seed):
    """The posterior has more of it, and says so; learning goes on elsewhere.

    A task has fewer rows than there are inducing inputs.
    """
    rng, tasks = np.random.default_rng(seed), np.repeat([0, 1], [19, 5])
    X, y = rng.uniform(0.0, 4.0, (24, 2)), np.full(24, 1.0)
    form = ones(2, diagonal=True)
    theta = np.r_[1.0, np.log([1e2, 1e2]), -70.0]
    bound = building.sparse(RBF(), form, X, tasks, y, X[:10])
    assert bound.value_and_grad(theta)[0] == -np.inf
    with pytest.warns(JitterWarning, match="was added to the noise variance"):
        posterior = bound.posterior(theta)
    assert (posterior.noise > 1e-11).all()
    theta[-1] = np.log(posterior.noise[0])
    same = bound.posterior(theta)
    for of in (posterior, same):
        assert np.isfinite(of.log_likelihood)
    np.testing.assert_allclose(posterior.mean(X, tasks), same.mean(X, tasks), rtol=1e-6)
