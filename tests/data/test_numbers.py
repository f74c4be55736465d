"""Columns of numbers, and what is said of those that are none."""

import datetime
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    PooledGP,
    WideRegressor,
)
from skmtgp._data.numbers import as_frame, by_rows, check_numbers
from skmtgp.inspection import CoverageDisplay
from skmtgp.metrics import coverage, normalized_mean_squared_error

DAY = pd.Timestamp("2026-01-02")
SECOND = np.timedelta64(1, "s")


def objects(values):
    array = np.empty(len(values), object)
    array[:] = values
    return array


NUMBERS = {
    "list": [1, 2.5],
    "array": np.array([1.0, 2.5], np.float32),
    "objects": objects([1, Decimal("2.5")]),
    "text": ["1", "2.5"],
    "Series": pd.Series([1, 2.5], dtype="Float64"),
    "category": pd.Series([1, 2.5], dtype="category"),
}


@pytest.mark.parametrize("values", NUMBERS.values(), ids=NUMBERS)
def test_numbers(values):
    found = check_numbers(values, "y")
    assert found.dtype == np.float64
    assert found.tolist() == [1.0, 2.5]


@pytest.mark.parametrize("values", [[1.0, 2.5], [[1.0, 2.5]], [1e308, 1e308]])
def test_an_array_of_finite_numbers_is_taken_as_it_is(values):
    values = np.array(values)
    assert check_numbers(values, "y") is values


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_array_of_numbers_that_are_not_finite(bad):
    for values in (np.array([1.0, bad]), np.array([[1.0, 3.0], [2.0, bad]])):
        with pytest.raises(ValueError, match="y"):
            check_numbers(values, "y")


def test_numbers_of_a_frame_are_row_after_row():
    found = check_numbers(pd.DataFrame({"a": [1.0, 2.0], "b": [3, 4]}), "X")
    assert found.flags.c_contiguous
    assert found.tolist() == [[1.0, 3.0], [2.0, 4.0]]
    assert by_rows(found) is found


TIMES = {
    "datetime64": np.array([DAY, DAY], "datetime64[ns]"),
    "timedelta64": np.array([SECOND, SECOND]),
    "Timestamps": [DAY, DAY],
    "dates": [DAY.date(), DAY.date()],
    "objects of datetime64": objects([np.datetime64("2026-01-02"), 1.0]),
    "objects of timedelta64": objects([SECOND, 1.0]),
    "Series": pd.Series([DAY, pd.NaT]),
    "Series with a time zone": pd.Series([DAY.tz_localize("UTC")] * 2),
    "durations": pd.Series([DAY - DAY, pd.NaT]),
    "category": pd.Series([DAY, DAY], dtype="category"),
    "missing ones": pd.Series([pd.NaT, pd.NaT]),
}


@pytest.mark.parametrize("values", TIMES.values(), ids=TIMES)
@pytest.mark.parametrize("estimator", [MultiTaskGPRegressor, BayesianLinearRegression])
def test_targets_that_are_times(estimator, values):
    """Of some unit, they would be numbers."""
    match = (
        r"^y must be numbers, but holds dates or times such as .* Convert it, to day"
    )
    with pytest.raises(ValueError, match=match):
        estimator().fit([[0.5, 1], [1.5, 1]], values)


@pytest.mark.parametrize("values", TIMES.values(), ids=TIMES)
def test_features_that_are_times(values):
    table = pd.DataFrame({"x": [0.5, 1.5], "when": values, "load": [1, 1]})
    match = "^Features must be numbers, but column 'when' holds dates or times such as"
    with pytest.raises(ValueError, match=match):
        BayesianLinearRegression().fit(table, [1.0, 2.0])
    with pytest.raises(ValueError, match=match.replace("'when'", "1")):
        BayesianLinearRegression().fit(table.to_numpy(dtype=object), [1.0, 2.0])


def test_arrays_that_are_times():
    table = np.array([[DAY, DAY], [DAY, DAY]], "datetime64[s]")
    match = "column 0 holds dates or times such as 2026-01-02"
    with pytest.raises(ValueError, match=match):
        BayesianLinearRegression().fit(table, [1.0, 2.0])


