"""Columns of X that describe the tasks."""

import numpy as np
import pytest

from skmtgp._data.descriptors import locate_descriptors, read_descriptors
from skmtgp._data.labels import Labels
from skmtgp.exceptions import DescriptorWarning

NAMES = ["a", "task", "age", "b", "mass"]
TASKS = np.array(["u", "v", "w", "x"])
CODES = np.array([0, 1, 2, 3, 1, 0, 3])
TABLE = np.array([[1.0, 20.0], [2.0, 40.0], [4.0, 10.0], [5.0, 90.0]])
COLUMNS = np.array([1, 3])


def features(table=TABLE, codes=CODES):
    x = np.arange(2.0 * len(codes)).reshape(-1, 2)
    return np.column_stack([x[:, 0], table[codes, 0], x[:, 1], table[codes, 1]])


def read(table=TABLE):
    names = np.array(["a", "age", "b", "mass"], dtype=object)
    return read_descriptors(COLUMNS, names, features(table), Labels(TASKS, CODES))


@pytest.mark.parametrize(
    ("given", "names"), [(["age", "mass"], NAMES), ([2, -1], NAMES), ((2, 4), None)]
)
def test_where_they_are_without_the_task_column(given, names):
    found = locate_descriptors(given, 1, 5, names)
    np.testing.assert_array_equal(found, COLUMNS)


@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        (["height"], ValueError, "task_descriptors='height' is not a column"),
        (["masse"], ValueError, "Did you mean 'mass'"),
        ([9], ValueError, "9 is out of range: X has 5 columns"),
        ([True], TypeError, "must be the position"),
        ([1.5], TypeError, "not float"),
        (["task"], ValueError, "has the task column, 'task'"),
        (["age", 2], ValueError, "names a column twice"),
        ([], ValueError, "task_descriptors is empty"),
        ([0, 2, 3, 4], ValueError, "leaves no column of X for the inputs"),
    ],
)
def test_what_is_no_such_column(given, error, match):
    with pytest.raises(error, match=match):
        locate_descriptors(given, 1, 5, NAMES)


def test_a_name_needs_names():
    with pytest.raises(ValueError, match="X has no column names"):
        locate_descriptors(["age"], 1, 5)


def test_the_table_and_the_inputs():
    found = read()
    np.testing.assert_array_equal(found.table, TABLE)
    np.testing.assert_array_equal(found.inputs(features()), features()[:, [0, 2]])


def test_rows_span_one_and_the_descriptors_and_are_orthogonal():
    found, D = read(), np.column_stack([np.ones(4), TABLE])
    assert found.n_rows == 3
    np.testing.assert_allclose(found.Q.T @ found.Q, 4.0 * np.eye(3), atol=1e-12)
    again = found.Q @ np.linalg.lstsq(found.Q, D, rcond=None)[0]
    np.testing.assert_allclose(again, D, rtol=1e-12)


def test_of_new_tasks_they_are_the_same_linear_map():
    found, new = read(), np.array([[3.0, 7.0], [2.0, 40.0]])
    weights = np.linalg.solve(np.column_stack([np.ones(3), TABLE[:3]]), found.Q[:3])
    expected = np.column_stack([np.ones(2), new]) @ weights
    np.testing.assert_allclose(found.rows(new), expected, atol=1e-12)
    np.testing.assert_allclose(found.rows(new)[1], found.Q[1], atol=1e-12)


def test_with_a_task_more_the_units_stay():
    found = read().with_task([3.0, 7.0], 1)
    np.testing.assert_array_equal(found.table[1], [3.0, 7.0])
    np.testing.assert_allclose(np.delete(found.Q, 1, 0), read().Q, atol=1e-12)


def test_one_that_varies_within_a_task_is_named():
    X = features()
    X[4, 3] = 41.0
    match = r"The descriptor 'mass' varies within task 'v': it has the values 40.0, 41"
    names = np.array(["a", "age", "b", "mass"], dtype=object)
    with pytest.raises(ValueError, match=match):
        read_descriptors(COLUMNS, names, X, Labels(TASKS, CODES))


def test_known_tasks_have_those_of_fit():
    found, labels = read(), Labels(np.array(["v", "z"]), np.array([0, 1, 0]))
    table = np.array([[2.0, 40.0], [9.0, 9.0]])
    found.check(features(table, labels.codes), labels, TASKS)
    table[0, 0] *= 1.0 + 1e-12  # read from a file
    found.check(features(table, labels.codes), labels, TASKS)
    table[0, 0] = 2.1
    match = "descriptor 'age' of task 'v' is 2.1, but was 2.0 in fit"
    with pytest.raises(ValueError, match=match):
        found.check(features(table, labels.codes), labels, TASKS)


@pytest.mark.parametrize("which", ["constant", "collinear"])
def test_those_that_cannot_be_told_apart_are_told(which):
    table = TABLE.copy()
    table[:, 1] = 3.0 if which == "constant" else 2.0 * table[:, 0] + 1.0
    match = r"\[1, descriptors\] has rank 2, not 3"
    with pytest.warns(DescriptorWarning, match=match):
        found = read(table)
    assert found.n_rows == 2
    assert np.isfinite(found.rows([[4.0, -7.0]])).all()


def test_few_tasks_are_told():
    codes = np.array([0, 1, 1])
    names = np.array(["a", "age", "b", "mass"])
    labels = Labels(TASKS[:2], codes)
    with pytest.warns(DescriptorWarning, match="The 2 tasks do not tell what each"):
        found = read_descriptors(COLUMNS, names, features(TABLE, codes), labels)
    assert found.n_rows == 2
