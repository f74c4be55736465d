import datetime
import tracemalloc
import uuid
from decimal import Decimal
from enum import Enum, IntEnum
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

from skmtgp import BayesianLinearRegression
from skmtgp._data.labels import (
    alike,
    check_labels,
    encode_tasks,
    rows_by_code,
    sorted_tasks,
)
from skmtgp.metrics import normalized_mean_squared_error

BIG = 2**53

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
    assert type(found.tasks) is np.ndarray
    assert found.tasks.dtype.kind in (kind, "i" if kind == "u" else kind)
    assert found.tasks.tolist() == sorted(set(labels))
    assert found.of_rows().tolist() == list(labels)


@pytest.mark.skipif(not hasattr(np.dtypes, "StringDType"), reason="needs NumPy 2")
def test_labels_of_numpys_variable_width_strings():
    found = check_labels(np.array(["b", "a", "b"], np.dtypes.StringDType()))
    assert found.tasks.dtype.kind == "U"
    assert found.of_rows().tolist() == ["b", "a", "b"]


def test_an_unused_category_is_no_task():
    labels = pd.Series(pd.Categorical(["a", "b"], ["a", "b", "c"]))
    assert check_labels(labels).tasks.tolist() == ["a", "b"]


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
    with pytest.raises(ValueError, match=r"1 missing label .* first in row 1"):
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


@pytest.mark.parametrize("label", [np.inf, -np.inf, 1e300, 2.0**53, -(2.0**53)])
def test_floats_that_are_not_exact_integers(label):
    with pytest.raises(ValueError, match=r"within 2\*\*53.*1 of 2 do not, such as"):
        check_labels(np.array([1.0, label]))


def test_large_integers_are_kept():
    labels = np.array([2**60, 2**60 + 1])
    assert check_labels(labels).of_rows().tolist() == labels.tolist()
    largest = np.array([-1.0, 1.0]) * (2**53 - 1)
    assert check_labels(largest).of_rows().tolist() == largest.tolist()


class Site(str, Enum):  # noqa: UP042 - as before Python 3.11
    NORTH = "the north"
    SOUTH = "the south"


class Number(IntEnum):
    ONE = 1
    TWO = 2


def objects(labels):
    """As an array of objects, whatever they are."""
    array = np.empty(len(labels), object)
    array[:] = labels
    return array


EXACTLY = {  # labels that differ, and what they are in `tasks_`
    "enumeration of str": ([*Site], ["the north", "the south"]),
    "enumeration of int": ([*Number], [1, 2]),
    "NumPy's str": ([np.str_("a"), np.str_("ab")], ["a", "ab"]),
    "NUL inside": (["a\0b", "a\0c"], ["a\0b", "a\0c"]),
    "blanks": (["", "a", "a "], ["", "a", "a "]),
    "another normal form": (["e\u0301", "\xe9"], ["e\u0301", "\xe9"]),
    "beyond 2**53": ([BIG, BIG + 1], [BIG, BIG + 1]),
    "beyond 2**63": ([2**63 + 1, 2**63 + 2], [2**63 + 1, 2**63 + 2]),
    "NumPy's uint64": ([np.uint64(BIG), np.uint64(BIG + 1)], [BIG, BIG + 1]),
    "fractions that are whole": ([Fraction(2), Fraction(3)], [2, 3]),
    "bool of Python and NumPy": ([False, np.True_], [False, True]),
    "bool of NumPy and int": ([np.True_, 2], [1, 2]),
}


@pytest.mark.parametrize("container", [list, objects, pd.Series, pd.Categorical])
@pytest.mark.parametrize(("labels", "tasks"), EXACTLY.values(), ids=EXACTLY)
def test_labels_are_never_merged(labels, tasks, container):
    found = check_labels(container([*labels, *labels]))
    assert found.tasks.tolist() == tasks
    assert found.of_rows().tolist() == tasks * 2
    kind = np.array(tasks).dtype.kind
    assert found.tasks.dtype.kind in (kind, "u" if kind == "i" else kind)


@pytest.mark.parametrize("dtype", ["Int64", "UInt64", "int64[pyarrow]"])
def test_nullable_integers_are_not_rounded(dtype):
    if "pyarrow" in dtype:
        pytest.importorskip("pyarrow")
    labels = pd.Series([BIG, BIG + 1], dtype=dtype)
    assert check_labels(labels).tasks.tolist() == [BIG, BIG + 1]


@pytest.mark.parametrize("kind", ["str", "Categorical", "int"])
def test_series_of_polars(kind):
    polars = pytest.importorskip("polars")
    labels = [BIG, BIG + 1] if kind == "int" else ["a\0b", "longer"]
    series = polars.Series(labels)
    series = series.cast(polars.Categorical) if kind == "Categorical" else series
    assert check_labels(series).tasks.tolist() == labels


@pytest.mark.parametrize("container", [list, objects])
def test_integers_beside_a_float_are_not_rounded(container):
    labels = [1.0, BIG + 1, BIG + 2]
    assert check_labels(container(labels)).tasks.tolist() == labels


