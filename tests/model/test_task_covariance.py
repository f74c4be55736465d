import hypothesis.strategies as st
import numpy as np
import pytest
import textbook
from hypothesis import given, settings

from skmtgp.model.task_covariance import (
    OfTasks,
    WithDiagonal,
    identity,
    leading_columns,
    low_rank,
    lower_trapezoid,
    ones,
)

SHAPES = [
    (M, r, diagonal) for M in (1, 2, 5) for r in range(1, M + 1) for diagonal in (0, 1)
]
every_form = pytest.mark.parametrize(
    "form", [low_rank(*shape) for shape in SHAPES], ids=[str(s) for s in SHAPES]
)


def draw(form, seed=0):
    return np.random.default_rng(seed).standard_normal(form.n_parameters)


def factor_and_kappa(form, parameters):
    F = parameters[: form.n_tasks * form.rank].reshape(form.n_tasks, form.rank)
    kappa = np.exp(parameters[form.n_tasks * form.rank :])
    return F, kappa if isinstance(form, WithDiagonal) else None


def derivatives(form, parameters):
    """dK^rho / d parameters, of shape (n_parameters, n_tasks, n_tasks)."""
    of_tasks = list(form.derivatives(parameters))
    assert all(isinstance(some, OfTasks) for some in of_tasks)
    positions = np.concatenate([[], *(some.positions for some in of_tasks)])
    np.testing.assert_array_equal(np.sort(positions), np.arange(form.n_parameters))
    found = np.zeros((form.n_parameters, form.n_tasks, form.n_tasks))
    for positions, half in of_tasks:
        for m, p in enumerate(positions):
            found[p, m] += half[m]
            found[p, :, m] += half[m]
    return found


def positive_semi_definite(M, seed=0):
    A = np.random.default_rng(seed).standard_normal((M, M + 2))
    return A @ A.T


@every_form
def test_matrix(form):
    parameters = draw(form)
    expected = textbook.low_rank(*factor_and_kappa(form, parameters))
    np.testing.assert_allclose(
        form.matrix(parameters), expected, rtol=1e-14, atol=1e-15
    )


@every_form
def test_matrix_is_positive_semi_definite_of_its_rank(form):
    K = form.matrix(draw(form))
    np.testing.assert_array_equal(K, K.T)
    values = np.linalg.eigvalsh(K)
    assert values[0] > -1e-14 * values[-1]
    rank = form.n_tasks if isinstance(form, WithDiagonal) else form.rank
    assert np.linalg.matrix_rank(K, hermitian=True) == rank


@every_form
def test_number_of_free_parameters_is_the_dimension_of_the_model(form):
    tangents = derivatives(form, draw(form)).reshape(form.n_parameters, -1)
    of_factor = tangents[: form.n_tasks * form.rank]
    r, M = form.rank, form.n_tasks
    assert np.linalg.matrix_rank(of_factor) == r * (2 * M + 1 - r) / 2  # eq. 8
    assert form.n_free == r * (2 * M + 1 - r) / 2 + M * isinstance(form, WithDiagonal)
    assert isinstance(form.n_free, int)


@every_form
@pytest.mark.parametrize("scale", [1e-3, 1.0, 50.0])
def test_bounds_are_in_units_of_the_targets(form, scale):
    n, bounds = form.n_tasks * form.rank, form.bounds(scale)
    assert bounds.shape == (form.n_parameters, 2)
    np.testing.assert_allclose(bounds[:n], [[-10.0 * scale, 10.0 * scale]] * n)
    kappa = [np.log([1e-16 * scale**2, 1e4 * scale**2])] * (form.n_parameters - n)
    np.testing.assert_allclose(bounds[n:], np.reshape(kappa, (-1, 2)))


@every_form
def test_derivatives(form):
    parameters = draw(form)
    expected = textbook.derivative(form.matrix, parameters)
    np.testing.assert_allclose(derivatives(form, parameters), expected, atol=1e-10)


@every_form
def test_pull_back(form):
    parameters, target = draw(form), positive_semi_definite(form.n_tasks)

    def loss(parameters):  # dL / dK = K - target
        return 0.5 * np.square(form.matrix(parameters) - target).sum()

    gradient = form.pull_back(parameters, form.matrix(parameters) - target)
    expected = textbook.derivative(loss, parameters)
    np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-9)


@every_form
def test_pull_back_contracts_the_derivatives(form):
    parameters, D = draw(form), positive_semi_definite(form.n_tasks)
    expected = np.einsum("pij,ij->p", derivatives(form, parameters), D)
    actual = form.pull_back(parameters, D)
    np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-12)


