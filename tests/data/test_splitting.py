"""Folds that all train on every task."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from samples import draw
from scipy.sparse import csr_array
from sklearn.model_selection import (
    GridSearchCV,
    GroupKFold,
    KFold,
    StratifiedKFold,
    cross_val_score,
    learning_curve,
)
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from skmtgp import BayesianLinearRegression
from skmtgp.exceptions import TaskColumnWarning
from skmtgp.metrics import make_normalized_mse_scorer
from skmtgp.model_selection import TaskStratifiedKFold

X, y = draw(per_task=6)
BY_TASK = np.argsort(X[:, -1], kind="stable")
SORTED = X[BY_TASK], y[BY_TASK]  # as data are recorded: task after task
LABELS = {
    "int": [3, 1, 2],
    "str": ["b", "c", "a"],
    "bool": [True, False, True],
    "integers as floats": [3.0, 1.0, 2.0],
}


def table_of(counts):
    """A feature, and a task column with so many rows of tasks 0, 1, and so on."""
    tasks = np.repeat(np.arange(len(counts)), counts)
    return np.column_stack([np.linspace(0.0, 1.0, len(tasks)), tasks])


def folds(cv, table, *args):
    return [(train.tolist(), test.tolist()) for train, test in cv.split(table, *args)]


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("n_splits", [2, 3, 5])
@pytest.mark.parametrize("counts", [[5], [10, 10], [7, 2, 23, 3], [5, 2, 2, 2, 2]])
def test_every_fold_trains_on_every_task(counts, n_splits, shuffle):
    table = table_of(counts)
    cv = TaskStratifiedKFold(n_splits, shuffle=shuffle)
    assert cv.get_n_splits() == cv.get_n_splits(table, None, None) == n_splits
    tested = np.zeros(len(table), dtype=int)
    for train, test in cv.split(table):
        assert sorted([*train, *test]) == list(range(len(table)))
        assert set(table[train, -1]) == set(range(len(counts)))
        found = np.bincount(table[test, -1].astype(int), minlength=len(counts))
        assert (np.abs(found - np.divide(counts, n_splits)) < 1.0).all()
        tested[test] += 1
    assert (tested == 1).all()


def test_test_sets_are_those_of_classes():
    tasks = X[:, -1].astype(int)
    expected = StratifiedKFold(3, shuffle=True, random_state=1).split(X, tasks)
    found = TaskStratifiedKFold(3, shuffle=True, random_state=1).split(X)
    for (train, test), (rows, others) in zip(found, expected, strict=True):
        np.testing.assert_array_equal(test, others)
        np.testing.assert_array_equal(np.sort(train), rows)


@pytest.mark.parametrize("kind", ["array", "list", "pandas", "category", "polars"])
@pytest.mark.parametrize("labels", LABELS)
def test_tables(labels, kind):
    tasks = np.array(LABELS[labels])[X[:, -1].astype(int)].tolist()
    codes = np.unique(tasks, return_inverse=True)[1]
    expected = folds(TaskStratifiedKFold(3), np.column_stack([X[:, 0], codes]))
    columns = {"a": X[:, 0].tolist(), "load": tasks, "b": X[:, 1].tolist()}
    if kind == "polars":
        table = pytest.importorskip("polars").DataFrame(columns)
    else:
        table = pd.DataFrame(columns)
    if kind == "category":
        table = table.astype({"load": "category"})
    if kind in ("array", "list"):
        table = table.to_numpy() if kind == "array" else table.to_numpy().tolist()
    places = [1, -2] if kind in ("array", "list") else [1, "load"]
    for place in places:
        assert folds(TaskStratifiedKFold(3, task_feature=place), table) == expected


def test_random_state_fixes_the_folds():
    first, again, other = (
        folds(TaskStratifiedKFold(3, shuffle=True, random_state=seed), X)
        for seed in (0, 0, 1)
    )
    assert first == again
    assert first != other


@pytest.mark.parametrize("counts", [[6, 6, 6], [100, 4, 8], [3, 30]])
def test_first_rows_of_a_training_set_have_the_tasks_in_proportion(counts):
    table = table_of(counts)
    for train, _ in TaskStratifiedKFold(2).split(table):
        tasks = table[train, -1].astype(int)
        share = np.bincount(tasks) / len(tasks)
        for n in range(1, len(train)):
            found = np.bincount(tasks[:n], minlength=len(counts))
            assert (np.abs(found - n * share) < len(counts)).all()
            assert n < len(counts) or (found > 0).all()


@pytest.mark.parametrize(
    ("counts", "match"),
    [
        ([1] * 8, r"n_splits=5 is above the number of rows .* is 1 at most"),
        ([4, 3, 4], "n_splits=5 is above the number of rows .* is 4 at most"),
        ([], "minimum of 1 is required"),
    ],
)
def test_too_few_rows(counts, match):
    with pytest.raises(ValueError, match=match):
        next(TaskStratifiedKFold(5).split(table_of(counts)))


@pytest.mark.parametrize(
    ("counts", "match"),
    [
        ([6, 1, 6], "One row alone of task 1: it is in every training set"),
        ([1, 6, 1], "One row alone of task 0, 2: .* by cross_val_predict, leave"),
        ([1, 1, 1, 1, 1, 6, 1], r"of task 0, 1, 2, 3, 4, \.\.\. \(6 in all\): it is"),
    ],
)
@pytest.mark.parametrize("shuffle", [False, True])
def test_rows_of_tasks_with_no_other_are_never_tested(counts, match, shuffle):
    table, counts = table_of(counts), np.array(counts)
    with pytest.warns(TaskColumnWarning, match=match):
        found = list(TaskStratifiedKFold(5, shuffle=shuffle).split(table))
    lone = np.flatnonzero(counts[table[:, -1].astype(int)] == 1)
    for train, test in found:
        assert sorted([*train, *test]) == list(range(len(table)))
        assert set(lone) <= set(train)
    tested = np.sort(np.concatenate([test for _, test in found]))
    assert tested.tolist() == sorted(set(range(len(table))) - set(lone))


def test_a_task_of_one_row_does_not_stop_a_search():
    table, y = table_of([8, 1, 8]), np.r_[np.arange(8.0), 50.0, 10.0 - np.arange(8.0)]
    model = BayesianLinearRegression()
    y_var = pd.Series(y).groupby(table[:, -1]).var(ddof=0)
    search = GridSearchCV(
        model,
        {"pooled": [True, False]},
        cv=TaskStratifiedKFold(4),
        scoring=make_normalized_mse_scorer(y_var=y_var),
    )
    with pytest.warns(TaskColumnWarning, match="One row alone of task 1"):
        search.fit(table, y)
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()
    assert search.best_params_ == {"pooled": False}


def test_name_of_a_task_with_one_row():
    table = pd.DataFrame({"a": range(5), "load": ["u", "u", "v", "u", "u"]})
    with pytest.warns(TaskColumnWarning, match="One row alone of task 'v'"):
        next(TaskStratifiedKFold(2).split(table))


@pytest.mark.parametrize(
    ("params", "table", "error", "match"),
    [
        ({"task_feature": 0}, X, ValueError, "18 of 18 are fractional"),
        ({"task_feature": 3}, X, ValueError, "out of range: X has 3 columns"),
        ({"task_feature": "load"}, X, ValueError, "X has no column names"),
        ({"task_feature": True}, X, TypeError, "must be the position"),
        ({}, np.where(X == 1.0, np.nan, X), ValueError, "missing labels"),
        ({}, X[:, -1], ValueError, "must be two-dimensional, but has 1 dim"),
        ({}, csr_array(X), TypeError, r"Sparse data .* Use X.toarray\(\)"),
        ({}, X[:-1], ValueError, r"inconsistent numbers of samples: \[17, 18\]"),
    ],
)
def test_bad_tables(params, table, error, match):
    with pytest.raises(error, match=match):
        next(TaskStratifiedKFold(2, **params).split(table, y))


@pytest.mark.parametrize(
    ("params", "error", "match"),
    [
        ({"n_splits": 1}, ValueError, "n_splits=2 or more"),
        ({"n_splits": 2.0}, ValueError, "must be of Integral type"),
        ({"shuffle": 1}, TypeError, "shuffle must be True or False"),
        ({"random_state": 0}, ValueError, "set shuffle=True"),
    ],
)
def test_bad_parameters(params, error, match):
    with pytest.raises(error, match=match):
        TaskStratifiedKFold(**params)


def test_column_that_cannot_hold_the_tasks():
    table = pd.DataFrame({"load": X[:, 2].astype(int), "temperature": X[:, 0]})
    message = (
        r"^Column 'temperature' \(task_feature=-1 of TaskStratifiedKFold\) cannot hold "
        r"the tasks: .* 18 of 18 are fractional"
    )
    with pytest.raises(ValueError, match=message):
        next(TaskStratifiedKFold(2).split(table))


def test_groups_are_not_used():
    with pytest.warns(UserWarning, match="ignored by TaskStratifiedKFold"):
        found = folds(TaskStratifiedKFold(2), X, y, X[:, -1])
    assert found == folds(TaskStratifiedKFold(2), X)


def test_repr():
    assert repr(TaskStratifiedKFold(3, task_feature="load")) == (
        "TaskStratifiedKFold(n_splits=3, random_state=None, shuffle=False,\n"
        "          task_feature='load')"
    )


class TestInScikitLearn:
    """With a regression for each task, which is exact and quick."""

    model = BayesianLinearRegression(task_feature=0)
    X = SORTED[0][:, [2, 0, 1]]
    y = X[:, 1] * X[:, 0] - X[:, 2]
    cv = TaskStratifiedKFold(3, task_feature=0)

    def test_scores(self):
        assert cross_val_score(self.model, self.X, self.y, cv=self.cv).min() > 0.999

    def test_grid_search(self):
        # The splitter sees X before the first step, the model after it.
        model = BayesianLinearRegression(task_feature=-1)
        moved = make_pipeline(FunctionTransformer(np.fliplr), model)
        grid = {"bayesianlinearregression__weight_variance": [1e-6, 1e6]}
        search = GridSearchCV(moved, grid, cv=self.cv, error_score="raise")
        search.fit(self.X, self.y)
        assert list(search.best_params_.values()) == [1e6]

    def test_grid_search_with_routed_metadata(self):
        grid = {"weight_variance": [1e6]}
        with sklearn.config_context(enable_metadata_routing=True):
            search = GridSearchCV(self.model, grid, cv=self.cv, error_score="raise")
            assert search.fit(self.X, self.y).best_score_ > 0.999

    @pytest.mark.parametrize("shuffle", [False, True])
    def test_learning_curve(self, shuffle):
        cv = TaskStratifiedKFold(3, task_feature=0, shuffle=shuffle)
        sizes, train, test = learning_curve(
            self.model,
            self.X,
            self.y,
            cv=cv,
            train_sizes=[3, 9, 12],
            error_score="raise",
        )
        assert sizes.tolist() == [3, 9, 12]
        assert np.isfinite(train).all()
        assert test[-1].min() > 0.999

    @pytest.mark.parametrize("cv", [KFold(3), GroupKFold(3)], ids=repr)
    def test_other_splits_say_what_to_use(self, cv):
        said = r"Unknown tasks? .*TaskStratifiedKFold.*, or TaskTimeSeriesSplit for"
        with pytest.raises(ValueError, match=said):
            cross_val_score(
                self.model,
                self.X,
                self.y,
                cv=cv,
                groups=self.X[:, 0] if isinstance(cv, GroupKFold) else None,
                error_score="raise",
            )