def test_one_of_several_outputs_that_is_a_time():
    y = pd.DataFrame({"u": [1.0, 2.0], "v": [DAY, DAY]})
    match = "^y must be numbers, but column 'v' holds dates"
    for target in (y, y.to_numpy()):
        name = match if target is y else match.replace("'v'", "1")
        with pytest.raises(ValueError, match=name):
            BayesianLinearRegression().fit([[0.5, 1], [1.5, 1]], target)


def test_times_in_frames_of_polars():
    """As one array they become integers."""
    polars = pytest.importorskip("polars")
    when = [datetime.datetime(2026, 1, 2), datetime.datetime(2026, 1, 3)]
    table = polars.DataFrame({"when": when, "load": [1, 1]})
    with pytest.raises(ValueError, match="column 'when' holds dates or times"):
        BayesianLinearRegression().fit(table, [1.0, 2.0])
    table = polars.DataFrame({"x": [0.5, 1.5], "load": [1, 1]})
    for y in (polars.Series(when), polars.DataFrame({"when": when})):
        with pytest.raises(ValueError, match=r"y must be numbers, but.* holds dates"):
            BayesianLinearRegression().fit(table, y)


def test_frames_of_others_keep_the_types_of_their_columns():
    polars = pytest.importorskip("polars")
    columns = {"a": [2**60 + 1], "b": [0.5], "c": ["u"], "d": [True]}
    found = as_frame(polars.DataFrame(columns))
    assert found.to_dict("list") == columns
    assert as_frame(found) is found


NOT_FINITE = {  # what is in rows 3 and 4 of 6
    "NaN": (np.nan, "NaN"),
    "infinity": (np.inf, "infinity"),
    "minus infinity": (-np.inf, "infinity"),
    "None": (None, "NaN"),
    "NA": (pd.NA, "NaN"),
}
REST = r": 2 of 6 values, the first in row 3\. .* impute those"
X = np.column_stack([np.arange(6.0), np.arange(6.0) ** 2, [0, 1] * 3])


@pytest.mark.parametrize(("value", "what"), NOT_FINITE.values(), ids=NOT_FINITE)
class TestNotFinite:
    def bad(self, value, column):
        table = X.copy() if isinstance(value, float) else X.astype(object)
        table[3:5, column] = value
        return table

    def test_feature(self, value, what):
        table, y = self.bad(value, 1), np.arange(6.0)
        with pytest.raises(
            ValueError, match=f"^Input X contains {what} in column 1{REST}"
        ):
            BayesianLinearRegression().fit(table, y)
        model = BayesianLinearRegression().fit(X, y)
        with pytest.raises(
            ValueError, match=f"^Input X contains {what} in column 1{REST}"
        ):
            model.predict(table)

    def test_feature_of_a_frame(self, value, what):
        table = pd.DataFrame(self.bad(value, 1), columns=["a", "b", "load"])
        with pytest.raises(ValueError, match=f"X contains {what} in column 'b'{REST}"):
            BayesianLinearRegression().fit(table, np.arange(6.0))

    def test_target(self, value, what):
        model, Y = BayesianLinearRegression(), self.bad(value, 1)
        with pytest.raises(ValueError, match=f"^Input y contains {what}{REST}"):
            model.fit(X, Y[:, 1])
        with pytest.raises(
            ValueError, match=f"^Input y contains {what} in column 1{REST}"
        ):
            model.fit(X, Y)
        frame = pd.DataFrame(Y, columns=["u", "v", "w"])
        with pytest.raises(
            ValueError, match=f"^Input y contains {what} in column 'v'{REST}"
        ):
            model.fit(X, frame)

    def test_metric_and_display(self, value, what):
        y, ones = self.bad(value, 1)[:, 1], np.ones(6)
        with pytest.raises(ValueError, match=f"^Input y_true contains {what}{REST}"):
            normalized_mean_squared_error(y, ones)
        with pytest.raises(ValueError, match=f"^Input y_std contains {what}{REST}"):
            coverage(ones, ones, y)
        with pytest.raises(ValueError, match=f"^Input y_mean contains {what}{REST}"):
            CoverageDisplay.from_predictions(ones, y, ones)


