"""Complete data by Kronecker algebra: the same as dense, and as the textbook."""

import pickle
import tracemalloc

import building
import hypothesis.strategies as st
import numpy as np
import pytest
import textbook
from hypothesis import given, settings
from pairs import in_pairs
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
)

from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.kernels import (
    ARDLinear,
    Columns,
    geometric_inverse_dynamics_kernel,
    inverse_dynamics_kernel,
)
from skmtgp.model.described import task_covariance
from skmtgp.model.task_covariance import identity, low_rank, ones

N, M, D = 11, 4, 4
ARD = (0.7, 1.1, 1.9, 0.9)
KERNELS = {
    "paper": inverse_dynamics_kernel(1),
    "geometric": geometric_inverse_dynamics_kernel("P"),
    "rbf": RBF(1.2),
    "fixed": ConstantKernel(1.3, "fixed") * RBF(ARD, "fixed"),
    "matern": ConstantKernel(0.6) * Matern(ARD, nu=1.5) + DotProduct(0.8),
    "columns": Columns(RationalQuadratic(1.2, 0.6), [0, 2]),
    "constant": ConstantKernel(0.8),
    "unknown": Columns(ExpSineSquared(1.2, 2.0), [1]) + ARDLinear(ARD, 0.4),
}
FORMS = {
    "identity": identity(M),
    "ones": ones(M),
    "rank 1": low_rank(M, 1),
    "rank 2, diagonal": low_rank(M, 2, diagonal=True),
    "full rank": low_rank(M, M),
    "descriptors": task_covariance(M, 2, np.eye(M)[:, ::-1][:, :3] + 0.5, shared=True),
}
CLOSE = {"rtol": 1e-10, "atol": 1e-11}
every_model = in_pairs(
    "tile",
    kernel=KERNELS,
    form=FORMS,
    n_noise={"shared": 1, "per task": M},
    tile={"small tiles": 3, "one tile": 240},
)


def draw(seed=0, n_inputs=N, n_tasks=M):
    """Complete data, sorted by task, each task's inputs in another order."""
    rng = np.random.default_rng(seed)
    inputs = rng.standard_normal((n_inputs, D))
    X = np.vstack([inputs[rng.permutation(n_inputs)] for _ in range(n_tasks)])
    tasks = np.repeat(np.arange(n_tasks), n_inputs)
    y = np.sin(X.sum(axis=1)) + tasks + rng.standard_normal(len(X))
    return X, tasks, y


def new_rows():
    rng = np.random.default_rng(5)
    Z = rng.standard_normal((8, D))
    Z[0] = draw()[0][0]
    return Z, np.array([2, 0, 0, 3, 1, 2, 3, 3])


def parameters(kernel, form, n_noise=1, seed=0):
    rng = np.random.default_rng(seed)
    rho = rng.standard_normal(form.n_parameters)
    return np.concatenate([kernel.theta + 0.2, rho, np.log(0.05 + rng.random(n_noise))])


def both(kernel, form, n_noise=1, data=None):
    """The likelihood by Kronecker algebra, the dense one and parameters."""
    arguments = kernel, form, *(data or draw()), n_noise
    theta = parameters(kernel, form, n_noise)
    return building.kronecker(*arguments), building.dense(*arguments), theta


def parts(likelihood, theta):
    """What theta stands for: the kernel, K^rho and the noise variances."""
    kernel, rho, log_noise = building.parts(likelihood, theta)
    kernel = likelihood.prior.kernel.clone_with_theta(kernel)
    return kernel, likelihood.prior.task_covariance.matrix(rho), np.exp(log_noise)


def textbook_value(likelihood, theta):
    K = textbook.covariance(*parts(likelihood, theta), likelihood.X, likelihood.tasks)
    return textbook.log_marginal_likelihood(K, likelihood.y)