def test_equal_labels_of_several_types_are_one_task():
    assert check_labels(["the north", *Site]).codes.tolist() == [0, 0, 1]
    assert check_labels([*Number, 1, 2.0, np.uint8(2)]).codes.tolist() == [
        0,
        1,
        0,
        1,
        1,
    ]


@pytest.mark.parametrize("container", [list, objects, pd.Series, pd.Categorical])
def test_strings_that_numpy_cannot_hold(container):
    with pytest.raises(ValueError, match=r"label 's\\x00' ends with a NUL .* without"):
        check_labels(container(["s", "s\0"]))


def test_strings_of_polars_that_numpy_cannot_hold():
    series = pytest.importorskip("polars").Series(["s", "s\0"])
    with pytest.raises(ValueError, match="ends with a NUL"):
        check_labels(series)


@pytest.mark.parametrize("labels", [[-1, 2**63], [2**64, 1], [-(2**63) - 1, 0]])
def test_integers_that_numpy_cannot_hold(labels):
    with pytest.raises(ValueError, match=r"must lie within 2\*\*63, but .*as strings"):
        check_labels(labels)


@pytest.mark.parametrize(
    ("label", "dtype", "digits"),
    [(2.0**24, np.float32, 24), (2.0**11, np.float16, 11), (2.0**53, "longdouble", 53)],
)
def test_floats_that_may_be_rounded_integers(label, dtype, digits):
    """2**24 + 1 is 2**24 as a float32."""
    match = rf"within 2\*\*{digits}, below which .* but 1 of 2 do not, such as"
    with pytest.raises(ValueError, match=match):
        check_labels(np.array([label, 1.0], dtype))
    whole = np.array([label - 1.0, 1.0], dtype)
    assert check_labels(whole).of_rows().tolist() == whole.tolist()


@pytest.mark.parametrize(
    ("labels", "match"),
    [
        ([1, 2.0, 0.5], "1 of 3 are fractional numbers such as 0.5"),
        ([Fraction(BIG + 2, BIG + 1), 1], f"such as {BIG + 2}/{BIG + 1}"),
        ([2.0**53, 1], r"1 of 2 do not, such as 9007199254740992\.0"),
    ],
)
def test_objects_that_are_no_integers(labels, match):
    with pytest.raises(ValueError, match=match):
        check_labels(labels)


NEITHER = {
    "tuple": ((1, 2), r"tuple, such as \(1, 2\)"),
    "bytes": (b"a", "bytes, such as b'a'"),
    "NumPy's bytes": (np.bytes_(b"a"), "bytes_, such as .*b'a'"),
    "date": (datetime.date(2026, 1, 2), r"date, such as datetime.date\(2026, 1, 2\)"),
    "Timestamp": (pd.Timestamp("2026-01-02"), "Timestamp, such as .*2026-01-02"),
    "datetime64": (np.datetime64("2026-01-02"), "datetime64, such as .*2026-01-02"),
    "UUID": (uuid.UUID(int=7), "UUID, such as .*00000007"),
    "Decimal": (Decimal(1), r"Decimal, such as Decimal\('1'\)"),
    "dict": ({"a": 1}, r"dict, such as \{'a': 1\}"),
}


@pytest.mark.parametrize(("label", "what"), NEITHER.values(), ids=NEITHER)
def test_labels_that_are_neither_text_nor_numbers(label, what):
    match = rf"all strings or all numbers, not {what}.* in row 1\. .*\.astype\(str\)"
    with pytest.raises(TypeError, match=match):
        check_labels(objects(["a", label]))
    table = pd.DataFrame(
        {"x": [0.5, 1.0], "who": objects([label, label])}, dtype=object
    )
    match = r"^Column 'who' \(task_feature='who' of Bayes.*\) cannot hold the tasks: "
    with pytest.raises(TypeError, match=match + f".*not {what}"):
        BayesianLinearRegression(task_feature="who").fit(table, [1.0, 2.0])


def test_labels_of_several_types():
    match = r"mixture: \['int', 'str'\]\. .*\.astype\(str\)"
    with pytest.raises(ValueError, match=match):
        check_labels([1, "a"])


@pytest.mark.parametrize("container", ["list", "objects", "category"])
def test_one_long_label_is_held_once(container):
    """Arrays of text are as wide as the longest, in every row."""
    n, long = 2000, "a" * 100_000
    labels = [long, *["b"] * (n - 1)]
    table = np.column_stack([np.arange(float(n)).astype(object), objects(labels)])
    if container == "list":
        table = table.tolist()
    if container == "category":
        table = pd.DataFrame({"x": np.arange(n), "load": pd.Categorical(labels)})
    y, model = np.sin(np.arange(n)), BayesianLinearRegression()
    tracemalloc.start()
    model.fit(table, y).predict(table)
    assert normalized_mean_squared_error(y, y + 1.0, tasks=labels[1:] + labels[1:2]) > 0
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()
    assert model.tasks_.tolist() == [long, "b"]


