import numpy as np
import pytest
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from sklearn.model_selection import GridSearchCV

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import load_puma560
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.preprocessing import InverseDynamicsFeatures

LOADS = {"n_per_load": 8, "loads": [1, 2, 5]}
X, Y = load_puma560(**LOADS, return_X_y=True)
FRAME, TARGETS = load_puma560(**LOADS, return_X_y=True, as_frame=True)
QUICK = {"max_iter": 3}
ESTIMATORS = {
    "mGP": MultiTaskGPRegressor(rank=2, **QUICK),
    "mGP-BIC": RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2)),
    "iGP": IndependentGP(**QUICK),
    "pGP": PooledGP(**QUICK),
    "sGP": SingleTaskGP(**QUICK),
}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_arrays_and_frames_with_named_loads(estimator):
    model = make_inverse_dynamics_regressor(estimator)
    numbered = clone(model).fit(X, Y[:, 0]).predict(X)
    assert numbered.shape == (24,)
    assert np.ptp(numbered) > 0.1 * np.ptp(Y[:, 0])
    named = clone(model).fit(FRAME, TARGETS["tau1"])
    np.testing.assert_allclose(named.predict(FRAME), numbered, rtol=1e-6)
    fitted = getattr(named[-1], "best_estimator_", named[-1])
    assert fitted.tasks_.tolist() == ["c1", "c2", "c5"]


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_pipeline_is_its_parts(estimator):
    model = make_inverse_dynamics_regressor(estimator).fit(X, Y[:, :2])
    features = InverseDynamicsFeatures(6).fit(X)
    alone = clone(estimator)
    nested = isinstance(alone, RankSearchIC)
    kernel = "estimator__kernel" if nested else "kernel"
    alone.set_params(**{kernel: inverse_dynamics_kernel(6)})
    alone.fit(features.transform(X), Y[:, :2])
    found = model.predict(X, return_std=True)
    expected = alone.predict(features.transform(X), return_std=True)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_default_is_the_rank_search_of_the_paper():
    model = make_inverse_dynamics_regressor()
    search = model[-1]
    assert list(model.named_steps) == ["features", "regressor"]
    assert isinstance(search, RankSearchIC)
    assert (search.ranks, search.criterion) == ((2, 4, 5, 6, 8, 10), "bic")
    assert search.estimator.kernel == inverse_dynamics_kernel(6)
    assert model[0].n_joints == 6


def test_kernel_of_the_user_is_kept():
    for estimator in (PooledGP(RBF()), RankSearchIC(MultiTaskGPRegressor(RBF()))):
        regressor = make_inverse_dynamics_regressor(estimator)[-1]
        assert getattr(regressor, "estimator", regressor).kernel == RBF()


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_estimator_of_the_user_is_left_alone(estimator):
    before = repr(estimator)
    regressor = make_inverse_dynamics_regressor(estimator)[-1]
    assert regressor is not estimator
    assert repr(estimator) == before
    assert getattr(estimator, "estimator", estimator).kernel is None


@pytest.mark.parametrize("pooled", [False, True])
def test_linear_regression_has_no_kernel(pooled):
    estimator = BayesianLinearRegression(pooled=pooled, task_feature=0)
    model = make_inverse_dynamics_regressor(estimator).fit(X, Y[:, :2])
    assert (model[-1].task_feature, estimator.task_feature) == (-1, 0)
    assert model[-1].tasks_.tolist() == [1, 2, 5]
    features = InverseDynamicsFeatures(6).fit_transform(X)
    alone = clone(estimator).set_params(task_feature=-1).fit(features, Y[:, :2])
    assert alone.coef_.shape == (2, 3, 24)  # (x, sgn(qd)); the constant is apart
    found = model.predict(X, return_std=True)
    expected = alone.predict(features, return_std=True)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_other_estimators_are_refused():
    message = "must be a MultiTaskGPRegressor, .* BayesianLinearRegression or Rank"
    with pytest.raises(TypeError, match=message):
        make_inverse_dynamics_regressor(InverseDynamicsFeatures())


def test_task_in_another_column():
    moved = np.column_stack([X[:, -1], X[:, :-1]])
    last = make_inverse_dynamics_regressor(PooledGP(**QUICK))
    first = make_inverse_dynamics_regressor(PooledGP(**QUICK), task_feature=0)
    expected = last.fit(X, Y[:, 0]).predict(X)
    np.testing.assert_allclose(first.fit(moved, Y[:, 0]).predict(moved), expected)
    named = make_inverse_dynamics_regressor(PooledGP(**QUICK), task_feature="load")
    frame = FRAME[["load", *FRAME.columns[:-1]]]
    np.testing.assert_allclose(named.fit(frame, Y[:, 0]).predict(frame), expected)


@pytest.mark.parametrize(
    "estimator",
    [
        PooledGP(task_feature=0, **QUICK),
        RankSearchIC(MultiTaskGPRegressor(task_feature="load", **QUICK), ranks=[1]),
    ],
)
def test_task_is_last_for_the_regressor(estimator):
    model = make_inverse_dynamics_regressor(estimator).fit(X, Y[:, 0])
    fitted = getattr(model[-1], "best_estimator_", model[-1])
    assert fitted.tasks_.tolist() == [1, 2, 5]


def test_another_number_of_joints():
    two = X[:, [0, 1, 6, 7, 12, 13, 18]]
    model = make_inverse_dynamics_regressor(PooledGP(**QUICK), n_joints=2)
    assert model.fit(two, Y[:, 0]).predict(two).shape == (24,)
    with pytest.raises(ValueError, match="X has 19 columns, but n_joints=2 needs 7"):
        model.fit(X, Y[:, 0])


def test_grid_search_over_nested_parameters():
    rows = np.arange(24)  # both halves have samples of every load
    halves = [(rows[k::2], rows[1 - k :: 2]) for k in (0, 1)]
    model = make_inverse_dynamics_regressor(MultiTaskGPRegressor(max_iter=0))
    grid = {"regressor__rank": [1, 2], "regressor__noise_variance": [1e-3, 100.0]}
    search = GridSearchCV(model, grid, cv=halves).fit(FRAME, TARGETS["tau1"])
    assert search.best_params_["regressor__noise_variance"] == 1e-3
    assert search.best_estimator_[-1].rank_ == search.best_params_["regressor__rank"]
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()
