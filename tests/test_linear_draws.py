"""Bayesian linear regression against explicit matrices and scipy's distributions."""

import numpy as np
import pytest
from linear_models import POOLED, TARGETS, X, Y, Z, design, regressions, y
from samples import split
from scipy.stats import kstest, t

from skmtgp import BayesianLinearRegression


@pytest.mark.parametrize("noise_shape", [0.5, 0.1])
def test_two_degrees_of_freedom_have_no_variance(noise_shape):
    rows = np.append(np.flatnonzero(X[:, -1] == 0)[:1], np.flatnonzero(X[:, -1] == 1))
    model = BayesianLinearRegression(noise_shape=noise_shape).fit(X[rows], y[rows])
    np.testing.assert_array_equal(np.isinf(model.noise_variance_), [True, False])
    mean, std = model.predict(X[rows], return_std=True)
    assert np.isfinite(mean).all()
    np.testing.assert_array_equal(np.isinf(std), rows == rows[0])
    cov = model.predict(X[rows], return_cov=True, include_noise=True)[1]
    np.testing.assert_array_equal(np.isinf(np.diag(cov)), rows == rows[0])
    assert np.isfinite(cov[0, 1:]).all()
    assert np.isfinite(model.sample_y(X[rows], 50)).all()


@POOLED
def test_covariance_is_between_samples_of_a_regression(pooled):
    model = BayesianLinearRegression(pooled=pooled).fit(X, y)
    std = model.predict(Z, return_std=True)[1]
    cov = model.predict(Z, return_cov=True)[1]
    np.testing.assert_allclose(np.diag(cov), std**2, rtol=1e-12)
    np.testing.assert_array_equal(cov, cov.T)
    apart = split(Z)[1][:, None] != split(Z)[1]
    assert (cov[apart] == 0.0).all() == (not pooled)
    assert (cov[~apart] != 0.0).all()


@POOLED
def test_observations_are_noisier(pooled):
    model = BayesianLinearRegression(pooled=pooled).fit(X, Y)
    std, noisy = (
        model.predict(Z, return_std=True, include_noise=flag)[1]
        for flag in (False, True)
    )
    expected = model.noise_variance_[:, split(Z)[1]].T
    np.testing.assert_allclose(noisy**2 - std**2, expected, rtol=1e-10)


@POOLED
@TARGETS
@pytest.mark.parametrize("noise", [False, True], ids=["of f", "with noise"])
def test_draws_have_the_moments_of_the_posterior(target, pooled, noise):
    model = BayesianLinearRegression(pooled=pooled, noise_shape=10.0).fit(X, target)
    options = {"include_noise": noise}
    draws = model.sample_y(Z, n_samples=4000, random_state=3, **options)
    mean, cov = model.predict(Z, return_cov=True, **options)
    assert draws.shape == (*mean.shape, 4000)
    draws = draws.reshape(len(Z), -1, 4000)
    mean, cov = mean.reshape(len(Z), -1), cov.reshape(len(Z), len(Z), -1)
    for j in range(mean.shape[1]):
        variances = np.diag(cov[..., j])
        error = np.abs(draws[:, j].mean(axis=1) - mean[:, j])
        assert (error < 5.0 * np.sqrt(variances / 4000)).all()
        scale = np.sqrt(np.outer(variances, variances))
        error = np.abs(np.cov(draws[:, j]) - cov[..., j])
        assert (error < 0.12 * scale).all()


@pytest.mark.parametrize("noise", [False, True], ids=["of f", "with noise"])
def test_draws_are_students(noise):
    few = np.concatenate([np.flatnonzero(X[:, -1] == m)[:4] for m in range(3)])
    model = BayesianLinearRegression(noise_shape=0.5).fit(X[few], y[few])
    draws = model.sample_y(Z, n_samples=5000, include_noise=noise)
    mean, std = model.predict(Z, return_std=True, include_noise=noise)
    nu = model.degrees_of_freedom_[0]
    assert nu == 5.0
    for i in (0, 5, 11):
        scale = std[i] * np.sqrt((nu - 2.0) / nu)
        assert kstest(draws[i], t(nu, mean[i], scale).cdf).pvalue > 0.01
        assert kstest((draws[i] - mean[i]) / std[i], "norm").pvalue < 1e-3


def test_draws_are_planes():
    draws = BayesianLinearRegression().fit(X, y).sample_y(Z, 3)
    for rows in regressions(Z, False):
        D = design(split(Z)[0][rows])
        residuals = np.linalg.lstsq(D, draws[rows], rcond=None)[1]
        assert (residuals < 1e-18 * np.square(draws).sum()).all()


def test_seed_of_the_draws():
    model = BayesianLinearRegression().fit(X, Y)
    first, again, other = (model.sample_y(Z, 2, random_state=s) for s in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
    np.testing.assert_array_equal(model.sample_y(Z, 2), first)


def test_spreads_are_of_one_kind():
    model = BayesianLinearRegression().fit(X, y)
    with pytest.raises(ValueError, match="Set return_std or return_cov, not both"):
        model.predict(Z, return_std=True, return_cov=True)
