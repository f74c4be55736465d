"""Missing cells of otherwise complete data: the same as dense, of the same rows."""

import pickle
import tracemalloc
from itertools import pairwise

import building
import hypothesis.strategies as st
import numpy as np
import pytest
import textbook
from hypothesis import given, settings
from pairs import in_pairs
from sklearn.gaussian_process.kernels import RBF
from test_kronecker import (
    ARD,
    CLOSE,
    FORMS,
    KERNELS,
    M,
    N,
    draw,
    new_rows,
)

from skmtgp._data.data import Data
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference import gaps
from skmtgp.inference.eigen import KroneckerEigen
from skmtgp.inference.gaps import GappyEigen
from skmtgp.model.task_covariance import low_rank

FIRST, LAST = 0, N - 1  # inputs
GAPS = {
    "one": [(3, 1)],
    "first and last input": [(FIRST, 0), (LAST, 0), (FIRST, M - 1), (LAST, 2)],
    "one cell left of an input": [(4, m) for m in range(M - 1)],
    "a task with two cells": [(i, 2) for i in range(2, N)],
    "a third": [(i, (i + j) % M) for i in range(0, N, 2) for j in range(M - 1)],
}
every_model = in_pairs(
    kernel=KERNELS,
    form=FORMS,
    n_noise={"shared": 1, "per task": M},
    levels={"levels": True, "no levels": False},
    where=GAPS,
)
some_models = in_pairs(
    form=FORMS,
    n_noise={"shared": 1, "per task": M},
    levels={"levels": True, "no levels": False},
)


def without(data, cells):
    """The rows but those of some cells, each an input and a task."""
    X, tasks, _ = data
    inputs = np.unique(X, axis=0)
    gone = [
        np.flatnonzero((inputs[i] == X).all(axis=1) & (tasks == m)) for i, m in cells
    ]
    return tuple(np.delete(part, np.concatenate(gone), axis=0) for part in data)


def both(kernel, form, n_noise, levels, data):
    """The likelihood by Kronecker algebra, the dense one and parameters."""
    model = kernel, form, *data, n_noise
    found = building.kronecker(*model, levels=levels)
    rng = np.random.default_rng(0)
    theta = 0.5 * rng.standard_normal(found.prior.n_theta)
    theta[: found.prior.kernel.n_dims] += kernel.theta
    theta[-n_noise:] = np.log(0.05 + rng.random(n_noise))
    return found, building.dense(*model, levels=levels), theta


@every_model
class TestAgainstDense:
    def test_value_and_gradient(self, kernel, form, n_noise, levels, where):
        data = without(draw(), where)
        likelihood, dense, theta = both(kernel, form, n_noise, levels, data)
        value, gradient = likelihood.value_and_grad(theta)
        expected = dense.value_and_grad(theta)
        np.testing.assert_allclose(value, expected[0], rtol=1e-11)
        np.testing.assert_allclose(gradient, expected[1], rtol=1e-9, atol=1e-10)
        assert likelihood.value(theta) == value
        D = likelihood.task_gradient(theta)
        np.testing.assert_array_equal(D, D.T)
        np.testing.assert_allclose(D, dense.task_gradient(theta), **CLOSE)
        assert isinstance(likelihood.eigen(theta), GappyEigen)

    def test_posterior(self, kernel, form, n_noise, levels, where):
        data = without(draw(), where)
        likelihood, dense, theta = both(kernel, form, n_noise, levels, data)
        posterior, expected = (of.posterior(theta) for of in (likelihood, dense))
        for rows in (new_rows(), data[:2]):
            for method in ("mean", "variance", "covariance", "mean_of_tasks"):
                found, of_dense = (
                    getattr(of, method)(*rows) for of in (posterior, expected)
                )
                np.testing.assert_allclose(found, of_dense, **CLOSE)
        value = likelihood.value(theta)
        np.testing.assert_allclose(posterior.log_likelihood, value, rtol=1e-14)
        for name in ("alpha", "levels"):
            found, of_dense = (getattr(of, name) for of in (posterior, expected))
            np.testing.assert_allclose(found, of_dense, **CLOSE)
        for method in ("precision", "level_variances"):
            found, of_dense = (getattr(of, method)() for of in (posterior, expected))
            np.testing.assert_allclose(found, of_dense, **CLOSE)
        for noisy in (False, True):
            found, of_dense = (of.leave_one_out(noisy) for of in (posterior, expected))
            np.testing.assert_allclose(found, of_dense, **CLOSE)

    def test_latent_functions(self, kernel, form, n_noise, levels, where):
        F, (Z, _) = np.random.default_rng(1).standard_normal((M, 2)), new_rows()
        data = without(draw(), where)
        *likelihoods, theta = both(kernel, form, n_noise, levels, data)
        (means, halves), expected = (
            of.posterior(theta).latent(Z, F) for of in likelihoods
        )
        np.testing.assert_allclose(means, expected[0], **CLOSE)
        explained, of_dense = (
            np.einsum("ait,biu->abtu", half, half) for half in (halves, expected[1])
        )
        np.testing.assert_allclose(explained, of_dense, **CLOSE)


