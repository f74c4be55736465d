import pickle
import tracemalloc
from enum import Enum
from functools import partial

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.dummy import DummyRegressor
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.neighbors import KNeighborsRegressor

from skmtgp.metrics import (
    coverage,
    make_coverage_scorer,
    make_normalized_mse_scorer,
    make_standardized_log_loss_scorer,
    mean_standardized_log_loss,
    normalized_mean_squared_error,
)
from skmtgp.model_selection import TaskStratifiedKFold

TASKS = np.repeat(["a", "b", "c"], [10, 20, 70])
ROWS = slice(0, 10), slice(10, 30), slice(30, 100)


@pytest.fixture
def data():
    rng = np.random.default_rng(0)
    y = rng.normal(size=(100, 2)) * [3.0, 0.1] + [1.0, 5.0]
    prediction = y + rng.normal(size=(100, 2)) * [0.5, 0.05]
    return y, prediction, rng.uniform(0.1, 1.0, size=(100, 2))


def test_nmse_of_one_task(data):
    y, prediction, _ = data
    found = normalized_mean_squared_error(y, prediction, multioutput="raw_values")
    expected = [((y - prediction)[:, j] ** 2).mean() / y[:, j].var() for j in (0, 1)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    averaged = normalized_mean_squared_error(y, prediction)
    assert type(averaged) is float
    assert averaged == pytest.approx(np.mean(expected), rel=1e-12)


def test_nmse_weighs_tasks_equally_whatever_their_size(data):
    y, prediction, _ = data
    found = normalized_mean_squared_error(y, prediction, tasks=TASKS)
    per_task = [
        normalized_mean_squared_error(y[rows], prediction[rows]) for rows in ROWS
    ]
    assert found == pytest.approx(np.mean(per_task), rel=1e-12)
    assert found != pytest.approx(normalized_mean_squared_error(y, prediction), rel=0.1)


def test_nmse_of_each_tasks_mean_is_one(data):
    y = pd.DataFrame(data[0])
    prediction = y.groupby(TASKS).transform("mean")
    raw = normalized_mean_squared_error(
        y, prediction, tasks=TASKS, multioutput="raw_values"
    )
    np.testing.assert_allclose(raw, 1.0, rtol=1e-12)


def test_nmse_of_a_task_with_one_sample():
    y = np.array([1.0, 2.0, 3.0])
    message = r"task 2 are constant, as there is one sample.*fewer folds, give y_var"
    with pytest.raises(ValueError, match=message):
        normalized_mean_squared_error(y, y, tasks=[1, 1, 2])


@pytest.mark.parametrize("constant", [0.0, 0.1, 1e9 / 3])
def test_nmse_of_constant_targets(constant):
    y = np.array([1.0, 2.0, constant, constant, constant])
    tasks = [1, 1, 2, 2, 2]
    with pytest.raises(ValueError, match=r"targets of task 2 are constant.*Leave that"):
        normalized_mean_squared_error(y, y, tasks=tasks)


def test_msll_is_the_textbooks(data):
    y, prediction, std = data
    train = data[0][:40] * 1.5
    found = mean_standardized_log_loss(
        y, prediction, std, y_train=train, tasks=TASKS, multioutput="raw_values"
    )
    loss = -norm.logpdf(y, prediction, std)
    loss += norm.logpdf(y, train.mean(axis=0), train.std(axis=0))
    expected = np.mean([loss[rows].mean(axis=0) for rows in ROWS], axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    averaged = mean_standardized_log_loss(
        y, prediction, std, y_train=train, tasks=TASKS
    )
    assert averaged == pytest.approx(expected.mean(), rel=1e-12)


def test_msll_of_the_trivial_model_is_zero(data):
    y = data[0][:, 0]
    mean, std = np.full(100, y.mean()), np.full(100, y.std())
    assert abs(mean_standardized_log_loss(y, mean, std, y_train=y)) < 1e-15


def test_msll_of_constant_training_targets():
    with pytest.raises(ValueError, match="y_train is constant"):
        mean_standardized_log_loss([0.0], [0.0], [1.0], y_train=[0.1, 0.1, 0.1])


def test_msll_of_other_outputs_in_training(data):
    y, prediction, std = data
    with pytest.raises(ValueError, match="y_true has 2 outputs and y_train has 1"):
        mean_standardized_log_loss(y, prediction, std, y_train=y[:, 0])


@pytest.mark.parametrize("level", [0.5, 0.9, 0.95])
def test_coverage_of_the_true_model_is_its_level(level):
    rng = np.random.default_rng(1)
    std = rng.uniform(0.1, 10.0, 40_000)
    y = rng.normal(size=40_000) * std
    assert coverage(y, np.zeros(40_000), std, level=level) == pytest.approx(
        level, abs=4.0 * np.sqrt(level * (1.0 - level) / 40_000)
    )


def test_coverage_counts_the_textbooks_interval(data):
    y, prediction, std = data
    found = coverage(
        y, prediction, std, level=0.8, tasks=TASKS, multioutput="raw_values"
    )
    low, high = norm.interval(0.8, prediction, std)
    inside = (low <= y) & (y <= high)
    expected = np.mean([inside[rows].mean(axis=0) for rows in ROWS], axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert 0.0 < expected.min() < 1.0


@pytest.mark.parametrize("level", [0.0, 1.0, 95, np.nan, "0.9", None])
def test_coverage_of_a_level_that_is_none(level):
    with pytest.raises(ValueError, match=r"level=.* must be a number between 0 and 1"):
        coverage([0.0], [0.0], [1.0], level=level)


def msll(y_true, y_pred, y_std, **options):
    return mean_standardized_log_loss(
        y_true, y_pred, y_std, y_train=np.array(y_true) * [[2.0]], **options
    )


@pytest.mark.parametrize("metric", [msll, coverage])
def test_standard_deviations_must_be_positive(metric):
    with pytest.raises(ValueError, match=r"y_std must be positive; its minimum is 0\."):
        metric([[0.0], [1.0]], [[0.0], [1.0]], [[1.0], [0.0]])


@pytest.mark.parametrize("metric", [msll, coverage])
def test_standard_deviations_of_other_outputs(metric, data):
    y, prediction, std = data
    with pytest.raises(ValueError, match="y_true has 2 outputs and y_std has 1"):
        metric(y, prediction, std[:, 0])


@pytest.fixture(params=["nmse", "msll", "coverage"])
def metric(request):
    if request.param == "nmse":
        return normalized_mean_squared_error
    with_std = {"msll": msll, "coverage": coverage}[request.param]
    return lambda y, p, **options: with_std(y, p, np.ones_like(y), **options)


def test_frames_and_labels_of_any_type(metric, data):
    y, prediction, _ = data
    expected = metric(y, prediction, tasks=TASKS)
    codes = np.searchsorted(["a", "b", "c"], TASKS)
    for tasks in (
        list(TASKS),
        codes,
        codes.astype(float),
        pd.Series(TASKS, dtype="category"),
        pd.Series(codes, dtype="Int64"),
    ):
        frames = pd.DataFrame(y), pd.DataFrame(prediction)
        assert metric(*frames, tasks=tasks) == pytest.approx(expected, rel=1e-12)


class Site(str, Enum):  # noqa: UP042 - as before Python 3.11
    A = "site one"
    B = "site two"
    C = "site three"


LABELS = {
    "enumeration": [*Site],
    "beyond 2**53": [2**53, 2**53 + 1, 2**53 + 2],
    "column": [["a"], ["b"], ["c"]],
}


@pytest.mark.parametrize("labels", LABELS.values(), ids=LABELS)
def test_labels_are_never_merged(metric, data, labels):
    y, prediction, _ = data
    tasks = [labels["abc".index(task)] for task in TASKS]
    expected = metric(y, prediction, tasks=TASKS)
    assert metric(y, prediction, tasks=tasks) == pytest.approx(expected, rel=1e-12)


def test_variances_given_for_members_of_an_enumeration():
    y = np.array([0.0, 1.0, 0.0, 2.0])
    y_var = {Site.A: 0.5, "site two": 2.0}
    found = normalized_mean_squared_error(
        y, np.zeros(4), tasks=[Site.A, Site.A, Site.B, Site.B], y_var=y_var
    )
    assert found == pytest.approx(1.0)


OF_UNITS = {
    "nmse": normalized_mean_squared_error,
    "msll": partial(mean_standardized_log_loss, y_train=[0.0, 1.0, 5.0]),
    "coverage": coverage,
}


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("name", OF_UNITS)
def test_many_tasks(name, offset):
    """Those of each task alone, in memory of a few columns."""
    rng, n, n_tasks = np.random.default_rng(0), 20_000, 1000
    tasks = rng.permutation(np.arange(n_tasks).repeat(2))
    tasks = np.append(tasks, rng.integers(0, 50, n - len(tasks)))  # of many sizes
    y = offset + rng.normal(size=n)
    columns = [y, y + 0.5 * rng.normal(size=n), np.ones(n)][: 2 + (name != "nmse")]
    tracemalloc.start()
    found = OF_UNITS[name](*columns, tasks=tasks)
    assert tracemalloc.get_traced_memory()[1] < 100 * n
    tracemalloc.stop()
    rows = (np.flatnonzero(tasks == task) for task in range(n_tasks))
    alone = [OF_UNITS[name](*(values[r] for values in columns)) for r in rows]
    assert found == pytest.approx(np.mean(alone), rel=1e-12)


def test_one_task_is_no_task(metric, data):
    y, prediction, _ = data
    assert metric(y, prediction, tasks=np.ones(100)) == metric(y, prediction)


def test_predictions_of_other_outputs(metric, data):
    y, prediction, _ = data
    with pytest.raises(ValueError, match="y_true has 2 outputs and y_pred has 1"):
        metric(y, prediction[:, 0])


@pytest.mark.parametrize("wrong", ["y_pred", "tasks"])
def test_lengths_that_differ(metric, data, wrong):
    y, prediction, _ = data
    tasks = TASKS[1:] if wrong == "tasks" else TASKS
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        metric(y, prediction[1:] if wrong == "y_pred" else prediction, tasks=tasks)


def test_targets_that_are_not_finite(metric, data):
    y, prediction, _ = data
    prediction[3, 1] = np.nan
    with pytest.raises(ValueError, match="y_pred contains NaN"):
        metric(y, prediction)


def test_missing_task_labels(metric, data):
    y, prediction, _ = data
    tasks = TASKS.astype(object)
    tasks[2] = None
    with pytest.raises(ValueError, match="1 missing label"):
        metric(y, prediction, tasks=tasks)


def test_multioutput_that_is_none(metric, data):
    y, prediction, _ = data
    with pytest.raises(ValueError, match="multioutput='median' must be 'raw_values'"):
        metric(y, prediction, multioutput="median")


class FirstFeature(RegressorMixin, BaseEstimator):
    def fit(self, X, y):
        return self

    def predict(self, X):
        return np.asarray(X)[:, 0].astype(float)


def frame():
    rng = np.random.default_rng(2)
    X = pd.DataFrame({"x": rng.normal(size=100), "load": TASKS})
    return X, X["x"].to_numpy() + 0.1 * rng.normal(size=100)


@pytest.mark.parametrize("task_feature", [-1, 1, "load"])
def test_scorer_is_minus_the_nmse_of_the_task_column(task_feature):
    X, y = frame()
    found = make_normalized_mse_scorer(task_feature)(FirstFeature(), X, y)
    assert found == -normalized_mean_squared_error(y, X["x"], tasks=TASKS)


def test_scorer_of_an_array():
    X, y = frame()
    expected = make_normalized_mse_scorer()(FirstFeature(), X, y)
    found = make_normalized_mse_scorer()(FirstFeature(), X.to_numpy(), y)
    assert found == expected


def test_scorer_survives_a_pickle_and_cross_validation():
    X, y = frame()
    X = X.assign(load=np.tile([1, 2], 50))
    scorer = pickle.loads(pickle.dumps(make_normalized_mse_scorer("load")))
    scores = cross_val_score(FirstFeature(), X, y, scoring=scorer, cv=4)
    assert ((scores > -0.1) & (scores < 0.0)).all()


def test_search_prefers_the_smaller_error():
    X, y = frame()
    X = np.column_stack([X["x"], np.tile([1, 2], 50)])
    grid = {"n_neighbors": [1, 70]}
    scorer = make_normalized_mse_scorer()
    search = GridSearchCV(KNeighborsRegressor(), grid, scoring=scorer, cv=4)
    assert search.fit(X, y).best_params_ == {"n_neighbors": 1}


def test_scorer_without_such_a_column():
    X, y = frame()
    scorer = make_normalized_mse_scorer("context")
    with pytest.raises(ValueError, match=r"'context' is not a column: \['x', 'load'\]"):
        scorer(DummyRegressor().fit(X, y), X, y)


WRONG = {
    "a name": "machine",
    "a number": 3,
    "None": None,
    "names": ["a", "b"],
    "texts of a frame": pd.DataFrame({"y": ["a", "b"]}),
}


@pytest.mark.parametrize("y_train", WRONG.values(), ids=WRONG)
def test_log_loss_scorer_of_what_are_no_targets(y_train):
    with pytest.raises(TypeError, match=r"(?s)y_train=.* must be the training") as e:
        make_standardized_log_loss_scorer(y_train)
    is_name = isinstance(y_train, str)
    assert ("Did you mean task_feature='machine'?" in str(e.value)) == is_name


@pytest.mark.parametrize("level", ["machine", 0.0, 1, 95, np.nan, None])
def test_coverage_scorer_of_a_level_that_is_none(level):
    with pytest.raises(ValueError, match=r"level=.* between 0 and 1") as error:
        make_coverage_scorer(level)
    is_name = isinstance(level, str)
    assert ("Did you mean task_feature='machine'?" in str(error.value)) == is_name


class TestGivenVariances:
    @pytest.mark.parametrize("kind", [dict, pd.DataFrame])
    def test_of_several_outputs(self, data, kind):
        y, prediction, _ = data
        y_var = pd.DataFrame(y).groupby(TASKS).var(ddof=0)
        if kind is dict:
            y_var = {task: row.to_numpy() for task, row in y_var.iterrows()}
        options = {"tasks": TASKS, "multioutput": "raw_values"}
        expected = normalized_mean_squared_error(y, prediction, **options)
        found = normalized_mean_squared_error(y, prediction, y_var=y_var, **options)
        np.testing.assert_allclose(found, expected, rtol=1e-12)

    @pytest.mark.parametrize("labels", [["a", "b"], [7, 3]])
    def test_folds_with_one_row_of_a_small_task(self, labels):
        task = np.repeat(labels, [20, 8])
        X = pd.DataFrame({"x": np.linspace(0.0, 1.0, 28), "machine": task})
        y = X["x"] + np.sin(20.0 * X["x"])
        y_var = y.groupby(task).var(ddof=0)
        cv = TaskStratifiedKFold(5, task_feature="machine")
        scorer = make_normalized_mse_scorer("machine", y_var=y_var)
        scorer = pickle.loads(pickle.dumps(scorer))
        options = {"cv": cv, "error_score": "raise"}
        scores = cross_val_score(FirstFeature(), X, y, scoring=scorer, **options)
        of_task = np.square(y - X["x"]) / y_var[task].to_numpy()
        expected = [
            -of_task[test].groupby(task[test]).mean().mean() for _, test in cv.split(X)
        ]
        np.testing.assert_allclose(scores, expected, rtol=1e-12)

    @pytest.mark.parametrize(
        ("y_var", "match"),
        [
            ({"a": 1.0, "c": 2.0}, r"no variance of task 'b'; it has \['a', 'c'\]"),
            (pd.Series([1.0, 2.0]), "no variance of task 'a'"),
            ({"a": 0.0, "b": 1.0}, "y_var of task 'a' is 0.0, but must be positive"),
            ({"a": np.nan, "b": 1.0}, "y_var of task 'a' is nan"),
            ({"a": [1.0, 2.0], "b": 1.0}, r"'a' has shape \(2,\), not one variance"),
        ],
    )
    def test_of_no_use(self, y_var, match):
        with pytest.raises(ValueError, match=match):
            normalized_mean_squared_error([0, 1], [0, 1], tasks=["a", "b"], y_var=y_var)

    def test_without_tasks(self):
        with pytest.raises(ValueError, match="tasks is None: give both"):
            normalized_mean_squared_error([0, 1], [0, 1], y_var={"a": 1.0})

    @pytest.mark.parametrize("y_var", [1.0, [1.0] * 2, np.ones(2), "a"])
    def test_no_mapping(self, y_var):
        match = r"^y_var=.* must be a mapping of task to variance, such as the Series"
        with pytest.raises(TypeError, match=match):
            make_normalized_mse_scorer("machine", y_var=y_var)
        with pytest.raises(TypeError, match=match):
            normalized_mean_squared_error([0, 1], [0, 1], tasks=["a", "b"], y_var=y_var)
