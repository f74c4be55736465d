"""Trends of shares that add up to one: what errors advise, Scheffe's polynomials."""

import numpy as np
import pandas as pd
import pytest
from sklearn.preprocessing import PolynomialFeatures

from skmtgp import MultiTaskGPRegressor

NAMES = ["x1", "x2", "x3"]


def mixtures(n=24, seed=0):
    """Shares of three components, of two tasks, and a response."""
    rng = np.random.default_rng(seed)
    X = pd.DataFrame(rng.dirichlet([1, 1, 1], n), columns=NAMES)
    task = np.arange(n) % 2
    y = X @ [1.0, 2.0, 3.0] + 4.0 * (1 + task) * X["x1"] * X["x2"] + task
    return X.assign(task=task), y + 0.02 * rng.standard_normal(n)


@pytest.mark.parametrize("per_task", [False, True])
def test_shares_and_a_constant(per_task):
    X, y = mixtures()
    model = MultiTaskGPRegressor(rank=1, trend="linear", trend_per_task=per_task)
    with pytest.raises(ValueError, match="leave the constant out") as caught:
        model.fit(X, y)
    assert "trend=[...] with the others alone ('x1', 'x2'" in str(caught.value)
    assert "trend_per_task=False" not in str(caught.value)
    with pytest.raises(ValueError, match="leave the constant out"):
        model.fit(X.to_numpy(), y)
    assert model.set_params(trend=NAMES).fit(X, y).coef_.size == 3 * (1 + per_task)


def test_columns_that_all_rows_tell_may_be_shared():
    X, y = mixtures()
    X = X[["x1", "x2", "task"]].copy()
    X.loc[X["task"] == 1, "x2"] = 0.5
    model = MultiTaskGPRegressor(rank=1, trend="linear", trend_per_task=True)
    with pytest.raises(ValueError, match=r"of task 1 .* or set trend_per_task"):
        model.fit(X, y)
    assert model.set_params(trend_per_task=False).fit(X, y).coef_.size == 3


def test_columns_that_no_rows_tell_are_to_be_left_out():
    X, y = mixtures()
    X = X.assign(x4=2.0 * X["x1"])[["x1", "x2", "x4", "task"]]
    model = MultiTaskGPRegressor(rank=1, trend="linear", trend_per_task=True)
    with pytest.raises(ValueError, match=r"Leave such columns out of trend\.$"):
        model.fit(X, y)


def test_scheffe_polynomials_of_each_task():
    X, y = mixtures()
    new, _ = mixtures(seed=1)
    task = new["task"]
    truth = new[NAMES] @ [1.0, 2.0, 3.0] + 4.0 * (1 + task) * new["x1"] * new["x2"]
    scheffe = PolynomialFeatures(2, include_bias=False, interaction_only=True)
    model = MultiTaskGPRegressor(trend=scheffe, trend_per_task=True).fit(X, y)
    np.testing.assert_allclose(model.predict(new), truth + task, atol=0.2)
    assert model.trend_names_.tolist() == [*NAMES, "x1 x2", "x1 x3", "x2 x3"]
