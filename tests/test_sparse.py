import contextlib
import pickle
import tracemalloc
from typing import NamedTuple

import building
import hypothesis.strategies as st
import numpy as np
import pytest
import textbook
from hypothesis import given, settings
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Exponentiation,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp.exceptions import JitterWarning
from skmtgp.inference import features, likelihood, sparse
from skmtgp.inference.features import Features
from skmtgp.inference.inducing import greedy_variance
from skmtgp.inference.sums import sum_features, sum_gradients
from skmtgp.inference.weights import Covariances, Gradients
from skmtgp.kernels import ARDLinear, Columns, inverse_dynamics_kernel
from skmtgp.model.task_covariance import identity, low_rank, ones

M, D = 4, 4
TASKS = (2, 0, 3, 3, 0, 2, 2, 0, 3, 1, 0, 2, 2, 3, 0, 3, 2, 0, 3, 2, 2, 3, 2)
ARD = (0.7, 1.1, 1.9, 0.9)

KERNELS = {
    "paper": inverse_dynamics_kernel(1),
    "rbf": RBF(1.2),
    "fixed": ConstantKernel(1.3, "fixed") * RBF(ARD, "fixed"),
    "matern": ConstantKernel(0.6) * Matern(ARD, nu=1.5) + DotProduct(0.8),
    "columns": Columns(RationalQuadratic(1.2, 0.6), [0, 2]) + RBF(ARD),
    "product": RBF(1.2) * ARDLinear(ARD, 0.4) + ConstantKernel(0.3) * ConstantKernel(2),
    "power": Exponentiation(Columns(RBF((0.8, 1.2)), [1, 1]) + DotProduct(0.8), 2.0),
    "unknown": Columns(ExpSineSquared(1.2, 2.0), [1]) + RBF(ARD),
}
WHITE = {
    "white": RBF(1.2) + WhiteKernel(0.1),
    "unknown, white": Columns(ExpSineSquared(1.2, 2.0), [1]) + WhiteKernel(0.1),
}
FORMS = {
    "identity": identity(M),
    "ones": ones(M),
    "rank 1": low_rank(M, 1),
    "rank 2, diagonal": low_rank(M, 2, diagonal=True),
    "ones, diagonal": ones(M, diagonal=True),
    "full rank": low_rank(M, M),
}
EVERY = KERNELS | WHITE
LEARNABLE = [name for name in EVERY if "unknown" not in name]
every_kernel = pytest.mark.parametrize("kernel", EVERY.values(), ids=EVERY.keys())
every_noise_free_kernel = pytest.mark.parametrize(
    "kernel", KERNELS.values(), ids=KERNELS.keys()
)
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
every_noise = pytest.mark.parametrize("n_noise", [1, M], ids=["shared", "per task"])


class Sample(NamedTuple):
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray


def draw(seed=0):
    rng, tasks = np.random.default_rng(seed), np.array(TASKS)
    X = rng.standard_normal((len(tasks), D))
    X[-3:] = X[:3]  # tasks that share inputs
    return Sample(X, tasks, np.sin(X.sum(axis=1)) + tasks + rng.standard_normal(len(X)))


def inducing(m=6, seed=1):
    return np.random.default_rng(seed).standard_normal((m, D))


def make(kernel, form, n_noise=1, Z=None, sample=None, block_size=7):
    sample, Z = sample or draw(), inducing() if Z is None else Z
    return building.sparse(kernel, form, *sample, Z, n_noise, block_size)


def dense(kernel, form, n_noise=1, sample=None):
    X, tasks, y = sample or draw()
    order = np.argsort(tasks, kind="stable")
    return building.dense(kernel, form, X[order], tasks[order], y[order], n_noise)


def parameters(kernel, form, n_noise=1, seed=0):
    rng = np.random.default_rng(seed)
    rho = rng.standard_normal(form.n_parameters)
    return np.concatenate([kernel.theta + 0.2, rho, np.log(0.05 + rng.random(n_noise))])


