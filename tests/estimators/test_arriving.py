"""What is said of rows and tasks that join, and what calls see meanwhile."""

import threading
from copy import deepcopy

import numpy as np
import pytest

from skmtgp import IndependentGP, MultiTaskGPRegressor
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
    with pytest.warns(TaskUnitWarning, match="'new'") as caught:
        for i in range(12):
            model.partial_fit(X[[i]], y[[i]])
    assert len(caught) == 1


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
    with pytest.warns(RepeatedRowsWarning, match="30 rows repeat"):
        deepcopy(fitted).partial_fit(X, y)
    more, t = rows("s1", 30, 10)
    deepcopy(fitted).partial_fit(more, t)
    some = np.concatenate([more, X[:10]]), np.concatenate([t, y[:10]])
    deepcopy(fitted).partial_fit(*some)


UNITS = data((1.0, 1.8, 10.0, 0.1, 5.0))
OWN = {"normalize_y": "per_task"}
MODELS = {
    "rank 0": MultiTaskGPRegressor(rank=0, shared=True, **OWN, **QUICK),
    "rank 0 and equal": MultiTaskGPRegressor(
        rank=0, shared=True, diagonal="equal", **OWN, **QUICK
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
    digits = {"rtol": 2e-2} if name in ("sparse", "rank 1") else {"rtol": 1e-6}
    np.testing.assert_allclose(model.predict(Z), whole.predict(Z), **digits)
    std = [of.predict(Z, return_std=True)[1] for of in (model, whole)]
    np.testing.assert_allclose(*std, rtol=5e-2, atol=1e-3)


def test_calls_see_one_state():
    """Threads predict a task in the middle while others join before it."""
    levels = [rows("m1", 20, 1, level=0.0), rows("m2", 20, 2, level=50.0)]
    X, y = map(np.concatenate, zip(*levels, strict=True))
    model, Z = IndependentGP(**OWN).fit(X, y), rows("m2", 300)[0]
    wrong, done = [], threading.Event()

    def watch():
        while not done.is_set():
            mean, std = model.predict(Z, return_std=True)
            if abs(mean.mean() - 50.0) > 5.0 or len(std) != len(mean):
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
