"""Targets that are rounded have at least the noise that rounding adds."""

import warnings

import numpy as np
import pytest

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
)

STEP, N = 0.5, 60


def draw(seed=0, step=STEP, n_test=200):
    """Rows of four tasks, rounded; rows to predict, rounded and as they were."""
    rng = np.random.default_rng(seed)
    x, task = rng.uniform(0.0, 8.0, N + n_test), np.arange(N + n_test) % 4
    phase = np.array([0.0, 0.4, 0.9, 1.5])[task]
    f = np.sin(x + phase) + 0.5 * phase
    y = np.round((f + 0.01 * rng.standard_normal(len(f))) / step) * step
    X = np.column_stack([x, task])
    return X[:N], y[:N], X[N:], y[N:], f[N:]


def fitted(model, X, y):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return model.fit(X, y)


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(rank=2),
        MultiTaskGPRegressor(rank=2, noise="per_task"),
        MultiTaskGPRegressor(rank=2, normalize_y="per_task"),
        MultiTaskGPRegressor(rank=2, hyperparameters="map"),
        RankSearchIC(ranks=[1, 2]),
        IndependentGP(),
    ],
    ids=str,
)
def test_noise_is_not_less(model):
    X, y, *_ = draw()
    model = fitted(model, X, y)
    model = getattr(model, "best_estimator_", model)
    unit = np.ravel(model.y_scale_) / np.max(model.y_scale_)
    assert (
        np.ravel(model.noise_variance_) >= (1 - 1e-9) * STEP**2 / 12 * unit**2
    ).all()


def test_of_single_tasks_too():
    X, y, *_ = draw()
    model = fitted(SingleTaskGP(), X, y)
    for of in model.estimators_:
        assert np.ravel(of.noise_variance_)[0] > 0.99 * STEP**2 / 12


def test_predictions_and_intervals_of_few_rows():
    """Without it noise vanishes in three of eight draws, and intervals with it."""
    held, losses = [], []
    for seed in range(4):
        X, y, X_test, y_test, _ = draw(seed, step=1.0)
        model = fitted(MultiTaskGPRegressor(rank=2), X, y)
        mean, std = model.predict(X_test, return_std=True, include_noise=True)
        held.append(np.mean(np.abs(y_test - mean) < 1.96 * std))
        losses.append(np.mean(0.5 * ((y_test - mean) / std) ** 2 + np.log(std)))
    assert np.mean(held) > 0.88
    assert np.max(losses) < 0.5


def test_bounds_that_are_given_hold():
    X, y, *_ = draw(5, step=1.0)
    bounds = (1e-9, 1e3)
    model = fitted(MultiTaskGPRegressor(rank=4, noise_variance_bounds=bounds), X, y)
    assert np.ravel(model.noise_variance_)[0] < 0.9 / 12


def test_exact_integers_stay_exact():
    x = np.tile(np.arange(15.0), 2)
    X, y = np.column_stack([x, np.repeat([0, 1], 15)]), 2.0 * x + np.repeat([0, 1], 15)
    model = fitted(MultiTaskGPRegressor(rank=1), X, y)
    assert np.abs(model.predict(X) - y).max() < 1e-3


def test_known_noise_and_transformed_targets_are_taken_as_they_are():
    X, y, *_ = draw()
    known = fitted(MultiTaskGPRegressor(rank=4), X, y).fit(X, y, alpha=0.01)
    assert np.ravel(known.noise_variance_)[0] < STEP**2 / 12


def test_it_is_said(caplog):
    X, y, *_ = draw()
    fitted(MultiTaskGPRegressor(rank=1, verbose=1), X, y)
    assert "targets that are rounded" in caplog.text