def test_all_columns_with_missing_values_are_told_at_once():
    table = pd.DataFrame(np.arange(32.0).reshape(4, 8), columns=list("abcdefgh"))
    table.iloc[1:3, [1, 3]] = np.nan
    match = r"in column 'b': 2 of 4 values, .* row 1; more in columns 'd' \(2\)\. Every"
    with pytest.raises(ValueError, match=match):
        check_numbers(table, "X")
    table.iloc[0] = np.inf
    match = r"columns 'b' \(3\), 'c' \(1\), .*, 'f' \(1\) and 2 others\. Every value"
    with pytest.raises(ValueError, match=match):
        check_numbers(table, "X")


def test_text_is_told_before_missing_values():
    table = pd.DataFrame({"a": [np.nan, 1.0], "operator": ["ann", "bob"]})
    with pytest.raises(ValueError, match="column 'operator' holds strings"):
        check_numbers(table, "X")


def test_values_of_another_kind_are_told_by_their_column():
    table = pd.DataFrame({"x": objects([1.0, {"a": 1}]), "load": [1, 1]})
    match = r"column 'x' holds \{'a': 1\}: float\(\) argument must be a string or a"
    with pytest.raises(TypeError, match=match):
        BayesianLinearRegression().fit(table, [1.0, 2.0])


def test_targets_that_are_text():
    y = pd.DataFrame({"u": [1.0, 2.0], "v": ["1.5", "high"]})
    with pytest.raises(
        ValueError, match=r"^y must be numbers, but column 'v' holds str"
    ):
        BayesianLinearRegression().fit([[0.5, 1], [1.5, 1]], y)


def test_targets_that_are_too_large_are_told_by_their_name():
    y = pd.DataFrame({"u": [1.0, 2.0], "v": [1e80, 1.0]})
    with pytest.raises(ValueError, match=r"y has values as large as .* in column 'v'"):
        BayesianLinearRegression().fit([[0.5, 1], [1.5, 1]], y)


@pytest.mark.parametrize("kind", [pd.DataFrame.copy, pd.DataFrame.to_numpy])
def test_what_has_no_rows_is_named(kind):
    frame, y = pd.DataFrame({"x": [1.0, 2.0], "load": [1, 2]}), pd.Series([1.0, 2.0])
    few, columns = frame[:0], pd.DataFrame({1: y, 2: y})
    for of_X, of_y, name in (few, y[:0], "X"), (frame, y[:0], "y"):
        with pytest.raises(ValueError, match=rf"^{name} has 0 sample\(s\) \(shape="):
            PooledGP(max_iter=0).fit(kind(of_X), of_y)
    with pytest.raises(ValueError, match=r"^X has 0 sample"):
        WideRegressor().fit(kind(few), columns[:0])
    with pytest.raises(ValueError, match=r"^X has 0 sample"):
        PooledGP(max_iter=0).fit(kind(frame), y).predict(kind(few))


def test_periods_are_dates():
    when = pd.DataFrame({"when": pd.period_range("2020-01", periods=2, freq="M")})
    match = r"'when' holds dates or times such as 2020-01\..*periods\.dt\.to_timestamp"
    with pytest.raises(ValueError, match=match):
        check_numbers(when, "X")


@pytest.mark.parametrize("fill", [0.0, 1.0])
def test_sparse_columns_are_dense(fill):
    codes = pd.arrays.SparseArray([0.0, 1.0, 1.0], fill_value=fill)
    frame = as_frame(pd.DataFrame({"a": codes, "b": ["u", "v", "w"]}))
    assert_array_equal(check_numbers(frame[["a"]], "X"), [[0.0], [1.0], [1.0]])
    assert frame["b"].tolist() == ["u", "v", "w"]


def test_lazy_frames_are_refused():
    polars = pytest.importorskip("polars")
    with pytest.raises(TypeError, match=r"no rows yet: pass what its \.collect"):
        as_frame(polars.DataFrame({"a": [1.0]}).lazy())
