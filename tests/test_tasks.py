import numpy as np
import pandas as pd
import pytest

from skmtgp import BayesianLinearRegression, MultiTaskGPRegressor
from skmtgp._labels import check_labels, encode_tasks
from skmtgp._tasks import (
    locate_task_column,
    split_table,
    task_labels,
)


@pytest.mark.parametrize(
    ("task_feature", "position"),
    [(0, 0), (2, 2), (-1, 2), (-3, 0), (np.int64(1), 1), ("load", 1)],
)
def test_column_is_found(task_feature, position):
    found = locate_task_column(task_feature, 3, np.array(["a", "load", "b"], object))
    assert found == position
    assert type(found) is int


@pytest.mark.parametrize("task_feature", [3, -4])
def test_column_out_of_range(task_feature):
    with pytest.raises(ValueError, match=f"{task_feature} is out of range: X has 3 co"):
        locate_task_column(task_feature, 3)


@pytest.mark.parametrize(
    ("task_feature", "kind"),
    [(True, "bool"), (np.False_, "bool"), (1.0, "float"), (None, "NoneType")],
)
def test_column_of_another_type(task_feature, kind):
    with pytest.raises(TypeError, match=rf"position \(int\) or the name .* not {kind}"):
        locate_task_column(task_feature, 3)


def test_column_name_without_names():
    with pytest.raises(ValueError, match=r"'load' names a column, .*set_output\("):
        locate_task_column("load", 3)


def test_column_name_that_is_not_there():
    with pytest.raises(ValueError, match=r"'load' is not a column: \['a', 'b'\]"):
        locate_task_column("load", 2, ["a", "b"])


@pytest.mark.parametrize(
    ("names", "advice"),
    [
        (
            ["num__x", "remainder__load"],
            r" Did you mean 'remainder__load'\? .*verbose_",
        ),
        (["load", "x"], r" Did you mean 'load'\?$"),
        (["x", "LOADS"], r" Did you mean 'LOADS'\?$"),
        ([0, "x"], r"'x'\]\.$"),
    ],
)
def test_column_name_that_is_meant(names, advice):
    name = "Load" if "load" in names else "load"
    with pytest.raises(ValueError, match=f"{name!r} is not a column: .*{advice}"):
        locate_task_column(name, 2, names)


LABELS = {
    "int": ([3, 1, 3], "i"),
    "int8": (np.array([3, 1, 3], np.int8), "i"),
    "uint8": (np.array([3, 1, 3], np.uint8), "u"),
    "float": (np.array([3.0, -1.0, 3.0]), "i"),
    "float32": (np.array([3.0, -1.0, 3.0], np.float32), "i"),
    "bool": (np.array([True, False, True]), "b"),
    "str": (["b", "a", "b"], "U"),
    "fixed-width str": (np.array(["b", "a", "b"]), "U"),
    "object of int": (np.array([3, 1, 3], object), "i"),
    "object of float": (np.array([3.0, 1, 3.0], object), "i"),
    "object of bool": (np.array([True, False, True], object), "b"),
    "object of NumPy bool": (np.array([np.True_, np.False_, np.True_], object), "b"),
    "Series": (pd.Series([3, 1, 3]), "i"),
    "Series of str": (pd.Series(["b", "a", "b"]), "U"),
    "string": (pd.Series(["b", "a", "b"], dtype="string"), "U"),
    "category of str": (pd.Series(["b", "a", "b"], dtype="category"), "U"),
    "category of int": (pd.Series([3, 1, 3], dtype="category"), "i"),
    "ordered category": (pd.Series(pd.Categorical([3, 1, 3], [3, 1], True)), "i"),
    "Int64": (pd.Series([3, 1, 3], dtype="Int64"), "i"),
    "UInt8": (pd.Series([3, 1, 3], dtype="UInt8"), "u"),
    "Float64": (pd.Series([3, 1, 3], dtype="Float64"), "i"),
    "boolean": (pd.Series([True, False, True], dtype="boolean"), "b"),
}


@pytest.mark.parametrize(("labels", "kind"), LABELS.values(), ids=LABELS)
def test_labels_keep_their_type_and_value(labels, kind):
    found = check_labels(labels)
    assert type(found) is np.ndarray
    assert found.dtype.kind in (kind, "i" if kind == "u" else kind)
    assert found.tolist() == list(labels)


@pytest.mark.skipif(not hasattr(np.dtypes, "StringDType"), reason="needs NumPy 2")
def test_labels_of_numpys_variable_width_strings():
    found = check_labels(np.array(["b", "a", "b"], np.dtypes.StringDType()))
    assert found.dtype.kind == "U"
    assert found.tolist() == ["b", "a", "b"]


def test_an_unused_category_is_no_task():
    labels = pd.Series(pd.Categorical(["a", "b"], ["a", "b", "c"]))
    assert check_labels(labels).tolist() == ["a", "b"]


