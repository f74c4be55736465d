"""predict_interval of every estimator."""

import re

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student
from sklearn.base import clone

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)

RNG = np.random.default_rng(0)
TASK = np.repeat([0, 1, 2], 8)
X = np.column_stack([RNG.uniform(0.0, 6.0, 24), TASK])
Y = np.sin(X[:, :1] + [0.0, 1.0]) + TASK[:, None]
Y += 0.1 * RNG.standard_normal(Y.shape)
Z = np.column_stack([np.linspace(0.0, 7.0, 6), [0, 1, 2, 0, 1, 2]])
NORMAL = {
    "multi-task": MultiTaskGPRegressor(rank=1, learning="staged"),
    "independent": IndependentGP(),
    "pooled": PooledGP(),
    "single": SingleTaskGP(),
    "search": RankSearchIC(MultiTaskGPRegressor(learning="staged"), ranks=(1,)),
}


@pytest.mark.parametrize("model", NORMAL.values(), ids=NORMAL)
@pytest.mark.parametrize("y", [Y, Y[:, 0]], ids=["two outputs", "one"])
def test_normal(model, y):
    model = clone(model).fit(X, y)
    for include_noise in (False, True):
        lower, upper = model.predict_interval(Z, 0.9, include_noise=include_noise)
        mean, std = model.predict(Z, return_std=True, include_noise=include_noise)
        assert lower.shape == upper.shape == mean.shape
        np.testing.assert_allclose(lower, norm.ppf(0.05, mean, std))
        np.testing.assert_allclose(upper, norm.ppf(0.95, mean, std))


@pytest.mark.parametrize("include_noise", [False, True])
@pytest.mark.parametrize("pooled", [False, True])
def test_students_t(pooled, include_noise):
    model = BayesianLinearRegression(pooled=pooled, noise_shape=2.0).fit(X, Y)
    lower, upper = model.predict_interval(Z, 0.9, include_noise=include_noise)
    mean, std = model.predict(Z, return_std=True, include_noise=include_noise)
    nu = model.degrees_of_freedom_[Z[:, 1].astype(int)][:, None]
    scale = std * np.sqrt((nu - 2.0) / nu)
    np.testing.assert_allclose(lower, student.ppf(0.05, nu, mean, scale))
    np.testing.assert_allclose(upper, student.ppf(0.95, nu, mean, scale))


def test_students_t_of_few_degrees_of_freedom():
    """Whose standard deviation is infinite."""
    rows = np.array([[0.0, 0], [1.0, 1]])
    options = {"noise_shape": 0.25, "noise_rate": 0.1}
    model = BayesianLinearRegression(**options).fit(rows, [1.0, 2.0])
    assert model.degrees_of_freedom_.max() < 2.0
    lower, upper = model.predict_interval(rows)
    assert np.isfinite([lower, upper]).all()
    assert (lower < upper).all()


def test_level_0_is_the_median():
    model = MultiTaskGPRegressor(rank=1).fit(X, Y)
    lower, upper = model.predict_interval(Z, 0.0)
    np.testing.assert_array_equal(lower, upper)
    np.testing.assert_allclose(lower, model.predict(Z))


@pytest.mark.parametrize("level", [-0.1, 1.0, 95, [0.5, 0.9], "0.9", None])
def test_levels_that_are_none(level):
    model = MultiTaskGPRegressor(rank=1).fit(X, Y)
    with pytest.raises(ValueError, match=re.escape(f"level={level!r} must be one")):
        model.predict_interval(Z, level)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
def test_draws_of_hyperparameters():
    options = {"hyperparameters": "sampled", "n_draws": 6}
    model = MultiTaskGPRegressor(rank=1, **options)
    model.fit(X[:12], Y[:12, 0])
    rows = Z[Z[:, 1] < 2]
    for include_noise in (False, True):
        components = model._components(
            rows[:, :1], rows[:, 1].astype(int), include_noise
        )
        means, variances = (of[..., 0] for of in components)
        lower, upper = model.predict_interval(rows, 0.8, include_noise=include_noise)
        for ends, p in ((lower, 0.1), (upper, 0.9)):
            below = norm.cdf(ends, means, np.sqrt(variances)).mean(axis=0)
            np.testing.assert_allclose(below, p, rtol=1e-8)
