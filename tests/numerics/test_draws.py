"""Draws from normal distributions, whose covariances may be singular."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp._numerics import linalg
from skmtgp._numerics.linalg import draw_normal, semidefinite_factor
from skmtgp.exceptions import NotPositiveDefiniteError

x = np.linspace(0.0, 1.0, 60)[:, None]
SMOOTH, ROUGH = RBF(0.5)(x), Matern(0.2, nu=0.5)(x)
KNOWN = np.arange(60) % 2 == 0
UNITS = np.repeat([1e-6, 1.0, 1e5], 20)
COVARIANCES = {
    "regular": ROUGH,
    "nearly singular": SMOOTH,
    "equal rows": np.repeat(np.repeat(ROUGH[:20, :20], 3, axis=0), 3, axis=1),
    "rank one": np.ones((4, 4)),
    "no variance": np.zeros((3, 3)),
    "one row": np.array([[4.0]]),
    "one row without variance": np.array([[0.0]]),
    "some rows without variance": ROUGH
    * np.outer(np.arange(60) % 2, np.arange(60) % 2),
    "rows in other units": SMOOTH * np.outer(UNITS, UNITS),
    "rounded": SMOOTH - 1e-15 * np.eye(60),
}
each = pytest.mark.parametrize("K", COVARIANCES.values(), ids=COVARIANCES)


@each
def test_the_factor_is_one_of_the_covariance(K):
    before, F = K.copy(), semidefinite_factor(K)
    deviations = np.sqrt(np.diagonal(K))
    error = np.abs(F @ F.T - K)
    assert (error <= 2e-7 * np.outer(deviations, deviations)).all()
    assert_array_equal(K, before)


def test_regular_covariances_get_hardly_any_jitter():
    F = semidefinite_factor(ROUGH)
    assert_allclose(F, np.linalg.cholesky(ROUGH), rtol=0.0, atol=1e-11)


def test_eigenvectors_where_jitter_is_not_enough(monkeypatch):
    monkeypatch.setattr(linalg, "JITTERS", ())
    for K in (SMOOTH, ROUGH):
        F = semidefinite_factor(K)
        assert_allclose(F @ F.T, K, rtol=0.0, atol=1e-13)
    monkeypatch.undo()
    K = np.diag([1.0, 1.0, 0.5])
    K[0, 1] = K[1, 0] = 1.0 + 1e-5  # more than rounding does
    F = semidefinite_factor(K)
    assert_allclose(F @ F.T, K, rtol=0.0, atol=2e-5)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_covariances_that_are_not_finite(bad):
    K = np.eye(3)
    K[1, 0] = K[0, 1] = bad
    with pytest.raises(NotPositiveDefiniteError, match="not finite"):
        semidefinite_factor(K)


@each
def test_moments_of_draws(K):
    n, n_draws = len(K), 4000
    mean = 10.0 * np.arange(n) * np.sqrt(np.diagonal(K))
    draws = draw_normal(mean, K, n_draws, np.random.RandomState(0))
    assert draws.shape == (n, n_draws)
    deviations = np.sqrt(np.diagonal(K))
    error = np.abs(draws.mean(axis=1) - mean)
    assert (error <= 5.0 / np.sqrt(n_draws) * deviations).all()
    error = np.abs(np.cov(draws).reshape(n, n) - K)
    most = 7.5 / np.sqrt(n_draws) * np.outer(deviations, deviations)
    assert (error <= most).all()


def test_few_draws_are_the_first_of_many():
    mean = np.arange(60.0)
    few, many = (draw_normal(mean, ROUGH, n, np.random.RandomState(1)) for n in (3, 20))
    assert_allclose(few, many[:, :3], rtol=1e-12)
    none = draw_normal(mean, ROUGH, 0, np.random.RandomState(1))
    assert none.shape == (60, 0)


def test_equal_rows_have_equal_draws():
    K = COVARIANCES["equal rows"]
    draws = draw_normal(np.zeros(60), K, 5, np.random.RandomState(2))
    assert_allclose(draws[::3], draws[1::3], rtol=0.0, atol=3e-3)
