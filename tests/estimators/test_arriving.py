"""What is said of rows and tasks that join, and what calls see meanwhile."""

import threading
from copy import deepcopy

import numpy as np
import pytest

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC
from skmtgp._data.outliers import far_off
from skmtgp.exceptions import (
    OutlierWarning,
    RepeatedRowsWarning,
    TaskColumnWarning,
    TaskUnitWarning,
)

QUICK = {"learning": "staged"}


def rows(label, n, seed=0, unit=1.0, level=12.0):
    """Rows of a task and their targets."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 6.0, n)
    y = unit * (level + 1.5 * np.sin(x) + 0.1 * rng.standard_normal(n))
    return np.column_stack([x.astype(object), np.full(n, label)]), y


def data(units=(1.0, 1.0, 1.0, 1.0), n=25):
    parts = [rows(f"s{i}", n, i, unit) for i, unit in enumerate(units)]
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


FIRST = data()


@pytest.fixture(scope="module")
def fitted():
    """One unit for all tasks; not to be changed."""
    return MultiTaskGPRegressor(rank=1, normalize_y="shared", **QUICK).fit(*FIRST)


@pytest.mark.parametrize(("unit", "what"), [(100.0, "times as much"), (1e-3, "less")])
def test_a_task_in_another_unit(fitted, unit, what):
    X, y = rows("new", 12, 7, unit)
    with pytest.warns(TaskUnitWarning, match=f"'new' varies .*{what}"):
        fitted.add_task(X, y)
    model = deepcopy(fitted)
    for i in range(4):
        model.partial_fit(X[[i]], y[[i]])
    with pytest.warns(TaskUnitWarning, match="'new'"):
        model.partial_fit(X[4:5], y[4:5])
    for i in range(5, 12):
        model.partial_fit(X[[i]], y[[i]])


@pytest.mark.parametrize("unit", [0.3, 1.0, 3.0])
def test_tasks_that_differ_a_little(fitted, unit):
    X, y = rows("new", 12, 7, unit)
    fitted.add_task(X, y)
    deepcopy(fitted).partial_fit(X[:1], y[:1]).partial_fit(X[1:], y[1:])


def test_a_label_written_otherwise(fitted):
    X, y = rows("S1 ", 4, 8)
    with pytest.warns(TaskColumnWarning, match="'s1', 'S1 ' differ in spaces or case"):
        fitted.add_task(X, y)
    with pytest.warns(TaskColumnWarning):
        deepcopy(fitted).partial_fit(X, y)


def test_a_code_for_a_gap(fitted):
    X, y = rows("s1", 3, 9)
    y[1] = -999.0
    with pytest.warns(OutlierWarning, match="-999 of task 's1'"):
        deepcopy(fitted).partial_fit(X, y)
    model = deepcopy(fitted)
    with pytest.raises(OutlierWarning):
        model.partial_fit(X, y)
    assert len(model.y_train_) == len(FIRST[1])


def test_rows_that_are_there_already(fitted):
    X, y = FIRST[0][:30], FIRST[1][:30]
    with pytest.warns(RepeatedRowsWarning, match="30 of 30 rows are there already"):
        deepcopy(fitted).partial_fit(X, y)
    more, t = rows("s1", 30, 10)
    deepcopy(fitted).partial_fit(more, t)
    some = np.concatenate([more, X[:10]]), np.concatenate([t, y[:10]])
    deepcopy(fitted).partial_fit(*some)


def test_targets_that_are_equal_by_chance():
    """Ratings at a few places."""
    rng = np.random.default_rng(0)
    X = rng.integers(0, 5, (120, 1)).astype(float)
    X = np.column_stack([X, rng.integers(0, 2, 120)])
    y = np.round(X[:, 0] + rng.standard_normal(120))
    model = MultiTaskGPRegressor("rbf", rank=1, **QUICK).fit(X[:80], y[:80])
    for i in range(80, 120, 8):
        model.partial_fit(X[i : i + 8], y[i : i + 8])


def test_a_new_task_has_a_code_for_a_gap():
    X, y = rows("new", 20, 7)
    y[3] = -999.0
    for units in ("shared", "per_task"):
        model = MultiTaskGPRegressor(rank=1, normalize_y=units, **QUICK).fit(*FIRST)
        with pytest.warns(OutlierWarning, match="-999") as caught:
            model.add_task(X, y)
        assert len(caught) == 1


def test_a_new_task_of_several_orders_of_magnitude():
    """What is far is asked of the transformed targets, as in fit."""
    X, y = FIRST
    model = MultiTaskGPRegressor(
        rank=1, normalize_y="shared", target_transform=(np.log, np.exp), **QUICK
    ).fit(X, y)
    new, t = rows("new", 20, 7)
    t[:2] = [90.0, 80.0]  # 2.0 in logarithms from the median
    assert far_off(t[:, None], np.zeros(20, dtype=int)).any()
    model.add_task(new, t)


def test_tasks_that_differ_in_size_and_noise():
    """A new one is like the third of them, which has the least of both."""
    sizes, noises = [1.0, 1.0, 0.2, 1.0], [0.02, 0.02, 0.02, 3.0]
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(0.0, 6.0, 120), np.arange(120) % 4])
    task = X[:, 1].astype(int)
    y = np.take(sizes, task) * np.sin(X[:, 0])
    y += np.take(noises, task) * rng.standard_normal(120)
    options = {"noise": "per_task", "normalize_y": "shared"}
    model = MultiTaskGPRegressor(rank=1, **options, **QUICK).fit(X, y)
    x = rng.uniform(0.0, 6.0, 15)
    t = 0.2 * np.sin(x) + 0.02 * rng.standard_normal(15)
    model.add_task(np.column_stack([x, np.full(15, 9)]), t)


def test_the_output_is_named():
    X, y = FIRST
    Y = np.column_stack([y + np.random.default_rng(0).standard_normal(100), y])
    model = MultiTaskGPRegressor(rank=1, normalize_y="shared", **QUICK).fit(X, Y)
    new, t = rows("new", 12, 7)
    with pytest.warns(TaskUnitWarning, match=r"noise, 0\.0.* in output 2") as caught:
        model.add_task(new, np.column_stack([t, 12.0 + 1e-3 * (t - 12.0)]))
    assert len(caught) == 1


def test_motion_after_a_standstill():
    """What the model foresees is no mistake."""
    rng = np.random.default_rng(0)
    x = np.append(np.zeros(18), rng.uniform(0.0, 6.0, 30))
    X = np.column_stack([np.append(x, x), np.repeat([0, 1], 48)])
    y = np.sin(X[:, 0]) + 1e-3 * rng.standard_normal(96)
    known = np.r_[0:18, 48:96]
    model = MultiTaskGPRegressor("rbf", rank=1, **QUICK).fit(X[known], y[known])
    for i in range(18, 30):
        model.partial_fit(X[[i]], y[[i]])


def test_a_relation_is_learned_once_rows_leave_a_product():
    """Rows that complete the cells of a grid do not count as learned from."""
    x = np.linspace(0.0, 6.0, 24)
    X = np.column_stack([np.tile(x, 3), np.repeat([0, 1, 2], 24)])
    rng = np.random.default_rng(0)
    weights = np.array([[1.0, 0.2], [-1.0, 0.5], [0.3, 1.0], [0.2, -1.0]])

    def target(x, task):
        one, two = weights[task]
        noise = 0.05 * rng.standard_normal(len(x))
        return one * np.sin(x) + two * np.cos(2.0 * x) + noise

    y = np.concatenate([target(x, task) for task in range(3)])
    model = MultiTaskGPRegressor(rank=2, normalize_y="shared", **QUICK).fit(X, y)
    assert model.inference_ == "kronecker"
    new, t = np.column_stack([x, np.full(24, 3)]), target(x, 3)
    stream = model.add_task(new[:1], t[:1]).partial_fit(new[1:], t[1:])
    again = np.column_stack([x + 0.1, np.full(24, 3)])
    stream.partial_fit(again, target(x + 0.1, 3))
    assert stream.inference_ == "dense"
    found = stream.task_correlation_.loc[3].to_numpy()
    expected = model.add_task(new, t).task_correlation_.loc[3].to_numpy()
    np.testing.assert_allclose(found, expected, atol=0.1)


UNITS = data((1.0, 1.8, 10.0, 0.1, 5.0))
OWN = {"normalize_y": "per_task"}
MODELS = {
    "rank 0": MultiTaskGPRegressor(rank=0, shared=True, **OWN, **QUICK),
    "rank 0 and equal": MultiTaskGPRegressor(
        rank=0, shared=True, diagonal="equal", **OWN, **QUICK
    ),
    "rank 0 and own": MultiTaskGPRegressor(
        rank=0, shared=True, diagonal=True, **OWN, **QUICK
    ),
    "rank 1": MultiTaskGPRegressor(rank=1, **OWN, **QUICK),
    "independent": IndependentGP(**OWN),
    "sparse": MultiTaskGPRegressor(
        rank=0, shared=True, inference="sparse", n_inducing=15, **OWN, **QUICK
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_unit_is_that_of_all_rows(name):
    """It is learned anew at 2, 3, 5, 8 and 12 rows."""
    (X, y), Z = rows("t", 12, 11, 100.0), rows("t", 40, 12, 100.0)[0]
    model = MODELS[name].fit(*UNITS)
    whole = deepcopy(model).partial_fit(X, y)
    for i in range(12):
        model.partial_fit(X[[i]], y[[i]])
    np.testing.assert_allclose(model.y_scale_, whole.y_scale_)
    learned = name in ("sparse", "rank 1", "rank 0 and own")
    digits = {"rtol": 2e-2} if learned else {"rtol": 1e-6}
    np.testing.assert_allclose(model.predict(Z), whole.predict(Z), **digits)
    std = [of.predict(Z, return_std=True)[1] for of in (model, whole)]
    np.testing.assert_allclose(*std, rtol=5e-2, atol=1e-3)


def test_calls_see_one_state():
    """Threads predict a task in the middle while others join before it."""
    levels = [rows("m1", 20, 1, level=0.0), rows("m2", 20, 2, level=50.0)]
    X, y = map(np.concatenate, zip(*levels, strict=True))
    model, Z = IndependentGP(**OWN).fit(X, y), rows("m2", 300)[0]
    before = model.predict(Z, return_std=True)[1]  # others tell nothing of the task
    wrong, done = [], threading.Event()

    def watch():
        while not done.is_set():
            mean, std = model.predict(Z, return_std=True)
            if abs(mean.mean() - 50.0) > 5.0 or abs(std - before).max() > 1e-6:
                wrong.append(mean.mean())

    threads = [threading.Thread(target=watch) for _ in range(3)]
    for thread in threads:
        thread.start()
    for k in range(40):
        model.partial_fit(*rows(f"a{99 - k}", 2, k, level=-30.0))
    done.set()
    for thread in threads:
        thread.join()
    assert not wrong


def test_a_call_keeps_the_state_that_it_began_with(fitted, monkeypatch):
    """Rows join in the middle of `predict`, as another thread may let them."""
    model, (Z, _) = deepcopy(fitted), rows("s1", 5, 3)
    expected = fitted.predict(Z, return_std=True)
    means = MultiTaskGPRegressor._means

    def then_more(self, *options):
        found = means(self, *options)
        monkeypatch.setattr(MultiTaskGPRegressor, "_means", means)
        model.partial_fit(*rows("s0", 20, 4, level=0.0))
        return found

    monkeypatch.setattr(MultiTaskGPRegressor, "_means", then_more)
    np.testing.assert_array_equal(model.predict(Z, return_std=True), expected)
    assert (model.predict(Z, return_std=True)[1] != expected[1]).any()


def test_a_search_keeps_the_state_of_its_best_model(monkeypatch):
    search = RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=[1]).fit(*FIRST)
    Z, means = rows("s1", 5, 3)[0], MultiTaskGPRegressor._means
    expected = search.predict(Z, return_std=True)

    def then_more(self, *options):
        found = means(self, *options)
        monkeypatch.setattr(MultiTaskGPRegressor, "_means", means)
        search.best_estimator_.partial_fit(*rows("s0", 20, 4))
        return found

    monkeypatch.setattr(MultiTaskGPRegressor, "_means", then_more)
    np.testing.assert_array_equal(search.predict(Z, return_std=True), expected)
