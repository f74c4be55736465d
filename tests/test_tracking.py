"""Descriptors of a task that may change, followed sample by sample."""

import pickle

import numpy as np
import pandas as pd
import pytest

from skmtgp import DescriptorTracker, MultiTaskGPRegressor, compile_predictor

LOADS = np.array([[0.5, 1.0], [1.0, -0.5], [2.0, 0.3], [3.0, 0.8]])
NOISE = 0.05


def f(x, load):
    """Two outputs, linear in what describes the task."""
    m, c = np.transpose(load)
    return np.column_stack([m * np.sin(x) + c * np.cos(x), m * np.cos(x) - c])


@pytest.fixture(scope="module")
def models():
    x, task = np.tile(np.linspace(0, 6, 15), 4), np.repeat([0, 1, 2, 3], 15)
    X = np.column_stack([x, LOADS[task], task])
    Y = f(x, LOADS[task]) + 1e-3 * np.random.default_rng(0).standard_normal((60, 2))
    return MultiTaskGPRegressor(
        rank=2, task_descriptors=[1, 2], task_levels=False, normalize_y="shared"
    ).fit(X, Y)


@pytest.fixture(scope="module")
def predictor(models):
    return compile_predictor(models)


class Line:
    """What is linear in two descriptors, known exactly."""

    descriptors = pd.DataFrame(LOADS, list("abcd"), ["m", "c"])
    outputs = [0, 1]

    def by_descriptors(self, x):
        s, c = np.sin(x[0]), np.cos(x[0])
        return np.array([0.5, -x[0]]), np.array([[s, c], [c, -1.0]])


def samples(n, load, seed=0, noise=NOISE):
    rng, line = np.random.default_rng(seed), Line()
    for x in rng.uniform(0, 6, (n, 1)):
        constants, slopes = line.by_descriptors(x)
        yield x, constants + slopes @ load + noise * rng.standard_normal(2)


def test_what_is_predicted_is_linear_in_the_descriptors(predictor):
    for x, load in zip(([0.3], [4.0]), ([2.5, -0.2], [0.1, 0.9]), strict=True):
        constants, slopes = predictor.by_descriptors(x)
        expected = predictor(x, descriptors=load)
        np.testing.assert_allclose(constants + slopes @ load, expected, rtol=1e-9)
    assert slopes.shape == (2, 2)
    np.testing.assert_array_equal(predictor.descriptors, LOADS)
    assert predictor.descriptors.index.tolist() == predictor.tasks


def test_no_line_without_descriptors():
    x, task = np.tile(np.linspace(0, 6, 8), 2), np.repeat([0, 1], 8)
    X, y = np.column_stack([x, task]), np.exp(np.sin(x) * (1 + task))
    plain = compile_predictor(MultiTaskGPRegressor(rank=1).fit(X, y))
    assert plain.descriptors is None
    with pytest.raises(ValueError, match="need models with the same task_descriptors"):
        plain.by_descriptors([1.0])
    with pytest.raises(ValueError, match="a predictor of models with the same task_d"):
        DescriptorTracker(plain, 0.1)
    X = np.column_stack([x, 1.0 + task, task])
    options = {"task_descriptors": [1], "target_transform": (np.log, np.exp)}
    curved = compile_predictor(MultiTaskGPRegressor(rank=1, **options).fit(X, y))
    with pytest.raises(ValueError, match="needs models without target_transform"):
        curved.by_descriptors([1.0])


def test_it_solves_the_linear_equations():
    """All at once, by Bayesian linear regression, it is the same."""
    tracker = DescriptorTracker(Line(), NOISE, widening=2.0, memory=np.inf)
    spread = LOADS - LOADS.mean(axis=0)
    prior = 4.0 * (spread.T @ spread / 4 + 1e-6 * np.diag(LOADS.var(axis=0)))
    np.testing.assert_allclose(tracker.covariance, prior, rtol=1e-9)
    information, pull = np.linalg.inv(prior), np.zeros(2)
    for x, y in samples(20, [1.5, 0.2]):
        found = tracker.update(x, y)
        constants, slopes = Line().by_descriptors(x)
        information += slopes.T @ slopes / NOISE**2
        pull += slopes.T @ (y - constants - slopes @ LOADS.mean(axis=0)) / NOISE**2
        expected = LOADS.mean(axis=0) + np.linalg.solve(information, pull)
        np.testing.assert_allclose(found, expected, rtol=1e-8)
    np.testing.assert_allclose(
        tracker.covariance, np.linalg.inv(information), rtol=1e-8
    )
    assert tracker.n_changes == 0


