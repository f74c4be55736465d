"""Positive targets that are likelier on another scale."""

import warnings

import numpy as np
import pytest
from rarely import rarely

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC, SingleTaskGP
from skmtgp.exceptions import TargetScaleWarning
from skmtgp.learning import transformed

LOGARITHM = r"target_transform=\(np.log, np.exp\)"
ROOT = r"target_transform=\(np.sqrt, np.square\)"


def drawn(back, noise=0.3, seed=0, n_each=25):
    """Normal targets of three tasks, of which `back` is a function."""
    rng = np.random.default_rng(seed)
    task, x = np.repeat(np.arange(3), n_each), rng.uniform(0.0, 6.0, 3 * n_each)
    z = 4.0 + np.sin(x) + 0.5 * task + noise * rng.standard_normal(3 * n_each)
    return np.column_stack([x, task]), back(z)


def told(model, X, y):
    """What was said of scales."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, y)
    return [str(of.message) for of in caught if of.category is TargetScaleWarning]


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(
    ("back", "advice"), [(np.exp, LOGARITHM), (lambda z: (z - 2.0) ** 2, ROOT)]
)
def test_the_scale_is_found(back, advice, unit):
    X, y = drawn(back)
    with pytest.warns(TargetScaleWarning, match=advice):
        MultiTaskGPRegressor().fit(X, unit * y)


@pytest.mark.parametrize("unit", [1.0, 30.0])
def test_units_come_first_where_tasks_may_have_their_own(unit):
    X, y = drawn(np.exp)
    y *= np.where(X[:, 1] == 1.0, unit, 1.0)
    [message] = told(MultiTaskGPRegressor("rbf", normalize_y="shared"), X, y)
    first = message.startswith("The targets of the output vary up to ")
    assert first == (unit > 1.0)
    assert ("normalize_y='per_task', and" in message) == first
    for text in told(MultiTaskGPRegressor("rbf", normalize_y="per_task"), X, y):
        assert "per_task" not in text


def test_counts_with_zeros():
    X, z = drawn(lambda z: np.exp(2.0 * z - 7.0), n_each=40)
    y = np.random.default_rng(0).poisson(z)
    assert y.min() == 0
    with pytest.warns(TargetScaleWarning, match=r"transform=\(np.log1p, np.expm1\)"):
        MultiTaskGPRegressor().fit(X, y)


@pytest.mark.parametrize("seed", [0, 1, *rarely(2, 3, 4)])
@pytest.mark.parametrize(
    "back", [np.asarray, lambda z: np.exp(z) + 500.0, lambda z: np.exp(z) - 60.0]
)
def test_nothing_is_said(back, seed):
    """Normal targets; of a small range; not positive."""
    X, y = drawn(back, noise=0.8, seed=seed)
    assert told(MultiTaskGPRegressor(), X, y) == []


@pytest.mark.parametrize("per_task", [False, True])
def test_the_gain_is_that_of_models_that_are_fitted(per_task, monkeypatch):
    """Both densities are of the targets themselves."""
    gains, gain = [], transformed._gain

    def kept(problem, mode, theta, y, *given):
        gains.append(gain(problem, mode, theta, y, *given))
        np.testing.assert_allclose(np.sort(y), np.sort(target) / target.max())
        return gains[-1]

    monkeypatch.setattr(transformed, "_gain", kept)
    X, target = drawn(np.exp)
    options = {"rank": 1, "kernel": "rbf", "noise": "shared", "task_levels": False}
    options["normalize_y"] = "per_task" if per_task else "shared"
    with pytest.warns(TargetScaleWarning):
        plain = MultiTaskGPRegressor(**options).fit(X, target)
    options["target_transform"] = (np.log, np.exp)
    moved = MultiTaskGPRegressor(**options).fit(X, target)
    values = [of.log_marginal_likelihood_value_ for of in (plain, moved)]
    expected = values[1] - np.log(target).sum() - values[0]
    assert gains[-1][0] == pytest.approx(expected, abs=0.5)
    assert expected > transformed.SURE


def test_another_unit_gains_nothing(monkeypatch):
    X, y = drawn(np.exp, noise=0.5)
    found = []

    def asked(problem, mode, *given):
        scale = lambda y: 3.0 * y - 5.0, lambda y: np.full(len(y), np.log(3.0))
        gain = transformed._gain(problem, mode, mode.theta, *given, *scale)
        found.append(gain[0])
        return ""

    monkeypatch.setattr("skmtgp._estimators.doubts.likelier_scale", asked)
    MultiTaskGPRegressor(normalize_y="per_task").fit(X, y)
    assert found[0] == pytest.approx(0.0, abs=0.2)


def test_models_and_outputs():
    X, y = drawn(np.exp)
    _, other = drawn(np.asarray)
    [text] = told(MultiTaskGPRegressor(), X, np.column_stack([other, y]))
    assert text.startswith("The targets of output 2 of 2 are never")
    for model in (IndependentGP(), RankSearchIC()):
        [text] = told(model, X, y)
        assert "(np.log, np.exp)" in text


def test_tasks_that_are_learned_alone_are_named():
    X, y = drawn(np.exp, n_each=40)
    [text] = told(SingleTaskGP(), X, y)
    assert text.startswith("Tasks 0, 1, 2: The targets of")
    assert "(np.log, np.exp)" in text


def test_where_nothing_is_asked(monkeypatch):
    X, y = drawn(np.exp)
    for cls in (MultiTaskGPRegressor, SingleTaskGP):
        assert told(cls(target_transform=(np.sqrt, np.square)), X, y) == []
    fixed = {"noise_variance": 100.0, "noise_variance_bounds": "fixed"}
    for params in ({"max_iter": 0}, {"trend": "linear"}, fixed):
        assert told(MultiTaskGPRegressor(**params), X, y) == []
    with warnings.catch_warnings():
        warnings.simplefilter("error", TargetScaleWarning)
        given = {"sample_weight": np.full(len(y), 2.0), "repeat_variance": np.abs(y)}
        MultiTaskGPRegressor().fit(X, y, **given)
    assert told(MultiTaskGPRegressor(inference="sparse"), X, y) == []
    for name, value in (("MOST", len(y) - 1), ("LEAST", len(y) + 1)):
        with monkeypatch.context() as patch:
            patch.setattr(transformed, name, value)
            assert told(MultiTaskGPRegressor(), X, y) == []


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SmallTaskWarning")
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.ConstantTargetWarning")
@pytest.mark.parametrize("tasks", ["single rows", "constant", "none"])
@pytest.mark.parametrize("back", [np.asarray, np.exp])
def test_units_do_not_matter(back, tasks, monkeypatch):
    """Also of tasks that have none of their own; tiny ones do not underflow."""
    X, y = drawn(back, n_each=20)
    rng = np.random.default_rng(1)
    if tasks == "single rows":
        more = np.column_stack([rng.uniform(0.0, 6.0, 6), np.arange(3, 9)])
        X, y = np.vstack([X, more]), np.append(y, rng.choice(y, 6))
    elif tasks == "constant":
        more = np.column_stack([rng.uniform(0.0, 6.0, 12), np.full(12, 3.0)])
        X, y = np.vstack([X, more]), np.append(y, np.full(12, 1.7))
    y, found, gain = y - y.min() + 0.3, [], transformed._gain

    def kept(*given):
        nats, theta = gain(*given)
        found[-1].append(nats)
        return nats, theta

    monkeypatch.setattr(transformed, "_gain", kept)
    for unit in (1.0, 1e-120, 1e-6, 1e6):
        found.append([])
        told(MultiTaskGPRegressor("rbf", rank=1, normalize_y="per_task"), X, unit * y)
        assert len(found[-1]) == 2
        np.testing.assert_allclose(found[-1], found[0], rtol=0, atol=0.1)
    assert np.isfinite(found).all()
    assert (max(found[0]) > transformed.SURE) == (back is np.exp)


@pytest.mark.parametrize("inference", ["dense", "kronecker"])
@pytest.mark.parametrize("units", ["shared", "per_task"])
def test_targets_that_are_asked_are_those_that_were_given(
    units, inference, monkeypatch
):
    """To the bit: logarithms of zeros that were rounded would be far off."""
    rng = np.random.default_rng(0)
    X = np.column_stack(
        [np.tile(rng.uniform(0.0, 6.0, 15), 3), np.repeat([0, 1, 2], 15)]
    )
    y = np.maximum(np.sin(X[:, 0]) + 0.3 * rng.standard_normal(45), 0.0)
    order, asked = rng.permutation(45), []
    X, y = X[order], y[order]

    def kept(problem, mode, y, groups):
        asked.append((problem.data.tasks, y))
        return ""

    monkeypatch.setattr("skmtgp._estimators.doubts.likelier_scale", kept)
    MultiTaskGPRegressor(rank=1, normalize_y=units, inference=inference).fit(X, y)
    [(tasks, found)] = asked
    for task in range(3):
        own = np.sort(y[X[:, 1] == task])
        np.testing.assert_array_equal(np.sort(found[tasks == task]), own)
