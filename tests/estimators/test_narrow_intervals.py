"""Intervals of few rows for each hyperparameter are told of, when asked for."""

import warnings

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import RBF

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC, SingleTaskGP
from skmtgp.exceptions import NarrowIntervalsWarning

pytestmark = pytest.mark.filterwarnings(
    "error::skmtgp.exceptions.NarrowIntervalsWarning"
)
ASKED = {
    "std": lambda model, X: model.predict(X, return_std=True),
    "cov": lambda model, X: model.predict(X, return_cov=True),
    "interval": lambda model, X: model.predict_interval(X),
}


def draw(n_each, n_tasks=3, seed=0):
    """Rows of related tasks."""
    rng = np.random.default_rng(seed)
    x, task = rng.uniform(0, 8, n_each * n_tasks), np.repeat(range(n_tasks), n_each)
    y = np.sin(x) * (1.0 + 0.4 * task) + 0.5 * np.cos(0.7 * x) * (task == 1)
    return np.column_stack([x, task]), y + 0.1 * rng.standard_normal(len(x))


@pytest.fixture(scope="module")
def few():
    """A model of rank 2 and 24 rows, for seven or more hyperparameters."""
    X, y = draw(8)
    return MultiTaskGPRegressor(rank=2).fit(X, y), X


@pytest.mark.parametrize("asked", ASKED.values(), ids=ASKED)
def test_few_rows_for_each_hyperparameter_are_told_with_their_numbers(few, asked):
    model, X = few
    words = f"24 rows are few for {model.n_hyperparameters_} hyperparameters"
    with pytest.warns(NarrowIntervalsWarning, match=words):
        asked(model, X)


def test_who_asks_for_means_is_not_told(few):
    model, X = few
    model.predict(X)


def test_eight_rows_for_each_hyperparameter_are_enough():
    X, y = draw(20)
    mixed = np.random.default_rng(1).permutation(60)
    X, y = X[mixed], y[mixed]
    model = MultiTaskGPRegressor(RBF(1.0), rank=1, noise="shared", normalize_y="shared")
    n = 8 * model.fit(X, y).n_hyperparameters_
    assert n <= 60
    assert not _is_told(model.fit(X[:n], y[:n]), X)
    assert _is_told(model.fit(X[: n - 1], y[: n - 1]), X)


def _is_told(model, X):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.predict_interval(X)
    return any(of.category is NarrowIntervalsWarning for of in caught)


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(rank=2, hyperparameters="laplace"),
        MultiTaskGPRegressor(rank=2, max_iter=0),
        MultiTaskGPRegressor(rank=0, shared=True),
        MultiTaskGPRegressor([RBF(1.0), RBF(0.5)], rank=1),
        IndependentGP(),
    ],
    ids=repr,
)
def test_other_models_say_nothing(model):
    X, y = draw(6)
    assert not _is_told(model.fit(X, y), X)


def test_draws_say_nothing_and_auto_draws():
    X, y = draw(6)
    options = {"hyperparameters": "auto", "n_draws": 5}
    model = MultiTaskGPRegressor(rank=1, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of so few draws
        model.fit(X, y)
    assert model.hyperparameters_ == "sampled"
    assert not _is_told(model, X)


def test_a_search_says_what_its_best_model_would():
    X, y = draw(8)
    search = RankSearchIC(MultiTaskGPRegressor(), ranks=[2], simpler=False).fit(X, y)
    assert _is_told(search, X)
    assert _is_told(search.best_estimator_, X)


def test_tasks_by_themselves_are_told_by_name():
    X, y = draw(40, n_tasks=2)
    model = SingleTaskGP().fit(X[:50], y[:50])  # ten rows of task 1
    with pytest.warns(NarrowIntervalsWarning, match="Task 1: too few rows"):
        model.predict_interval(X)


def test_tasks_by_themselves_with_enough_rows_are_not_told():
    X, y = draw(40, n_tasks=2)
    assert not _is_told(SingleTaskGP().fit(X, y), X)


def test_an_unfitted_model_is_refused_as_before():
    with pytest.raises(NotFittedError):
        MultiTaskGPRegressor().predict_interval([[0.0, 0]])