@some_models
def test_textbook(form, n_noise, levels):
    """Gradients by differences of what the definitions give."""
    data = without(draw(), GAPS["a third"])
    likelihood, _, theta = both(RBF(ARD), form, n_noise, levels, data)

    def expected(theta):
        prior, values = likelihood.prior, likelihood.prior.values(theta)
        f = prior.kernel_at(theta), prior.K_rho_at(theta)
        K = textbook.covariance(*f, values.noise, *data[:2], values.level)
        return textbook.log_marginal_likelihood(K, data[2])

    value, gradient = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, expected(theta), rtol=1e-11)
    by_differences = textbook.derivative(expected, theta)
    np.testing.assert_allclose(gradient, by_differences, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("levels", [True, False])
def test_by_batches_of_inputs(levels, monkeypatch):
    monkeypatch.setattr(gaps, "MOST", 1)
    data = without(draw(), GAPS["a third"])
    likelihood, dense, theta = both(RBF(ARD), low_rank(M, 2), M, levels, data)
    found, expected = (of.value_and_grad(theta)[1] for of in (likelihood, dense))
    np.testing.assert_allclose(found, expected, **CLOSE)


def test_levels_much_larger_than_the_rest():
    """Their variances keep their digits, as those of complete data do."""
    X, tasks, y = without(draw(), GAPS["a third"])
    data = X, tasks, y + 1e6 * tasks
    likelihood, dense, theta = both(RBF(ARD), low_rank(M, 2), 1, True, data)
    theta[-2] = np.log(1e12)
    assert likelihood.prior.values(theta).level == pytest.approx(1e12)
    posterior, expected = (of.posterior(theta) for of in (likelihood, dense))
    theta[-2] = np.log(1e4)  # of which dense has more digits
    near = dense.posterior(theta)
    found = posterior.variance(*new_rows())
    np.testing.assert_allclose(found, near.variance(*new_rows()), rtol=1e-3)
    mean, of_dense = (of.mean(*new_rows()) for of in (posterior, expected))
    np.testing.assert_allclose(mean, of_dense, atol=1e-3)


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
def test_accuracy_of_small_noise(noise):
    """As of complete data, in test_kronecker: |K| / noise of the digits are lost."""
    rng, tasks = np.random.default_rng(0), np.repeat([0, 1], 12)
    inputs = np.sort(rng.uniform(0.0, 4.0, (12, 1)), axis=0)
    X, F = np.tile(inputs, (2, 1)), np.array([[1.0], [0.7]])
    y = np.ravel(F[tasks, 0] * np.sin(2.0 * X[:, 0]))
    X, tasks, y = (np.delete(of, [0, 5, 15], axis=0) for of in (X, tasks, y))
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


def test_tasks_without_data():
    X, tasks, y = without(draw(n_tasks=2), [(0, 0), (5, 1), (6, 1)])
    data = X, np.array([1, 3])[tasks], y
    for levels in (True, False):
        likelihood, dense, theta = both(RBF(ARD), low_rank(M, 2), M, levels, data)
        found, expected = (
            np.r_[of.value_and_grad(theta)] for of in (likelihood, dense)
        )
        np.testing.assert_allclose(found, expected, **CLOSE)
        for method in ("mean", "variance", "covariance"):
            found, expected = (
                getattr(of.posterior(theta), method)(*new_rows())
                for of in (likelihood, dense)
            )
            np.testing.assert_allclose(found, expected, **CLOSE)


def test_tasks_that_join():
    """Rows of novel tasks are eliminated from what the rows there are explain."""
    X, tasks, y = draw()
    old = without(
        (X[tasks < 3], tasks[tasks < 3], y[tasks < 3]), GAPS["one"] + [(0, 2)]
    )
    new = X[tasks == 3][:4] + np.c_[[0.0, 0.0, 0.0, 0.3]], tasks[tasks == 3][:4], y[:4]
    data = [np.concatenate(of) for of in zip(old, new, strict=True)]
    for levels in (True, False):
        _, dense, theta = both(RBF(ARD), low_rank(M, 2), M, levels, draw())
        model = RBF(ARD), low_rank(M, 2), *data, M
        dense = building.dense(*model, levels=levels)
        found = building.extended(*model, [3], levels=levels)
        assert found.n_missing == 2
        for of, expected in zip(
            found.value_and_grad(theta), dense.value_and_grad(theta), strict=True
        ):
            np.testing.assert_allclose(of, expected, **CLOSE)
        posteriors = found.posterior(theta), dense.posterior(theta)
        for method in ("mean", "variance", "covariance"):
            of, expected = (getattr(p, method)(*new_rows()) for p in posteriors)
            np.testing.assert_allclose(of, expected, **CLOSE)
        for method in ("precision", "level_variances", "leave_one_out"):
            of, expected = (np.array(getattr(p, method)()) for p in posteriors)
            np.testing.assert_allclose(of, expected, **CLOSE)


def test_complete_data_have_no_gaps():
    likelihood, _, theta = both(RBF(ARD), low_rank(M, 2), 1, True, draw())
    assert type(likelihood.eigen(theta)) is KroneckerEigen
    assert likelihood.n_missing == 0


def test_no_matrix_of_all_samples():
    n_tasks, n_inputs = 30, 40
    data = draw(n_inputs=n_inputs, n_tasks=n_tasks)
    data = without(data, [(i, i % n_tasks) for i in range(12)])
    likelihood, _, theta = both(RBF(ARD), low_rank(n_tasks, 3), 1, True, data)
    tracemalloc.start()
    likelihood.value_and_grad(theta)
    posterior = likelihood.posterior(theta)
    posterior.covariance(*new_rows()), posterior.leave_one_out()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.5 * 8 * (n_tasks * n_inputs) ** 2


def test_fisher_information_is_that_of_the_dense_likelihood():
    data = without(draw(), GAPS["a third"])
    likelihood, dense, theta = both(RBF(ARD), low_rank(M, 2), M, True, data)
    found, expected = (of.fisher_information(theta) for of in (likelihood, dense))
    np.testing.assert_array_equal(found, expected)


def test_pickle():
    data = without(draw(), GAPS["a third"])
    likelihood, _, theta = both(RBF(ARD), low_rank(M, 2), M, True, data)
    likelihood.value_and_grad(theta)
    posterior, rows = likelihood.posterior(theta), new_rows()
    again = pickle.loads(pickle.dumps(posterior))
    np.testing.assert_array_equal(again.variance(*rows), posterior.variance(*rows))
    again = pickle.loads(pickle.dumps(likelihood))
    assert again.value(theta) == likelihood.value(theta)


@pytest.mark.parametrize(
    ("k", "bad"), [(0, np.nan), (-2, np.inf), (-1, np.nan), (-1, np.inf), (-1, -800.0)]
)
def test_failures(k, bad):
    data = without(draw(), GAPS["one"])
    likelihood, _, theta = both(RBF(ARD), low_rank(M, 2), 1, False, data)
    theta[k] = bad
    with np.errstate(invalid="ignore", over="ignore"):
        value, gradient = likelihood.value_and_grad(theta)
        assert value == likelihood.value(theta) == -np.inf
        assert np.isnan(gradient).all()
        with pytest.raises(NotPositiveDefiniteError):
            likelihood.posterior(theta)


class TestThinned:
    """Parts of such data are such data, and have rows of every task."""

    @pytest.fixture
    def data(self):
        data = without(draw(), GAPS["a task with two cells"])
        return building.data(*data, M, complete=True)

    @pytest.mark.parametrize("size", range(1, N + 1))
    def test_rows(self, data, size):
        part = data.thinned(size)
        assert set(part.tasks) == set(range(M))
        assert size <= part.n_inputs <= size + 1  # for the task with two cells
        inputs, tasks = np.nonzero(part.design >= 0)
        rows = part.design[inputs, tasks]
        assert sorted(rows) == list(range(len(part)))
        np.testing.assert_array_equal(part.tasks[rows], tasks)
        for i, of_input in enumerate(part.design):
            assert len(np.unique(part.X[of_input[of_input >= 0]], axis=0)) == 1, i
        found = {(*x, m, t) for x, m, t in zip(part.X, part.tasks, part.y, strict=True)}
        assert found <= {
            (*x, m, t) for x, m, t in zip(data.X, data.tasks, data.y, strict=True)
        }

    def test_less_is_part_of_more(self, data):
        parts = [set(data.thinned(size).y) for size in range(1, N + 1)]
        assert all(a <= b for a, b in pairwise(parts))
        assert parts[-1] == set(data.y)

    def test_complete_data_as_ever(self):
        X, tasks, y = draw()
        data = building.data(X, tasks, y, M, complete=True)
        assert isinstance(data, Data)
        assert data.thinned(4).n_inputs == 4
        assert len(data.thinned(4)) == 4 * M


@given(
    st.sampled_from(sorted(KERNELS)),
    st.integers(0, 2**32 - 1),
    st.booleans(),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_hidden_cells_are_rows_that_are_not_there(name, seed, levels, per_task):
    """Whatever is hidden, short of half, and in whatever order the rows come."""
    rng = np.random.default_rng(seed)
    n_inputs, n_tasks = rng.integers(2, 12), rng.integers(2, 6)
    X, tasks, y = draw(seed, n_inputs, n_tasks)
    most = (len(y) - 1) // 2
    kept = np.sort(rng.permutation(len(y))[rng.integers(0, most + 1) :])
    order = kept[np.lexsort([rng.random(len(kept)), tasks[kept]])]
    if len(set(tasks[kept])) < n_tasks or len(np.unique(X[kept], axis=0)) < n_inputs:
        kept = order = np.arange(len(y))
    rank, n_noise = min(2, n_tasks), n_tasks if per_task else 1
    form = low_rank(n_tasks, rank, diagonal=bool(seed % 2) and n_tasks > 2)
    found, dense, theta = (
        both(KERNELS[name], form, n_noise, levels, (X[rows], tasks[rows], y[rows]))[k]
        for rows, k in [(order, 0), (kept, 1), (kept, 2)]
    )
    for of, expected in zip(
        found.value_and_grad(theta), dense.value_and_grad(theta), strict=True
    ):
        atol = 1e-8 * np.abs(expected).max()
        np.testing.assert_allclose(of, expected, rtol=1e-8, atol=atol)


def test_levels_without_noise():
    """What is filled in is refined: at first it is off by digits that levels lose."""
    rng = np.random.default_rng(0)
    x, tasks = np.sort(rng.uniform(0.0, 6.0, 30)), np.repeat(np.arange(4), 30)
    F = rng.normal(size=(4, 2))
    Y = np.column_stack([np.sin(x), np.cos(2.0 * x)]) @ F.T
    X, y = np.tile(x, 4)[:, None], Y.T.ravel()
    kept = np.delete(np.arange(120), [3, 33, 63, 7, 50, 110])
    data = X[kept], tasks[kept], y[kept]
    model = building.kronecker(RBF(1.0), low_rank(4, 2), *data, levels=True)
    theta = np.r_[0.0, F.ravel(), 0.0, np.log(1e-14)]
    mean = model.posterior(theta).mean(X, tasks)
    np.testing.assert_allclose(mean, y, atol=0.05)
    eigen = model.eigen(theta)
    rotated = model.rotated(eigen)
    atol = 1e-6 * np.abs(rotated).max()
    np.testing.assert_allclose(eigen.completed(rotated), rotated, atol=atol)
