"""Masked arrays: what is masked is missing, wherever it is given."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    PooledGP,
    WideRegressor,
)
from skmtgp._data.labels import check_labels
from skmtgp._data.numbers import as_frame, check_numbers, unmasked
from skmtgp.metrics import coverage, make_standardized_log_loss_scorer
from skmtgp.model_selection import TaskStratifiedKFold

X = np.column_stack([np.linspace(0.0, 3.0, 12), np.arange(12) % 2])
Y = np.sin(X[:, 0])
ROW = 5


def masked(values, *where):
    """The values, with one of them masked."""
    mask = np.zeros(np.shape(values), bool)
    mask[where or ROW] = True
    return np.ma.MaskedArray(values, mask)


@pytest.mark.parametrize("kind", [float, np.float32, int, bool, object])
def test_what_is_masked_is_not_a_number(kind):
    values = np.array([[1, 0], [1, 1], [0, 1]], kind)
    match = "Input X contains NaN in column 1: 1 of 3 values, the first in row 2"
    with pytest.raises(ValueError, match=match):
        check_numbers(masked(values, 2, 1), "X")


def test_masks_that_hide_nothing():
    for mask in (False, np.zeros(2, bool)):
        values = np.ma.MaskedArray([1.0, 2.5], mask)
        found = check_numbers(values, "y")
        assert type(found) is np.ndarray
        assert found.tolist() == [1.0, 2.5]
    values = np.arange(3)
    assert unmasked(values) is values


def test_numbers_that_are_left_keep_their_digits():
    found = as_frame(masked(np.array([2**53 + 1, 7]), 1))
    assert found[0] == 2**53 + 1
    assert np.isnan(found[1])


@pytest.mark.parametrize(
    "estimator", [MultiTaskGPRegressor(max_iter=0), BayesianLinearRegression()]
)
@pytest.mark.parametrize("kind", [float, object])
def test_rows_that_are_masked(estimator, kind):
    table, missing = X.astype(kind), "Input {} contains NaN{}: 1 of 12 values, .*row 5"
    feature, label = masked(table, ROW, 0), masked(table, ROW, 1)
    with pytest.raises(ValueError, match=missing.format("X", " in column 0")):
        estimator.fit(feature, Y)
    with pytest.raises(ValueError, match=r"1 missing label of 12 .* first in row 5"):
        estimator.fit(label, Y)
    with pytest.raises(ValueError, match=missing.format("y", "")):
        estimator.fit(table, masked(Y))
    model = estimator.fit(np.ma.MaskedArray(table), np.ma.MaskedArray(Y))
    assert_array_equal(model.predict(X), estimator.fit(table, Y).predict(X))
    with pytest.raises(ValueError, match=missing.format("X", " in column 0")):
        model.predict(feature)


@pytest.mark.parametrize("name", ["alpha", "sample_weight", "repeat_variance"])
def test_noise_that_is_masked(name):
    known = {"sample_weight": np.full(12, 2.0), name: masked(np.full(12, 2.0))}
    with pytest.raises(ValueError, match=f"{name} has nan, and must be finite"):
        PooledGP(max_iter=0).fit(X, Y, **known)


@pytest.mark.parametrize("labels", [np.arange(3), np.array(["a", "b", "c"])])
def test_labels_that_are_masked(labels):
    with pytest.raises(ValueError, match="1 missing label of 3"):
        check_labels(masked(labels, 1))
    assert check_labels(np.ma.MaskedArray(labels)).tasks.tolist() == labels.tolist()


def test_rows_that_join_are_masked():
    model = MultiTaskGPRegressor(rank=1, max_iter=0).fit(X, Y)
    new = np.column_stack([X[:, 0], np.full(12, 7)])
    for join, rows in (model.add_task, new), (model.partial_fit, X):
        with pytest.raises(ValueError, match="Input y contains NaN: 1 of 12"):
            join(rows, masked(Y))


def test_masked_columns_of_tasks_have_gaps():
    """As those that are NaN."""
    wide, gaps = np.column_stack([Y, -Y]), masked(np.column_stack([Y, -Y]), ROW, 1)
    model = WideRegressor(PooledGP(max_iter=0))
    found = model.fit(X[:, :1], gaps)
    expected = WideRegressor(PooledGP(max_iter=0)).fit(X[:, :1], gaps.filled(np.nan))
    assert_array_equal(found.predict(X[:, :1]), expected.predict(X[:, :1]))
    weights = masked(np.ones(12))
    with pytest.raises(ValueError, match="NaN"):
        found.score(X[:, :1], wide, sample_weight=weights)
    scores = [
        make_standardized_log_loss_scorer(y_train=of)(model, X[:, :1], wide)
        for of in (gaps, gaps.filled(np.nan))
    ]
    assert scores[0] == scores[1]


def test_metrics_and_splits():
    with pytest.raises(ValueError, match="Input y_true contains NaN"):
        coverage(masked(Y), Y, np.ones(12), level=0.9, tasks=X[:, 1])
    with pytest.raises(ValueError, match="missing label"):
        next(TaskStratifiedKFold(2).split(masked(X, ROW, 1)))