MISSING = {
    "NaN": np.array([1.0, np.nan, 2.0]),
    "None": np.array(["a", None, "b"], object),
    "NaN in a list of str": ["a", np.nan, "b"],
    "NaN among str": np.array(["a", np.nan, "b"], object),
    "NA in Int64": pd.Series([1, pd.NA, 2], dtype="Int64"),
    "NA in boolean": pd.Series([True, pd.NA, False], dtype="boolean"),
    "NA in string": pd.Series(["a", pd.NA, "b"], dtype="string"),
    "missing category": pd.Series(["a", None, "b"], dtype="category"),
}


@pytest.mark.parametrize("labels", MISSING.values(), ids=MISSING)
def test_missing_labels(labels):
    with pytest.raises(ValueError, match=r"1 missing labels .* first in row 1"):
        check_labels(labels)


def test_a_missing_label_is_told_by_its_index():
    labels = pd.Series(["a", None], index=["monday", "tuesday"])
    with pytest.raises(ValueError, match=r"first in row 1, index tuesday\. Every"):
        check_labels(labels)
    with pytest.raises(ValueError, match=r"first in row 1\. Every"):
        check_labels(labels.to_numpy())


def test_continuous_labels():
    message = r"2 of 3 are fractional numbers such as 0\.5.*remainder='passthrough'"
    with pytest.raises(ValueError, match=message):
        check_labels(np.array([1.0, 0.5, 2.25]))


@pytest.mark.parametrize("label", [np.inf, -np.inf, 1e300, 2.0**53 + 2])
def test_floats_that_are_not_exact_integers(label):
    with pytest.raises(ValueError, match=r"within 2\*\*53.*1 of 2 do not, such as"):
        check_labels(np.array([1.0, label]))


def test_large_integers_are_kept():
    labels = np.array([2**60, 2**60 + 1])
    assert check_labels(labels).tolist() == labels.tolist()
    assert check_labels(np.array([2.0**53, -(2.0**53)])).tolist() == [2**53, -(2**53)]


@pytest.mark.parametrize(
    ("labels", "error", "message"),
    [
        ([1, "a"], ValueError, r"not a mixture: \['int', 'str'\]"),
        ([(1, 2), "a"], TypeError, "must be a string or a number, not .*tuple"),
    ],
)
def test_labels_of_several_types(labels, error, message):
    mixed = np.empty(2, object)
    mixed[:] = labels
    with pytest.raises(error, match=message):
        check_labels(mixed)


@pytest.mark.parametrize("dtype", ["datetime64[D]", "S1", "complex128"])
def test_labels_of_a_type_that_is_none(dtype):
    with pytest.raises(ValueError, match=r"integers or strings, not .*task_feature"):
        check_labels(np.array([1, 2]).astype(dtype))


def test_labels_that_are_not_a_column():
    with pytest.raises(ValueError, match=r"one-dimensional, .* shape \(2, 1\)"):
        check_labels(np.array([[1], [2]]))


def test_split_of_an_array():
    X = np.array([[0.5, 2.0, 1.5], [0.25, 1.0, 2.5]])
    features, labels = split_table(X, 1)
    np.testing.assert_array_equal(features, X[:, [0, 2]])
    assert labels.tolist() == [2, 1]


@pytest.mark.parametrize("labels", [["b", "a"], [True, False], [2, 1]])
@pytest.mark.parametrize("dtype", ["float64", "float32", "Float64", "object"])
def test_split_of_a_frame_keeps_the_type(labels, dtype):
    X = pd.DataFrame({"x": [0.5, 0.25], "load": labels}).astype({"x": dtype})
    features, found = split_table(X, 1)
    assert features.dtype == np.float64
    np.testing.assert_array_equal(features, [[0.5], [0.25]])
    assert found.tolist() == labels
    assert found.dtype.kind == np.array(labels).dtype.kind


def test_split_with_a_missing_feature():
    X = pd.DataFrame({"x": pd.array([0.5, None], dtype="Float64"), "load": ["a", "b"]})
    with pytest.raises(ValueError, match="X contains NaN"):
        split_table(X, 1)


DAY = pd.Timestamp("2026-01-02")
NO_NUMBERS = {
    "the tasks": ({"site": ["A", "B"]}, r"'site' holds .*'A'.* task_feature='site'"),
    "text": ({"u": ["1.5", "high"]}, r"'u' holds strings such as 'high'.*OneHotEnc"),
    "missing text": ({"u": [None, "high"]}, "'u' holds strings such as 'high'"),
    "categories": ({"u": pd.Categorical(["A", "B"])}, "'u' holds strings such as 'A'"),
    "dates": ({"day": [DAY, DAY]}, "'day' holds dates or times such as 2026-01-02"),
    "objects": ({"day": np.array([DAY, 1.0], object)}, "'day' holds dates or times"),
    "durations": ({"age": [DAY - DAY, pd.NaT]}, "'age' holds dates or times"),
}


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize(("column", "message"), NO_NUMBERS.values(), ids=NO_NUMBERS)
def test_split_names_the_feature_that_is_no_number(column, message, alone):
    X = pd.DataFrame({**column, "x": [0.5, 0.25], "z": [1, 2]})
    X = X.drop(columns="x") if alone else X
    with pytest.raises(ValueError, match=f"Features must be numbers, .*{message}"):
        split_table(X, X.columns.get_loc("z"))


