import pickle

import building
import numpy as np
import pytest
import textbook
from dense_models import (
    ARD,
    D,
    M,
    draw,
    every_kernel,
    every_model,
    every_model_and_tile,
    new_rows,
    parameters,
    parts,
    textbook_value,
)
from sklearn.gaussian_process.kernels import RBF

from skmtgp._numerics import linalg as _linalg
from skmtgp.inference import tiles
from skmtgp.model.task_covariance import low_rank, ones


@every_model_and_tile
def test_posterior(kernel, form, n_noise, tile):
    likelihood, (Z, tasks) = building.dense(kernel, form, *draw(), n_noise), new_rows()
    theta = parameters(kernel, form, n_noise)
    posterior = likelihood.posterior(theta)
    mean, covariance = textbook.posterior(*parts(likelihood, theta), *draw(), Z, tasks)
    close = {"rtol": 1e-10, "atol": 1e-11}
    np.testing.assert_allclose(posterior.mean(Z, tasks), mean, **close)
    np.testing.assert_allclose(posterior.covariance(Z, tasks), covariance, **close)
    np.testing.assert_allclose(
        posterior.variance(Z, tasks), np.diagonal(covariance), **close
    )
    value = textbook_value(likelihood, theta)
    np.testing.assert_allclose(posterior.log_likelihood, value, rtol=1e-11)


def test_mean_of_tasks():
    form, (Z, _) = low_rank(M, 2), new_rows()
    posterior = building.dense(RBF(ARD), form, *draw()).posterior(
        parameters(RBF(ARD), form)
    )
    means = posterior.mean_of_tasks(Z, np.array([3, 0]))
    for column, task in enumerate([3, 0]):
        one = posterior.mean(Z, np.full(len(Z), task))
        np.testing.assert_allclose(means[:, column], one, rtol=1e-13)


@every_kernel
@pytest.mark.parametrize("size", [1, 5, 300])
def test_mean_in_tiles(kernel, size, monkeypatch):
    monkeypatch.setattr(tiles, "TILE", size)
    form, rng = low_rank(M, 2), np.random.default_rng(7)
    Z, tasks = rng.standard_normal((31, D)), rng.integers(0, M, 31)
    likelihood = building.dense(kernel, form, *draw())
    theta = parameters(kernel, form)
    mean, _ = textbook.posterior(*parts(likelihood, theta), *draw(), Z, tasks)
    posterior = likelihood.posterior(theta)
    close = {"rtol": 1e-10, "atol": 1e-11}
    np.testing.assert_allclose(posterior.mean(Z, tasks), mean, **close)
    means = posterior.mean_of_tasks(Z, np.arange(M))
    np.testing.assert_allclose(means[np.arange(31), tasks], mean, **close)


def test_mean_factorises_nothing(monkeypatch):
    form, (Z, tasks) = low_rank(M, 2), new_rows()
    likelihood = building.dense(RBF(ARD), form, *draw())
    posterior = likelihood.posterior(parameters(RBF(ARD), form))
    expected = posterior.mean(Z, tasks)
    again = pickle.loads(pickle.dumps(posterior))

    def fail(*args, **kwargs):
        raise AssertionError("a mean needs no factor")

    monkeypatch.setattr(_linalg.Cholesky, "_routines", _linalg.Routines(*[fail] * 6))
    np.testing.assert_array_equal(again.mean(Z, tasks), expected)
    with pytest.raises(AssertionError, match="a mean needs no factor"):
        again.variance(Z, tasks)


def test_posterior_describes_itself():
    form = low_rank(M, 2)
    theta = parameters(RBF(ARD), form)
    posterior = building.dense(RBF(ARD), form, *draw()).posterior(theta)
    assert posterior.kernel == RBF(ARD).clone_with_theta(theta[:4])
    np.testing.assert_array_equal(posterior.K_rho, form.matrix(theta[4:12]))


def test_variance_is_never_negative(monkeypatch):
    X, tasks = np.linspace(0.0, 9.0, 30)[:, None], np.zeros(30, dtype=int)
    likelihood = building.dense(RBF(), ones(1), X, tasks, np.sin(X[:, 0]))
    posterior = likelihood.posterior(np.array([-1.0, np.log(1e-15)]))
    variance = posterior.variance(X, tasks)
    assert (variance >= 0.0).all()
    assert variance.max() < 1e-14
    half = posterior._half(X, tasks)  # as rounding may make it
    monkeypatch.setattr(posterior, "_half", lambda *args: half * (1.0 + 1e-12))
    np.testing.assert_array_equal(posterior.variance(X, tasks), 0.0)


def textbook_left_out(likelihood, theta):
    """Mean and variance of f at each row, given the others."""
    X, tasks, y = draw()
    found = []
    for i in range(len(y)):
        rest = [part[np.arange(len(y)) != i] for part in (X, tasks, y)]
        at_row = X[i : i + 1], tasks[i : i + 1]
        found.append(textbook.posterior(*parts(likelihood, theta), *rest, *at_row))
    return np.transpose([(mean.item(), cov.item()) for mean, cov in found])


@every_model
def test_leave_one_out(kernel, form, n_noise):
    likelihood = building.dense(kernel, form, *draw(), n_noise)
    theta = parameters(kernel, form, n_noise)
    posterior = likelihood.posterior(theta)
    factor = posterior.cholesky.factor.copy()
    mean, expected = textbook_left_out(likelihood, theta)
    residual, variance = posterior.leave_one_out()
    close = {"rtol": 1e-10, "atol": 1e-11}
    np.testing.assert_allclose(residual, likelihood.y - mean, **close)
    np.testing.assert_allclose(variance, expected, **close)
    residual, variance = posterior.leave_one_out(include_noise=True)
    noise = np.exp(theta[-n_noise:])[likelihood.noise_of_row]
    np.testing.assert_allclose(residual, likelihood.y - mean, **close)
    np.testing.assert_allclose(variance, expected + noise, **close)
    np.testing.assert_array_equal(posterior.cholesky.factor, factor)


def test_variance_left_out_is_never_negative(monkeypatch):
    form = low_rank(M, 2)
    likelihood = building.dense(RBF(ARD), form, *draw())
    theta = parameters(RBF(ARD), form)
    posterior, noise = likelihood.posterior(theta), np.exp(theta[-1])
    as_rounding_may_make_it = np.full(len(likelihood.y), (1.0 + 1e-14) / noise)
    monkeypatch.setattr(
        posterior.cholesky, "inverse_diagonal", lambda: as_rounding_may_make_it
    )
    np.testing.assert_array_equal(posterior.leave_one_out()[1], 0.0)
    np.testing.assert_allclose(posterior.leave_one_out(True)[1], noise, rtol=1e-15)
