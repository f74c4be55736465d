"""Variograms: the numbers of dots and lines."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from pictured import FRAME, TASKS, X, Y, texts, y
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import RBF, Matern
from sklearn.pipeline import make_pipeline

from skmtgp import MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp.inspection import VariogramDisplay
from skmtgp.inspection._variogram import _Survey

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
QUICK = {"max_iter": 3, "noise": "per_task"}
TERMS = [Matern(1.5, nu=0.5), RBF(0.4)]


def survey(n=40, seed=0):
    """Places, of which the second task has every other one and two of its own."""
    rng = np.random.default_rng(seed)
    places, own = rng.uniform(0.0, 5.0, (n, 2)), rng.uniform(0.0, 5.0, (2, 2))
    X = np.vstack([places, places[::2], own])
    tasks = np.repeat(["zinc", "lead"], [n, n // 2 + 2])
    y = np.sin(X.sum(axis=1)) + 0.3 * rng.standard_normal(len(X)) + (tasks == "lead")
    frame = pd.DataFrame({"east": X[:, 0], "north": X[:, 1], "metal": tasks})
    return frame, y


@pytest.fixture(scope="module")
def model():
    return MultiTaskGPRegressor(TERMS, rank=1, **QUICK).fit(*survey())


def by_the_book(a, b, model, low, high):
    """Mean distance, half products of differences and their expectation, by loops."""
    frame, y = survey()
    of = [frame.assign(y=y)[frame["metal"] == task] for task in (a, b)]
    both = of[0].merge(of[1], on=["east", "north"])
    codes = [model.tasks_.tolist().index(task) for task in (a, b)]
    noise = model.noise_variance_[codes[0]] if a == b else 0.0
    found, at = [], both[["east", "north"]].to_numpy()
    of_a, of_b = both["y_x"].to_numpy(), both["y_y"].to_numpy()
    for i in range(len(both)):
        for j in range(i):
            x = at[[i, j]]
            distance = np.linalg.norm(x[0] - x[1])
            if low < distance <= high:
                product = (of_a[i] - of_a[j]) * (of_b[i] - of_b[j])
                pairs = zip(model.kernel_, model.task_covariance_, strict=True)
                expected = sum(K[*codes] * (1.0 - k(x)[0, 1]) for k, K in pairs)
                found.append((distance, 0.5 * product, expected + noise))
    return [*np.mean(found, axis=0), len(found)]


@pytest.mark.parametrize("pair", [("zinc", "zinc"), ("lead", "zinc"), ("lead", "lead")])
def test_dots_and_lines_by_the_book(model, pair):
    tasks = ["zinc", "lead"]
    shown = VariogramDisplay.from_estimator(
        model, tasks=tasks, n_bins=3, max_distance=3.0
    )
    frame = shown.variograms
    frame = frame[(frame["task"] == pair[0]) & (frame["other"] == pair[1])]
    found = frame[["distance", "observed", "model", "pairs"]]
    for k, row in enumerate(found.to_numpy()):
        assert_allclose(row, by_the_book(*pair, model, k, k + 1.0), rtol=1e-10)
    assert_allclose(shown.observed_[pair].get_ydata(), found["observed"])
    assert_allclose(shown.lines_[pair].get_ydata(), found["model"])
    assert texts(ax.title for ax in shown.axes_[:, 0]) == ["zinc", "lead and zinc"]
    assert not shown.axes_[0, 1].axison
    legend = texts(shown.figure_.legends[0].get_texts())
    assert legend == ["observed", "model"]


def test_expectations_are_those_of_draws():
    """Of data from a known model the dots scatter around the line."""
    rng, kernel = np.random.default_rng(0), RBF(1.0, "fixed")
    x = rng.uniform(0.0, 10.0, 60)
    X = np.column_stack([np.tile(x, 2), np.repeat([0, 1], 60)])
    K = np.kron([[4.0, 1.5], [1.5, 1.0]], kernel(x[:, None])) + 0.2 * np.eye(120)
    draws = np.linalg.cholesky(K) @ rng.standard_normal((120, 100))
    model = MultiTaskGPRegressor(kernel, rank=2, max_iter=0).fit(X, draws[:, 0])
    drawn, edges = _Survey.of(model, 0, slice(None)), np.linspace(0.0, 4.0, 5)
    for a, b, sill, noise in [(0, 0, 4.0, 0.2), (1, 0, 1.5, 0.0), (1, 1, 1.0, 0.2)]:
        frames = [drawn._replace(y=of).variogram(a, b, edges) for of in draws.T]
        h = frames[0]["distance"]
        expected = sill * (1.0 - np.exp(-0.5 * h**2)) + noise
        found = np.mean([frame["observed"] for frame in frames], axis=0)
        assert_allclose(found, expected, rtol=0.1, atol=0.05)


@pytest.mark.parametrize("per_task", [False, True])
def test_a_trend_is_taken_off(per_task):
    frame, y = survey()
    steep = y + np.where(frame["metal"] == "lead", 30.0, 20.0) * frame["east"]
    options = {"trend": ["east", "north"], "trend_per_task": per_task}
    model = MultiTaskGPRegressor(rank=1, max_iter=0, **options).fit(frame, steep)
    shown = VariogramDisplay.from_estimator(model, n_bins=1, max_distance=99.0)
    zinc = (frame["metal"] == "zinc").to_numpy()
    coef = model.coef_[1] if per_task else model.coef_
    left = (steep - frame[["east", "north"]] @ coef).to_numpy()[zinc]
    expected = np.square(np.subtract.outer(left, left)).sum() / (2.0 * 40 * 39)
    found = shown.variograms.set_index(["task", "other"])["observed"]
    assert found["zinc", "zinc"] == pytest.approx(expected)
    assert expected < (1.0 if per_task else 20.0) < 0.1 * steep[zinc].var()


def test_transformed_targets():
    frame, y = survey()
    logs = {"target_transform": (np.log, np.exp), "rank": 1, "max_iter": 0}
    own = MultiTaskGPRegressor(**logs).fit(frame, np.exp(y))
    other = MultiTaskGPRegressor(rank=1, max_iter=0).fit(frame, y)
    found, expected = map(VariogramDisplay.from_estimator, (own, other))
    numbers = ["distance", "observed", "model"]
    assert_allclose(found.variograms[numbers], expected.variograms[numbers])


@pytest.mark.parametrize("features", ["north", [1], ["north"]])
def test_distances_of_some_features(model, features):
    shown = VariogramDisplay.from_estimator(
        model, tasks=["zinc"], features=features, n_bins=1, max_distance=0.5
    )
    frame, _ = survey()
    north = frame.loc[frame["metal"] == "zinc", "north"].to_numpy()
    apart = np.abs(np.subtract.outer(north, north))[np.triu_indices(len(north), 1)]
    [found] = shown.variograms.to_dict("records")
    assert found["pairs"] == (apart <= 0.5).sum()
    assert found["distance"] == pytest.approx(apart[apart <= 0.5].mean())


def test_features_beside_descriptors():
    frame, y = survey()
    frame.insert(0, "weight", np.where(frame["metal"] == "lead", 207.2, 65.4))
    options = {"rank": 1, "max_iter": 0, "task_feature": "metal"}
    model = MultiTaskGPRegressor(task_descriptors=["weight"], **options).fit(frame, y)
    found = VariogramDisplay.from_estimator(model, features=["north"]).variograms
    plain = MultiTaskGPRegressor(**options).fit(frame.drop(columns="weight"), y)
    expected = VariogramDisplay.from_estimator(plain, features=["north"]).variograms
    assert_allclose(found["distance"], expected["distance"])


@pytest.mark.parametrize("output", [0, 1])
@pytest.mark.parametrize("name", ["MultiTaskGPRegressor", "IndependentGP", "PooledGP"])
def test_models_and_outputs(fitted, name, output):
    shown = VariogramDisplay.from_estimator(fitted[name], output=output, n_bins=2)
    frame = shown.variograms
    one = frame[(frame["task"] == 1) & (frame["other"] == 1)]
    of, places = Y[TASKS == 1, output], X[TASKS == 1, :-1]
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    reach = 0.5 * np.linalg.norm(np.ptp(X[:, :-1], axis=0))
    i, j = np.nonzero(np.triu(apart <= reach, 1))
    total = (one["observed"] * one["pairs"]).sum()
    assert total == pytest.approx(0.5 * np.square(of[i] - of[j]).sum())
    assert shown.figure_ is shown.ax_.figure


def test_tasks_that_share_no_place():
    frame, y = survey()
    frame.loc[frame["metal"] == "lead", "east"] += 0.01
    model = PooledGP(max_iter=0).fit(frame, y)
    shown = VariogramDisplay.from_estimator(model)
    assert shown.axes_[1, 0].get_title() == "zinc and lead: no places"
    assert len(shown.lines_["zinc", "zinc"].get_xdata())


def test_many_places_are_drawn():
    x = np.linspace(0.0, 1.0, 1600)
    X, of = np.column_stack([x, np.zeros(1600)]), np.sin(9.0 * x)
    sparse = {"inference": "sparse", "n_inducing": 10, "n_exact": 50}
    model = PooledGP(RBF(0.3), max_iter=0, **sparse).fit(X, of)
    frame = VariogramDisplay.from_estimator(model, max_distance=1.0).variograms
    assert frame["pairs"].sum() == 1500 * 1499 // 2


def test_pipelines_and_axes(piped):
    _, ax = plt.subplots(1, 1)
    shown = VariogramDisplay.from_estimator(piped, tasks=["w"], ax=ax)
    assert shown.axes_[0, 0] is ax
    assert not shown.figure_.legends
    axes = plt.subplots(2, 2)[1]
    shown = VariogramDisplay.from_estimator(piped, tasks=["w", "u"], ax=axes)
    assert shown.ax_.get_title() == "w"


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"tasks": ["gold"]}, ValueError, r"has 'gold', .* from \['lead', 'zinc'\]"),
        ({"tasks": []}, ValueError, "tasks is empty: choose from"),
        ({"features": ["up"]}, ValueError, "element of features='up' is not a column"),
        ({"features": ["metal"]}, ValueError, "has the task column"),
        ({"n_bins": 0}, ValueError, "n_bins == 0, must be >= 1"),
        ({"max_distance": -1.0}, ValueError, "max_distance=-1.0 must be positive"),
        ({"output": 1}, ValueError, "output=1 must be 0"),
        ({"ax": [None]}, ValueError, r"ax has shape \(1,\), but 2 tasks need \(2, 2\)"),
    ],
)
def test_errors(model, options, error, message):
    with pytest.raises(error, match=message):
        VariogramDisplay.from_estimator(model, **options)


def test_models_that_have_none():
    with pytest.raises(NotFittedError):
        VariogramDisplay.from_estimator(make_pipeline(PooledGP()))
    alone = SingleTaskGP(max_iter=0).fit(FRAME[["a", "b", "load"]], y)
    with pytest.raises(TypeError, match=r"has no task_covariance: .* its estimators_"):
        VariogramDisplay.from_estimator(alone)
    VariogramDisplay.from_estimator(alone.estimators_[0])
    X = np.column_stack([np.tile(np.arange(5.0), 7), np.repeat(np.arange(7), 5)])
    many = PooledGP(max_iter=0).fit(X, np.sin(X[:, 0]))
    with pytest.raises(ValueError, match=r"are 7 tasks, .* at most 6: tasks=\[0, 1, 2"):
        VariogramDisplay.from_estimator(many)