@pytest.mark.parametrize(
    ("fitted", "asked"), [("uint64", "int64"), ("int64", "uint64"), ("uint64", object)]
)
def test_large_labels_of_other_types_in_predict(fitted, asked):
    """As floats, the first two are one, and so are the others."""
    labels = np.array([2**62, 2**62 + 1, 2**62 + 2, 2**62 + 3] * 3)
    x, y = np.arange(12.0), np.tile([0.0, 100.0, -100.0, 7.0], 3)
    table = pd.DataFrame({"x": x, "load": labels.astype(fitted)})
    model = BayesianLinearRegression().fit(table, y)
    table = table.assign(load=labels.astype(asked))
    np.testing.assert_allclose(model.predict(table), y, atol=1e-5)
    table["load"] += 4
    with pytest.raises(ValueError, match=rf"Unknown tasks? {2**62 + 4}, .*: the model"):
        model.predict(table)


def test_tasks_are_joined_exactly():
    assert sorted_tasks([2**63 + 1, 2**53 + 1, 2**53]).tolist() == [
        2**53,
        2**53 + 1,
        2**63 + 1,
    ]
    assert sorted_tasks([]).tolist() == []


def test_rows_of_each_code():
    present, rows = rows_by_code(np.array([4, 1, 4, 4, 0]))
    assert present.tolist() == [0, 1, 4]
    assert [of_code.tolist() for of_code in rows] == [[4], [1], [0, 2, 3]]


@pytest.mark.parametrize(
    ("dtype", "label"),
    [("datetime64[D]", "1970-01-02"), ("S1", "b'1'"), ("complex128", r"\(1")],
)
def test_labels_of_a_type_that_is_none(dtype, label):
    match = rf"integers or strings, not .*, such as {label}.*task_feature.*astype\(str"
    with pytest.raises(ValueError, match=match):
        check_labels(np.array([1, 2]).astype(dtype))


def test_labels_that_are_not_a_column():
    with pytest.raises(ValueError, match=r"one-dimensional, .* shape \(1, 2\)"):
        check_labels(np.array([[1, 2]]))


@pytest.mark.parametrize("tasks", [[1, 3, 5], ["a", "b", "long"], [False, True]])
def test_codes_are_positions(tasks):
    tasks = np.array(tasks)
    codes = np.array([1, 0, 1, len(tasks) - 1])
    found = encode_tasks(check_labels(tasks[codes]), tasks)
    np.testing.assert_array_equal(found, codes)


@pytest.mark.parametrize("label", ["lon", "longer", "long\0", "Long", " long"])
def test_labels_of_another_length_are_unknown(label):
    labels = check_labels(["long"])._replace(tasks=np.array([label], object))
    with pytest.raises(ValueError, match=r"Unknown task .*: the model knows 'long'"):
        encode_tasks(labels, np.array(["long"]))


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
        encode_tasks(check_labels(np.array(labels)), np.array([1, 2, 3]))


def test_the_advice_on_unknown_tasks_names_their_column():
    with pytest.raises(ValueError, match=r"TaskStratifiedKFold\(task_feature=\.\.\.\)"):
        encode_tasks(check_labels([4]), np.array([1, 2]))


@pytest.mark.parametrize("can_join", [False, True])
def test_an_unknown_task_may_join_some_models(can_join):
    with pytest.raises(ValueError, match="Unknown task 4: the model knows") as error:
        encode_tasks(check_labels([4, 4]), np.array([1, 2]), can_join=can_join)
    assert ("or let it join with add_task" in str(error.value)) == can_join
    assert "labels are" not in str(error.value)


@pytest.mark.parametrize(
    ("label", "meant"), [(" Hill", "hill"), ("HILL", "hill"), ("the  mast", "the mast")]
)
def test_a_label_with_other_spaces_or_case_is_told_which_may_be_meant(label, meant):
    message = f"Unknown task '{label}': .* Did you mean '{meant}'\\? Fit with"
    with pytest.raises(ValueError, match=message):
        encode_tasks(check_labels([label]), np.array(["hill", "the mast"]))
    with pytest.raises(ValueError, match="Unknown task 'hil'") as error:
        encode_tasks(check_labels(["hil"]), np.array(["hill"]))
    assert "Did you mean" not in str(error.value)


def test_labels_that_differ_in_spaces_or_case_alone():
    labels = ["", " hill", "Hill", "hill", "lake", "lake 2", "lake  2", "lakes"]
    groups = [[" hill", "Hill", "hill"], ["lake 2", "lake  2"]]
    assert alike(labels) == groups
    assert alike([1, 2, 10]) == alike([True, False]) == []


def test_a_number_is_no_known_string():
    match = "Unknown task 1: .*'1', 'a'.* labels are numbers, the model's are strings"
    with pytest.raises(ValueError, match=match):
        encode_tasks(check_labels([1]), np.array(["1", "a"]))
