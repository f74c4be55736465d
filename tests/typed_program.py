"""A program of a user: mypy finds nothing wrong, and knows what everything is.

test_typed_programs.py checks it. Nothing here is run.
"""

from typing import assert_type

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
    add_task,
    compile_predictor,
    log_predictive_density,
    make_inverse_dynamics_regressor,
    predict_interval,
    stack_tasks,
)
from skmtgp.datasets import (
    fetch_kinova_gen3,
    fetch_puma560,
    load_puma560,
    make_puma560,
    make_sites,
    make_soil,
)
from skmtgp.inspection import TaskPredictionDisplay
from skmtgp.kernels import ARDLinear, Columns, Spherical
from skmtgp.metrics import (
    coverage,
    make_normalized_mse_scorer,
    mean_standardized_log_loss,
    normalized_mean_squared_error,
)
from skmtgp.preprocessing import InverseDynamicsFeatures
from skmtgp.robot import RigidBodyRegressor, SemiparametricRegressor

Array = NDArray[np.float64]


def fits() -> None:
    X, y = make_sites()
    assert_type(MultiTaskGPRegressor("rbf").fit(X, y), MultiTaskGPRegressor)
    assert_type(SingleTaskGP().fit(X, y, alpha=y**2), SingleTaskGP)
    assert_type(IndependentGP().fit(X, y), IndependentGP)
    assert_type(PooledGP().fit(X, y), PooledGP)
    assert_type(RankSearchIC(ranks=(1, 2)).fit(X, y), RankSearchIC)
    assert_type(BayesianLinearRegression().fit(X, y), BayesianLinearRegression)
    assert_type(WideRegressor().fit(X, y), WideRegressor)
    assert_type(InverseDynamicsFeatures().fit(X), InverseDynamicsFeatures)
    assert_type(RigidBodyRegressor("a.urdf").fit(X, y), RigidBodyRegressor)
    rest = SemiparametricRegressor("a.urdf").fit(X, y)
    assert_type(rest, SemiparametricRegressor)


def predictions(uncertain: bool) -> None:
    X, y = make_sites()
    model = MultiTaskGPRegressor(task_feature="site").fit(X, y)
    assert_type(model.predict(X), Array)
    mean, std = model.predict(X, return_std=True)
    assert_type(std, Array)
    mean, covariance = model.predict(X, return_cov=True)
    assert_type(covariance, Array)
    assert_type(model.predict(X, uncertain), Array | tuple[Array, Array])
    lower, upper = model.predict_interval(X, 0.95)
    assert_type(upper, Array)
    assert_type(model.log_predictive_density(X, y), Array)
    lower, upper = model.predict_interval(X, alpha=y**2)
    assert_type(model.log_predictive_density(X, y, alpha=0.1), Array)
    assert_type(model.log_marginal_likelihood(), float)
    value, gradient = model.log_marginal_likelihood(model.theta_, True)
    assert_type(value, float)
    assert_type(gradient, Array)
    assert_type(model.sample_y(X, 3), Array)
    assert_type(model.add_task(X, y, alpha=y**2), MultiTaskGPRegressor)
    assert_type(model.partial_fit(X, y, alpha=y**2, max_rows=9), MultiTaskGPRegressor)
    assert_type(compile_predictor([model], task="hill")(mean), Array)
    TaskPredictionDisplay.from_estimator(model, X, y).plot()


def models_of_other_kinds() -> None:
    X, y = make_sites()
    search = RankSearchIC().fit(X, y)
    value, gradient = search.log_marginal_likelihood(eval_gradient=True)
    assert_type(search.log_marginal_likelihood() - value, float)
    value, gradient = SingleTaskGP().fit(X, y).log_marginal_likelihood(None, True)
    assert_type(gradient, Array)
    mean, std = BayesianLinearRegression().fit(X, y).predict(X, True)
    assert_type(std, Array)
    pipe = make_inverse_dynamics_regressor(PooledGP(), kernel="geometric")
    lower, upper = predict_interval(add_task(pipe, X, y), X)
    assert_type(upper, Array)
    assert_type(log_predictive_density(pipe, X, y), Array)


def tables_with_columns_of_tasks() -> None:
    survey, truth = make_soil(return_truth=True)
    X, y = stack_tasks(make_soil(60, n_cadmium=20), ["cadmium", "zinc"])
    wide = WideRegressor().fit(survey[["east", "north"]], survey[["cadmium", "zinc"]])
    assert_type(wide.predict(truth), Array)
    assert_type(wide.log_predictive_density(truth, survey), Array)
    mean, std = wide.predict(truth, return_std=True)
    assert_type(mean, Array)


def loaders(as_frame: bool) -> None:
    X, y, truth = make_sites((9, 9, 9, 9, 9), return_truth=True)
    y - truth(X)
    puma = load_puma560(subset="extrapolation", as_frame=True)
    puma.data, puma.target_names, puma.DESCR
    Q, tau = load_puma560(n_per_load=20, loads=range(1, 6), return_X_y=True)
    assert_type(tau, Array)
    frame, torques = fetch_puma560(random_state=3, return_X_y=True, as_frame=True)
    assert_type(torques, pd.DataFrame)
    Q, tau = make_puma560(masses=[0.5, 1.0], noise=0.1, return_X_y=True)
    assert_type(Q, Array)
    Q, tau = fetch_kinova_gen3(recordings=["run"], return_X_y=True)
    assert_type(Q, Array)
    Q, tau = fetch_kinova_gen3(return_X_y=True, as_frame=as_frame)


def metrics(y: Array, mean: Array, std: Array) -> None:
    assert_type(normalized_mean_squared_error(y, mean, tasks=["a", "b"]), float)
    assert_type(coverage(y, mean, std, level=0.9), float)
    each = mean_standardized_log_loss(y, mean, std, y_train=y, multioutput="raw_values")
    assert_type(each, Array)
    make_normalized_mse_scorer("site", y_var={"north": 1.0})


def kernels(x: Array) -> None:
    assert_type(ARDLinear([1.0, 2.0])(x, x), Array)
    assert_type(ARDLinear().diag(x), Array)
    K, gradient = Spherical(2.0)(x, None, True)
    assert_type(gradient, Array)
    K, gradient = Columns(Spherical(), [0])(x, eval_gradient=True)
    assert_type(gradient, Array)
