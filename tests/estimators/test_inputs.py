"""What the estimators take, and what they say to what they do not."""

import re
import warnings
from enum import Enum

import numpy as np
import pandas as pd
import pytest
from samples import draw
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import RBF
from sklearn.multioutput import RegressorChain

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.exceptions import TaskColumnWarning
from skmtgp.kernels import ARDLinear, Columns

QUICK = {"task_feature": "load", "max_iter": 0}
ESTIMATORS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(**QUICK),
    "IndependentGP": IndependentGP(**QUICK),
    "PooledGP": PooledGP(**QUICK),
    "SingleTaskGP": SingleTaskGP(**QUICK),
    "RankSearchIC": RankSearchIC(
        MultiTaskGPRegressor(learning="staged", **QUICK), ranks=(1, 2)
    ),
}
LABELS = {
    "int": ([3, 1, 2], None),
    "uint8": ([3, 1, 2], "uint8"),
    "float of integers": ([3.0, 1.0, 2.0], None),
    "bool": ([True, False, False], None),
    "str": (["b", "c", "a"], None),
    "object": (["b", "c", "a"], object),
    "category": (["b", "c", "a"], "category"),
    "int category": ([3, 1, 2], "category"),
    "Int64": ([3, 1, 2], "Int64"),
    "Float64": ([3, 1, 2], "Float64"),
    "string": (["b", "c", "a"], "string"),
    "boolean": ([True, False, False], "boolean"),
}
X, y = draw(per_task=6)
TASKS = X[:, -1].astype(int)


def frame(labels="str", features="float64"):
    values, dtype = LABELS[labels]
    load = pd.Series(np.array(values)[TASKS]).astype(dtype or np.array(values).dtype)
    table = pd.DataFrame(X[:, :2], columns=["a", "b"]).astype(features)
    return table.assign(load=load)[["a", "load", "b"]]  # the task in the middle


def coded(labels):
    """The same as an array, tasks as numbers in the order of their labels."""
    values = LABELS[labels][0]
    codes = np.unique(np.array(values), return_inverse=True)[1]
    return np.column_stack([X[:, 0], codes[TASKS], X[:, 1]])


def by_position(estimator):
    nested = "estimator__" if isinstance(estimator, RankSearchIC) else ""
    return estimator.set_params(**{f"{nested}task_feature": 1})


@pytest.fixture(params=ESTIMATORS.values(), ids=ESTIMATORS)
def estimator(request):
    return clone(request.param)


FEATURES = ["float64", "Float64", "float32", "object"]
# every two of an estimator, a type of labels and a type of features
TYPES = [
    pytest.param(clone(of), labels, FEATURES[(i + j) % 4], id=f"{name}-{labels}")
    for i, (name, of) in enumerate(ESTIMATORS.items())
    for j, labels in enumerate(LABELS)
]


@pytest.mark.parametrize(("estimator", "labels", "features"), TYPES)
def test_frames(estimator, labels, features):
    table = frame(labels, features)
    found = estimator.fit(table, y).predict(table)
    assert estimator.feature_names_in_.tolist() == ["a", "load", "b"]
    model = getattr(estimator, "best_estimator_", estimator)
    assert model.tasks_.tolist() == sorted(set(LABELS[labels][0]))
    array = coded(labels)
    expected = by_position(estimator).fit(array, y).predict(array)
    rtol = 1e-3 if features == "float32" else 1e-9
    np.testing.assert_allclose(found, expected, rtol=rtol)


