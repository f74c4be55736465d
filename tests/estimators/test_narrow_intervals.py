"""Fits to few rows for each hyperparameter say that intervals are too narrow."""

import warnings

import dask.array as da
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    average_repeats,
)
from skmtgp._estimators import doubts
from skmtgp.exceptions import NarrowIntervalsWarning
from skmtgp.inspection import TransferDisplay


def draw(n_each, n_tasks=3, seed=0):
    """Rows of related tasks, mixed."""
    rng = np.random.default_rng(seed)
    x, task = rng.uniform(0, 8, n_each * n_tasks), np.repeat(range(n_tasks), n_each)
    y = np.sin(x) * (1.0 + 0.4 * task) + 0.5 * np.cos(0.7 * x) * (task == 1)
    X, mixed = np.column_stack([x, task]), rng.permutation(len(x))
    return X[mixed], (y + 0.1 * rng.standard_normal(len(x)))[mixed]


def told_by(function, *arguments, **options):
    """What is said of narrow intervals while a function runs."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        function(*arguments, **options)
    return [str(of.message) for of in caught if of.category is NarrowIntervalsWarning]


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(),
        MultiTaskGPRegressor(rank=2),
        MultiTaskGPRegressor(rank=0, shared=True, noise="shared"),
        MultiTaskGPRegressor(rank=1, hyperparameters="map"),
        IndependentGP(),
        RankSearchIC(),
    ],
    ids=repr,
)
def test_few_rows_for_each_hyperparameter_are_told_once(model):
    [told] = told_by(model.fit, *draw(4))
    assert "fewer than 4 rows for each hyperparameter" in told
    assert "hyperparameters='auto'" in told
    of = getattr(model, "best_estimator_", model)
    has_rank = np.any(getattr(of, "rank_", 0))
    assert ("diagonal='equal'" in told) == has_rank


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(rank=2),
        MultiTaskGPRegressor(rank=1, hyperparameters="laplace"),
        PooledGP(),
        SingleTaskGP(),
        RankSearchIC(),
    ],
    ids=repr,
)
def test_enough_rows_are_not_told(model):
    assert told_by(model.fit, *draw(40)) == []


@pytest.mark.parametrize(("learning", "each"), [("annealed", 4), ("staged", 8)])
def test_how_many_rows_for_each_hyperparameter_are_enough(learning, each):
    """Where variances count that hyperparameters were learned, half as many."""
    X, y = draw(20)
    options = {"noise": "shared", "normalize_y": "shared", "learning": learning}
    model = MultiTaskGPRegressor(RBF(1.0), rank=1, **options)
    n = each * model.fit(X, y).n_hyperparameters_
    assert n <= 60
    assert not told_by(model.fit, X[:n], y[:n])
    assert told_by(model.fit, X[: n - 1], y[: n - 1])


def test_noise_variances_of_tasks_count_as_one():
    X, y = draw(20)
    options = {"rank": 1, "normalize_y": "shared"}
    shared = MultiTaskGPRegressor(RBF(1.0), noise="shared", **options).fit(X, y)
    own = MultiTaskGPRegressor(RBF(1.0), noise="per_task", **options)
    n = 4 * shared.n_hyperparameters_
    assert not told_by(own.fit, X[:n], y[:n])
    assert own.n_hyperparameters_ == shared.n_hyperparameters_ + 2


def test_laplace_is_told_what_helps():
    X, y = draw(10)
    options = {"rank": 1, "noise": "shared", "hyperparameters": "laplace"}
    model = MultiTaskGPRegressor(RBF(1.0), **options).fit(X, y)
    n = 4 * model.n_hyperparameters_
    assert n <= 30
    assert not told_by(model.fit, X[:n], y[:n])
    [told] = told_by(model.fit, X[: n - 1], y[: n - 1])
    assert "fewer than 4 rows" in told
    assert "hyperparameters='sampled'" in told


def test_auto_draws_and_is_silent():
    model = MultiTaskGPRegressor(rank=1, hyperparameters="auto", n_draws=5)
    assert told_by(model.fit, *draw(6)) == []
    assert model.hyperparameters_ == "sampled"


def test_several_kernels_have_no_draws():
    [told] = told_by(MultiTaskGPRegressor([RBF(1.0), RBF(0.5)], rank=1).fit, *draw(6))
    assert "fewer than 8 rows" in told
    assert "one kernel with hyperparameters='auto'" in told


def test_auto_of_sparse_inference_is_the_mode_and_names_draws():
    X, y = draw(26, n_tasks=20)  # 520 rows for 135 hyperparameters
    options = {"inference": "sparse", "n_inducing": 10, "max_iter": 2}
    model = MultiTaskGPRegressor(rank=8, hyperparameters="auto", **options)
    [told] = told_by(model.fit, X, y)
    assert model.hyperparameters_ == "mode"
    assert "hyperparameters='sampled'" in told


def test_of_many_rows_draws_would_take_hours(monkeypatch):
    X, y = draw(26, n_tasks=20)
    monkeypatch.setattr(doubts, "MOST_DRAWN", 519)
    options = {"inference": "sparse", "n_inducing": 10, "max_iter": 2}
    [told] = told_by(MultiTaskGPRegressor(rank=8, **options).fit, X, y)
    assert "sampled" not in told
    assert "This helps: more rows, or fewer hyperparameters: a lower rank" in told


def test_nothing_is_told_where_nothing_is_learned():
    assert told_by(MultiTaskGPRegressor(rank=2, max_iter=0).fit, *draw(6)) == []


def test_repeats_do_not_count():
    X, y = draw(6)
    X, y = np.repeat(X, 20, axis=0), np.repeat(y, 20)
    y = y + 0.1 * np.random.default_rng(0).standard_normal(len(y))
    model = MultiTaskGPRegressor(rank=2)
    assert told_by(model.fit, X, y)
    X, y, counts, variance = average_repeats(X, y)
    given = {"sample_weight": counts, "repeat_variance": variance}
    assert told_by(model.fit, X, y, **given)


def test_rows_in_partitions_are_counted_as_they_are():
    X, y = draw(6)
    model = PooledGP("rbf", inference="sparse", n_inducing=4)
    parts = [da.from_array(of, chunks=9) for of in (X[:18], y[:18])]
    [told] = told_by(model.fit, *parts)
    assert told.endswith("This helps: more rows.")


def test_tasks_by_themselves_are_told_by_name():
    X, y = draw(40, n_tasks=2)
    few = (X[:, 1] == 0) | (np.cumsum(X[:, 1]) <= 10)  # ten rows of task 1
    [told] = told_by(SingleTaskGP().fit, X[few], y[few])
    assert told.startswith("Task 1: ")


def test_predictions_and_displays_say_nothing_of_it():
    X, y = draw(8)
    model = MultiTaskGPRegressor(rank=2).fit(X, y)
    assert told_by(model.predict_interval, X) == []
    assert told_by(TransferDisplay.from_estimator, model) == []
