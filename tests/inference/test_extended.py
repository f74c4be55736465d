"""Complete data and novel tasks by block elimination: the same as dense."""

import pickle
import tracemalloc
import warnings

import building
import hypothesis.strategies as st
import numpy as np
import pytest
import textbook
from hypothesis import given, settings
from pairs import in_pairs
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from test_kronecker import ARD, CLOSE, KERNELS, D, parameters, parts

from skmtgp.exceptions import JitterWarning
from skmtgp.model.task_covariance import low_rank

N, M, NOVEL = 9, 5, {1: 4, 4: 2}  # rows of each novel task
FORMS = {
    "rank 2": low_rank(M, 2),
    "rank 2, diagonal": low_rank(M, 2, diagonal=True),
    "full rank": low_rank(M, M),
}
NOISES = {"shared": 1, "per task": M}
every_model = in_pairs(kernel=KERNELS, form=FORMS, n_noise=NOISES)
every_noise = pytest.mark.parametrize("n_noise", NOISES.values(), ids=NOISES)


def draw(seed=0, n_inputs=N, n_tasks=M, novel=None):
    """Data sorted by task; all but the novel tasks are at the same inputs."""
    rng, novel = np.random.default_rng(seed), novel or NOVEL
    inputs = rng.standard_normal((n_inputs, D))
    X = [inputs[rng.permutation(n_inputs)] for _ in range(n_tasks)]
    for m, count in novel.items():
        X[m] = rng.standard_normal((count, D))
        X[m][0] = inputs[0]  # where the others were observed
    tasks = np.repeat(np.arange(n_tasks), [len(rows) for rows in X])
    X = np.vstack(X)
    return X, tasks, np.sin(X.sum(axis=1)) + tasks + rng.standard_normal(len(X))


def both(kernel, form, n_noise=1, data=None, novel=tuple(NOVEL)):
    """The extended likelihood, the dense one and parameters."""
    arguments = kernel, form, *(data or draw()), n_noise
    theta = parameters(kernel, form, n_noise)
    return building.extended(*arguments, novel), building.dense(*arguments), theta


def new_rows():
    Z = np.random.default_rng(5).standard_normal((8, D))
    return Z, np.array([2, 0, 4, 3, 1, 2, 3, 1])


@every_model
class TestAgainstDense:
    def test_value_and_gradient(self, kernel, form, n_noise):
        likelihood, dense, theta = both(kernel, form, n_noise)
        value, gradient = likelihood.value_and_grad(theta)
        expected = dense.value_and_grad(theta)
        np.testing.assert_allclose(value, expected[0], rtol=1e-12)
        np.testing.assert_allclose(gradient, expected[1], **CLOSE)
        assert likelihood.value(theta) == value
        D = likelihood.task_gradient(theta)
        np.testing.assert_array_equal(D, D.T)
        np.testing.assert_allclose(D, dense.task_gradient(theta), **CLOSE)

    def test_posterior(self, kernel, form, n_noise):
        likelihood, dense, theta = both(kernel, form, n_noise)
        posterior, (Z, tasks) = likelihood.posterior(theta), new_rows()
        expected = dense.posterior(theta)
        for method in ("mean", "variance", "covariance", "mean_of_tasks"):
            found, of_dense = (
                getattr(each, method)(Z, tasks) for each in (posterior, expected)
            )
            np.testing.assert_allclose(found, of_dense, **CLOSE)
        np.testing.assert_allclose(posterior.alpha, expected.alpha, **CLOSE)
        value = likelihood.value(theta)
        np.testing.assert_allclose(posterior.log_likelihood, value, rtol=1e-12)
        for noisy in (False, True):
            found, of_dense = (
                each.leave_one_out(noisy) for each in (posterior, expected)
            )
            np.testing.assert_allclose(found, of_dense, **CLOSE)

    def test_latent_functions(self, kernel, form, n_noise):
        F, (Z, _) = np.random.default_rng(1).standard_normal((M, 2)), new_rows()
        (means, halves), expected = (
            likelihood.posterior(theta).latent(Z, F)
            for *likelihoods, theta in [both(kernel, form, n_noise)]
            for likelihood in likelihoods
        )
        np.testing.assert_allclose(means, expected[0], **CLOSE)
        explained, of_dense = (
            np.einsum("ait,biu->abtu", half, half) for half in (halves, expected[1])
        )
        np.testing.assert_allclose(explained, of_dense, **CLOSE)


