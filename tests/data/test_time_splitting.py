"""Folds in order of time, which test later rows of known tasks."""

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
import sklearn
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from sklearn.base import clone
from sklearn.model_selection import (
    GridSearchCV,
    TimeSeriesSplit,
    cross_val_score,
    cross_validate,
    learning_curve,
)
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from strategies import examples

from skmtgp import BayesianLinearRegression, WideRegressor, stack_tasks
from skmtgp.exceptions import TaskColumnWarning
from skmtgp.model_selection import TaskTimeSeriesSplit

WEEKS = pd.date_range("2026-01-05", periods=12, freq="7D")
late = pytest.mark.filterwarnings("ignore:No fold tests")


def panel(*opens, n=12):
    """Weeks with the task last; store k opens in week opens[k]."""
    rows = [(float(t), k) for t in range(n) for k, of in enumerate(opens) if t >= of]
    return np.array(rows)


def frame(*opens, n=12):
    X = panel(*opens, n=n).astype(int)
    stores = np.array(["a", "b", "c", "d"])[X[:, 1]]
    return pd.DataFrame({"date": WEEKS[X[:, 0]], "store": stores})


def folds(cv, table, *args):
    return [(sorted(train), test.tolist()) for train, test in cv.split(table, *args)]


def by_time(*args, **params):
    return TaskTimeSeriesSplit(*args, time_feature=0, **params)


