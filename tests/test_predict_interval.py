"""Intervals and densities through a pipeline and a search."""

import numpy as np
import pandas as pd
import pytest
from sklearn.compose import TransformedTargetRegressor
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline

from skmtgp import (
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    log_predictive_density,
    make_inverse_dynamics_regressor,
    predict_interval,
)
from skmtgp.datasets import load_puma560

X, Y = load_puma560(n_per_load=8, loads=[1, 2, 5], return_X_y=True)
QUICK = {"max_iter": 3}
MODELS = {
    "mGP-BIC": RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2)),
    "sGP": SingleTaskGP(**QUICK),
}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def expected(model):
    return model[-1].predict_interval(model[0].transform(X), 0.8, False)


@pytest.mark.parametrize("name", ["mGP-BIC", "sGP"])
def test_of_a_pipeline(name):
    model = make_inverse_dynamics_regressor(MODELS[name]).fit(X, Y[:, 0])
    found = predict_interval(model, X, 0.8, include_noise=False)
    np.testing.assert_array_equal(found, expected(model))
    found = predict_interval(model[-1], model[0].transform(X))
    usual = model[-1].predict_interval(model[0].transform(X))
    np.testing.assert_array_equal(found, usual)
    found = log_predictive_density(model, X, Y[:, 0])
    usual = model[-1].log_predictive_density(model[0].transform(X), Y[:, 0])
    np.testing.assert_array_equal(found, usual)


def test_of_a_search():
    model = make_inverse_dynamics_regressor(PooledGP(**QUICK))
    search = GridSearchCV(model, {"regressor__tol": [1e-3]}, cv=2)
    with pytest.raises(NotFittedError, match="GridSearchCV instance is not fitted"):
        predict_interval(search, X)
    search.fit(X, Y[:, 0])
    found = predict_interval(search, X, 0.8, include_noise=False)
    np.testing.assert_array_equal(found, expected(search.best_estimator_))


def test_other_models_are_refused():
    model = make_pipeline(LinearRegression()).fit(X, Y[:, 0])
    with pytest.raises(TypeError, match="not a LinearRegression"):
        predict_interval(model, X)
    with pytest.raises(TypeError, match="not a LinearRegression"):
        log_predictive_density(model, X, Y[:, 0])


def test_targets_in_another_order_are_refused():
    model = make_inverse_dynamics_regressor(PooledGP(max_iter=0)).fit(X, Y[:, 0])
    y = pd.Series(Y[:, 0])[::-1]
    with pytest.raises(ValueError, match="order"):
        log_predictive_density(model, pd.DataFrame(X), y)


def test_transformed_targets_are_those_of_the_model():
    model = TransformedTargetRegressor(PooledGP(max_iter=0), func=np.cbrt)
    model.set_params(check_inverse=False, inverse_func=np.sinh).fit(X, Y[:, 0])
    with pytest.raises(
        TypeError, match=r"TransformedTargetRegressor.*target_transform"
    ):
        predict_interval(model, X)
