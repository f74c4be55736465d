"""A task whose targets are all equal tells nothing of the noise of the others."""

import warnings

import numpy as np
import pytest

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC

NOISE, N = 0.1, 96


def draw(noise=NOISE, seed=0):
    """Rows of four tasks, of which the third is constant, and of the others' f."""
    rng = np.random.default_rng(seed)
    X = np.column_stack([rng.uniform(size=(N, 2)), np.arange(N) % 4])
    X_new = np.column_stack([rng.uniform(size=(300, 2)), rng.choice([0, 1, 3], 300)])

    def function(X):
        return np.sin(5.0 * X[:, 0]) * (1.0 + X[:, -1]) + X[:, 1]

    is_constant = X[:, -1] == 2
    y = np.where(is_constant, 3.0, function(X) + noise * rng.standard_normal(N))
    return X, y, is_constant, X_new, function(X_new)


def fitted(model, X, y):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return model.fit(X, y)


def error(model, X, f):
    return np.sqrt(np.mean(np.square(model.predict(X) - f)))


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(rank=1),
        MultiTaskGPRegressor(),
        IndependentGP(),
        RankSearchIC(ranks=[1, 2]),
    ],
    ids=str,
)
def test_others_keep_their_noise(model):
    X, y, is_constant, X_new, f = draw()
    without = error(fitted(model, X[~is_constant], y[~is_constant]), X_new, f)
    beside = fitted(model, X, y)
    assert error(beside, X_new, f) < 1.5 * without
    of = getattr(beside, "best_estimator_", beside)
    assert np.sqrt(np.ravel(of.noise_variance_)).min() > 0.4 * NOISE


@pytest.mark.parametrize("normalize_y", ["shared", "per_task"])
def test_it_is_predicted(normalize_y):
    X, y, is_constant, *_ = draw()
    model = fitted(MultiTaskGPRegressor(rank=1, normalize_y=normalize_y), X, y)
    assert model.predict(X[is_constant]) == pytest.approx(3.0, abs=0.01)


def corners(seed, n_equal):
    """Eight tasks of 12 rows with a step each, noise 0.015; one of equal targets."""
    rng = np.random.default_rng(seed)
    X, tasks = rng.uniform(size=(96 + n_equal, 2)), np.arange(96) // 12
    tasks = np.r_[tasks, np.full(n_equal, 8)]
    at, low = rng.uniform(0.3, 0.7, 9), rng.uniform(0.3, 0.7, 9)
    f = low[tasks] + 0.3 / (1.0 + np.exp(-20.0 * (X.mean(axis=1) - at[tasks])))
    y = np.where(tasks == 8, 0.63, f + 0.015 * rng.standard_normal(len(X)))
    return np.column_stack([X, tasks]), y


@pytest.mark.parametrize(
    "model", [MultiTaskGPRegressor(rank=2), MultiTaskGPRegressor()], ids=str
)
@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.long)])
def test_few_equal_targets_are_enough_to_hide_noise(model, seed):
    X, y = corners(seed, 5)
    noise = np.sqrt(np.ravel(fitted(model, X, y).noise_variance_))
    assert ((noise > 0.6 * 0.015) & (noise < 1.5 * 0.015)).all()


def test_noise_of_each_task_follows_no_constant():
    """Else the kernel is that of the task whose noise vanishes."""
    X, y = corners(3, 20)
    model = fitted(MultiTaskGPRegressor(rank=2, noise="per_task"), X, y)
    assert np.sqrt(model.noise_variance_).min() > 0.3 * 0.015


def test_exact_data_stay_exact():
    X, y, _, X_new, f = draw(noise=0.0)
    assert error(fitted(MultiTaskGPRegressor(), X, y), X_new, f) < 0.001


@pytest.mark.parametrize("n_rows", [3, 4])
def test_few_exact_rows_stay_exact(n_rows):
    """A small model might take their curves for noise."""
    rng = np.random.default_rng(1)
    tasks = np.repeat(np.arange(6), [n_rows] * 5 + [10])
    x = rng.uniform(0.0, 1.0, len(tasks))
    y = np.where(tasks == 5, 3.0, np.sin(5.0 * x) * (1.0 + 0.3 * tasks) + 0.2 * tasks)
    model = fitted(MultiTaskGPRegressor(), np.column_stack([x, tasks]), y)
    assert np.sqrt(np.ravel(model.noise_variance_)[0]) < 1e-3


def test_each_task_constant_in_another_output():
    X, *_ = draw()
    rng, tasks = np.random.default_rng(0), X[:, -1].astype(int)
    f = np.sin(5.0 * X[:, 0]) * (1.0 + tasks) + X[:, 1]
    Y = f[:, None] + NOISE * rng.standard_normal((N, 4))
    Y[np.arange(N), tasks] = 1.0
    model = fitted(MultiTaskGPRegressor(rank=1), X, Y)
    assert np.sqrt(model.noise_variance_).min() > 0.4 * NOISE


def test_a_constant_output_beside_another():
    X, y, *_ = draw()
    Y = np.column_stack([y, np.full(N, 2.0)])
    model = fitted(MultiTaskGPRegressor(rank=1), X, Y)
    assert model.predict(X)[:, 1] == pytest.approx(2.0)


def test_weights_and_descriptors():
    X, y, _, X_new, f = draw()
    model = fitted(MultiTaskGPRegressor(rank=1), X, y)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        weighted = MultiTaskGPRegressor(rank=1).fit(X, y, sample_weight=np.ones(N))
    assert error(weighted, X_new, f) < 1.5 * error(model, X_new, f)
    described = np.column_stack([X[:, :2], np.square(X[:, 2]), X[:, 2]])
    model = MultiTaskGPRegressor(task_descriptors=[2])
    assert np.isfinite(fitted(model, described, y).predict(described)).all()