def test_split_names_the_position_of_a_feature_without_a_name():
    X = np.array([[0.5, "A", 1], [0.25, "B", 2]], object)
    with pytest.raises(ValueError, match=r"column 1 holds .*'A'.*\(it is column 2 now"):
        split_table(X, 2)


def test_split_of_numbers_in_text():
    features, _ = split_table(np.array([["0.5", "a"], ["0.25", "b"]], object), 1)
    np.testing.assert_array_equal(features, [[0.5], [0.25]])


FRAME = pd.DataFrame({"load": ["b", "a"], "x": [0.5, 0.25]})


@pytest.mark.parametrize(
    ("X", "task_feature", "expected"),
    [
        (FRAME, "load", ["b", "a"]),
        (FRAME, -2, ["b", "a"]),
        (FRAME.to_numpy(), 0, ["b", "a"]),
        (FRAME.to_numpy().tolist(), 0, ["b", "a"]),
        ([[0.5, 2], [0.25, 1]], -1, [2, 1]),
        (np.array([[0.5, 2.0], [0.25, 1.0]]), -1, [2, 1]),
    ],
)
def test_labels_of_a_table(X, task_feature, expected):
    assert task_labels(X, task_feature).tolist() == expected


@pytest.mark.parametrize("labels", [["b", "a"], [2, 1]])
def test_labels_of_a_frame_of_polars(labels):
    X = pytest.importorskip("polars").DataFrame({"load": labels, "x": [0.5, 0.25]})
    assert task_labels(X, "load").tolist() == task_labels(X, 0).tolist() == labels


def test_labels_of_a_table_that_is_none():
    with pytest.raises(ValueError, match="two-dimensional, but has 1 dimensions"):
        task_labels([1, 2])


@pytest.mark.parametrize("tasks", [[1, 3, 5], ["a", "b", "long"], [False, True]])
def test_codes_are_positions(tasks):
    tasks = np.array(tasks)
    codes = np.array([1, 0, 1, len(tasks) - 1])
    np.testing.assert_array_equal(encode_tasks(tasks[codes], tasks), codes)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ([1, 4, 9, 4], "Unknown tasks 4, 9: the model knows 1, 2, 3"),
        (["1", "2"], "Unknown tasks '1', '2': the model knows 1, 2, 3"),
        (range(10, 17), r"10, 11, 12, 13, 14, \.\.\. \(7 in all\): the model knows"),
    ],
)
def test_unknown_tasks(labels, message):
    with pytest.raises(ValueError, match=message):
        encode_tasks(np.array(labels), np.array([1, 2, 3]))


def test_the_advice_on_unknown_tasks_names_their_column():
    with pytest.raises(ValueError, match=r"TaskStratifiedKFold\(task_feature=\.\.\.\)"):
        encode_tasks(np.array([4]), np.array([1, 2]))


@pytest.mark.parametrize("can_join", [False, True])
def test_an_unknown_task_may_join_some_models(can_join):
    with pytest.raises(ValueError, match="Unknown task 4: the model knows") as error:
        encode_tasks(np.array([4, 4]), np.array([1, 2]), can_join=can_join)
    assert ("or let it join with add_task" in str(error.value)) == can_join
    assert "labels are" not in str(error.value)


def test_a_number_is_no_known_string():
    match = "Unknown task 1: .*'1', 'a'.* labels are numbers, the model's are strings"
    with pytest.raises(ValueError, match=match):
        encode_tasks(np.array([1]), np.array(["1", "a"]))


@pytest.mark.parametrize("names", [None, ["a", "b", "temperature"]])
@pytest.mark.parametrize("estimator", [MultiTaskGPRegressor, BayesianLinearRegression])
def test_column_that_cannot_hold_the_tasks(estimator, names):
    X = np.column_stack([[1, 1, 2], [2, 1, 1], [0.5, 1.0, 2.0]])
    column, table = (2, X) if names is None else ("temperature", pd.DataFrame(X))
    if names is not None:
        table.columns = names
    of = rf"\(task_feature=-1 of {estimator.__name__}\)"
    with pytest.raises(ValueError, match=rf"^Column {column!r} {of} cannot hold the"):
        estimator().fit(table, [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=rf"^Column {column!r} \(task_feature=-1\) "):
        task_labels(table)