@every_noise
def test_textbook(n_noise):
    likelihood, _, theta = both(KERNELS["paper"], low_rank(M, 2), n_noise)
    X, tasks, y = draw()

    def expected(theta):
        K = textbook.covariance(*parts(likelihood, theta), X, tasks)
        return textbook.log_marginal_likelihood(K, y)

    value, gradient = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, expected(theta), rtol=1e-11)
    by_differences = textbook.derivative(expected, theta)
    np.testing.assert_allclose(gradient, by_differences, rtol=1e-7, atol=1e-7)
    model, (Z, of_Z) = parts(likelihood, theta), new_rows()
    mean, covariance = textbook.posterior(*model, X, tasks, y, Z, of_Z)
    posterior = likelihood.posterior(theta)
    np.testing.assert_allclose(posterior.mean(Z, of_Z), mean, **CLOSE)
    np.testing.assert_allclose(posterior.covariance(Z, of_Z), covariance, **CLOSE)


def test_fisher_information_is_that_of_the_dense_likelihood():
    likelihood, dense, theta = both(RBF(ARD), low_rank(M, 2), M)
    found, expected = (each.fisher_information(theta) for each in (likelihood, dense))
    np.testing.assert_array_equal(found, expected)


def test_no_matrix_of_all_samples():
    n_tasks, n_inputs = 30, 40
    data = draw(n_inputs=n_inputs, n_tasks=n_tasks, novel={4: 3})
    likelihood, _, theta = both(RBF(ARD), low_rank(n_tasks, 3), 1, data, [4])
    tracemalloc.start()
    likelihood.value_and_grad(theta)
    posterior = likelihood.posterior(theta)
    posterior.covariance(*new_rows()), posterior.leave_one_out()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.25 * 8 * (n_tasks * n_inputs) ** 2


def test_pickle():
    likelihood, _, theta = both(RBF(ARD), low_rank(M, 2))
    posterior, rows = likelihood.posterior(theta), new_rows()
    again = pickle.loads(pickle.dumps(posterior))
    np.testing.assert_array_equal(again.variance(*rows), posterior.variance(*rows))
    again = pickle.loads(pickle.dumps(likelihood))
    assert again.value(theta) == likelihood.value(theta)


def test_what_rows_that_join_leave_as_it_is_is_not_made_again():
    likelihood, _, theta = both(RBF(ARD), low_rank(M, 2))
    base, (Z, tasks) = likelihood.posterior(theta).base, new_rows()
    as_made = pickle.dumps(likelihood.base.posterior(theta))
    posterior = likelihood.base.posterior(theta)
    posterior.variance(Z, tasks)
    assert pickle.dumps(posterior) == as_made
    more = base.with_tasks(likelihood.base, theta)
    assert more.bound is base.bound
    assert more.largest_of_k is base.largest_of_k


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("k", [0, 1, -1])
def test_parameters_that_are_not_finite(k, bad):
    likelihood, _, theta = both(ConstantKernel(), low_rank(M, 2))
    theta[k] = bad
    with np.errstate(invalid="ignore"):
        value, gradient = likelihood.value_and_grad(theta)
    assert value == -np.inf
    assert np.isnan(gradient).all()


def test_jitter_of_the_novel_rows_counts_as_noise():
    X, tasks, y = draw(novel={4: 6}, n_tasks=5)
    new = tasks == 4
    X[new] = X[new][0]  # one input, observed again and again
    likelihood = building.extended(RBF(1.2), low_rank(5, 5), X, tasks, y, 1, [4])
    theta = np.r_[0.2, np.eye(5).ravel(), np.log(1e-20)]
    with warnings.catch_warnings():
        warnings.simplefilter("error", JitterWarning)
        with pytest.raises(JitterWarning, match="was added to its diagonal"):
            likelihood.posterior(theta)
    with pytest.warns(JitterWarning):
        posterior = likelihood.posterior(theta)
    assert (posterior.jitter > 0.0).tolist() == new.tolist()
    (_, variance), (_, noisy) = (posterior.leave_one_out(b) for b in (False, True))
    added = np.full(new.sum(), posterior.cholesky.jitter)
    np.testing.assert_allclose((noisy - variance)[new], added, rtol=1e-3)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_any_tasks_may_be_novel(seed):
    rng = np.random.default_rng(seed)
    n_tasks, n_inputs = rng.integers(2, 6), rng.integers(1, 8)
    chosen = rng.permutation(n_tasks)[: rng.integers(1, n_tasks)]
    novel = {m: rng.integers(1, 9) for m in chosen.tolist()}
    data, form = draw(seed, n_inputs, n_tasks, novel), low_rank(n_tasks, 2)
    likelihood, dense, theta = both(RBF(ARD), form, n_tasks, data, list(novel))
    found, expected = (
        np.r_[each.value_and_grad(theta)] for each in (likelihood, dense)
    )
    atol = 1e-8 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=atol)
    Z, tasks = rng.standard_normal((5, D)), rng.integers(0, n_tasks, 5)
    found, expected = (
        each.posterior(theta).covariance(Z, tasks) for each in (likelihood, dense)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)
