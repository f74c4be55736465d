import numpy as np
import pytest

from skmtgp._numerics.linalg import (
    HALVED,
    Cholesky,
    SingleCholesky,
    cholesky_with_jitter,
    correlation,
    invert_triangle,
    svd,
)
from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError


@pytest.fixture
def K():
    A = np.random.default_rng(0).standard_normal((8, 12))
    return np.asfortranarray(A @ A.T)


@pytest.fixture
def cholesky(K):
    lower = np.asfortranarray(np.tril(K) + np.triu(np.full_like(K, np.nan), 1))
    return Cholesky(lower)  # only the lower triangle is read


def test_log_det(K, cholesky):
    np.testing.assert_allclose(cholesky.log_det(), np.linalg.slogdet(K)[1], rtol=1e-14)


@pytest.mark.parametrize("shape", [(8,), (8, 1), (8, 3)])
def test_solve(K, cholesky, shape):
    b = np.random.default_rng(1).standard_normal(shape)
    x = cholesky.solve(b)
    assert x.shape == shape
    np.testing.assert_allclose(x, np.linalg.solve(K, b), rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("order", "CF")
@pytest.mark.parametrize("shape", [(8,), (8, 0), (8, 1), (8, 3)])
def test_half_solve(K, cholesky, shape, order):
    b = np.random.default_rng(1).standard_normal(shape).copy(order=order)
    C = np.linalg.cholesky(K)
    close = {"rtol": 1e-12, "atol": 1e-14}
    np.testing.assert_allclose(cholesky.half_solve(b), np.linalg.solve(C, b), **close)
    actual = cholesky.half_solve(b, transposed=True)
    np.testing.assert_allclose(actual, np.linalg.solve(C.T, b), **close)


def test_invert(K, cholesky):
    inverse = np.tril(cholesky.invert())
    expected = np.tril(np.linalg.inv(K))
    np.testing.assert_allclose(inverse, expected, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize(
    "n", [1, HALVED.start - 1, HALVED.start, 131, HALVED.stop - 1, HALVED.stop]
)
def test_invert_triangle(n):
    rng = np.random.default_rng(0)
    lower = np.tril(0.1 * rng.standard_normal((n, n)), -1) + 3.0 * np.eye(n)
    L = np.asfortranarray(lower + np.triu(np.full_like(lower, np.nan), 1))
    assert invert_triangle(L) is L
    np.testing.assert_allclose(np.tril(L) @ lower, np.eye(n), atol=1e-13)


ASKED = {
    "solve": lambda cholesky, b: cholesky.solve(b),
    "half_solve": lambda cholesky, b: cholesky.half_solve(b),
    "half_solve of several": lambda cholesky, b: cholesky.half_solve(b[:, None]),
    "log_det": lambda cholesky, _: cholesky.log_det(),
    "inverse_diagonal": lambda cholesky, _: cholesky.inverse_diagonal(),
    "invert": lambda cholesky, _: cholesky.invert(),
    "factor": lambda cholesky, _: cholesky.factor,
}


@pytest.mark.parametrize("ask", ASKED.values(), ids=ASKED)
def test_spent_factor(cholesky, ask):
    cholesky.invert()
    with pytest.raises(RuntimeError, match="solve before `invert`"):
        ask(cholesky, np.ones(8))


def test_log_det_where_the_determinant_overflows():
    scale = 1e300
    cholesky = Cholesky(np.asfortranarray(scale * np.eye(5)))
    np.testing.assert_allclose(cholesky.log_det(), 5.0 * np.log(scale), rtol=1e-15)


BAD = {
    "singular": [[1.0, 1.0], [1.0, 1.0]],
    "zero": [[0.0, 0.0], [0.0, 0.0]],
    "indefinite": [[1.0, 2.0], [2.0, 1.0]],
    "negative": [[-1.0, 0.0], [0.0, 1.0]],
    "nan on the diagonal": [[1.0, 0.0], [0.0, np.nan]],
    "nan beside it": [[1.0, np.nan], [np.nan, 1.0]],
    "infinite": [[np.inf, 0.0], [0.0, 1.0]],
    "infinite beside the diagonal": [[1.0, np.inf], [np.inf, 1.0]],
}


@pytest.mark.parametrize("K", BAD.values(), ids=BAD.keys())
def test_not_positive_definite(K):
    with pytest.raises(NotPositiveDefiniteError, match="of 2 is not positive"):
        Cholesky(np.array(K, order="F"))


def test_error_is_a_linear_algebra_error():
    assert issubclass(NotPositiveDefiniteError, np.linalg.LinAlgError)


def diagonal(*values):
    return lambda: np.asfortranarray(np.diag(values))


def test_no_jitter_unless_needed(K):
    cholesky = cholesky_with_jitter(K.copy)  # a warning would be an error
    assert cholesky.log_det() == Cholesky(K).log_det()


def test_jitter_is_reported():
    message = r"6\.7e-09 \(1e-08 of its mean diagonal\).* larger noise_variance"
    with pytest.warns(JitterWarning, match=message):
        cholesky = cholesky_with_jitter(diagonal(1.0, 1.0, -1e-9))
    jitter = 1e-8 * (2.0 - 1e-9) / 3.0
    pivots = np.square(np.diagonal(cholesky.factor))
    expected = [1.0 + jitter, 1.0 + jitter, jitter - 1e-9]
    np.testing.assert_allclose(pivots, expected, rtol=1e-7)


@pytest.mark.parametrize(("relative", "needed"), [("1e-12", 0.0), ("1e-04", 7e-5)])
def test_smallest_and_largest_jitter(relative, needed):
    with pytest.warns(JitterWarning, match=rf"\({relative} of"):
        cholesky_with_jitter(diagonal(1.0, 1.0, 1.0, -needed))


@pytest.mark.parametrize("last", [np.nan, -1.0, -1.1e-4])
def test_jitter_cannot_help(last):
    with pytest.raises(NotPositiveDefiniteError, match="even with 1e-04 of its mean"):
        cholesky_with_jitter(diagonal(1.0, 1.0, last))


def test_correlation():
    K = np.array([[4.0, -3.0, 0.0], [-3.0, 9.0, 0.0], [0.0, 0.0, 0.0]])
    found = correlation(K)
    expected = [[1.0, -0.5, 0.0], [-0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(found, expected)
    assert np.abs(correlation(np.full((2, 2), 3.1))).max() <= 1.0


def gives_up(*args, **kwargs):
    raise np.linalg.LinAlgError("SVD did not converge")


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("converges", [True, False])
def test_svd(full, converges, monkeypatch):
    A = np.random.default_rng(0).standard_normal((4, 6))
    if not converges:
        monkeypatch.setattr(np.linalg, "svd", gives_up)
    U, s, Vt = svd(A, full_matrices=full)
    assert len(Vt) == (6 if full else 4)
    np.testing.assert_allclose(U * s @ Vt[:4], A, rtol=0, atol=1e-14)
    np.testing.assert_allclose(Vt @ Vt.T, np.eye(len(Vt)), rtol=0, atol=1e-14)


def test_svd_of_what_is_not_finite():
    with pytest.raises(NotPositiveDefiniteError, match="not finite"):
        svd(np.array([[1.0, np.nan]]))


class TestSinglePrecision:
    """SingleCholesky does as Cholesky, with seven digits."""

    @pytest.fixture(params=[8, 150])
    def K(self, request):
        n = request.param
        A = np.random.default_rng(0).standard_normal((n, 2 * n))
        return np.asfortranarray(A @ A.T / n)

    @pytest.fixture
    def lower(self, K):
        return np.asfortranarray(np.tril(K) + np.triu(np.full_like(K, 1e300), 1))

    def test_log_det(self, K, lower):
        found, exact = SingleCholesky(lower).log_det(), Cholesky(K).log_det()
        assert found == pytest.approx(exact, rel=1e-5)
        assert found != exact

    @pytest.mark.parametrize("shape", [(), (1,), (3,)])
    def test_solve(self, K, lower, shape):
        b = np.random.default_rng(1).standard_normal((len(K), *shape))
        x = SingleCholesky(lower).solve(b)
        assert (x.dtype, x.shape) == (np.float64, b.shape)
        np.testing.assert_allclose(x, np.linalg.solve(K, b), atol=1e-5)

    def test_invert(self, K, lower):
        cholesky = SingleCholesky(lower)
        np.testing.assert_array_equal(np.tril(lower), np.tril(K))  # not overwritten
        inverse = cholesky.invert()
        assert inverse is lower
        np.testing.assert_allclose(
            np.tril(inverse), np.tril(np.linalg.inv(K)), atol=1e-5
        )
        with pytest.raises(RuntimeError, match="solve before `invert`"):
            cholesky.solve(K[0])

    def test_not_positive_definite(self, lower):
        lower[-1, -1] = -1.0
        with pytest.raises(NotPositiveDefiniteError, match="is not positive"):
            SingleCholesky(lower)