def test_another_task_is_noticed_and_found():
    tracker = DescriptorTracker(Line(), NOISE, start="b")
    np.testing.assert_array_equal(tracker.descriptors, LOADS[1])
    for x, y in samples(30, LOADS[1]):
        tracker.update(x, y)
    np.testing.assert_allclose(tracker.descriptors, LOADS[1], rtol=1e-6)
    assert tracker.n_changes == 0
    for x, y in samples(2, [2.5, -0.4], seed=1):
        tracker.update(x, y)
    assert tracker.n_changes == 1
    np.testing.assert_allclose(tracker.descriptors, [2.5, -0.4], atol=6 * NOISE)
    for x, y in samples(30, [0.7, 0.1], seed=2):
        tracker.update(x, y)
    assert tracker.n_changes == 2
    np.testing.assert_allclose(tracker.descriptors, [0.7, 0.1], atol=NOISE)


def test_small_changes_are_followed_by_fading():
    remembers, forgets = (
        DescriptorTracker(Line(), NOISE, memory=memory) for memory in (np.inf, 20)
    )
    for k, (x, y) in enumerate(samples(300, np.zeros(2))):
        load = np.array([1.0 + k / 300, 0.0])
        for tracker in (remembers, forgets):
            tracker.update(x, y + Line().by_descriptors(x)[1] @ load)
    assert abs(remembers.descriptors[0] - 2.0) > 0.3
    assert abs(forgets.descriptors[0] - 2.0) < 0.1


def test_what_fades_is_never_less_known_than_at_first():
    tracker = DescriptorTracker(Line(), NOISE, memory=5)
    widest = tracker.covariance
    for x, y in samples(10, [1.0, 0.0]):
        tracker.update(x, y)
    for _ in range(200):
        tracker.update([1.0], [np.nan, np.nan])
    np.testing.assert_allclose(tracker.covariance, widest, rtol=1e-6)


def test_outputs_that_were_not_measured():
    first, both = (DescriptorTracker(Line(), [NOISE, 1e9]) for _ in range(2))
    for x, y in samples(5, [1.0, 0.5]):
        both.update(x, y)
        first.update(x, [y[0], np.nan])
    np.testing.assert_allclose(first.descriptors, both.descriptors, rtol=1e-9)


def test_it_follows_a_fitted_model(predictor):
    tracker = DescriptorTracker(predictor, 0.01, start=0)
    load, x = np.array([2.4, 0.5]), np.array([0.5, 1.7, 3.0])
    for each, y in zip(x, f(x, np.tile(load, (3, 1))), strict=True):
        found = tracker.update([each], y)
    np.testing.assert_allclose(found, load, atol=0.02)
    again = pickle.loads(pickle.dumps(tracker))
    np.testing.assert_array_equal(again.descriptors, found)
    np.testing.assert_array_equal(again.covariance, tracker.covariance)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (
            {"noise": 0.0},
            "noise=0.0 must be a number above 0, or one for each of the",
        ),
        ({"noise": [1.0, 1.0, 1.0]}, "or one for each of the 2 outputs"),
        ({"noise": [1.0, np.nan]}, "must be a number above 0"),
        ({"widening": 0.0}, "widening=0.0 must be above 0"),
        ({"surprise": np.nan}, "surprise=nan must be above 0"),
        ({"memory": 1.0}, "memory=1.0 must be above 1"),
        ({"start": "e"}, "start='e' is not a task of the predictor, such as .*'a'"),
        ({"start": [1.0]}, r"one for each of \['m', 'c'\]"),
        ({"start": [1.0, np.inf]}, "must be finite numbers"),
    ],
)
def test_bad_arguments(options, match):
    with pytest.raises(ValueError, match=match):
        DescriptorTracker(Line(), **({"noise": NOISE} | options))


@pytest.mark.parametrize("y", [[1.0], [1.0, np.inf]])
def test_bad_samples_change_nothing(y):
    tracker = DescriptorTracker(Line(), NOISE)
    before = tracker.descriptors, tracker.covariance
    with pytest.raises(ValueError, match="must be 2 finite numbers"):
        tracker.update([1.0], y)
    np.testing.assert_array_equal(tracker.descriptors, before[0])
    np.testing.assert_array_equal(tracker.covariance, before[1])


def test_a_state_that_was_not_measured(predictor):
    """NaN in y means so, but not in x: an encoder may have failed."""
    tracker = DescriptorTracker(predictor, 0.01, start=0)
    before = tracker.descriptors
    with pytest.raises(ValueError, match=r"predictions at x=.*nan.* are not finite"):
        tracker.update([np.nan], [1.0, np.nan])
    np.testing.assert_array_equal(tracker.descriptors, before)
