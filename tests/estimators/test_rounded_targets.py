"""Targets that are rounded have at least the noise that rounding adds."""

import warnings
from itertools import product

import numpy as np
import pytest
from sklearn.base import clone

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
    """Without it noise vanishes in these draws, and 50 to 67 % are held."""
    held, losses = [], []
    for seed in (4, 6, 7):
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


def test_known_noise_is_taken_as_it_is():
    X, y, *_ = draw()
    known = fitted(MultiTaskGPRegressor(rank=4), X, y).fit(X, y, alpha=0.01)
    assert np.ravel(known.noise_variance_)[0] < STEP**2 / 12


def test_nothing_moves_without_iterations():
    X, y, *_ = draw()
    quick = MultiTaskGPRegressor(rank=1, max_iter=0, noise_variance=1e-3)
    given = clone(quick).set_params(noise_variance_bounds=(1e-9, 1e3))
    found = [fitted(of, X, y).noise_variance_ for of in (quick, given)]
    assert found[0] == found[1] < 0.1 * STEP**2 / 12


def of_grid(n_values, n_inputs, function):
    """A function of all combinations of inputs, and of two tasks."""
    values = product(*[np.arange(float(n_values))] * n_inputs, (0.0, 1.0))
    X = np.array(list(values))
    return X, function(X)


@pytest.mark.parametrize(
    ("n_values", "n_inputs", "function"),
    [
        (7, 2, lambda X: X[:, 0] + X[:, 1] * (1 + X[:, 2])),
        (7, 2, lambda X: (X[:, 0] - 3) ** 2 + X[:, 2] * X[:, 1]),
        (7, 2, lambda X: 2 * X[:, 0] + X[:, 2]),
        (2, 4, lambda X: X[:, 0] + 2 * X[:, 1] - X[:, 2] + X[:, 4]),
        (2, 4, lambda X: X[:, 0] * X[:, 1]),
    ],
    ids=["planes", "even", "irrelevant input", "factorial", "logic"],
)
def test_exact_integers_that_repeat(n_values, n_inputs, function):
    X, y = of_grid(n_values, n_inputs, function)
    test = np.arange(len(y)) % 5 == 2
    model = fitted(MultiTaskGPRegressor(rank=2), X[~test], y[~test])
    assert np.abs(model.predict(X[test]) - y[test]).max() < 1e-3


def test_it_is_said(caplog):
    X, y, *_ = draw()
    fitted(MultiTaskGPRegressor(rank=1, verbose=1), X, y)
    assert "a least noise variance" in caplog.text