@st.composite
def tables(draw):
    """A panel with gaps and rows in any order, and a splitter of it."""
    n_times, n_tasks = draw(st.integers(6, 15)), draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    opens, n = rng.integers(n_times, size=n_tasks), 3 * n_times
    rows = [(rng.integers(of, n_times, n), np.full(n, k)) for k, of in enumerate(opens)]
    rows.append(
        (np.repeat(np.arange(n_times), 3), np.zeros(n))
    )  # task 0 is always there
    times, tasks = np.hstack(rows)
    X = np.column_stack([times / 4 - 1.0, tasks])[rng.permutation(len(tasks))]
    n_splits, size = draw(st.integers(2, 3)), draw(st.sampled_from([None, 1]))
    params = {"test_size": size, "min_train_rows": draw(st.integers(1, 3))}
    params["max_train_size"] = draw(st.sampled_from([None, 2, 5]))
    most = n_times - n_splits * (size or n_times // (n_splits + 1)) - 1
    return X, by_time(n_splits, gap=draw(st.integers(0, most)), **params)


@late
@given(tables())
@examples(60)
def test_laws(drawn):
    (X, cv), n = drawn, len(np.unique(drawn[0][:, 0]))
    position = np.unique(X[:, 0], return_inverse=True)[1]
    size = cv.test_size or n // (cv.n_splits + 1)
    tested = []
    for k, (train, test) in enumerate(cv.split(X)):
        first = n - (cv.n_splits - k) * size
        assert position[train].max() + cv.gap < first <= position[test].min()
        if cv.max_train_size:
            assert position[train].min() >= first - cv.gap - cv.max_train_size
        rows = np.bincount(X[train, -1].astype(int), minlength=4)
        assert (rows[X[test, -1].astype(int)] >= cv.min_train_rows).all()
        assert ((rows == 0) | (rows >= cv.min_train_rows)).all()
        known = rows[X[:, -1].astype(int)] > 0
        at = (first <= position) & (position < first + size)
        assert test.tolist() == np.flatnonzero(at & known).tolist()
        tested.append(test)
    tested = np.hstack(tested)
    assert len(set(tested)) == len(tested)
    assert cv.get_n_splits() == cv.get_n_splits(X, None, None) == k + 1


@late
@given(tables(), st.integers(0, 1000))
@examples(30)
def test_the_order_of_rows_does_not_matter(drawn, seed):
    X, cv = drawn
    order = np.random.default_rng(seed).permutation(len(X))
    for (train, test), (rows, others) in zip(
        cv.split(X), cv.split(X[order]), strict=True
    ):
        assert sorted(order[rows]) == sorted(train)
        assert sorted(order[others]) == test.tolist()


@given(st.integers(2, 4), st.integers(0, 2), st.sampled_from([None, 1, 2]))
@examples(30)
def test_of_one_task_and_a_row_at_each_time_it_is_that_of_rows(n_splits, gap, size):
    params = {"gap": gap, "test_size": size, "max_train_size": 5}
    X = panel(0)
    assert folds(by_time(n_splits, **params), X) == [
        (train.tolist(), test.tolist())
        for train, test in TimeSeriesSplit(n_splits, **params).split(X)
    ]


DATES = {
    "dates": lambda w: WEEKS[w],
    "dates of Python": lambda w: pd.Series(WEEKS[w]).dt.date,
    "with a zone": lambda w: WEEKS[w].tz_localize("Europe/Zurich"),
    "periods": lambda w: WEEKS[w].to_period("W"),
    "durations": lambda w: WEEKS[w] - WEEKS[0],
    "integers": lambda w: w - 20,
    "numbers": lambda w: w / 7,
    "Int64": lambda w: pd.Series(w, dtype="Int64"),
    "categories": lambda w: pd.Categorical(w.astype(float)),
    "text of numbers": lambda w: w.astype(str),  # "10" is after "9"
}


@late
@pytest.mark.parametrize("kind", ["pandas", "array", "list", "polars"])
@pytest.mark.parametrize("dates", DATES)
def test_tables(dates, kind):
    X = panel(0, 2, 9).astype(int)
    expected = folds(by_time(3), X)
    table = pd.DataFrame({"date": DATES[dates](X[:, 0]), "load": X[:, 1], "x": 1.0})
    if kind == "polars":
        if dates in ("periods", "categories"):
            pytest.skip("polars has no such type")
        table = pytest.importorskip("polars").from_pandas(table)
    elif kind != "pandas":
        table = table.to_numpy() if kind == "array" else table.to_numpy().tolist()
    names = [(0, 1), (-3, -2)]
    names += [("date", "load")] if kind in ("pandas", "polars") else []
    for time, task in names:
        cv = TaskTimeSeriesSplit(3, time_feature=time, task_feature=task)
        assert folds(cv, table) == expected


@late
def test_tasks_of_a_training_set_come_in_turns():
    X = panel(0, 0, 5)[::-1]
    for train, _ in by_time(3).split(X):
        rows = X[train]
        tasks = set(rows[:, -1])
        assert set(rows[: len(tasks), -1]) == tasks
        for task in tasks:
            assert (np.diff(rows[rows[:, -1] == task, 0]) < 0).all()


def test_a_task_that_begins_late():
    X, tests = panel(0, 7), []
    for train, test in by_time(3).split(X):
        assert set(X[test, -1]) <= set(X[train, -1])
        tests.append(sorted(set(X[test, -1])))
    assert tests == [[0], [0], [0, 1]]


def test_tasks_that_no_fold_tests():
    X = frame(0, 9, 10, 0)
    X = X[(X["store"] != "d") | (X["date"] < WEEKS[3])]  # d is closed before
    cv = TaskTimeSeriesSplit(3, time_feature="date")
    match = "No fold tests rows of task 'b', 'c': too few rows come before"
    with pytest.warns(TaskColumnWarning, match=match) as told:
        next(cv.split(X))
    assert len(told) == 1


def test_too_few_rows_to_train():
    X = panel(0, 5)
    few, more = by_time(3), by_time(3, min_train_rows=2)
    of_few, of_more = (
        [(np.bincount(X[rows, -1].astype(int))).tolist() for rows in of]
        for cv in (few, more)
        for of in [[rows for fold in cv.split(X) for rows in fold]]
    )
    assert of_few == [[3], [3], [6, 1], [3, 3], [9, 4], [3, 3]]
    assert of_more == [[3], [3], [6], [3], [9, 4], [3, 3]]


@pytest.mark.parametrize(
    ("params", "table", "error", "match"),
    [
        ({"time_feature": 2}, panel(0), ValueError, "time_feature=2 is out of range"),
        ({"time_feature": "day"}, panel(0), ValueError, "X has no column names"),
        (
            {"time_feature": 0.5},
            panel(0),
            TypeError,
            "time_feature=0.5 must be the pos",
        ),
        (
            {"time_feature": 1},
            panel(0),
            ValueError,
            r"Column 1 .* also the task column",
        ),
        ({"time_feature": "store"}, frame(0), ValueError, "'store' .* also the task"),
        (
            {"time_feature": "Date"},
            frame(0),
            ValueError,
            "time_feature='Date' is not a column: .* Did you mean 'date'",
        ),
        (
            {"time_feature": "date"},
            frame(0).assign(x=1).set_index("date"),
            ValueError,
            r"time_feature='date' is in the index .* X\.reset_index\('date'\)",
        ),
        ({"task_feature": 0}, panel(0) + 0.5, ValueError, "are fractional"),
        ({}, csr_array(panel(0)), TypeError, "but TaskTimeSeriesSplit reads"),
        ({}, np.empty((0, 2)), ValueError, "Column 0 .* has 0"),
        ({}, panel(0)[:, :1].ravel(), ValueError, "must be two-dimensional"),
    ],
)
def test_bad_tables(params, table, error, match):
    params = {"time_feature": 0} | params
    with pytest.raises(error, match=match):
        next(TaskTimeSeriesSplit(2, **params).split(table))


@pytest.mark.parametrize(
    ("times", "match"),
    [
        ([1, 2, np.nan, 4], "'t' .* has 1 missing times, the first in row 2. Fill"),
        ([WEEKS[0], None, None, WEEKS[1]], "has 2 missing times, the first in row 1"),
        ([1.0, 2.0, 3.0, np.inf], "Column 't' .* holds inf, but times must be"),
        (["5 Jan", "12 Jan", "2", "3"], "holds '5 Jan', but .* by pd.to_datetime"),
        ([1, "2", WEEKS[0], 3], r"holds Timestamp\(.*by pd.to_datetime"),
        ([WEEKS[0], WEEKS[0].date(), WEEKS[1], WEEKS[2]], "of several types"),
        ([WEEKS[0], WEEKS[1].tz_localize("UTC")] * 2, "'t' .* no common order.*to_d"),
        (pd.Categorical([1, 2, None, 4]), "has 1 missing times, the first in row 2"),
        ([1j, 2j, 3j, 4j], r"holds .*1j.*, but times must be finite numbers or dates"),
    ],
)
def test_bad_times(times, match):
    X = pd.DataFrame({"t": times, "store": "a"})
    with pytest.raises(ValueError, match=match):
        next(TaskTimeSeriesSplit(2, time_feature="t").split(X))


@pytest.mark.parametrize(
    "times",
    [[Fraction(k, 3) for k in range(6)], [2**70 + k for k in range(6)], list("012345")],
)
def test_numbers_of_any_type(times):
    X = pd.DataFrame({"t": times, "store": "a"})
    folds = TaskTimeSeriesSplit(2, time_feature="t").split(X)
    assert [test.tolist() for _, test in folds] == [[2, 3], [4, 5]]


@pytest.mark.parametrize(
    ("params", "match"),
    [
        ({"n_splits": 5}, r"n_splits=5, test_size=1 and gap=0 need 6 distinct"),
        (
            {"test_size": 2},
            r"test_size=2 and gap=0 need 5 .*'date'.* has 4\. Set a sm",
        ),
        ({"gap": 2}, "gap=2 need 5 distinct times or more. Column 'date'"),
    ],
)
def test_too_few_times(params, match):
    cv = TaskTimeSeriesSplit(**{"n_splits": 2, "time_feature": "date"} | params)
    with pytest.raises(ValueError, match=match):
        next(cv.split(frame(0, 0, n=4)))


def test_a_fold_without_a_row_to_test():
    X = panel(0, 8)
    X = X[(X[:, 1] == 1) | (X[:, 0] < 6)]
    with pytest.raises(ValueError, match=r"Fold 2 of 3 has no row .* larger test_size"):
        list(by_time(3).split(X))


@pytest.mark.parametrize(
    ("params", "error", "match"),
    [
        ({"n_splits": 1}, ValueError, "n_splits=2 or more"),
        ({"n_splits": 2.0}, ValueError, "must be of Integral type"),
        ({"gap": -1}, ValueError, "gap=-1 must be an integer of 0 or more"),
        ({"gap": None}, TypeError, r"gap=None must be an integer of 0 or more\.$"),
        ({"test_size": 0}, ValueError, "test_size=0 must be an .* 1 or more, or None"),
        ({"test_size": 0.2}, TypeError, "test_size=0.2 must be an integer"),
        ({"max_train_size": 0}, ValueError, "max_train_size=0 must be"),
        ({"min_train_rows": True}, TypeError, "min_train_rows=True must be"),
    ],
)
def test_bad_parameters(params, error, match):
    with pytest.raises(error, match=match):
        by_time(**params)


def test_groups_are_not_used():
    X = panel(0, 0)
    with pytest.warns(UserWarning, match="ignored by TaskTimeSeriesSplit"):
        found = folds(by_time(2), X, X[:, 0], X[:, 1])
    assert found == folds(by_time(2), X)


def test_repr():
    assert repr(by_time(3, gap=1)) == (
        "TaskTimeSeriesSplit(gap=1, max_train_size=None, min_train_rows=1, "
        "n_splits=3,\n"
        "          task_feature=-1, test_size=None, time_feature=0)"
    )
    with pytest.raises(TypeError, match="time_feature"):
        TaskTimeSeriesSplit()


class TestInScikitLearn:
    """With a regression for each task, which is exact and quick."""

    X = frame(0, 0, 5)
    y = (X["date"] - WEEKS[0]).dt.days * X["store"].map({"a": 1.0, "b": 2.0, "c": 3.0})
    cv = TaskTimeSeriesSplit(3, time_feature="date", task_feature="store")
    model = make_pipeline(
        FunctionTransformer(lambda X: X.assign(date=(X["date"] - WEEKS[0]).dt.days)),
        BayesianLinearRegression(task_feature="store"),
    )
    options = {"cv": cv, "error_score": "raise"}

    @pytest.mark.parametrize("n_jobs", [None, 2])
    def test_scores(self, n_jobs):
        found = cross_validate(
            clone(self.model), self.X, self.y, **self.options, n_jobs=n_jobs
        )
        assert found["test_score"].min() > 0.99

    def test_grid_search(self):
        grid = {"bayesianlinearregression__weight_variance": [1e-6, 1e6]}
        for routed in (False, True):
            with sklearn.config_context(enable_metadata_routing=routed):
                search = GridSearchCV(self.model, grid, **self.options)
                search.fit(self.X, self.y)
            assert list(search.best_params_.values()) == [1e6]

    def test_learning_curve(self):
        sizes, _, test = learning_curve(
            self.model,
            self.X,
            self.y,
            cv=self.cv,
            train_sizes=[4, 6],
            error_score="raise",
        )
        assert sizes.tolist() == [4, 6]
        assert np.isfinite(test).all()

    def test_wide_tables(self):
        """A column that begins late stops TimeSeriesSplit; stacked rows do not."""
        t = pd.DataFrame({"t": np.arange(12.0)})
        Y = pd.DataFrame({"a": t["t"], "b": -t["t"], "c": t["t"].where(t["t"] > 4)})
        wide = WideRegressor(BayesianLinearRegression())
        with pytest.raises(ValueError, match="Column 'c' of y has no value"):
            cross_val_score(wide, t, Y, cv=TimeSeriesSplit(3), error_score="raise")
        first = TimeSeriesSplit(3, test_size=2)
        assert cross_val_score(wide, t, Y, cv=first, error_score="raise").min() > 0.9
        X, y = stack_tasks(t.join(Y), list(Y))
        cv = TaskTimeSeriesSplit(3, time_feature="t")
        model = BayesianLinearRegression()
        assert cross_val_score(model, X, y, cv=cv, error_score="raise").min() > 0.9
