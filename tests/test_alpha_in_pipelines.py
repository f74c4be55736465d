"""Known noise of new rows, through the helpers for pipelines."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.compose import make_column_transformer
from sklearn.dummy import DummyRegressor
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import (
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    WideRegressor,
    add_task,
    log_predictive_density,
    partial_fit,
    predict_interval,
)
from skmtgp.model_selection import TaskStratifiedKFold

RNG = np.random.default_rng(0)
X = pd.DataFrame({"x": RNG.uniform(0.0, 6.0, 30), "task": np.arange(30) % 3})
y = pd.Series(np.sin(X["x"]) * (1 + X["task"]) + 0.1 * RNG.standard_normal(30))
ALPHA = pd.Series(RNG.uniform(0.0, 0.4, 30))
MODEL = MultiTaskGPRegressor("rbf", rank=1, max_iter=0)
SCALED = make_column_transformer((StandardScaler(), ["x"]), remainder="passthrough")
FIRST, LATER = slice(0, 20), slice(20, 30)
KNOWN = {"alpha": ALPHA[LATER], "sample_weight": np.arange(10) % 3}


def chain(model=MODEL):
    return make_pipeline(clone(SCALED), clone(model))


@pytest.fixture(scope="module")
def fitted():
    return chain().fit(X, y)


def test_predictions(fitted):
    inner = fitted[0].transform(X)
    expected = fitted[-1].predict_interval(inner, 0.9, alpha=ALPHA.to_numpy())
    found = predict_interval(fitted, X, 0.9, alpha=ALPHA)
    np.testing.assert_array_equal(found, expected)
    expected = fitted[-1].log_predictive_density(inner, y, alpha=ALPHA)
    found = log_predictive_density(fitted, X, y, alpha=ALPHA)
    np.testing.assert_array_equal(found, expected)
    grid = {"multitaskgpregressor__rank": [1]}
    search = GridSearchCV(chain(), grid, cv=TaskStratifiedKFold(2, task_feature="task"))
    found = log_predictive_density(search.fit(X, y), X, y, alpha=ALPHA)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_rows_that_join():
    found = partial_fit(chain(), X[FIRST], y[FIRST], alpha=ALPHA[FIRST])
    model = clone(MODEL)
    scaled = found[0].transform(X)
    model.fit(scaled[FIRST], y[FIRST], alpha=ALPHA[FIRST])
    found = partial_fit(found, X[LATER], y[LATER], **KNOWN, max_rows=25)
    model.partial_fit(scaled[LATER], y[LATER], **KNOWN, max_rows=25)
    np.testing.assert_array_equal(found[-1].predict(scaled), model.predict(scaled))
    assert found[-1].y_train_.shape == (25,)


@pytest.mark.parametrize("model", [MODEL, RankSearchIC(MODEL, ranks=(1,))])
def test_tasks_that_join(model):
    before = chain(model).fit(X[FIRST], y[FIRST])
    new = X[LATER].assign(task=7)
    found = add_task(before, new, y[LATER], **KNOWN)
    expected = before[-1].add_task(before[0].transform(new), y[LATER], **KNOWN)
    inner = before[0].transform(new)
    np.testing.assert_array_equal(found[-1].predict(inner), expected.predict(inner))


def test_labels_in_another_order_are_seen_before_they_are_lost(fitted):
    turned, match = ALPHA.iloc[::-1], "alpha has the labels of the rows in another ord"
    for call in (
        lambda: predict_interval(fitted, X, alpha=turned),
        lambda: log_predictive_density(fitted, X, y, alpha=turned),
        lambda: partial_fit(fitted, X, y, alpha=turned),
        lambda: add_task(fitted, X.assign(task=8), y, alpha=turned),
    ):
        with pytest.raises(ValueError, match=match):
            call()
    assert len(fitted[-1].y_train_) == 30


def test_a_table_with_a_column_for_each_task():
    wide = y.to_numpy().reshape(10, 3)
    model = WideRegressor(PooledGP("rbf", max_iter=0)).fit(X[:10][["x"]], wide)
    alpha = ALPHA.to_numpy().reshape(10, 3)
    found = predict_interval(model, X[:10][["x"]], alpha=alpha)
    expected = model.predict_interval(X[:10][["x"]], alpha=alpha)
    np.testing.assert_array_equal(found, expected)


def test_models_without():
    dummy = DummyRegressor().fit(X, y)
    with pytest.raises(TypeError, match="must be one of skmtgp"):
        predict_interval(dummy, X, alpha=0.1)
