"""Scorers and displays ask the model at the end of a pipeline."""

import numpy as np
import pandas as pd
import pytest
from sklearn import config_context
from sklearn.dummy import DummyRegressor
from sklearn.frozen import FrozenEstimator
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from skmtgp import (
    PooledGP,
    WideRegressor,
    add_task,
    compile_predictor,
    partial_fit,
    predict_interval,
)
from skmtgp.metrics import (
    make_coverage_scorer,
    make_normalized_mse_scorer,
    make_standardized_log_loss_scorer,
)

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.NarrowIntervalsWarning"),
]


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(1)
    X = pd.DataFrame({"x": rng.normal(size=40), "site": np.repeat(["a", "b"], 20)})
    return X, np.sin(X["x"]) + 0.1 * rng.normal(size=40)


@pytest.fixture(scope="module")
def model(rows):
    return PooledGP(max_iter=2, task_feature="site").fit(*rows)


@pytest.mark.parametrize("routing", [False, True])
def test_scores_are_those_of_the_model(rows, model, routing):
    X, y = rows
    chain = make_pipeline(FunctionTransformer(), model)
    scorers = [
        make_coverage_scorer(task_feature="site"),
        make_normalized_mse_scorer("site"),
        make_standardized_log_loss_scorer(y, "site"),
    ]
    with config_context(enable_metadata_routing=routing):
        for score in scorers:
            assert score(chain, X, y) == score(model, X, y)
            nested = make_pipeline(FunctionTransformer(), chain)
            assert score(nested, X, y) == score(model, X, y)


def test_models_that_tell_no_deviation(rows):
    X, y = rows
    chain = make_pipeline(FunctionTransformer(), DummyRegressor()).fit(X, y)
    score = make_coverage_scorer(task_feature="site")
    with pytest.raises(TypeError, match="DummyRegressor takes no include_noise"):
        score(chain, X, y)


@pytest.mark.parametrize("routing", [False, True])
def test_a_pipeline_in_a_wide_regressor(rows, routing):
    """It has intervals and draws, as the model has."""
    X, y = rows
    X, Y = X[["x"]].to_numpy()[:20], np.column_stack([y[:20], -y[:20]])
    plain = PooledGP(max_iter=2)
    chain = make_pipeline(FunctionTransformer(), plain)
    search = GridSearchCV(chain, {"pooledgp__max_iter": [2]}, cv=2)
    expected = WideRegressor(plain).fit(X, Y)
    with config_context(enable_metadata_routing=routing):
        for inner in (chain, search):
            wide = WideRegressor(inner).fit(X, Y)
            asked = [
                lambda of: of.predict(X),
                lambda of: of.predict(X, return_std=True),
                lambda of: of.predict_interval(X, 0.9),
                lambda of: predict_interval(of, X, 0.9),
                lambda of: of.sample_y(X, 3, random_state=1),
                lambda of: of.loo_predict(),
            ]
            for ask in asked:
                np.testing.assert_allclose(ask(wide), ask(expected), rtol=1e-9)


def test_what_a_wide_regressors_model_lacks(rows):
    X, y = rows
    wide = WideRegressor(DummyRegressor()).fit(X[["x"]], y)
    for method in (wide.predict_interval, wide.sample_y):
        with pytest.raises(TypeError, match="DummyRegressor has no"):
            method(X[["x"]])


def test_what_holds_a_model_says_what_to_pass(rows, model):
    """Intervals look inside of it; what changes a model does not."""
    X, y = rows
    search = GridSearchCV(model, {"max_iter": [2]}, cv=2).fit(X, y)
    frozen = FrozenEstimator(model)
    for held, name in ((search, "best_estimator_"), (frozen, "estimator")):
        for call in (add_task, partial_fit, lambda of, *_: compile_predictor(of)):
            with pytest.raises(TypeError, match=rf"Pass its {name}\.$"):
                call(held, X[:3], y[:3])
    expected = model.predict_interval(X)
    np.testing.assert_array_equal(predict_interval(frozen, X), expected)
