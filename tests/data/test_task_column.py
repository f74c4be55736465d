import numpy as np
import pandas as pd
import pytest

from skmtgp import BayesianLinearRegression, MultiTaskGPRegressor, PooledGP
from skmtgp._data.task_column import locate_task_column, split_table, task_labels
from skmtgp.exceptions import TaskColumnWarning

BIG = 2**53


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


def test_column_name_among_several_levels():
    columns = pd.MultiIndex.from_tuples([("at", "x"), ("at", "site")])
    table = pd.DataFrame([[0.5, 1], [1.5, 2], [2.5, 2]], columns=columns)
    match = (
        r"columns of X have 2 levels, such as \('at', 'x'\)\. Make them one, by X.co"
    )
    with pytest.raises(ValueError, match=match):
        PooledGP(task_feature="site").fit(table, [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=match):
        task_labels(table, "site")
    assert PooledGP(max_iter=0).fit(table, [1.0, 2.0, 3.0]).tasks_.tolist() == [1, 2]
    table.columns = ["_".join(map(str, c)) for c in table.columns]
    assert task_labels(table, "at_site").tasks.tolist() == [1, 2]


def test_column_name_in_the_index():
    table = pd.DataFrame({"x": [0.5, 1.5, 2.5], "z": 1.0, "site": ["a", "b", "b"]})
    match = r"'site' is in the index of X, .*by X\.reset_index\('site'\)"
    for index in ("site", ["site", "z"]):
        indexed = table.set_index(index)
        with pytest.raises(ValueError, match=match):
            PooledGP(task_feature="site").fit(indexed, [1.0, 2.0, 3.0])
        with pytest.raises(ValueError, match=match):
            task_labels(indexed, "site")
        found = task_labels(indexed.reset_index("site"), "site")
        assert found.tasks.tolist() == ["a", "b"]
    both = table.set_index("site", drop=False)
    assert task_labels(both, "site").tasks.tolist() == ["a", "b"]
    numbered = table.set_index(pd.Index([5, 6, 7], name="load"))
    assert task_labels(numbered, -1).tasks.tolist() == ["a", "b"]


@pytest.mark.parametrize("model", [PooledGP, BayesianLinearRegression])
def test_several_columns_that_tell_the_task(model):
    match = (
        r"Got \['site', 'machine'\] instead.* join them in one, such as X\['site'\] \+"
    )
    with pytest.raises(ValueError, match=match):
        model(task_feature=["site", "machine"]).fit([[0.5, 1, 1]], [1.0])


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


def test_tables_that_are_lists_keep_their_labels():
    """NumPy would make floats of integers beside a float."""
    table = [[0.5, BIG], [1.5, BIG + 1], [2.0, BIG + 2]]
    model = BayesianLinearRegression().fit(table, [1.0, 2.0, 3.0])
    assert model.tasks_.tolist() == [BIG, BIG + 1, BIG + 2]
    assert task_labels(table).tasks.tolist() == model.tasks_.tolist()
    with pytest.raises(ValueError, match=r"within 2\*\*53, .* 3 of 3 do not"):
        BayesianLinearRegression().fit(np.array(table), [1.0, 2.0, 3.0])


def test_frames_of_polars_keep_their_labels():
    polars = pytest.importorskip("polars")
    table = polars.DataFrame({"x": [0.5, 1.5], "load": [BIG, BIG + 1]})
    model = BayesianLinearRegression(task_feature="load").fit(table, [1.0, 2.0])
    assert model.tasks_.tolist() == [BIG, BIG + 1]
    assert model.feature_names_in_.tolist() == ["x", "load"]
    assert task_labels(table).tasks.tolist() == [BIG, BIG + 1]


def test_split_of_an_array():
    X = np.array([[0.5, 2.0, 1.5], [0.25, 1.0, 2.5]])
    features, labels = split_table(X, 1)
    np.testing.assert_array_equal(features, X[:, [0, 2]])
    assert labels.of_rows().tolist() == [2, 1]


@pytest.mark.parametrize("labels", [["b", "a"], [True, False], [2, 1]])
@pytest.mark.parametrize("dtype", ["float64", "float32", "Float64", "object"])
def test_split_of_a_frame_keeps_the_type(labels, dtype):
    X = pd.DataFrame({"x": [0.5, 0.25], "load": labels}).astype({"x": dtype})
    features, found = split_table(X, 1)
    assert features.dtype == np.float64
    np.testing.assert_array_equal(features, [[0.5], [0.25]])
    assert found.of_rows().tolist() == labels
    assert found.tasks.dtype.kind == np.array(labels).dtype.kind


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
    "durations": (
        {"age": [DAY - DAY, pd.NaT]},
        "'age' holds dates or times such as 0 days 00:00:00. .*: durations / pd.Timed",
    ),
    "dates as text": (
        {"day": ["2026-01-02", "2026-01-03"]},
        r"'day' holds dates or times such as '2026-01-02'.* \(pd.to_datetime\(dates\)",
    ),
    "other dates": ({"day": ["2.1.2026", "3.1.2026"]}, "'day' holds dates .*to_datet"),
    "times": ({"day": ["1/2/2026 12:30"] * 2}, "'day' holds dates .*to_datetime"),
    "versions": ({"of": ["1.2.3", "1.2.4"]}, "'of' holds strings .*OneHotEncoder"),
    "commas": ({"u": ["1.5", "-1,5"]}, r"'-1,5'. Is that a decimal comma\?.*decimal="),
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


def test_a_column_whose_label_is_an_integer_is_named_by_its_position():
    X = pd.DataFrame({2: ["A", "B"], 0: [0.5, 0.25], 1: [1, 2], 3: [2, 1]})
    match = (
        r"column 2 holds .*'A'.* task_feature=0 \(an integer is a position, not a col"
    )
    with pytest.raises(ValueError, match=match):
        PooledGP(task_feature=2).fit(X, [1.0, 2.0])
    PooledGP(task_feature=0, max_iter=0).fit(X, [1.0, 2.0])
    with pytest.raises(ValueError, match=r"column 2 holds .*task_feature=2 of the"):
        split_table(X[[0, 1, 2, 3]], 1)  # where the label is the position


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
    assert task_labels(X, task_feature).of_rows().tolist() == expected


@pytest.mark.parametrize("labels", [["b", "a"], [2, 1]])
def test_labels_of_a_frame_of_polars(labels):
    X = pytest.importorskip("polars").DataFrame({"load": labels, "x": [0.5, 0.25]})
    for place in ("load", 0):
        assert task_labels(X, place).of_rows().tolist() == labels


def test_labels_of_a_table_that_is_none():
    with pytest.raises(ValueError, match="two-dimensional, but has 1 dimensions"):
        task_labels([1, 2])


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


def test_rows_without_their_task():
    """What scikit-learn says, and what to do about it."""
    rows = pd.DataFrame({"x": [0.5, 1.5], "z": [1.0, 0.0], "metal": ["Cd", "Zn"]})
    model = BayesianLinearRegression().fit(rows, [1.0, 2.0])
    assert model.predict(rows).shape == (2,)
    message = (
        r"now missing:\n- metal\nX lacks the task column 'metal'\. .*'metal': 'Cd'"
    )
    with pytest.raises(ValueError, match=message):
        model.predict(rows[["x", "z"]])
    with pytest.raises(ValueError, match=r"now missing:\n- metal\n- z\n*$"):
        model.predict(rows[["x"]])
    with pytest.raises(
        ValueError, match=r"in the same order as they were in fit\.\n*$"
    ):
        model.predict(rows[["z", "x", "metal"]])


def test_arrays_without_their_task():
    model = BayesianLinearRegression().fit([[0.5, 1.0, 7], [1.5, 0.0, 9]], [1.0, 2.0])
    message = r"expecting 3 features as input\.\nDoes X lack the .* column 2\? .* as 7"
    with pytest.raises(ValueError, match=message):
        model.predict([[0.5, 1.0]])
    with pytest.raises(ValueError, match=r"expecting 3 features as input\.$"):
        model.predict([[0.5]])


@pytest.mark.parametrize("name", ["hour", "Age", "bus count", "minutes"])
def test_quantities_that_are_taken_for_tasks_by_default(name):
    table = pd.DataFrame({"x": np.linspace(0.0, 1.0, 12), name: np.arange(12) % 3})
    y, model = np.sin(table["x"]), PooledGP(max_iter=0)
    match = f"takes the last column, '{name}', .* 3 of them, such as 0, 1, 2"
    with pytest.warns(TaskColumnWarning, match=match):
        model.fit(table, y)
    model.set_params(task_feature=name).fit(table, y)
    model.set_params(task_feature=1).fit(table, y)
    text = table.astype({name: str})
    model.set_params(task_feature=-1).fit(text, y)


@pytest.mark.parametrize("name", ["task", "hours_of", "site", "counter", "load", 5])
def test_names_that_say_nothing_of_tasks(name):
    table = pd.DataFrame({0: np.linspace(0.0, 1.0, 12), name: np.arange(12) % 3})
    table.columns = table.columns if name == 5 else ["x", name]
    PooledGP(max_iter=0).fit(table, np.sin(table.iloc[:, 0]))
    PooledGP(max_iter=0).fit(table.to_numpy(), np.sin(table.iloc[:, 0]))


@pytest.mark.parametrize("name", ["site", "Patient-ID", "no_of_machine", "player_id"])
def test_another_column_that_has_the_name_of_tasks(name):
    x = np.linspace(0.0, 1.0, 12)
    table = pd.DataFrame({name: np.arange(12) % 3, "x": x, "wind": np.arange(12) % 5})
    model = PooledGP(max_iter=0)
    match = f"takes the last column, 'wind', .* column that has them, '{name}' for exa"
    with pytest.warns(TaskColumnWarning, match=match):
        model.fit(table, x)
    model.set_params(task_feature="wind").fit(table, x)
    model.set_params(task_feature=name).fit(table, x)
    model.set_params(task_feature=-1).fit(table.to_numpy(), x)


@pytest.mark.parametrize(
    ("values", "last"),
    [
        (np.linspace(0.0, 1.0, 12), "kind"),  # fractions
        (np.arange(12), "kind"),  # of one row each
        (np.arange(12) % 3, "machine"),
    ],
)
def test_columns_that_have_names_of_tasks_and_are_none(values, last):
    table = pd.DataFrame({"site": values, last: np.arange(12) % 3})
    PooledGP(max_iter=0).fit(table, np.sin(np.arange(12.0)))


def test_unknown_tasks_of_the_last_column():
    """An error in predict may be the first sign of a column taken by default."""
    table = pd.DataFrame({"x": np.linspace(0.0, 1.0, 12), "kind": np.arange(12) % 3})
    model = MultiTaskGPRegressor(rank=1, max_iter=0).fit(table, table["x"])
    match = "Unknown task 7: .* those of the last column, 'kind', by task_feature=-1"
    with pytest.raises(ValueError, match=match):
        model.predict(table.assign(kind=7))
    with pytest.raises(ValueError, match="of the last column, 1, by task_feature=-1"):
        model.fit(table.to_numpy(), table["x"]).predict([[0.5, 7.0]])
    named = model.set_params(task_feature="kind").fit(table, table["x"])
    with pytest.raises(ValueError, match="Unknown task 7") as error:
        named.predict(table.assign(kind=7))
    assert "last column" not in str(error.value)


@pytest.mark.parametrize("n_more", [0, 4, 5])
def test_rows_that_do_not_tell_noise_from_levels(n_more):
    tasks = np.append(np.arange(30), np.arange(n_more))
    X = np.column_stack([np.linspace(0.0, 1.0, len(tasks)), tasks])
    for model in (MultiTaskGPRegressor(rank=1, max_iter=0), PooledGP(max_iter=0)):
        with pytest.warns(TaskColumnWarning, match="30 tasks of ") as caught:
            model.fit(X, np.sin(X[:, 0]))
        said = " ".join(str(of.message) for of in caught)
        told = "PooledGP takes both for noise" in said
        assert told == (n_more < 5 and not isinstance(model, PooledGP))
