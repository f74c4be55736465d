"""Tasks that one kernel does not suit: a model of each is likelier."""

import warnings

import numpy as np
import pytest
from rarely import rarely
from sklearn.base import clone
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators import other_models
from skmtgp.exceptions import UnrelatedTasksWarning
from skmtgp.learning import separate

N_TASKS, ROWS = 3, 20
UNRELATED = {"rank": 0, "diagonal": "equal", "kernel": "rbf", "noise": "shared"}


def drawn(*, own_input=True, seed=0):
    """Tasks that depend on an input each, or all on the first."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(N_TASKS), ROWS)
    X = rng.uniform(-2.0, 2.0, (len(task), N_TASKS))
    x = X[np.arange(len(X)), task if own_input else 0]
    y = np.sin(2.0 * x + (0.0 if own_input else task))
    return np.column_stack([X, task]), y + 0.1 * rng.standard_normal(len(y))


def said(model, X, y, *given):
    """What was said of unrelated tasks."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, y, *given)
    return [str(of.message) for of in caught if of.category is UnrelatedTasksWarning]


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_it_is_said(unit):
    X, y = drawn()
    (message,) = said(MultiTaskGPRegressor(), X, unit * y)
    assert message.startswith("No two tasks of the output are closely related")


@pytest.mark.parametrize("seed", [0, *rarely(1, 2)])
def test_tasks_of_one_kernel(seed):
    assert said(MultiTaskGPRegressor(), *drawn(own_input=False, seed=seed)) == []


def test_each_output_is_named():
    X, y = drawn()
    other = drawn(own_input=False)[1]
    model = MultiTaskGPRegressor(**UNRELATED)
    (message,) = said(model, X, np.column_stack([other, y]))
    assert "tasks of output 2 of 2 are" in message


def test_a_search_has_compared_them():
    X, y = drawn()
    search = RankSearchIC()
    assert said(search, X, y) == []
    assert search.best_model_ == "single tasks"
    model = MultiTaskGPRegressor(diagonal="equal")
    assert len(said(RankSearchIC(model, ranks=[0]), X, y)) == 1  # this one has not


def gains(monkeypatch, model, X, y, *given):
    """What the fit finds that models of each task gain."""
    found, ask = [], separate.gain_of_separate_models

    def asked(problem, mode):
        found.append(ask(problem, mode))
        return found[-1]

    monkeypatch.setattr(other_models, "gain_of_separate_models", asked)
    said(model, X, y, *given)
    return found


@pytest.mark.parametrize("normalize_y", ["shared", "per_task"])
def test_the_gain_is_that_of_models_that_are_fitted(monkeypatch, normalize_y):
    """Both by BIC, and the latter with a mean of each task."""
    X, y = drawn()
    y = y + 0.3 * X[:, -1]
    model = MultiTaskGPRegressor(**UNRELATED, normalize_y=normalize_y)
    (gain,) = gains(monkeypatch, model, X, y)
    bic = model.log_marginal_likelihood_value_
    bic -= 0.5 * model.n_hyperparameters_ * np.log(len(y))
    expected = -bic
    for task in range(N_TASKS):
        of = X[:, -1] == task
        kernel = ConstantKernel(1.0) * RBF([1.0] * N_TASKS, (1e-3, 1e3))
        kernel = kernel + WhiteKernel(0.01, (1e-8, 1e2))
        options = {"n_restarts_optimizer": 3, "random_state": 0}
        alone = GaussianProcessRegressor(kernel, **options)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            alone.fit(X[of, :-1], (y[of] - y[of].mean()) / y[of].std())
        expected += alone.log_marginal_likelihood_value_ - ROWS * np.log(y[of].std())
        expected -= 0.5 * (N_TASKS + 3) * np.log(ROWS)
    assert gain > 10.0
    assert gain == pytest.approx(expected, abs=2.0)


def test_where_nothing_is_asked(monkeypatch):
    X, y = drawn()
    few = np.flatnonzero(np.arange(len(y)) % ROWS < 11)
    model = MultiTaskGPRegressor(**UNRELATED)
    cases = {
        "pooled": (PooledGP(), X, y),
        "independent": (IndependentGP(), X, y),
        "few rows": (model, X[few], y[few]),
        "fixed noise": (clone(model).set_params(noise_variance_bounds="fixed"), X, y),
        "alpha": (clone(model), X, y, np.full(len(y), 0.1)),
        "trend": (clone(model).set_params(trend="linear"), X, y),
        "a constant task": (clone(model), X, np.where(X[:, -1] == 0, 0.1, y)),
        "one task": (clone(model), X[:ROWS], y[:ROWS]),
        "sparse": (clone(model).set_params(inference="sparse", n_inducing=9), X, y),
        "alone": (SingleTaskGP(), X, y),
    }
    for name, case in cases.items():
        found = gains(monkeypatch, *case)
        assert not np.isfinite(found).any(), name


def test_rows_that_are_alike_by_chance(monkeypatch):
    """Repeated rows of one task have the same target, those of others have not."""
    X, y = drawn(own_input=False)
    y = y + 0.3 * np.random.default_rng(1).standard_normal(len(y))
    X[10:20], y[10:20], X[30:40], X[50:60] = X[:10], y[:10], X[20:30], X[40:50]
    model = MultiTaskGPRegressor(**UNRELATED)
    assert gains(monkeypatch, model, X, y) == [-np.inf]
    assert model.noise_variance_ > 1e-2


def test_a_search_leaves_out_models_that_are_exact_by_chance():
    """Counts of one task are the same wherever its inputs are."""
    rng = np.random.default_rng(0)
    X = np.column_stack([np.tile(np.arange(10.0), 6), np.repeat([0, 1, 2], 20)])
    y = rng.poisson(2.0, 60).astype(float)
    compared = []
    for repeats in (False, True):
        if repeats:
            y[10:20] = y[:10]
        bounds = (1e-9, 1e3)  # beside those of the default, counts have noise
        model = MultiTaskGPRegressor(noise_variance_bounds=bounds)
        search = RankSearchIC(model, criterion="bic", simpler=True, ranks=(0, 1))
        said(search, X, y)
        compared.append("single tasks" in search.results_["model"].tolist())
    assert compared == [True, False]
