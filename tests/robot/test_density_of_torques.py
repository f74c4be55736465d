"""Log densities of torques, which are normal."""

import numpy as np
import pytest
from scipy.stats import norm

from skmtgp import add_task
from skmtgp.exceptions import UnidentifiedNoiseWarning
from skmtgp.robot import RigidBodyRegressor

pytest.importorskip("pinocchio")


def test_they_are_those_of_means_and_deviations(puma, moved):
    X, Y, _ = moved
    Y = Y + 0.2 * np.random.default_rng(0).standard_normal(Y.shape)
    model = RigidBodyRegressor(puma, empty_task=1).fit(X[::2], Y[::2])
    X, Y = X[1::40], Y[1::40]
    mean, std = model.predict(X, return_std=True, include_noise=True)
    found = model.log_predictive_density(X, Y)
    np.testing.assert_allclose(found, norm.logpdf(Y, mean, std), rtol=1e-10)


def test_where_rows_tell_nothing_it_is_zero(puma, moved):
    """Deviations are infinite there."""
    X, Y, _ = moved
    with pytest.warns(UnidentifiedNoiseWarning):
        model = RigidBodyRegressor(puma, prior=None).fit(X[:3], Y[:3])
    blind = np.isinf(model.predict(X[100:103], return_std=True)[1])
    assert blind.any()
    found = model.log_predictive_density(X[100:103], Y[100:103])
    assert (found[blind] == -np.inf).all()


def test_errors_of_new_torques_may_be_known(puma, moved):
    """Of each joint; what joins has none."""
    X, Y, _ = moved
    Y = Y + 0.2 * np.random.default_rng(0).standard_normal(Y.shape)
    model = RigidBodyRegressor(puma, empty_task=1).fit(X[::2], Y[::2])
    X, Y = X[1::40], Y[1::40]
    mean, std = model.predict(X, return_std=True, include_noise=True)
    alpha = np.linspace(0.0, 2.0, Y.size).reshape(Y.shape)
    std = np.sqrt(std**2 + alpha)
    found = model.log_predictive_density(X, Y, alpha=alpha)
    np.testing.assert_allclose(found, norm.logpdf(Y, mean, std), rtol=1e-10)
    lower, _ = model.predict_interval(X, alpha=alpha)
    np.testing.assert_allclose(lower, norm.ppf(0.025, mean, std), rtol=1e-10)
    with pytest.raises(TypeError, match=r"'alpha'\. It takes X, y, prior"):
        add_task(model, X, Y, alpha=0.1)
