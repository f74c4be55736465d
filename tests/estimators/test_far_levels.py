"""Levels of tasks that are hundreds of deviations of their functions apart."""

import pickle
import warnings

import numpy as np
import pytest
from samples import log_densities, posteriors

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC, TaskIdentifier
from skmtgp.exceptions import FarLevelsWarning

FAR = 1e7  # deviations of the functions
MODELS = [
    MultiTaskGPRegressor("rbf", rank=1),
    MultiTaskGPRegressor("rbf", rank=1, normalize_y="shared", noise="per_task"),
    IndependentGP("rbf"),
]
each_model = pytest.mark.parametrize("model", MODELS, ids=["auto", "shared", "igp"])


def draw(n=24, n_tasks=3, seed=0, n_outputs=None):
    """Rows, targets without levels, and levels of deviation 1 for each row."""
    rng = np.random.default_rng(seed)
    task = np.arange(n * n_tasks) % n_tasks
    x = rng.uniform(0.0, 6.0, len(task))
    f = np.sin(x) * (1.0 + task)
    y = f[:, None] + 0.1 * rng.standard_normal((len(task), n_outputs or 1))
    level = (np.arange(n_tasks) - 1.0)[task]
    return np.column_stack([x, task]), y if n_outputs else y[:, 0], level


@each_model
def test_they_do_not_matter(model):
    X, y, level = draw()
    found = []
    for far in (1e4, FAR, 1e10):
        of = model.fit(X, far * level + y)
        assert of.normalize_y_ == "shared"
        mean, std = of.predict(X, return_std=True, include_noise=True)
        found.append((mean - far * level, std))
        assert np.ravel(of.noise_variance_) == pytest.approx(0.01, rel=0.6)
    for mean, std in found:
        np.testing.assert_allclose(mean, found[0][0], atol=0.02)  # noise has 0.1
        np.testing.assert_allclose(std, found[0][1], rtol=0.1)


@pytest.mark.usefixtures("certain_theta")
@pytest.mark.parametrize("n_outputs", [None, 2])
@each_model
def test_they_are_those_of_the_definition(model, n_outputs):
    X, y, level = draw(n_outputs=n_outputs)
    y = y + 1e5 * (level if n_outputs is None else level[:, None])
    of = model.fit(X, y)
    np.testing.assert_allclose(
        of.log_marginal_likelihoods_, log_densities(of, X, y), rtol=1e-6
    )
    Z = X[:5] + [0.3, 0.0]
    mean, std = (a.reshape(5, -1) for a in of.predict(Z, return_std=True))
    for j, (f, K) in enumerate(posteriors(of, X, y, Z)):
        np.testing.assert_allclose(mean[:, j], f, rtol=1e-9)
        np.testing.assert_allclose(std[:, j], np.sqrt(np.diag(K)), rtol=1e-5)


def test_attributes_are_in_units_of_y():
    X, y, level = draw()
    of = MODELS[0].fit(X, FAR * level + y)
    assert of.y_mean_.shape == (3,)
    assert of.y_scale_ == pytest.approx(np.std(y), rel=0.1)
    np.testing.assert_allclose(of.task_level_, FAR * np.array([-1, 0, 1]), atol=5.0)
    again = pickle.loads(pickle.dumps(of))
    np.testing.assert_array_equal(again.predict(X), of.predict(X))


def test_near_levels_are_learned_as_before():
    X, y, level = draw()
    of = MODELS[0].fit(X, 100.0 * level + y)
    assert np.ndim(of.y_mean_) == 0
    assert of.level_variance_ > 1e3


def test_levels_that_inputs_may_explain_are_learned():
    """Tasks in narrow ranges of one steep line: means tell the line."""
    rng = np.random.default_rng(0)
    task = np.repeat(np.arange(6), 12)
    x = task + 1e-3 * rng.uniform(size=len(task))
    X, y = np.column_stack([x, task]), x + 1e-5 * rng.standard_normal(len(x))
    of = MultiTaskGPRegressor("linear", rank=0, shared=True).fit(X, y)
    assert np.ndim(of.y_mean_) == 0
    assert of.predict([[2.5, 2]]) == pytest.approx(2.5, abs=0.05)


