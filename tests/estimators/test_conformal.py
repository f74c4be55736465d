"""Conformal intervals of MAPIE around our estimators, as the guide makes them."""

import numpy as np
import pandas as pd
import pytest

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp.model_selection import TaskStratifiedGroupKFold, TaskStratifiedKFold

regression = pytest.importorskip("mapie.regression")
SITE = {"task_feature": "site"}


def draw(n, rng):
    site, x = rng.choice(["a", "b"], n), rng.uniform(0.0, 6.0, n)
    y = np.where(site == "a", 1.0, -1.0) * np.sin(x) + 0.1 * rng.standard_t(2, n)
    return pd.DataFrame({"x": x, "site": site}), y


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    return *draw(60, rng), *draw(400, rng)


@pytest.mark.parametrize("method", ["plus", "base"])
def test_cross_conformal(data, method):
    X, y, X_test, y_test = data
    conformal = regression.CrossConformalRegressor(
        MultiTaskGPRegressor(rank=1, learning="staged", **SITE),
        confidence_level=0.9,
        method=method,
        cv=TaskStratifiedKFold(5, **SITE),
    )
    mean, intervals = conformal.fit_conformalize(X, y).predict_interval(X_test)
    lower, upper = intervals[..., 0].T
    assert mean.shape == y_test.shape
    assert 0.85 < np.mean((lower <= y_test) & (y_test <= upper)) < 0.99


def test_groups_stay_together(data):
    X, y, X_test, _ = data
    groups = np.arange(len(y)) // 4  # stretches of a recording
    conformal = regression.CrossConformalRegressor(
        MultiTaskGPRegressor(rank=1, learning="staged", **SITE),
        confidence_level=0.9,
        cv=TaskStratifiedGroupKFold(3, **SITE),
    )
    conformal.fit_conformalize(X, y, groups=groups)
    _, intervals = conformal.predict_interval(X_test)
    assert (intervals[:, 0] <= intervals[:, 1]).all()


def test_a_search(data):
    X, y, X_test, _ = data
    search = RankSearchIC(MultiTaskGPRegressor(**SITE), ranks=(0, 1), simpler=False)
    conformal = regression.CrossConformalRegressor(
        search, confidence_level=0.9, cv=TaskStratifiedKFold(3, **SITE)
    )
    _, intervals = conformal.fit_conformalize(X, y).predict_interval(X_test)
    assert np.isfinite(intervals).all()


def test_split_with_a_fitted_model():
    """MAPIE asks it for a row of zeros first: there has to be a task 0."""
    rng = np.random.default_rng(0)
    x, task = rng.uniform(0.0, 6.0, 160), np.tile([0, 1], 80)
    y = np.where(task, -1.0, 1.0) * np.sin(x) + 0.1 * rng.standard_t(2, 160)
    X = np.column_stack([x, task])
    model = MultiTaskGPRegressor(rank=1).fit(X[:60], y[:60])
    split = regression.SplitConformalRegressor(model, confidence_level=0.9, prefit=True)
    _, intervals = split.conformalize(X[60:], y[60:]).predict_interval(X)
    lower, upper = intervals[..., 0].T
    assert 0.85 < np.mean((lower <= y) & (y <= upper)) < 0.99