def parts(bound, theta):
    """What theta stands for: the kernel, K^rho and the noise of each row."""
    kernel, rho, log_noise = building.parts(bound, theta)
    noise = np.broadcast_to(np.exp(log_noise), M)[bound.tasks]
    K_rho = bound.task_covariance.matrix(rho)
    return bound.kernel.clone_with_theta(kernel), K_rho, noise


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


@every_kernel
@every_form
@every_noise
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
        bound.value_and_grads(parameters(bound.kernel, ones(M)))


@every_noise_free_kernel
@every_form
@every_noise
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


def new_rows():
    rng = np.random.default_rng(5)
    X = rng.standard_normal((9, D))
    X[0], X[1] = draw().X[0], inducing()[0]
    return X, np.array([2, 0, 0, 3, 1, 2, 3, 3, 1])


@every_kernel
@every_form
@every_noise
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


seeds = st.integers(0, 2**32 - 1)
quick = settings(max_examples=40, deadline=None)


def random_model(name, seed):
    rng = np.random.default_rng(seed)
    form, n_noise = FORMS[list(FORMS)[rng.integers(len(FORMS))]], rng.choice([1, M])
    theta = parameters(EVERY[name], form, n_noise, seed)
    theta += 0.5 * rng.standard_normal(len(theta))
    theta[-n_noise:] += rng.uniform(-6.0, 3.0)
    Z = inducing(rng.integers(1, 20), seed)
    return rng, theta, (EVERY[name], form, int(n_noise)), Z


@given(st.sampled_from(sorted(EVERY)), seeds)
@quick
def test_never_above_the_likelihood(name, seed):
    _, theta, model, Z = random_model(name, seed)
    exact = dense(*model, draw(seed)).value(theta)
    assert make(*model, Z, draw(seed)).value(theta) <= exact + 1e-9 * (1 + abs(exact))


@given(st.sampled_from(sorted(EVERY)), seeds)
@quick
def test_more_inducing_inputs_never_lower_it(name, seed):
    rng, theta, model, Z = random_model(name, seed)
    few = make(*model, Z[: rng.integers(1, len(Z) + 1)], draw(seed)).value(theta)
    many = make(*model, Z, draw(seed)).value(theta)
    assert few <= many + 1e-9 * (1 + abs(many))


@given(st.sampled_from(sorted(EVERY)), seeds, st.integers(1, 30))
@quick
def test_blocks_and_order_of_rows_do_not_matter(name, seed, block_size):
    rng, theta, model, Z = random_model(name, seed)
    sample, order = draw(seed), rng.permutation(len(TASKS))
    one = make(*model, Z, sample, block_size=100).value_and_grad(theta)
    shuffled = Sample(*(part[order] for part in sample))
    other = make(*model, Z, shuffled, block_size=block_size).value_and_grad(theta)
    scale = np.abs(one[1]).max(initial=abs(one[0]))
    np.testing.assert_allclose(other[0], one[0], rtol=0.0, atol=1e-10 * scale)
    np.testing.assert_allclose(other[1], one[1], rtol=0.0, atol=1e-10 * scale)


@given(st.sampled_from(sorted(EVERY)), seeds)
@quick
def test_rotations_of_the_factor_do_not_matter(name, seed):
    rng, form = np.random.default_rng(seed), low_rank(M, 2)
    theta, n = parameters(EVERY[name], form), EVERY[name].n_dims
    rotation = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    rotated = theta.copy()
    rotated[n:-1] = (theta[n:-1].reshape(M, 2) @ rotation).ravel()
    bound = make(EVERY[name], form)
    np.testing.assert_allclose(bound.value(rotated), bound.value(theta), rtol=1e-11)