@every_model
class TestLikelihood:
    def test_textbook(self, kernel, form, n_noise, tile):
        likelihood, _, theta = both(kernel, form, n_noise)
        value, gradient = likelihood.value_and_grad(theta)
        np.testing.assert_allclose(value, textbook_value(likelihood, theta), rtol=1e-11)
        assert likelihood.value(theta) == value
        expected = textbook.derivative(lambda t: textbook_value(likelihood, t), theta)
        np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-7)

    def test_dense(self, kernel, form, n_noise, tile):
        likelihood, dense, theta = both(kernel, form, n_noise)
        (value, gradient), expected = (
            each.value_and_grad(theta) for each in (likelihood, dense)
        )
        np.testing.assert_allclose(value, expected[0], rtol=1e-12)
        np.testing.assert_allclose(gradient, expected[1], **CLOSE)
        D = likelihood.task_gradient(theta)
        np.testing.assert_array_equal(D, D.T)
        np.testing.assert_allclose(D, dense.task_gradient(theta), **CLOSE)

    def test_posterior(self, kernel, form, n_noise, tile):
        likelihood, dense, theta = both(kernel, form, n_noise)
        posterior, (Z, tasks) = likelihood.posterior(theta), new_rows()
        given = likelihood.X, likelihood.tasks, likelihood.y
        mean, covariance = textbook.posterior(
            *parts(likelihood, theta), *given, Z, tasks
        )
        np.testing.assert_allclose(posterior.mean(Z, tasks), mean, **CLOSE)
        found = posterior.covariance(Z, tasks)
        np.testing.assert_allclose(found, covariance, **CLOSE)
        variance = posterior.variance(Z, tasks)
        np.testing.assert_allclose(variance, np.diagonal(covariance), **CLOSE)
        value = likelihood.value(theta)
        np.testing.assert_allclose(posterior.log_likelihood, value, rtol=1e-14)
        expected = dense.posterior(theta)
        np.testing.assert_allclose(posterior.alpha, expected.alpha, **CLOSE)
        of_tasks = posterior.mean_of_tasks(Z, np.arange(M))
        np.testing.assert_allclose(of_tasks[np.arange(8), tasks], mean, **CLOSE)
        *joint, cross = posterior.joint(Z, tasks)
        for found, expected in zip(joint, (mean, covariance), strict=True):
            np.testing.assert_allclose(found, expected, **CLOSE)
        np.testing.assert_array_equal(cross, posterior.cross(Z))

    def test_leave_one_out(self, kernel, form, n_noise, tile):
        *likelihoods, theta = both(kernel, form, n_noise)
        posteriors = [likelihood.posterior(theta) for likelihood in likelihoods]
        for include_noise in (False, True):
            found, expected = (of.leave_one_out(include_noise) for of in posteriors)
            np.testing.assert_allclose(found, expected, **CLOSE)

    def test_latent_functions(self, kernel, form, n_noise, tile):
        F, (Z, _) = np.random.default_rng(1).standard_normal((M, 2)), new_rows()
        (means, halves), expected = (
            likelihood.posterior(theta).latent(Z, F)
            for *likelihoods, theta in [both(kernel, form, n_noise)]
            for likelihood in likelihoods
        )
        np.testing.assert_allclose(means, expected[0], **CLOSE)
        # the factors of K differ, but not what they explain
        explained, of_dense = (
            np.einsum("ait,biu->abtu", half, half) for half in (halves, expected[1])
        )
        np.testing.assert_allclose(explained, of_dense, **CLOSE)


def test_fisher_information_is_that_of_the_dense_likelihood():
    likelihood, dense, theta = both(RBF(ARD), low_rank(M, 2), M)
    found, expected = (each.fisher_information(theta) for each in (likelihood, dense))
    np.testing.assert_array_equal(found, expected)


def test_covariance_is_symmetric_and_its_diagonal_is_the_variance():
    likelihood, _, theta = both(RBF(ARD), low_rank(M, 2))
    posterior, (Z, tasks) = likelihood.posterior(theta), new_rows()
    covariance = posterior.covariance(Z, tasks)
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-13, atol=1e-15)
    variance = posterior.variance(Z, tasks)
    np.testing.assert_allclose(np.diagonal(covariance), variance, rtol=1e-13)


def test_tasks_without_data():
    """Section 3.3 needs them: K^rho has a task that joins later."""
    X, tasks, y = draw(n_tasks=2)
    tasks, form = np.array([1, 3])[tasks], low_rank(M, 2)
    for n_noise in (1, M):
        likelihood, dense, theta = both(RBF(ARD), form, n_noise, (X, tasks, y))
        found, expected = (
            np.r_[each.value_and_grad(theta)] for each in (likelihood, dense)
        )
        np.testing.assert_allclose(found, expected, **CLOSE)
        Z, of_Z = new_rows()
        for method in ("mean", "variance", "covariance"):
            found, expected = (
                getattr(each.posterior(theta), method)(Z, of_Z)
                for each in (likelihood, dense)
            )
            np.testing.assert_allclose(found, expected, **CLOSE)