@every_form
def test_factor_is_a_lower_trapezoid(form):
    parameters = draw(form)
    L, (F, _) = form.factor(parameters), factor_and_kappa(form, parameters)
    assert L.shape == F.shape
    np.testing.assert_allclose(L @ L.T, F @ F.T, rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(np.triu(L, 1), 0.0)
    assert (np.diagonal(L) > 0.0).all()


@pytest.mark.parametrize("rank", [1, 2, 3, 4, 5])
def test_best_approximation_of_its_rank(rank):
    K, form = positive_semi_definite(5), low_rank(5, rank)
    approximation = form.matrix(form.parameters(K))
    error = np.linalg.norm(K - approximation, 2)
    next_singular_value = np.r_[np.linalg.svd(K, compute_uv=False), 0.0][rank]
    np.testing.assert_allclose(error, next_singular_value, rtol=1e-12, atol=1e-13)
    frobenius = np.sqrt(np.square(np.linalg.svd(K, compute_uv=False)[rank:]).sum())
    np.testing.assert_allclose(
        np.linalg.norm(K - approximation), frobenius, rtol=1e-12, atol=1e-13
    )


def test_approximation_of_a_matrix_that_rounding_has_made_indefinite():
    K = np.ones((4, 4))
    K[0, 0] -= 1e-15
    form = low_rank(4, 4)
    parameters = form.parameters(K)
    np.testing.assert_allclose(form.matrix(parameters), K, rtol=1e-14)


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_parameters_of_its_own_matrix(rank):
    form = low_rank(5, rank)
    K = form.matrix(draw(form))
    np.testing.assert_allclose(
        form.matrix(form.parameters(K)), K, rtol=1e-13, atol=1e-13
    )


@pytest.mark.parametrize("rank", [1, 2, 4])
def test_what_is_cut_from_the_diagonal_becomes_kappa(rank):
    K, form = positive_semi_definite(5), low_rank(5, rank, diagonal=True)
    parameters = form.parameters(K)
    np.testing.assert_allclose(np.diagonal(form.matrix(parameters)), np.diagonal(K))
    plain = low_rank(5, rank)
    np.testing.assert_array_equal(parameters[: 5 * rank], plain.parameters(K))


def test_kappa_starts_above_zero_where_nothing_is_cut():
    K, form = positive_semi_definite(3), low_rank(3, 3, diagonal=True)
    kappa = np.exp(form.parameters(K)[9:])
    np.testing.assert_allclose(kappa, 1e-6 * np.trace(K) / 3.0)
    assert np.isfinite(form.parameters(np.zeros((3, 3)))).all()


@pytest.mark.parametrize("diagonal", [False, True])
def test_grown(diagonal):
    lower, higher = low_rank(5, 2, diagonal), low_rank(5, 4, diagonal)
    parameters, columns = draw(lower), np.random.default_rng(1).standard_normal((5, 2))
    same = higher.matrix(lower.grown(parameters, np.zeros((5, 2))))
    np.testing.assert_array_equal(same, lower.matrix(parameters))
    grown = higher.matrix(lower.grown(parameters, columns))
    np.testing.assert_allclose(
        grown - same, columns @ columns.T, rtol=1e-12, atol=1e-13
    )


def incomplete_cholesky(K, rank):
    """The largest diagonal element that is left is the next pivot, by the book."""
    rest, F = K.copy(), np.zeros((len(K), rank))
    for r in range(rank):
        pivot = np.argmax(np.diagonal(rest))
        if rest[pivot, pivot] < 1e-12 * np.trace(K):
            break
        F[:, r] = rest[:, pivot] / np.sqrt(rest[pivot, pivot])
        rest -= np.outer(F[:, r], F[:, r])
    return F


class TestLeadingColumns:
    @pytest.mark.parametrize("M", [1, 2, 5, 80])
    def test_is_an_incomplete_cholesky_decomposition(self, M):
        K = positive_semi_definite(M)
        before = K.copy()
        for rank in (1, (M + 1) // 2, M):
            F, expected = leading_columns(K, rank), incomplete_cholesky(K, rank)
            assert F.shape == (M, rank)
            np.testing.assert_allclose(F, expected, rtol=1e-9, atol=1e-10)
        np.testing.assert_array_equal(K, before)
        np.testing.assert_allclose(F @ F.T, K, rtol=1e-12, atol=1e-12)  # full rank

    @pytest.mark.parametrize("rank", [2, 3, 5])
    def test_of_a_singular_matrix(self, rank):
        F = np.random.default_rng(0).standard_normal((5, 2))
        L = leading_columns(F @ F.T, rank)
        assert L.shape == (5, rank)
        np.testing.assert_allclose(L @ L.T, F @ F.T, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(L[:, 2:], 0.0)

    @pytest.mark.parametrize("M", [1, 4])
    def test_of_zeros_and_of_ones(self, M):
        np.testing.assert_array_equal(leading_columns(np.zeros((M, M)), M), 0.0)
        L = leading_columns(np.ones((M, M)), M)
        np.testing.assert_allclose(L @ L.T, np.ones((M, M)), rtol=1e-15)

    @pytest.mark.parametrize("seed", range(5))
    def test_what_is_left_shrinks(self, seed):
        K = positive_semi_definite(6, seed)
        columns = [leading_columns(K, rank) for rank in range(1, 7)]
        left = np.array([np.trace(K - F @ F.T) for F in columns])
        assert (np.diff(left) < 0.0).all()
        assert abs(left[-1]) < 1e-12 * np.trace(K)
        for F in columns:  # positive semi-definite
            assert np.linalg.eigvalsh(K - F @ F.T)[0] > -1e-12 * np.trace(K)

    @pytest.mark.parametrize("diagonal", [False, True])
    def test_of_a_form(self, diagonal):
        K, form = positive_semi_definite(5), low_rank(5, 2, diagonal)
        parameters = form.parameters(K, "cholesky")
        expected = incomplete_cholesky(K, 2)
        np.testing.assert_allclose(form.columns(parameters), expected, atol=1e-13)
        assert not np.allclose(form.matrix(parameters), form.matrix(form.parameters(K)))
        if diagonal:
            found = np.diagonal(form.matrix(parameters))
            np.testing.assert_allclose(found, np.diag(K), rtol=1e-5)


every_position = pytest.mark.parametrize("position", [0, 1, 3])


def assert_bordered(K, old, row, corner, position):
    """[[old, row], [row^T, corner]], the last task moved to its position."""
    others = np.delete(np.arange(len(K)), position)
    np.testing.assert_allclose(K[np.ix_(others, others)], old, rtol=1e-13)
    np.testing.assert_allclose(K[position, others], row, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(K[others, position], row, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(K[position, position], corner, rtol=1e-14)


class TestBordered:
    @every_position
    @pytest.mark.parametrize("rank", [1, 2, 3])
    @pytest.mark.parametrize("w", [None, 0.7])
    def test_low_rank(self, position, rank, w):
        form, row = low_rank(3, rank), np.array([0.5, -2.0, 3.0])[:rank]
        F, before = draw(form).reshape(3, rank), draw(form)
        bordered, parameters = form.bordered(F.ravel(), row, w, position)
        corner = row @ row + (w**2 if w else 0.0)
        K = bordered.matrix(parameters)
        assert_bordered(K, F @ F.T, F @ row, corner, position)
        assert (bordered.n_tasks, bordered.rank) == (4, rank + (w is not None))
        assert parameters.shape == (bordered.n_parameters,)
        assert bordered.n_free == low_rank(4, bordered.rank).n_free
        np.testing.assert_array_equal(F.ravel(), before)
        columns = np.delete(bordered.columns(parameters), position, axis=0)
        np.testing.assert_array_equal(columns[:, :rank], F)
        np.testing.assert_array_equal(columns[:, rank:], 0.0)

    @every_position
    @pytest.mark.parametrize("rank", [1, 2, 3])
    def test_with_a_diagonal(self, position, rank):
        form, row, w = low_rank(3, rank, True), np.array([0.5, -2.0, 3.0])[:rank], 0.7
        old = draw(form)
        F, kappa = factor_and_kappa(form, old)
        bordered, parameters = form.bordered(old, row, w, position)
        K = bordered.matrix(parameters)
        assert_bordered(K, form.matrix(old), F @ row, row @ row + w**2, position)
        assert (bordered.n_tasks, bordered.rank) == (4, rank)
        assert parameters.shape == (bordered.n_parameters,)
        assert bordered.n_free == low_rank(4, rank, True).n_free
        found = np.exp(parameters[4 * rank :])
        np.testing.assert_allclose(found, np.insert(kappa, position, w**2), rtol=1e-14)

    def test_one_after_another(self):
        form, row = low_rank(2, 2), np.array([0.5, -2.0])
        once = form.bordered(draw(form), row, 0.3, 2)
        both, parameters = once[0].bordered(once[1], np.append(row, 0.1), 0.4, 0)
        K = both.matrix(parameters)
        old = once[0].matrix(once[1])
        np.testing.assert_allclose(K[1:, 1:], old, rtol=1e-13)
        np.testing.assert_allclose(K[0, 0], row @ row + 0.1**2 + 0.4**2)
        assert K[0, 3] == pytest.approx(row @ row + 0.1 * 0.3)
        assert (both.n_tasks, both.rank) == (4, 4)


@pytest.mark.parametrize("M", [1, 2, 5])
@pytest.mark.parametrize(
    ("make", "expected", "rank"),
    [(identity, np.eye, lambda M: M), (ones, lambda M: np.ones((M, M)), lambda M: 1)],
)
def test_fixed(M, make, expected, rank):
    form, nothing = make(M), np.empty(0)
    np.testing.assert_array_equal(form.matrix(nothing), expected(M))
    assert form.n_tasks == M
    assert form.n_parameters == form.n_free == len(form.bounds(1.0)) == 0
    assert form.pull_back(nothing, np.ones((M, M))).shape == (0,)
    assert derivatives(form, nothing).shape == (0, M, M)
    L = form.factor(nothing)
    assert L.shape == (M, rank(M))
    np.testing.assert_allclose(L @ L.T, expected(M), rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(np.triu(L, 1), 0.0)


@pytest.mark.parametrize("make", [identity, ones])
def test_fixed_with_a_diagonal(make):
    form, plain = make(3, diagonal=True), make(3)
    kappa, D = np.array([0.1, 2.0, 30.0]), positive_semi_definite(3)
    parameters = np.log(kappa)
    K = plain.matrix(np.empty(0)) + np.diag(kappa)
    np.testing.assert_allclose(form.matrix(parameters), K, rtol=1e-14)
    np.testing.assert_allclose(form.parameters(K), parameters, rtol=1e-12)
    np.testing.assert_allclose(form.pull_back(parameters, D), np.diagonal(D) * kappa)
    expected = textbook.derivative(form.matrix, parameters)
    np.testing.assert_allclose(derivatives(form, parameters), expected, atol=1e-8)
    assert form.n_parameters == form.n_free == len(form.bounds(1.0)) == 3
    L = form.factor(parameters)
    np.testing.assert_allclose(L @ L.T, plain.matrix(np.empty(0)), atol=1e-14)


shapes = st.integers(1, 7).flatmap(lambda M: st.tuples(st.just(M), st.integers(1, M)))
seeds = st.integers(0, 2**32 - 1)
scales = st.sampled_from([1e-8, 1.0, 1e8])


@given(shapes, seeds, scales)
@settings(max_examples=60, deadline=None)
def test_lower_trapezoid(shape, seed, scale):
    F = scale * np.random.default_rng(seed).standard_normal(shape)
    L = lower_trapezoid(F)
    atol = 1e-13 * np.square(F).sum()
    np.testing.assert_allclose(L @ L.T, F @ F.T, rtol=0.0, atol=atol)
    np.testing.assert_array_equal(np.triu(L, 1), 0.0)
    assert (np.diagonal(L) >= 0.0).all()
    np.testing.assert_allclose(
        np.abs(lower_trapezoid(L)), np.abs(L), atol=1e-12 * scale
    )


def test_lower_trapezoid_of_dependent_rows():
    F = np.array([[0.0, 0.0], [1.0, 2.0], [-1.0, -2.0], [3.0, 1.0]])
    L = lower_trapezoid(F)
    np.testing.assert_allclose(L @ L.T, F @ F.T, rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(np.triu(L, 1), 0.0)
    assert (np.diagonal(L) >= 0.0).all()


@given(shapes, seeds, st.booleans(), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_relabelled_tasks(shape, seed, diagonal, random):
    form, M = low_rank(*shape, diagonal), shape[0]
    parameters, order = draw(form, seed), random.sample(range(M), M)
    F, kappa = factor_and_kappa(form, parameters)
    relabelled = F[order].ravel()
    if diagonal:
        relabelled = np.r_[relabelled, np.log(kappa[order])]
    K, between = form.matrix(parameters), np.ix_(order, order)
    atol = 1e-13 * np.trace(K)
    np.testing.assert_allclose(form.matrix(relabelled), K[between], atol=atol)
    truncated = form.matrix(form.parameters(K))
    again = form.matrix(form.parameters(K[between]))
    np.testing.assert_allclose(again, truncated[between], atol=1e3 * atol)


EQUAL = {
    "independent": low_rank(4, 0, "equal"),
    "compound symmetry": low_rank(4, 0, "equal", shared=True),
    "rank 2 and equal diagonal": low_rank(4, 2, "equal"),
    "shared and rank 1 and equal diagonal": low_rank(4, 1, "equal", shared=True),
}


@pytest.mark.parametrize(("name", "form"), EQUAL.items(), ids=EQUAL)
class TestEqualDiagonal:
    def test_matrix_is_that_of_the_other_form_and_one_variance(self, name, form):
        parameters = draw(form)
        other = form.form.matrix(parameters[:-1])
        expected = other + np.exp(parameters[-1]) * np.eye(4)
        np.testing.assert_allclose(form.matrix(parameters), expected, rtol=1e-14)
        assert str(form) == name
        assert form.n_free == form.form.n_free + 1
        assert len(form.bounds(2.0)) == form.n_parameters
        np.testing.assert_allclose(form.bounds(2.0)[-1], np.log([4e-16, 4e4]))

    def test_gradients(self, name, form):
        parameters, target = draw(form), positive_semi_definite(4)

        def loss(parameters):
            return 0.5 * np.square(form.matrix(parameters) - target).sum()

        D = form.matrix(parameters) - target
        expected = textbook.derivative(loss, parameters)
        found = form.pull_back(parameters, D)
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)
        last = list(form.derivatives(parameters))[-1]
        np.testing.assert_allclose(last, np.exp(parameters[-1]) * np.eye(4))

    def test_latent_functions(self, name, form):
        parameters = draw(form)
        F, kappa = form.latent(parameters)
        K = F @ F.T + np.diag(kappa)
        np.testing.assert_allclose(K, form.matrix(parameters), rtol=1e-13)

        def loss(parameters):
            F, kappa = form.latent(parameters)
            return 0.5 * np.square(F).sum() + 0.5 * np.square(kappa).sum()

        expected = textbook.derivative(loss, parameters)
        found = form.pull_back_latent(parameters, F, kappa)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)

    def test_parameters_of_its_own_matrix(self, name, form):
        if form.shared and form.rank:
            pytest.skip("the columns may take of what is shared")
        K = form.matrix(draw(form))
        if form.rank:  # what the columns leave is spread over the diagonal
            K = form.matrix(form.parameters(K))
            np.testing.assert_allclose(np.diagonal(K).mean(), np.trace(K) / 4)
        else:
            np.testing.assert_allclose(form.matrix(form.parameters(K)), K, rtol=1e-12)

    def test_a_task_that_joins_has_the_same_variance(self, name, form):
        parameters, row = draw(form), np.full(form.rank, 0.3)
        other, found = form.bordered(parameters, row, None, 1)
        K, before = other.matrix(found), form.matrix(parameters)
        others = [0, 2, 3, 4]
        np.testing.assert_allclose(K[np.ix_(others, others)], before, rtol=1e-13)
        a = np.exp(parameters[-2]) if form.shared else 0.0
        corner = row @ row + a + np.exp(parameters[-1])
        assert K[1, 1] == pytest.approx(corner)
        assert str(other) == name

    def test_it_is_held_up_with_the_noise_unless_it_is_all_there_is(self, name, form):
        assert form.n_kappa == (0 if name == "independent" else 1)


def test_a_task_without_data_has_the_shared_function_and_the_equal_variance():
    form = EQUAL["compound symmetry"]
    loadings, own = form.unseen(np.log([4.0, 0.5]))
    np.testing.assert_allclose(loadings, [[2.0]])
    assert own == pytest.approx(0.5)
    loadings, own = EQUAL["independent"].unseen(np.log([0.5]))
    assert loadings.shape == (1, 0)
    assert own == pytest.approx(0.5)


@pytest.mark.parametrize("diagonal", [False, True, "equal"])
def test_a_task_without_data_has_the_mean_of_the_loadings(diagonal):
    form = low_rank(3, 2, diagonal, shared=True)
    F, kappa = np.arange(6.0).reshape(3, 2), np.array([0.5, 2.0, 3.5])[: form.n_own]
    parameters = np.concatenate([F.ravel(), np.log([4.0]), np.log(kappa)])
    loadings, own = form.unseen(parameters)
    np.testing.assert_allclose(loadings, [[2.0, 2.0, 3.0]])
    assert own == pytest.approx(kappa.mean() if diagonal else 0.0)


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("diagonal", [False, True, "equal"])
def test_another_rank(diagonal, shared):
    form = low_rank(4, 1, diagonal, shared).with_rank(2)
    same = low_rank(4, 2, diagonal, shared)
    assert (str(form), form.n_free, form.rank) == (str(same), same.n_free, 2)
    assert form.n_parameters == same.n_parameters
