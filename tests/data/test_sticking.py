"""Long runs of equal targets in one task, as of a sensor that is stuck."""

import numpy as np
import pytest

from skmtgp import MultiTaskGPRegressor
from skmtgp._data.sticking import stuck_runs
from skmtgp.exceptions import ConstantTargetWarning

N, STUCK = 40, np.arange(22, 37)  # rows of each task, and those of "b" that are equal


def recorded(n_inputs=1):
    """Three tasks in turn along a time, with noise, and where "b" has its rows."""
    rng, time = np.random.default_rng(0), np.repeat(np.linspace(0.0, 6.0, N), 3)
    codes = np.tile([0, 1, 2], N)
    y = 5.0 + np.sin(2.0 * time + codes) + 0.1 * rng.standard_normal(3 * N)
    X = np.column_stack([time, rng.uniform(size=(3 * N, n_inputs - 1))])
    return X, codes, y, np.flatnonzero(codes == 1)


def found(X, codes, y):
    return [(run.task, run.n_equal, run.value) for run in stuck_runs(X, codes, y)]


@pytest.mark.parametrize("n_inputs", [1, 2])
def test_a_run_within_the_range(n_inputs):
    X, codes, y, of_b = recorded(n_inputs)
    assert found(X, codes, y) == []
    y[of_b[STUCK]] = 5.1
    assert found(X, codes, y) == [(1, 15, 5.1)]


def test_the_order_is_that_of_the_only_input():
    X, codes, y, of_b = recorded()
    y[of_b[STUCK]] = 5.1
    order = np.random.default_rng(0).permutation(len(y))
    assert found(X[order], codes[order], y[order]) == [(1, 15, 5.1)]
    two = np.column_stack([X, X])[order]
    assert found(two, codes[order], y[order]) == []


def test_not_repeats_at_one_input():
    """They have no order, and may well be equal."""
    X, codes, y, of_b = recorded()
    y[of_b[STUCK]], X[of_b[STUCK]] = 5.1, 3.0
    assert found(X, codes, y) == []


def test_not_a_short_run_nor_almost_all_rows():
    for stuck in (slice(10, 19), slice(5, 36)):
        X, codes, y, of_b = recorded()
        y[of_b[stuck]] = 5.1
        assert found(X, codes, y) == []


@pytest.mark.parametrize("limit", [np.minimum, np.maximum])
def test_not_where_the_range_ends(limit):
    X, codes, y, of_b = recorded()
    y[of_b] = limit(5.1, y[of_b] * np.where(np.arange(N) < 15, 0.9, 1.1))
    assert found(X, codes, y) == []


def test_not_at_rest():
    X, codes, y, of_b = recorded()
    y -= 5.1
    y[of_b[STUCK]] = 0.0
    assert found(X, codes, y) == []


def test_not_where_others_are_equal_too():
    X, codes, y, of_b = recorded()
    y[of_b[STUCK]] = 5.1
    y[of_b[:4]] = 4.9
    assert found(X, codes, y) == []


def test_not_where_most_tasks_have_such_rows():
    X, codes, y, of_b = recorded()
    y[of_b[STUCK]] = 5.1
    y[of_b[STUCK] + 1] = 5.2
    assert found(X, codes, y) == []


@pytest.mark.parametrize("step", [0.0, 0.05, 0.5, 2.0])
def test_not_by_chance(step):
    """Draws of counts and of rounded normal variables, with and without a function."""
    rng, codes = np.random.default_rng(0), np.arange(10_000) % 100
    X = rng.uniform(0.0, 6.0, (10_000, 1))
    for size in (0.0, 1.0, 3.0):
        y = size * np.sin(X[:, 0] + codes) + rng.standard_normal(10_000)
        assert found(X, codes, np.round(y / step) * step if step else y) == []
        assert found(X, codes, rng.poisson(np.exp(size * np.sin(X[:, 0])))) == []


@pytest.mark.parametrize(
    ("n_inputs", "where"),
    [(1, "where the input is from 3.38.* to 5.5"), (2, "its rows 22 to 36, counted")],
)
def test_the_warning_names_task_value_and_rows(n_inputs, where):
    X, codes, y, of_b = recorded(n_inputs)
    y[of_b[STUCK]] = 5.1
    rows = np.column_stack([X.astype(object), np.array(list("abc"))[codes]])
    model = MultiTaskGPRegressor("rbf", rank=1, max_iter=0)
    message = f"^15 of 40 targets of task 'b' are 5.1, {where}.*Leave them out"
    with pytest.warns(ConstantTargetWarning, match=message):
        model.fit(rows, y)
    with pytest.warns(ConstantTargetWarning, match="'b' in output 2 are 5.1"):
        model.fit(rows, np.column_stack([y * np.linspace(1.0, 2.0, len(y)), y]))
    model.fit(rows, y, alpha=np.full(len(y), 0.1))  # weighed rows are not asked


def test_the_value_is_that_of_y():
    X, codes, y, of_b = recorded()
    y[of_b[STUCK]] = 5.1
    logs = {"target_transform": (np.log, np.exp)}
    model = MultiTaskGPRegressor("rbf", rank=1, max_iter=0, **logs)
    with pytest.warns(ConstantTargetWarning, match="are 5.1, "):
        model.fit(np.column_stack([X, codes]), y)