@pytest.mark.parametrize(("n_inputs", "n_tasks"), [(1, 3), (7, 1), (1, 1)])
def test_few(n_inputs, n_tasks):
    data = draw(n_inputs=n_inputs, n_tasks=n_tasks)
    likelihood, dense, theta = both(RBF(ARD), low_rank(n_tasks, 1), n_tasks, data)
    found, expected = (each.value_and_grad(theta) for each in (likelihood, dense))
    np.testing.assert_allclose(np.r_[found], np.r_[expected], **CLOSE)


@pytest.mark.parametrize("apart", [True, False])
def test_incomplete_data(apart):
    """Half of the cells are missing, or one has two rows."""
    rows = np.r_[: N * M] if apart else np.r_[0, : N * M]
    X, tasks, y = (part[rows] for part in draw())
    X[tasks > 1] += apart
    with pytest.raises(ValueError, match="not observed at the same inputs"):
        building.kronecker(RBF(ARD), low_rank(M, 2), X, tasks, y)


def test_no_matrix_of_all_samples():
    """Learning and predicting take less memory than one of them would."""
    n_tasks, n_inputs = 30, 40
    data = draw(n_inputs=n_inputs, n_tasks=n_tasks)
    likelihood, _, theta = both(RBF(ARD), low_rank(n_tasks, 3), 1, data)
    Z, tasks = new_rows()
    tracemalloc.start()
    likelihood.value_and_grad(theta)
    posterior = likelihood.posterior(theta)
    posterior.covariance(Z, tasks), posterior.leave_one_out()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.25 * 8 * (n_tasks * n_inputs) ** 2


class TestMemory:
    def test_evaluations_do_not_disturb_each_other(self):
        likelihood, _, theta = both(KERNELS["paper"], low_rank(M, 2))
        value, gradient = likelihood.value_and_grad(theta)
        kept, posterior = gradient.copy(), likelihood.posterior(theta)
        before = posterior.eigen.U.copy()
        assert likelihood.value(theta + 0.1) != value
        np.testing.assert_array_equal(gradient, kept)
        np.testing.assert_array_equal(posterior.eigen.U, before)
        again = likelihood.value_and_grad(theta)
        assert again[0] == value
        np.testing.assert_array_equal(again[1], gradient)

    def test_is_not_pickled_and_can_be_released(self):
        likelihood, _, theta = both(KERNELS["paper"], low_rank(M, 2))
        size, value = len(pickle.dumps(likelihood)), likelihood.value(theta)
        assert len(pickle.dumps(likelihood)) == size
        assert pickle.loads(pickle.dumps(likelihood)).value(theta) == value
        likelihood.release()
        assert likelihood.value(theta) == value


class Indefinite(RBF):
    """Not a covariance."""

    def __call__(self, X, Y=None, eval_gradient=False):
        return -super().__call__(X, Y)


FAILURES = {
    "NaN": (RBF(1.2), 0, np.nan),
    "infinite": (ConstantKernel(0.8), 0, np.inf),
    "NaN in K^rho": (RBF(1.2), 1, np.nan),
    "infinite K^rho": (RBF(1.2), 1, np.inf),
    "noise": (RBF(1.2), -1, np.nan),
    "infinite noise": (RBF(1.2), -1, np.inf),
    "no noise": (RBF(1.2), -1, -np.inf),
    "noise that vanishes": (RBF(1.2), -1, -800.0),
    "not a covariance": (Indefinite(), -1, -5.0),
}


@pytest.mark.parametrize(("kernel", "k", "bad"), FAILURES.values(), ids=FAILURES)
def test_failures(kernel, k, bad):
    likelihood, _, theta = both(kernel, low_rank(M, 2))
    theta[k] = bad
    with np.errstate(invalid="ignore", over="ignore"):
        value, gradient = likelihood.value_and_grad(theta)
        assert value == likelihood.value(theta) == -np.inf
        assert np.isnan(gradient).all()
        assert gradient.shape == theta.shape
        with pytest.raises(NotPositiveDefiniteError):
            likelihood.posterior(theta)


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
def test_accuracy_of_small_noise(noise):
    # The eigenvalues of K^x are off by eps |K^x|, those of K by eps |K|, and the
    # smallest are the noise variance: the likelihood loses |K| / noise of its digits,
    # the mean half of them. Cholesky pivots are off by eps times their diagonal element
    # only; where the noise is 1e-10 it keeps about a digit more of the likelihood.
    rng, tasks = np.random.default_rng(0), np.repeat([0, 1], 12)
    inputs = np.sort(rng.uniform(0.0, 4.0, (12, 1)), axis=0)
    X, F = np.tile(inputs, (2, 1)), np.array([[1.0], [0.7]])
    y = np.ravel(F[tasks, 0] * np.sin(2.0 * X[:, 0]))
    Z, tasks_of_Z = rng.uniform(0.0, 4.0, (4, 1)), np.array([0, 1, 0, 1])
    form, theta = low_rank(2, 1), np.r_[0.0, F.ravel(), np.log(noise)]
    K_rho, noise, eps = F @ F.T, np.exp(theta[-1]), np.finfo(float).eps
    likelihood = building.kronecker(RBF(), form, X, tasks, y)
    exact = textbook.exact_log_marginal_likelihood(K_rho, noise, X, tasks, y)
    norm = np.linalg.norm(textbook.covariance(RBF(), K_rho, noise, X, tasks), 2)
    loss = eps * norm / noise
    np.testing.assert_allclose(likelihood.value(theta), exact, rtol=loss)
    mean = textbook.exact_mean(K_rho, noise, X, tasks, y, Z, tasks_of_Z)
    posterior = likelihood.posterior(theta)
    actual = posterior.mean(Z, tasks_of_Z)
    np.testing.assert_allclose(actual, mean, rtol=0.0, atol=20.0 * eps / noise**0.5)
    assert (posterior.variance(X, tasks) >= 0.0).all()