class TestSums:
    """What is made of the rows adds up over them."""

    @pytest.fixture(params=["paper", "unknown"])
    def bound(self, request):
        return make(EVERY[request.param], low_rank(M, 2, diagonal=True), M)

    def test_forward(self, bound):
        theta = building.parts(
            bound, parameters(bound.kernel, bound.task_covariance, M)
        )[0]
        features = Features(bound.kernel, bound.node, theta, bound.Z)
        blocks = list(bound.blocks())
        whole = sum_features(features, M, blocks)
        halves = (
            sum_features(features, M, blocks[:2]),
            sum_features(features, M, blocks[2:]),
        )
        self.check(halves[0] + halves[1], whole)
        none = sum_features(features, M, [])
        self.check(whole + none, whole)

    def test_backward(self, bound):
        theta = parameters(bound.kernel, bound.task_covariance, M)
        phi, weights = bound.forward(theta)
        adjoint, blocks = Gradients(weights).adjoint(), list(bound.blocks())
        whole, one, two = (
            sum_gradients(phi, adjoint, some)
            for some in (blocks, blocks[:2], blocks[2:])
        )
        self.check(one + two, whole)

    def check(self, actual, expected):
        assert type(actual) is type(expected)
        for name, value in vars(expected).items():
            np.testing.assert_allclose(
                getattr(actual, name), value, rtol=1e-11, atol=1e-11
            )

    def test_are_small(self, bound):
        theta = parameters(bound.kernel, bound.task_covariance, M)
        phi, weights = bound.forward(theta)
        m, adjoint = len(bound.Z), Gradients(weights).adjoint()
        for sums in (weights.sums, sum_gradients(phi, adjoint, bound.blocks())):
            assert max(part.size for part in vars(sums).values()) <= M * m * m


def test_rows_on_disk(tmp_path):
    kernel, form = KERNELS["paper"], low_rank(M, 2)
    mapped = []
    for name, part in draw()._asdict().items():
        np.save(tmp_path / f"{name}.npy", part)
        mapped.append(np.load(tmp_path / f"{name}.npy", mmap_mode="r"))
    theta = parameters(kernel, form)
    value, gradient = make(kernel, form, sample=Sample(*mapped)).value_and_grad(theta)
    expected = make(kernel, form).value_and_grad(theta)
    assert value == expected[0]
    np.testing.assert_array_equal(gradient, expected[1])


def test_rows_of_single_precision():
    kernel, form, (X, tasks, y) = RBF(ARD), low_rank(M, 2), draw()
    X, y = X.astype(np.float32), y.astype(np.float32)
    theta = parameters(kernel, form)
    value = make(kernel, form, sample=Sample(X, tasks, y)).value(theta)
    double = Sample(X.astype(float), tasks, y.astype(float))
    assert value == make(kernel, form, sample=double).value(theta)


def test_memory():
    n, m, rng = 20_000, 50, np.random.default_rng(0)
    X, tasks, y = rng.standard_normal((n, D)), np.arange(n) % M, rng.standard_normal(n)
    kernel, form = KERNELS["paper"], low_rank(M, 2)
    bound = building.sparse(kernel, form, X, tasks, y, X[:m], block_size=100)
    theta = parameters(kernel, form)
    tracemalloc.start()
    try:
        bound.value_and_grads(theta)
        bound.posterior(theta)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.25 * 8 * n * m


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
    trace = weights.K_diagonal @ weights.sums.rest / noise
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
    twice.value_and_grad(parameters(twice.kernel, twice.task_covariance))
    assert sizes == [len(twice.Z)]


def test_singular_inducing_covariance(twice):
    theta = parameters(twice.kernel, twice.task_covariance)
    once = make(RBF(0.8), low_rank(M, 2))
    value, gradient = twice.value_and_grad(theta)
    expected = once.value_and_grad(theta)
    np.testing.assert_allclose(value, expected[0], rtol=1e-9)
    np.testing.assert_allclose(gradient, expected[1], rtol=1e-5, atol=1e-6)
    mean = once.posterior(theta).mean(*new_rows())
    found = twice.posterior(theta).mean(*new_rows())
    np.testing.assert_allclose(found, mean, rtol=1e-6)


