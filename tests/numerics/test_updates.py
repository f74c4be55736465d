"""Cholesky factors that get more rows, or fewer."""

import numpy as np
import pytest

from skmtgp._numerics.linalg import Cholesky
from skmtgp._numerics.updates import UpdatedCholesky
from skmtgp.exceptions import NotPositiveDefiniteError

N = 40


def matrix(seed=0, least=1e-2):
    A = np.random.default_rng(seed).standard_normal((N, N))
    return A @ A.T / N + least * np.eye(N)


def factor(K):
    return UpdatedCholesky.of(Cholesky(np.asfortranarray(K)))


def check(cholesky, K, atol=1e-10):
    """Whether it is the factor of K, in any order of the rows."""
    inverse, b = np.linalg.inv(K), np.linspace(-1.0, 1.0, len(K))
    close = {"rtol": 0.0, "atol": atol * np.abs(inverse).max()}
    np.testing.assert_allclose(cholesky.solve(b), inverse @ b, **close)
    B = np.column_stack([b, b**2])
    half = cholesky.half_solve(B)
    np.testing.assert_allclose(half.T @ half, B.T @ inverse @ B, **close)
    back = cholesky.half_solve(half, transposed=True)
    np.testing.assert_allclose(back, inverse @ B, **close)
    diagonal = np.diagonal(inverse)
    np.testing.assert_allclose(cholesky.inverse_diagonal(), diagonal, **close)
    np.testing.assert_allclose(cholesky.kept_diagonal(), diagonal, **close)
    assert cholesky.log_det() == pytest.approx(np.linalg.slogdet(K)[1], abs=1e-9)


@pytest.fixture(params=[False, True], ids=["diagonal unknown", "diagonal kept"])
def keeps(request):
    return request.param


@pytest.mark.parametrize("places", [[0], [7], [N - 1], [0, 3, 4, N - 2]], ids=str)
def test_rows_that_come(places, keeps):
    K, others = matrix(), np.delete(np.arange(N), places)
    cholesky = factor(K[np.ix_(others, others)])
    if keeps:
        cholesky.kept_diagonal()
    cross, corner = K[np.ix_(others, places)], K[np.ix_(places, places)]
    found = cholesky.bordered(np.array(places), cross, corner)
    assert (found.diagonal is not None) == keeps
    check(found, K)


@pytest.mark.parametrize("rows", [[0], [7], [N - 1], [9, 0, 30, N - 1]], ids=str)
def test_rows_that_go(rows, keeps):
    K, left = matrix(), np.delete(np.arange(N), rows)
    cholesky = factor(K)
    if keeps:
        cholesky.kept_diagonal()
    found = cholesky.without(np.array(rows))
    assert (found.diagonal is not None) == keeps
    check(found, K[np.ix_(left, left)])
    assert found.n_dropped == len(rows)
    check(cholesky, K)  # it stays as it is


def test_many_that_come_and_go():
    """The rows of a window that moves, in no order."""
    K, rng = matrix(), np.random.default_rng(1)
    rows = list(range(20))
    cholesky = factor(K[:20, :20])
    cholesky.kept_diagonal()
    for _ in range(50):
        new = int(rng.choice(np.setdiff1d(np.arange(N), rows)))
        place, gone = rng.integers(0, 21, 2)
        cross, corner = K[rows, new][:, None], K[[[new]], [[new]]]
        cholesky = cholesky.bordered(np.array([place]), cross, corner)
        rows.insert(place, new)
        cholesky = cholesky.without(np.array([gone]))
        rows.pop(gone)
    assert cholesky.n_dropped == 50
    check(cholesky, K[np.ix_(rows, rows)])


def test_columns_of_the_inverse():
    K, rows = matrix(), np.array([3, 17])
    V = factor(K).columns_of_inverse(rows)
    left = np.delete(np.arange(N), rows)
    found = (np.linalg.inv(K) - V @ V.T)[np.ix_(left, left)]
    expected = np.linalg.inv(K[np.ix_(left, left)])
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_border_that_is_not_positive_definite():
    K = matrix()
    with pytest.raises(NotPositiveDefiniteError):
        factor(K).bordered(np.array([N]), K[:, :1], K[:1, :1] - 1e-6)


def test_it_is_not_inverted_in_place():
    with pytest.raises(NotImplementedError, match="cannot be inverted in place"):
        factor(matrix()).invert()
