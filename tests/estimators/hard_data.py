"""All estimators, and small data for hard cases."""

import functools

import numpy as np
import pytest
from sklearn.base import clone

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)

STAGED = MultiTaskGPRegressor(learning="staged")  # from one start: quicker
GPS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=1),
    "IndependentGP": IndependentGP(),
    "PooledGP": PooledGP(),
    "SingleTaskGP": SingleTaskGP(),
    "RankSearchIC": RankSearchIC(STAGED, ranks=(1, 2)),
}
SHARED = {name: GPS[name] for name in list(GPS)[:3]}  # all rows in one matrix
ALL = GPS | {"BayesianLinearRegression": BayesianLinearRegression()}
each_gp = pytest.mark.parametrize("model", GPS.values(), ids=GPS)


def columns(features, tasks):
    return np.column_stack([features, tasks])


def draw(n=24, n_tasks=3, n_features=2, seed=0):
    """Features, tasks and targets of smooth functions with a little noise."""
    rng = np.random.default_rng(seed)
    tasks, F = np.arange(n) % n_tasks, rng.uniform(-1.0, 1.0, (n, n_features))
    y = (1.0 + tasks) * F[:, 0] + 0.3 * np.sin(2.0 * F[:, -1])
    return F, tasks, y + 0.01 * rng.standard_normal(n)


F, TASKS, Y = draw()
X = columns(F, TASKS)


def with_params(model, **params):
    """A clone with other parameters, those of the estimator inside a search."""
    model = clone(model)
    if isinstance(model, RankSearchIC):
        return model.set_params(estimator=clone(STAGED).set_params(**params))
    return model.set_params(**params)


def fitted(model, X, y, **params):
    return with_params(model, **params).fit(X, y)


@functools.cache
def learned(model):
    """Fitted to X and Y; not to be changed."""
    return fitted(model, X, Y)


def assert_sound(model, X):
    """Finite predictions, variances that are not negative."""
    mean, std = model.predict(X, return_std=True, include_noise=True)
    assert np.isfinite(mean).all()
    assert np.isfinite(std).all()
    assert (std > 0.0).all()
    cov = model.predict(X, return_cov=True)[1]
    assert np.isfinite(cov).all()
    return mean, std