def test_more_jitter_than_usual_is_told(twice, monkeypatch):
    monkeypatch.setattr(features, "ROUNDING", 1e-19)  # too little for a singular K_ZZ
    message = r"covariance of the 12 inducing inputs .* was added .* See the user guide"
    with pytest.warns(JitterWarning, match=message):
        twice.posterior(parameters(twice.kernel, twice.task_covariance))


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
    monkeypatch.setattr(features, "ROUNDING", 0.02)
    bound = make(ConstantKernel(1.3) * RBF(0.8), low_rank(M, 2))
    theta = parameters(bound.kernel, bound.task_covariance)
    by_differences = textbook.derivative(bound.value, theta)
    value, gradient = bound.value_and_grad(theta)
    np.testing.assert_allclose(gradient, by_differences, rtol=1e-7, atol=1e-7)
    assert value < dense(bound.kernel, bound.task_covariance).value(theta)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("position", [0, 1, 5, 9])
def test_parameters_that_are_not_finite(bad, position):
    bound = make(ConstantKernel(), low_rank(M, 2))
    theta = parameters(bound.kernel, bound.task_covariance)
    theta[position] = bad
    with np.errstate(invalid="ignore"):
        value, gradient, d_Z = bound.value_and_grads(theta)
        assert bound.value(theta) == -np.inf
    assert value == -np.inf
    assert np.isnan(gradient).all()
    assert np.isnan(d_Z).all()


@pytest.mark.parametrize("n_noise", [1, M])
def test_fisher_information(n_noise):
    kernel, form = KERNELS["paper"], low_rank(M, 2, diagonal=True)
    theta = parameters(kernel, form, n_noise)
    actual = make(kernel, form, n_noise).fisher_information(theta)
    expected = dense(kernel, form, n_noise).fisher_information(theta)
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-10)


def test_fisher_information_of_some_rows(monkeypatch):
    monkeypatch.setattr(likelihood, "FISHER_ROWS", 5)
    kernel, form, (X, tasks, y) = RBF(ARD), low_rank(M, 2), draw()
    theta, rows = parameters(kernel, form), np.linspace(0, len(y) - 1, 5).astype(int)
    few = dense(kernel, form, sample=Sample(X[rows], tasks[rows], y[rows]))
    actual = make(kernel, form).fisher_information(theta)
    expected = few.fisher_information(theta) * len(y) / 5
    np.testing.assert_allclose(actual, expected, rtol=1e-10)


def test_pickles():
    bound = make(KERNELS["paper"], low_rank(M, 2, diagonal=True))
    theta = parameters(bound.kernel, bound.task_covariance)
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


def test_weights_cannot_be_refined_without_their_factor():
    bound = make(RBF(1.2), low_rank(M, 2))
    theta = parameters(RBF(1.2), low_rank(M, 2))
    _, weights = bound.forward(theta)
    errors = np.ones_like(weights.own)
    weights.refined(errors)
    Covariances(weights)
    with pytest.raises(RuntimeError, match="solve before `invert`"):
        weights.refined(errors)


def test_variance_is_never_negative(monkeypatch):
    _, F, (X, tasks, y) = small_noise_problem()
    bound = building.sparse(RBF(), low_rank(2, 1), X, tasks, y, X)
    posterior = bound.posterior(np.r_[0.0, F.ravel(), np.log(1e-15)])
    assert (posterior.variance(X, tasks) >= 0.0).all()
    less = 1.0 - 1e-12  # as rounding may make it
    monkeypatch.setattr(
        posterior.features.kernel, "diag", lambda X: np.full(len(X), less)
    )
    np.testing.assert_array_equal(posterior.variance(X, tasks), 0.0)
    monkeypatch.setattr(posterior, "kernel", lambda X: less * RBF()(X))
    covariance = posterior.covariance(X, tasks)
    np.testing.assert_array_equal(np.diagonal(covariance), 0.0)


@pytest.mark.parametrize("Z", [np.ones((3, D + 1)), np.ones(D), np.ones((0, D))])
def test_inducing_inputs_of_other_features(Z):
    with pytest.raises(ValueError, match=r"at least one row and the 4 features of X"):
        make(RBF(), ones(M), Z=Z)