@pytest.mark.parametrize("labels", ["int", "str", "bool", "category"])
def test_polars_frames(estimator, labels):
    polars = pytest.importorskip("polars")
    values = np.array(LABELS[labels][0])[TASKS]
    load = polars.Series(values.tolist())
    if labels == "category":
        load = load.cast(polars.Categorical)
    table = polars.DataFrame({"a": X[:, 0], "load": load, "b": X[:, 1]})
    found = estimator.fit(table, y).predict(table)
    assert estimator.feature_names_in_.tolist() == ["a", "load", "b"]
    expected = estimator.fit(frame(labels), y).predict(frame(labels))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_tables_of_pyarrow(estimator):
    pyarrow = pytest.importorskip("pyarrow")
    table, targets = pyarrow.table(frame()), pyarrow.chunked_array([y])
    found = estimator.fit(table, targets).predict(table)
    assert estimator.feature_names_in_.tolist() == ["a", "load", "b"]
    expected = estimator.fit(frame(), y).predict(frame())
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("target", ["Float64", "Int64", "list", "frame"])
def test_targets(estimator, target):
    targets = {
        "Float64": pd.Series(y, dtype="Float64"),
        "Int64": pd.Series(y.round().astype(int), dtype="Int64"),
        "list": y.tolist(),
        "frame": pd.DataFrame({"u": y, "v": -y}),
    }
    given = targets[target]
    found = estimator.fit(frame(), given).predict(frame())
    plain = np.array(given, dtype=float)
    assert found.shape == plain.shape
    expected = estimator.fit(frame(), plain).predict(frame())
    np.testing.assert_array_equal(found, expected)


class Site(str, Enum):  # noqa: UP042 - as before Python 3.11
    A = "site one"
    B = "site two"
    C = "site three"


@pytest.mark.parametrize("container", ["frame", "objects", "list"])
def test_members_of_an_enumeration(estimator, container):
    """NumPy would make all of them 'Site.' or the like."""
    table = frame().assign(load=pd.Series([list(Site)[m] for m in TASKS], dtype=object))
    named = table.assign(load=[member.value for member in table["load"]])
    if container != "frame":
        by_position(estimator)
        table, named = (of.to_numpy(dtype=object) for of in (table, named))
    if container == "list":
        table, named = table.tolist(), named.tolist()
    found = estimator.fit(table, y).predict(table)
    model = getattr(estimator, "best_estimator_", estimator)
    assert model.tasks_.tolist() == ["site one", "site three", "site two"]
    np.testing.assert_array_equal(estimator.predict(named), found)
    np.testing.assert_array_equal(estimator.fit(named, y).predict(table), found)


def test_negative_position_and_name_are_the_same_column():
    table = frame()[["a", "b", "load"]]
    named = MultiTaskGPRegressor(**QUICK).fit(table, y).predict(table)
    last = MultiTaskGPRegressor(max_iter=0).fit(table, y).predict(table)
    np.testing.assert_array_equal(named, last)


def test_some_of_the_tasks_can_be_predicted(estimator):
    table = frame()
    whole = estimator.fit(table, y).predict(table)
    rows = table["load"] == "c"
    found = estimator.predict(table[rows])
    np.testing.assert_allclose(found, whole[rows], rtol=1e-9)


def changed(values):
    """The frame with a column of other values."""
    return frame().assign(**values)


def with_first(column, value):
    table = frame().astype({"load": object})
    table.loc[0, column] = value
    return table


def test_more_tasks_than_half_of_the_rows(estimator):
    table = pd.concat([frame(), frame()[:6]], ignore_index=True)
    table["load"] = np.minimum(np.arange(24), 12)
    match = r"13 tasks of 24 rows: does task_feature name the .* \[0, 1, 2, 3, 4\]"
    with pytest.warns(TaskColumnWarning, match=match):
        estimator.fit(table, np.arange(24.0))
    table["load"] = np.minimum(np.arange(24), 11)
    estimator.fit(table, np.arange(24.0))


