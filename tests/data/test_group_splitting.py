"""Folds by task in which groups stay together."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from samples import draw
from scipy.sparse import csr_array
from sklearn.model_selection import GridSearchCV, cross_val_score

from skmtgp import BayesianLinearRegression
from skmtgp.model_selection import TaskStratifiedGroupKFold


def table_of(*sizes):
    """Groups of so many rows of each task; X and the group of each row."""
    counts = [(task, size) for task, of in enumerate(sizes) for size in of]
    tasks = np.concatenate([np.full(size, task) for task, size in counts])
    groups = np.repeat(np.arange(len(counts)), [size for _, size in counts])
    return np.column_stack([np.linspace(0.0, 1.0, len(tasks)), tasks]), groups


def folds(cv, X, groups):
    found = cv.split(X, groups=groups)
    return [(train.tolist(), test.tolist()) for train, test in found]


SIZES = [
    [[3] * 6, [3] * 6],
    [[2] * 10, [7, 1, 1], [4, 4], [1] * 40],
    [[5, 4, 3, 2, 1], [1, 2]],
    [[1] * 7],
]


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("n_splits", [2, 3, 5])
@pytest.mark.parametrize("sizes", SIZES)
def test_every_fold_trains_on_every_task(sizes, n_splits, shuffle):
    X, groups = table_of(*sizes)
    cv = TaskStratifiedGroupKFold(n_splits, shuffle=shuffle)
    assert cv.get_n_splits(X, None, groups) == n_splits
    tested, of_tasks = np.zeros(len(X), dtype=int), []
    for train, test in cv.split(X, groups=groups):
        assert sorted([*train, *test]) == list(range(len(X)))
        assert not set(groups[train]) & set(groups[test])
        assert set(X[train, -1]) == set(range(len(sizes)))
        of_tasks.append(np.bincount(X[test, -1].astype(int), minlength=len(sizes)))
        tested[test] += 1
    assert (tested == 1).all()
    tests = np.count_nonzero(of_tasks, axis=0)
    assert tests.tolist() == [min(n_splits, len(of)) for of in sizes]


def test_groups_in_another_order_are_refused():
    X, groups = table_of([3] * 4, [2] * 4)
    frame = pd.DataFrame(X, columns=["x", "site"])
    cv = TaskStratifiedGroupKFold(2, task_feature="site")
    shuffled = pd.Series(groups).sample(frac=1.0, random_state=0)
    with pytest.raises(ValueError, match=r"groups has the index .* groups\.loc\[X\.in"):
        folds(cv, frame, shuffled)
    assert folds(cv, frame, shuffled.sort_index()) == folds(cv, frame, groups)


def test_groups_of_one_size_are_dealt_evenly():
    X, groups = table_of([3] * 11, [2] * 8)
    for _, test in TaskStratifiedGroupKFold(4).split(X, groups=groups):
        rows = np.bincount(X[test, -1].astype(int))
        assert rows[0] in (6, 9)
        assert rows[1] == 4


def test_groups_of_several_tasks_stay_together():
    rng = np.random.default_rng(0)
    tasks, groups = rng.integers(4, size=200), rng.integers(12, size=200)
    X = np.column_stack([rng.uniform(size=200), tasks])
    for train, test in TaskStratifiedGroupKFold(3).split(X, groups=groups):
        assert not set(groups[train]) & set(groups[test])
        share = np.bincount(tasks[test]) / np.bincount(tasks)
        assert (np.abs(share - 1 / 3) < 0.15).all()


def test_a_task_is_not_left_to_one_fold():
    # the last group is drawn to the fold of the second, which has the rest of task 0
    counts = {"a": [0, 6, 6], "b": [5, 0, 0], "c": [5, 4, 4]}
    tasks = np.concatenate([np.repeat(range(3), of) for of in counts.values()])
    groups = np.repeat(list(counts), [sum(of) for of in counts.values()])
    X = np.column_stack([np.ones(len(tasks)), tasks])
    for train, _ in TaskStratifiedGroupKFold(2).split(X, groups=groups):
        assert set(tasks[train]) == {0, 1, 2}


def test_groups_that_leave_a_training_set_without_a_task():
    tasks, groups = [0, 1, 1, 2, 2, 0], ["a", "a", "b", "b", "c", "c"]
    X = np.column_stack([np.ones(6), tasks])
    with pytest.raises(ValueError, match=r"All rows of task .* would be in one fold"):
        next(TaskStratifiedGroupKFold(2).split(X, groups=groups))


@pytest.mark.parametrize(
    "labels",
    [
        lambda g: g.tolist(),
        lambda g: g / 10.0,
        lambda g: pd.Series(g.astype(str), index=g[::-1]),
        lambda g: pd.Categorical(g.astype(str)),
        lambda g: pd.Timestamp(0) + pd.to_timedelta(g, unit="s"),
    ],
)
def test_labels_of_groups_are_of_any_type(labels):
    X, groups = table_of([3, 2, 2], [2, 2])
    cv = TaskStratifiedGroupKFold(2)
    assert folds(cv, X, labels(groups)) == folds(cv, X, groups)


def test_random_state_fixes_the_folds():
    X, groups = table_of([3] * 6, [3] * 6)
    first, again, other = (
        folds(TaskStratifiedGroupKFold(3, shuffle=True, random_state=seed), X, groups)
        for seed in (0, 0, 1)
    )
    assert first == again
    assert first != other


def test_rows_of_a_training_set_come_in_turns():
    X, groups = table_of([3] * 6, [3] * 6)
    for train, _ in TaskStratifiedGroupKFold(3).split(X, groups=groups):
        assert set(X[train[:2], -1]) == {0, 1}


@pytest.mark.parametrize(
    ("sizes", "match"),
    [
        ([[2, 2, 2, 2], [9]], "One group alone of task 1: no fold .* 2 groups or more"),
        ([[2, 2, 2, 2], [9]], "of every task, or leave its rows out"),
        ([[2, 2], [3, 3]], "n_splits=3 is above the number of groups .* is 2 at most"),
    ],
)
def test_too_few_groups(sizes, match):
    X, groups = table_of(*sizes)
    with pytest.raises(ValueError, match=match):
        next(TaskStratifiedGroupKFold(3).split(X, groups=groups))


@pytest.mark.parametrize(
    ("groups", "match"),
    [
        (None, r"groups is None, .* of shape \(5,\).* use TaskStratifiedKFold"),
        ([1, 2], r"groups is of shape \(2,\), but .* of shape \(5,\)"),
        (np.ones((5, 2)), r"groups is of shape \(5, 2\)"),
        ([1.0, 1.0, np.nan, 2.0, np.nan], "2 missing labels .* the first in row 2"),
        (["a", "a", "b", None, "c"], "1 missing labels .* the first in row 3"),
    ],
)
def test_bad_groups(groups, match):
    X, _ = table_of([1, 1, 1], [1, 1])
    with pytest.raises(ValueError, match=match):
        next(TaskStratifiedGroupKFold(2).split(X, groups=groups))


@pytest.mark.parametrize(
    ("X", "error", "match"),
    [
        (csr_array(np.ones((4, 2))), TypeError, "but TaskStratifiedGroupKFold reads"),
        (np.full((4, 2), np.nan), ValueError, "missing labels"),
        (np.empty((0, 2)), ValueError, "minimum of 1 is required"),
    ],
)
def test_bad_tables(X, error, match):
    with pytest.raises(error, match=match):
        next(TaskStratifiedGroupKFold(2).split(X, groups=np.arange(X.shape[0])))


def test_repr():
    assert repr(TaskStratifiedGroupKFold(3, task_feature="load")) == (
        "TaskStratifiedGroupKFold(n_splits=3, random_state=None, shuffle=False,\n"
        "             task_feature='load')"
    )


class TestInScikitLearn:
    X, _ = draw(per_task=6)
    y, groups = X[:, 0] * (1.0 + X[:, -1]), np.arange(len(X)) // 2
    cv = TaskStratifiedGroupKFold(2)

    def test_scores(self):
        model, options = BayesianLinearRegression(), {"cv": self.cv}
        for params in ({"groups": self.groups}, {"params": {"groups": self.groups}}):
            with sklearn.config_context(enable_metadata_routing="params" in params):
                scores = cross_val_score(model, self.X, self.y, **options, **params)
            assert scores.min() > 0.9

    def test_grid_search(self):
        grid = {"weight_variance": [1e-6, 1e6]}
        search = GridSearchCV(BayesianLinearRegression(), grid, cv=self.cv)
        search.fit(self.X, self.y, groups=self.groups)
        assert search.best_params_ == {"weight_variance": 1e6}
