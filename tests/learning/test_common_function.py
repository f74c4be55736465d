"""A function of one input that all tasks share beside others, as shocks of a year."""

import warnings

import numpy as np
import pandas as pd
import pytest
from rarely import rarely
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp._estimators import other_models
from skmtgp.exceptions import SeveralKernelsWarning
from skmtgp.kernels import Columns
from skmtgp.learning import own_kernels
from skmtgp.learning.common_function import NOT_ASKED, common_function

N_TASKS, YEARS = 12, 15
ONE = {"rank": 0, "diagonal": "equal", "noise": "shared", "normalize_y": "shared"}


def panel(*, shock=0.5, seed=1):
    """Countries with levels, slopes along covariates, and shocks that all feel.

    X, y, and the function itself.
    """
    rng = np.random.default_rng(seed)
    year, x = np.tile(np.arange(YEARS), N_TASKS), rng.normal(size=(N_TASKS * YEARS, 3))
    country = np.repeat(np.arange(N_TASKS), YEARS)
    f = rng.normal(0.0, 2.0, N_TASKS)[country] + x @ [0.8, -0.5, 0.3]
    f += shock * rng.normal(size=YEARS)[year]
    columns = {"a": x[:, 0], "year": 1990.0 + year, "b": x[:, 1], "c": x[:, 2]}
    X = pd.DataFrame(columns).assign(country=country.astype(str))
    return X, f + 0.4 * rng.normal(size=len(f)), f


def said(model, X, y, *given):
    """What was said of several kernels."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, y, *given)
    return [str(of.message) for of in caught if of.category is SeveralKernelsWarning]


def asked(monkeypatch, model, X, y, *given):
    """The problem, the mode, and what is found."""
    found = []

    def ask(problem, mode, enough):
        found.append((problem, mode, common_function(problem, mode, enough)))
        return found[-1][-1]

    monkeypatch.setattr(other_models, "common_function", ask)
    said(model, X, y, *given)
    return found


def named(message):
    """The model that a message names."""
    told = message.split("Try ")[1].split(", with Columns")[0]
    known = {"Columns": Columns, "Matern": Matern}
    return eval(told, known | {"MultiTaskGPRegressor": MultiTaskGPRegressor})


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_it_is_said_and_what_it_says_is_better(unit):
    X, y, f = panel()
    known = np.random.default_rng(1).random(len(y)) < 0.75
    model = MultiTaskGPRegressor(task_feature="country")
    (message,) = said(model, X[known], unit * y[known])
    assert message.startswith("All tasks of the output share a function of 'year'")
    better = named(message).set_params(task_feature="country")
    better.fit(X[known], unit * y[known])
    errors = [
        np.square(of.predict(X[~known]) / unit - f[~known]).mean()
        for of in (model, better)
    ]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("seconds", [False, True])
def test_of_an_array_it_names_the_column(seconds):
    X, y, _ = panel()
    X = X.assign(year=3e7 * X["year"]) if seconds else X
    (message,) = said(MultiTaskGPRegressor(), X.to_numpy(dtype=float), y)
    assert "a function of column 1 of the inputs alone" in message
    named(message).fit(X.to_numpy(dtype=float), y)


@pytest.mark.parametrize("seed", [0, *rarely(1, 2)])
def test_where_there_is_none_it_is_not_said(seed):
    X, y, _ = panel(shock=0.0, seed=seed)
    assert not said(MultiTaskGPRegressor(task_feature="country"), X, y)


def test_the_gain_is_that_of_bic(monkeypatch):
    """Beside a length-scale and a variance more."""
    X, y, _ = panel()
    model = MultiTaskGPRegressor(task_feature="country", **ONE)
    [(_, _, found)] = asked(monkeypatch, model, X, y)
    two = {"shared": [False, True], "diagonal": ["equal", False]}
    kernel = [model.kernel_, Columns(found.kernel, ["year"])]
    two = clone(model).set_params(kernel=kernel, **two).fit(X, y)
    gain = two.log_marginal_likelihood_value_ - model.log_marginal_likelihood_value_
    assert found.gain == pytest.approx(gain - np.log(len(y)), abs=0.5)
    assert found.feature == 1


def test_where_it_is_not_asked(monkeypatch):
    X, y, _ = panel()
    model = MultiTaskGPRegressor(task_feature="country", **ONE)
    y_exact = np.sin(X["a"].to_numpy()) + X["country"].astype(float).to_numpy()
    cases = {
        "no noise": (clone(model), X, y_exact),
        "a kernel that is given": (clone(model).set_params(kernel="matern"), X, y),
        "alpha": (clone(model), X, y, np.full(len(y), 0.1)),
        "trend": (clone(model).set_params(trend=["year"]), X, y),
        "held length-scales": (clone(model).set_params(kernel=RBF(1, "fixed")), X, y),
        "independent": (IndependentGP(task_feature="country"), X, y),
        "pooled": (PooledGP(task_feature="country"), X, y),
        "single": (SingleTaskGP(task_feature="country"), X, y),
    }
    for name, case in cases.items():
        found = asked(monkeypatch, *case)
        assert all(of is NOT_ASKED for *_, of in found), name
    few_values = X.assign(
        year=X["year"] // 5, **(X[["a", "b", "c"]] > 0.0).astype(float)
    )
    found = asked(monkeypatch, clone(model), few_values, y)
    assert [of for *_, of in found] == [NOT_ASKED]
    monkeypatch.setattr(own_kernels, "MOST_ROWS", len(y) - 1)
    assert [of for *_, of in asked(monkeypatch, clone(model), X, y)] == [NOT_ASKED]