@pytest.mark.parametrize(
    ("labels", "match"),
    [
        (
            ["u", "u ", "v"],
            r"'u', 'u ' differ in spaces or case alone: they are learned",
        ),
        (["u", "u ", "v", " v", "w", "W"], "alone, and 2 more such groups: they are"),
    ],
)
def test_labels_that_are_written_in_several_ways(estimator, labels, match):
    table = changed({"load": labels * (18 // len(labels))})
    with pytest.warns(TaskColumnWarning, match=match):
        estimator.fit(table, y)


RNG = np.random.default_rng(0)
ROWS = np.column_stack([RNG.normal(size=(80, 2)), RNG.integers(0, 3, 80)])
COUNTS = np.append(RNG.poisson(4.0, 79), 20)  # one value is of one row alone
OUTPUTS = {"counts": COUNTS, "differences": COUNTS % 5 - 2}


class TestChain:
    """Whose outputs become the last columns of X."""

    @pytest.mark.parametrize("output", OUTPUTS.values(), ids=OUTPUTS)
    def test_warns(self, output):
        chain = RegressorChain(BayesianLinearRegression())
        match = (
            r"label (\d+ is of one row alone|-2 is a negative number), and the column "
            r"before it .* RegressorChain .* from the left: task_feature=2\. If .*=3\.$"
        )
        with pytest.warns(TaskColumnWarning, match=match):
            chain.fit(ROWS, np.column_stack([output, np.sin(ROWS[:, 0])]))

    @pytest.mark.parametrize("output", OUTPUTS.values(), ids=OUTPUTS)
    def test_with_a_position_from_the_left(self, output):
        Y = np.column_stack([output, np.sin(ROWS[:, 0])])
        chain = RegressorChain(BayesianLinearRegression(task_feature=2)).fit(ROWS, Y)
        for model in chain.estimators_:
            assert model.tasks_.tolist() == [0, 1, 2]

    SILENT = {
        "labels": RNG.integers(0, 4, 80),
        "labels with gaps": RNG.choice([1, 7, 1001], 80),
        "rare labels, not at the ends": np.append(RNG.choice([1, 9], 79), 5),
    }

    @pytest.mark.parametrize("labels", SILENT.values(), ids=SILENT)
    def test_ordinary_labels_after_a_flag(self, labels):
        flag = ROWS[:, 2] > 0
        table = np.column_stack([ROWS[:, :2], flag, labels])
        BayesianLinearRegression().fit(table, ROWS[:, 0])

    @pytest.mark.parametrize("before", [ROWS[:, 0], -ROWS[:, 2], np.zeros(80)])
    def test_ordinary_features(self, before):
        table = np.column_stack([ROWS[:, :2], before, COUNTS])
        BayesianLinearRegression().fit(table, ROWS[:, 0])

    @pytest.mark.parametrize("how", ["name", "position", "integers", "few rows"])
    def test_what_says_that_the_column_is_meant(self, how):
        names = ["a", "b", "c", "d"]
        table = pd.DataFrame(np.column_stack([ROWS, COUNTS]), columns=names)
        place = {"name": "d", "position": 3}.get(how, -1)
        if how == "integers":
            table = table.astype({"d": int})
        if how == "few rows":
            table = table[-20:]
        model = BayesianLinearRegression(task_feature=place)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            model.fit(table, ROWS[: len(table), 0])


BAD_DATA = {
    "missing label": (with_first("load", None), y, "1 missing label of"),
    "NaN label": (with_first("load", np.nan), y, "1 missing label.*Every row needs"),
    "NA label": (with_first("load", pd.NA), y, "1 missing label .* first in row 0"),
    "NaN label in an array": (
        np.where(X[0, -1] == X, np.nan, X)[:, [0, 2, 1]],
        y,
        "6 missing labels",
    ),
    "continuous labels": (changed({"load": X[:, 0]}), y, "18 of 18 are fractional"),
    "mixed labels": (with_first("load", 1), y, r"mixture: \['int', 'str'\]"),
    "NaN feature": (with_first("a", np.nan), y, "Input X contains NaN"),
    "infinite feature": (with_first("a", np.inf), y, "X contains infinity"),
    "NA feature": (
        changed({"a": pd.array([pd.NA, *X[1:, 0]], dtype="Float64")}),
        y,
        "X contains NaN",
    ),
    "text feature": (
        changed({"a": "text"}),
        y,
        "column 'a' holds strings such as 'text'",
    ),
    "no feature": (frame()[["load"]], y, r"1 feature\(s\).*task's column and at least"),
    "no feature in an array": (X[:, -1:], y, r"1 feature\(s\).*minimum of 2"),
    "tasks that are columns of y": (
        X[:, :1],
        np.eye(len(X)),
        r"let WideRegressor stack them",
    ),
    "no rows": (frame()[:0], y[:0], r"0 sample\(s\)"),
    "one dimension": (X[:, 0], y, "Expected 2D array"),
    "no target": (frame(), None, "requires y to be passed, but the target y is None"),
    "NaN target": (frame(), np.full(18, np.nan), "Input y contains NaN"),
    "text target": (
        frame(),
        ["text"] * 18,
        "y must be numbers, but holds strings such as 'text'",
    ),
    "short target": (frame(), y[:-1], r"inconsistent numbers of samples: \[18, 17\]"),
    "three axes of the target": (frame(), np.ones((18, 1, 1)), "y with dim 3"),
}


@pytest.mark.parametrize(("table", "target", "match"), BAD_DATA.values(), ids=BAD_DATA)
def test_bad_data(estimator, table, target, match):
    if not isinstance(table, pd.DataFrame):
        by_position(estimator)
    with pytest.raises(ValueError, match=match):
        estimator.fit(table, target)
    with pytest.raises(NotFittedError):
        estimator.predict(frame())


NOISE_BOUNDS = "must be a pair of positive numbers, the smaller one first, or 'fixed'"
BAD_PARAMETERS = {
    "kernel of another type": ({"kernel": 1.0}, ValueError, "must be an instance of"),
    "kernel class": ({"kernel": RBF}, ValueError, "'kernel' parameter .* must be"),
    "length-scales": (
        {"kernel": RBF([1.0] * 3)},
        ValueError,
        r"kernel=RBF\(length_scale=\[1, 1, 1\]\) cannot take X, which has 2 features",
    ),
    "weights": (
        {"kernel": ARDLinear([1.0] * 3)},
        ValueError,
        r"kernel=ARDLinear\(.*\) cannot take X, which has 2 features",
    ),
    "columns": (
        {"kernel": Columns(RBF(), [0, 2])},
        ValueError,
        r"kernel=Columns\(.*which has 2 features beside the task column",
    ),
    "reversed bounds": (
        {"noise_variance_bounds": (1.0, 0.1)},
        ValueError,
        rf"noise_variance_bounds=\(1.0, 0.1\) {NOISE_BOUNDS}",
    ),
    "bounds at zero": ({"noise_variance_bounds": (0, 1)}, ValueError, NOISE_BOUNDS),
    "three bounds": ({"noise_variance_bounds": (1, 2, 3)}, ValueError, NOISE_BOUNDS),
    "bounds of text": ({"noise_variance_bounds": "none"}, ValueError, "array-like or"),
    "no bounds": ({"noise_variance_bounds": None}, ValueError, "array-like or"),
    **{
        f"bounds {bounds!r}": (
            {"noise_variance_bounds": bounds},
            ValueError,
            rf"noise_variance_bounds={re.escape(repr(bounds))} {NOISE_BOUNDS}",
        )
        for bounds in [
            ("a", "b"),
            ("1e-3", "1"),
            ["a", 1.0],
            (),
            (1.0,),
            [[1.0, 2.0]],
            [0.1, [1.0]],
            (np.nan, 1.0),
            (0.1, np.nan),
            (-1.0, 1.0),
            (0.1, np.inf),
            (None, 1.0),
            (0.1, 1j),
            {0.1: 1.0},
            np.array(["a", "b"]),
        ]
    },
    "no noise": ({"noise_variance": 0.0}, ValueError, "=0 leaves the noise to alpha"),
    "negative noise": ({"noise_variance": -1.0}, ValueError, r"range \[0.0, inf\)"),
    "inference": ({"inference": "exact"}, ValueError, "must be a str among"),
    "iterations": ({"max_iter": -1}, ValueError, r"'max_iter' .* range \[0, inf\)"),
    "tolerance": ({"tol": 0.0}, ValueError, r"'tol' .* range \(0.0, inf\)"),
    "name": ({"task_feature": "task"}, ValueError, "'task' is not a column: .*'load'"),
    "position": ({"task_feature": 3}, ValueError, "3 is out of range: X has 3 columns"),
    "fraction": ({"task_feature": 1.0}, ValueError, "an instance of 'int' or .*'str'"),
    "truth": ({"task_feature": True}, TypeError, r"True must be the position \(int\)"),
}


@pytest.mark.parametrize(
    ("params", "error", "match"), BAD_PARAMETERS.values(), ids=BAD_PARAMETERS
)
def test_bad_parameters(estimator, params, error, match):
    if isinstance(estimator, RankSearchIC):
        params = {f"estimator__{name}": value for name, value in params.items()}
    estimator.set_params(**params)
    with pytest.raises(error, match=match):
        estimator.fit(frame(), y)


@pytest.mark.parametrize(
    ("params", "match"),
    [
        ({"rank": -1}, r"'rank' .* must be an int in the range \[0, inf\).* or None"),
        ({"rank": 0}, "rank=0 leaves tasks nothing in common. Set shared=True"),
        ({"rank": 2.0}, r"'rank' .* must be an int in the range \[0, inf\).* or None"),
        ({"rank": 4}, "rank=4 is above the number of tasks, 3"),
        ({"noise": "each"}, "'noise' .* must be a str among"),
        ({"diagonal": "yes"}, "'diagonal' .* must be"),
        ({"n_restarts_optimizer": -1}, "'n_restarts_optimizer' .* range"),
        ({"random_state": "x"}, "'random_state' .* must be"),
    ],
)
def test_bad_parameters_of_the_multi_task_model(params, match):
    with pytest.raises(ValueError, match=match):
        MultiTaskGPRegressor(**QUICK).set_params(**params).fit(frame(), y)


def test_name_of_the_task_column_of_an_array(estimator):
    with pytest.raises(ValueError, match="'load' names a column, but X has no column"):
        estimator.fit(X, y)


CALLS = {
    "fit": lambda model: model.fit(frame(), y, weights=1),
    "predict": lambda model: model.predict(frame(), weights=1),
    "sample_y": lambda model: model.sample_y(frame(), weights=1),
    "loo_predict": lambda model: model.loo_predict(weights=1),
    "log_marginal_likelihood": (lambda model: model.log_marginal_likelihood(weights=1)),
    "__init__": lambda model: type(model)(weights=1),
}


@pytest.mark.parametrize("name", CALLS)
def test_unknown_arguments_name_the_public_class(estimator, name):
    match = rf"^{type(estimator).__name__}\.{name}\(\) got an unexpected .* 'weights"
    with pytest.raises(TypeError, match=match):
        CALLS[name](estimator)


def test_missing_arguments_name_the_public_class():
    match = r"^PooledGP\.fit\(\) missing a required argument: 'y'\. It takes X, y, alp"
    with pytest.raises(TypeError, match=match):
        PooledGP().fit(frame())


NEW = {
    "unknown task": (changed({"load": "d"}), "Unknown task 'd': the model knows 'a'"),
    "number for text": (changed({"load": 1}), "Unknown task 1: the model knows 'a'"),
    "missing label": (with_first("load", None), "1 missing label"),
    "NaN feature": (with_first("b", np.nan), "Input X contains NaN"),
    "other columns": (
        frame()[["b", "load", "a"]],
        "feature names should match those that were passed during fit",
    ),
    "too wide": (
        changed({"c": 1.0}).to_numpy(),
        "X has 4 features, but .* is expecting 3 features",
    ),
}


@pytest.mark.filterwarnings("ignore:X does not have valid feature names")
@pytest.mark.parametrize(("table", "match"), NEW.values(), ids=NEW)
def test_bad_data_at_predict(estimator, table, match):
    estimator.fit(frame(), y)
    if isinstance(estimator, PooledGP) and "'d'" in match:  # all tasks are one
        assert np.isfinite(estimator.predict(table)).all()
        return
    with pytest.raises(ValueError, match=match):
        estimator.predict(table)


def test_an_unknown_task_is_told_of_add_task(estimator):
    if isinstance(estimator, PooledGP):
        pytest.skip("it predicts one")
    estimator.fit(frame(), y)
    with pytest.raises(ValueError, match="Unknown task 'd'") as error:
        estimator.predict(changed({"load": "d"}))
    assert ("add_task" in str(error.value)) == hasattr(estimator, "add_task")


def test_spreads_are_of_one_kind(estimator):
    estimator.fit(frame(), y)
    with pytest.raises(ValueError, match="Set return_std or return_cov, not both"):
        estimator.predict(frame(), return_std=True, return_cov=True)


@pytest.mark.parametrize("name", ["predict", "sample_y"])
def test_methods_of_what_is_not_fitted(estimator, name):
    if hasattr(estimator, name):
        with pytest.raises(NotFittedError):
            getattr(estimator, name)(frame())


def test_theta_of_another_length():
    model = MultiTaskGPRegressor(**QUICK).fit(frame(), y)
    with pytest.raises(ValueError, match=r"theta has shape \(3,\); the model has"):
        model.log_marginal_likelihood([0.0, 0.0, 0.0])