def test_nothing_is_added_where_the_dense_covariance_is_singular():
    """No jitter: the clipped eigenvalues leave the noise as it is."""
    X, tasks, y = draw()
    likelihood = building.kronecker(ConstantKernel(), ones(M), X, tasks, y)
    theta = np.array([0.0, np.log(1e-14)])
    value = -0.5 * ((len(y) - 1) * np.log(1e-14) + np.log(len(y)))
    value -= 0.5 * (y.var() * len(y) / 1e-14 + y.mean() ** 2)
    value -= 0.5 * len(y) * np.log(2.0 * np.pi)
    np.testing.assert_allclose(likelihood.value(theta), value, rtol=1e-9)
    posterior = likelihood.posterior(theta)
    np.testing.assert_allclose(posterior.mean(X, tasks), y.mean(), rtol=1e-7)
    assert posterior.jitter == 0.0


seeds = st.integers(0, 2**32 - 1)
names = st.sampled_from(sorted(KERNELS))
quick = settings(max_examples=40, deadline=None)


def evaluated(kind, kernel, F, noise, data):
    """Value, and gradients by kernel theta and, by task, F and log noise."""
    likelihood = kind(kernel, low_rank(*F.shape), *data, len(noise))
    value, gradient = likelihood.value_and_grad(
        np.concatenate([kernel.theta, F.ravel(), np.log(noise)])
    )
    d_kernel, d_F, d_noise = building.parts(likelihood, gradient)
    return np.r_[value, d_kernel], np.column_stack([d_F.reshape(F.shape), d_noise])


def random_model(seed):
    rng = np.random.default_rng(seed)
    n_inputs, n_tasks = rng.integers(1, 12), rng.integers(1, 6)
    F, noise = rng.standard_normal((n_tasks, 2)), 10.0 ** rng.uniform(-4, 0, n_tasks)
    return rng, F, noise, draw(seed, n_inputs, n_tasks)


@given(names, seeds)
@quick
def test_both_engines_agree(name, seed):
    _, F, noise, data = random_model(seed)
    results = [
        evaluated(kind, KERNELS[name], F, noise, data)
        for kind in (building.kronecker, building.dense)
    ]
    for found, expected in zip(*results, strict=True):
        atol = 1e-8 * np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=atol)


@given(names, seeds)
@quick
def test_order_within_a_task_does_not_matter(name, seed):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    order = np.lexsort([rng.random(len(y)), tasks])
    found, expected = (
        evaluated(building.kronecker, KERNELS[name], F, noise, data)
        for data in [(X[order], tasks[order], y[order]), (X, tasks, y)]
    )
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


@given(names, seeds)
@quick
def test_labels_of_tasks_do_not_matter(name, seed):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    label = rng.permutation(len(F))  # of each task
    order, new = np.argsort(label[tasks], kind="stable"), np.argsort(label)
    expected = evaluated(building.kronecker, KERNELS[name], F, noise, (X, tasks, y))
    data = X[order], label[tasks][order], y[order]
    found = evaluated(building.kronecker, KERNELS[name], F[new], noise[new], data)
    atol = 1e-9 * np.abs(expected[0]).max()
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-9, atol=atol)
    atol = 1e-9 * np.abs(expected[1]).max()
    np.testing.assert_allclose(found[1], expected[1][new], rtol=1e-9, atol=atol)