@pytest.mark.parametrize("trend", [None, [0]], ids=str)
def test_a_task_joins(trend):
    X, y, level = draw()
    known, options = X[:, -1] < 2, {} if trend is None else {"trend": trend}
    of = MultiTaskGPRegressor("rbf", rank=1, **options)
    of = of.fit(X[known], (FAR * level + y)[known])
    new = ~known & (np.cumsum(~known) <= 12)
    of = of.add_task(X[new], (FAR * level + y)[new])
    rest = ~known & ~new
    error = of.predict(X[rest]) - (FAR * level + y)[rest]
    assert np.sqrt(np.mean(error**2)) < 0.5 * y[rest].std()
    assert of.y_mean_.shape == (3,)
    assert np.ndim(of.y_scale_) == 0


def test_rows_join():
    X, y, level = draw()
    of = MODELS[0].fit(X[:48], (FAR * level + y)[:48])
    of.partial_fit(X[48:], (FAR * level + y)[48:])
    error = of.predict(X[48:]) - (FAR * level + y)[48:]
    assert np.sqrt(np.mean(error**2)) < 0.2


def test_tasks_that_fit_has_not_seen_are_refused():
    X, y, level = draw()
    of = MultiTaskGPRegressor("rbf", rank=0, shared=True).fit(X, FAR * level + y)
    with pytest.raises(ValueError, match="must not be hundreds of deviations apart"):
        of.predict([[1.0, 9]])
    with pytest.raises(ValueError, match="hundreds of deviations apart"):
        TaskIdentifier(MODELS[0].fit(X, FAR * level + y)).estimate(X[:3, :1], y[:3])


def test_a_search_takes_them():
    X, y, level = draw()
    near, far = (
        RankSearchIC(MultiTaskGPRegressor("rbf"), ranks=(0, 1)).fit(X, size * level + y)
        for size in (1e4, FAR)
    )
    assert near.best_rank_ == far.best_rank_ == 1
    assert far.predict(X) - FAR * level == pytest.approx(
        near.predict(X) - 1e4 * level, abs=0.02
    )


def test_a_row_left_out_does_not_tell_its_level():
    """Of a task with that row alone, only the coarse level is known."""
    X, y, level = draw()
    X, y = np.vstack([X, [3.0, 3]]), np.append(y, 0.3)
    level = np.append(level, 1.5)
    of = MultiTaskGPRegressor("rbf", rank=1).fit(X, FAR * level + y)
    std = of.loo_predict(include_noise=True)[1][-1]
    assert std > 10.0 * of.y_scale_


def test_outputs_have_levels_of_their_own():
    X, y, level = draw(n_outputs=2)
    far = y + np.column_stack([np.zeros_like(level), FAR * level])
    alone, both = MODELS[0].fit(X, y[:, 0]).predict(X), MODELS[0].fit(X, far)
    np.testing.assert_allclose(both.predict(X)[:, 0], alone, rtol=1e-9)
    assert np.ptp(both.y_mean_[0]) == 0.0


def test_targets_that_are_left_as_they_are():
    X, y, level = draw()
    of = MultiTaskGPRegressor("rbf", rank=1, normalize_y=False)
    assert of.fit(X, 1e3 * level + y).y_mean_ == 0.0


LEFT = {
    "normalize_y=False": {"normalize_y": False},
    "descriptors": {"task_feature": 1, "task_descriptors": [2]},
    "constant": {"trend": "constant"},
    "overlap": {},
}


@pytest.mark.parametrize("why", LEFT)
def test_levels_that_are_not_subtracted(why):
    X, y, level = draw()
    if why == "descriptors":
        X = np.column_stack([X, X[:, 1] ** 2])
    elif why == "overlap":
        X = np.column_stack([X[:, 0], X[:, 1] + 0.1 * X[:, 0], X[:, 1]])
    of = MultiTaskGPRegressor("rbf", rank=1, **LEFT[why])
    with pytest.warns(FarLevelsWarning, match=why):
        of.fit(X, FAR * level + y)
    with warnings.catch_warnings():
        warnings.simplefilter("error", FarLevelsWarning)
        of.fit(X, 1e3 * level + y)
