"""K^rho that is made of the tasks' descriptors."""

import numpy as np
import pytest
import textbook

from skmtgp.model.described import Described, describes, task_covariance
from skmtgp.model.task_covariance import WithDiagonal, WithShared, low_rank

M, ROWS = 6, 4
Q = np.random.default_rng(0).standard_normal((M, ROWS))
NEW = np.random.default_rng(1).standard_normal((2, ROWS))
OPTIONS = {
    "plain": {},
    "shared": {"shared": True},
    "diagonal": {"diagonal": True},
    "all": {"shared": True, "diagonal": "equal"},
}
every_rank = pytest.mark.parametrize("rank", range(ROWS + 1))
every_form = pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)


def draw(form, seed=2):
    return np.random.default_rng(seed).standard_normal(form.n_parameters)


def by_the_book(parameters, rank, Q, shared=False, diagonal=False):
    """D B B^T D^T + a 1 1^T + diag(kappa), entry by entry."""
    B, rest = np.split(parameters, [ROWS * rank])
    K = textbook.low_rank(Q @ B.reshape(ROWS, rank))
    if shared:
        K += np.exp(rest[0])
    if diagonal:
        K += np.diag(np.broadcast_to(np.exp(rest[shared:]), len(Q)))
    return K


@every_rank
@every_form
def test_matrix_and_latent_functions(rank, options):
    form = task_covariance(M, rank, Q, **options)
    parameters = draw(form)
    expected = by_the_book(parameters, rank, Q, **options)
    np.testing.assert_allclose(form.matrix(parameters), expected, rtol=1e-12)
    F, kappa = form.latent(parameters)
    np.testing.assert_allclose(F @ F.T + np.diag(kappa), expected, rtol=1e-12)


@every_rank
@every_form
def test_gradients(rank, options):
    form = task_covariance(M, rank, Q, **options)
    parameters = draw(form)
    expected = textbook.derivative(form.matrix, parameters).reshape(-1, M, M)
    D = np.random.default_rng(3).standard_normal((M, M))
    D += D.T
    found = form.pull_back(parameters, D)
    np.testing.assert_allclose(found, np.sum(expected * D, axis=(1, 2)), atol=1e-8)
    shape = form.latent(parameters)[0].shape
    weights = np.random.default_rng(4).standard_normal(shape), np.arange(M) + 1.0

    def of_latent(parameters):
        return sum(map(np.vdot, weights, form.latent(parameters)))

    found = form.pull_back_latent(parameters, *weights)
    expected = textbook.derivative(of_latent, parameters)
    np.testing.assert_allclose(found, expected, atol=1e-8)


@every_rank
def test_derivatives_are_those_of_the_matrix(rank):
    form = Described(Q, rank)
    parameters = draw(form)
    found = np.array(list(form.derivatives(parameters))).reshape(-1, M, M)
    expected = textbook.derivative(form.matrix, parameters).reshape(-1, M, M)
    np.testing.assert_allclose(found, expected, atol=1e-8)
    # rotations apart, all of them matter
    assert np.linalg.matrix_rank(found.reshape(-1, M * M)) == form.n_free
    assert form.n_free == ROWS * rank - rank * (rank - 1) // 2


@every_rank
def test_a_matrix_of_its_own_is_found_again(rank):
    form = Described(Q, rank)
    K = form.matrix(draw(form))
    for truncation in ("eigen", "cholesky"):
        again = form.parameters(K, truncation)
        np.testing.assert_allclose(form.matrix(again), K, atol=1e-10)
    L = form.factor(draw(form))
    np.testing.assert_allclose(L @ L.T, K, atol=1e-10)
    np.testing.assert_array_equal(np.triu(L, 1), 0.0)


def test_a_factor_may_have_more_columns_than_there_are_tasks():
    form = Described(Q[:2], ROWS)
    L = form.factor(draw(form))
    np.testing.assert_allclose(L @ L.T, form.matrix(draw(form)), atol=1e-12)


@every_form
def test_tasks_without_data_are_as_their_descriptors_say(options):
    form = task_covariance(M, 2, Q, **options)
    parameters = draw(form)
    larger = np.vstack([Q, NEW])
    loadings, own = form.unseen(parameters, NEW)
    known = form.latent(parameters)[0][:, : loadings.shape[1]]
    without = {name: of for name, of in options.items() if name != "diagonal"}
    expected = by_the_book(parameters, 2, larger, **without)
    np.testing.assert_allclose(known @ loadings.T, expected[:M, M:], atol=1e-12)
    np.testing.assert_allclose(loadings @ loadings.T, expected[M:, M:], atol=1e-12)
    kappa = np.exp(parameters[2 * ROWS + ("shared" in options) :])
    assert own == pytest.approx(kappa.mean() if "diagonal" in options else 0.0)


@every_form
def test_a_task_that_joins(options):
    form = task_covariance(M, 2, Q, **options)
    parameters = draw(form)
    larger, more = form.bordered(parameters, NEW[0], 0.7, 2)
    others = np.delete(np.arange(M + 1), 2)
    K = larger.matrix(more)
    expected = form.matrix(parameters)
    np.testing.assert_allclose(K[np.ix_(others, others)], expected, rtol=1e-12)
    loadings, _ = form.unseen(parameters, NEW[:1])
    known = form.latent(parameters)[0][:, : loadings.shape[1]]
    np.testing.assert_allclose(K[2, others], loadings[0] @ known.T, rtol=1e-12)


def test_columns_are_added_where_they_gain_most():
    form = Described(Q, 1)
    D = np.random.default_rng(5).standard_normal((M, M))
    D += D.T
    parameters = draw(form)
    columns = form.directions(D)[:, -1:]
    grown = form.with_rank(2).matrix(form.grown(parameters, columns))
    expected = form.matrix(parameters) + columns @ columns.T
    np.testing.assert_allclose(grown, expected, atol=1e-12)


def test_without_descriptors_it_is_the_plain_form():
    assert str(task_covariance(M, 2)) == str(low_rank(M, 2))
    form = task_covariance(M, 2, Q, shared=True, diagonal=True)
    assert describes(form)
    assert not describes(WithDiagonal(WithShared(low_rank(M, 2))))
    assert str(form) == "shared and descriptors of rank 2 and diagonal"
