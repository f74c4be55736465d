"""What scikit-learn users do with regressors, done with those of the package."""

import numpy as np
import pandas as pd
import pytest
from citizens import (
    CV,
    ESTIMATORS,
    FRAME,
    X,
    Y,
    contained,
    each_twice,
    scaled,
    tasks_of,
    y,
)
from scipy.stats import loguniform
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import BaggingRegressor, StackingRegressor
from sklearn.gaussian_process.kernels import RBF, Matern
from sklearn.inspection import partial_dependence, permutation_importance
from sklearn.model_selection import (
    GridSearchCV,
    RandomizedSearchCV,
    cross_validate,
    learning_curve,
)
from sklearn.multioutput import MultiOutputRegressor
from sklearn.preprocessing import StandardScaler

from skmtgp import BayesianLinearRegression, PooledGP

GPS = {k: v for k, v in ESTIMATORS.items() if k != "BayesianLinearRegression"}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def cube(values):
    return values**3


def parameters(name):
    """Of an estimator, with values to choose from."""
    kernels = {"kernel": [RBF([1.0, 1.0]), Matern(2.0)]}
    return {
        "MultiTaskGPRegressor": {"rank": [1, 2], **kernels},
        "BayesianLinearRegression": {"weight_variance": [1e-4, 1e8]},
        "RankSearchIC": {
            "criterion": ["bic", "aic"],
            **{f"estimator__{key}": value for key, value in kernels.items()},
        },
    }.get(name, kernels)


class TestSearches:
    @pytest.mark.parametrize("name", ESTIMATORS)
    def test_grid_search(self, name):
        grid = parameters(name)
        search = GridSearchCV(ESTIMATORS[name], grid, cv=CV, error_score="raise")
        search.fit(FRAME, y)
        assert len(search.cv_results_["params"]) == np.prod([*map(len, grid.values())])
        for key, value in search.best_params_.items():
            assert search.best_estimator_.get_params()[key] == value
        assert search.best_score_ == search.cv_results_["mean_test_score"].max()
        assert search.predict(FRAME).shape == y.shape
        assert grid == parameters(name)  # learning leaves kernels as they were

    @pytest.mark.parametrize("name", ESTIMATORS)
    def test_grid_search_of_a_pipeline(self, name):
        key, values = next(iter(parameters(name).items()))
        grid = {f"model__{key}": values}
        grid["features__scale"] = [StandardScaler(), "passthrough"]
        model = scaled(ESTIMATORS[name], remainder="passthrough")
        search = GridSearchCV(model, grid, cv=CV, error_score="raise").fit(FRAME, y)
        assert tasks_of(search.best_estimator_[-1]) == ["u", "v", "w"]
        assert np.isfinite(search.cv_results_["mean_test_score"]).all()

    @pytest.mark.parametrize("name", GPS)
    def test_randomized_search_in_parameters_of_the_kernel(self, name):
        nested = "model__" + "estimator__" * (name == "RankSearchIC")
        model = scaled(clone(GPS[name]), remainder="passthrough")
        model.set_params(**{f"{nested}kernel": RBF(1.0, "fixed")})
        wanted = {
            f"{nested}kernel__length_scale": loguniform(0.1, 10.0),
            f"{nested}noise_variance": loguniform(1e-4, 1.0),
        }
        search = RandomizedSearchCV(
            model, wanted, n_iter=3, cv=CV, random_state=0, error_score="raise"
        )
        search.fit(FRAME, y)
        scores = search.cv_results_["mean_test_score"]
        assert len(set(scores.tolist())) == 3
        best = search.best_estimator_.get_params()
        assert {key: best[key] for key in wanted} == search.best_params_

    def test_cross_validate(self, estimator):
        found = cross_validate(
            estimator,
            FRAME,
            Y,
            cv=CV,
            scoring=("r2", "neg_mean_squared_error"),
            return_train_score=True,
            return_estimator=True,
            error_score="raise",
        )
        (train, test), _ = CV.split(FRAME)
        first = clone(estimator).fit(FRAME.iloc[train], Y[train])
        assert found["test_r2"][0] == first.score(FRAME.iloc[test], Y[test])
        assert [tasks_of(model) for model in found["estimator"]] == [
            ["u", "v", "w"]
        ] * 2
        assert np.isfinite(found["train_neg_mean_squared_error"]).all()

    def test_learning_curve(self, estimator):
        sizes, train, test = learning_curve(
            estimator, FRAME, y, cv=CV, train_sizes=[0.5, 1.0], error_score="raise"
        )
        assert sizes.tolist() == [6, 12]
        assert np.isfinite([train, test]).all()


class TestInspection:
    # scikit-learn makes an array of what is not a frame of pandas.
    @pytest.mark.filterwarnings("ignore:X does not have valid feature names")
    @each_twice("container", ["array", "object", "pandas", "polars"])
    def test_permutation_importance(self, estimator, container):
        table = contained(container)
        estimator.fit(table, y)
        found = permutation_importance(estimator, table, y, n_repeats=3, random_state=0)
        assert found.importances.shape == (3, 3)
        assert found.importances_mean[:2].max() > 0.01

    # Polars frames are beyond scikit-learn's own partial_dependence.
    @each_twice("container", ["array", "object", "pandas"])
    def test_partial_dependence(self, estimator, container):
        table = contained(container)
        estimator.fit(table, y)
        feature = "b" if container == "pandas" else 1
        found = partial_dependence(
            estimator, table, [feature], grid_resolution=4, kind="both"
        )
        at = found["grid_values"][0][2]
        moved = table.assign(b=at) if container == "pandas" else table.copy()
        if container != "pandas":
            moved[:, 1] = at
        expected = estimator.predict(moved)
        np.testing.assert_allclose(found["individual"][0, :, 2], expected)
        np.testing.assert_allclose(found["average"][0, 2], expected.mean())


class TestMetaEstimators:
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.RepeatedRowsWarning")
    @each_twice("container", ["array", "object", "pandas", "polars"])
    def test_bagging(self, estimator, container):
        # Rows are drawn whatever their task, so that a bag has some tasks more often
        # than others, and misses a task of k of the n rows with probability
        # (1 - k / n)^n: no more than about exp(-k).
        table = contained(container)
        bags = BaggingRegressor(estimator, 3, random_state=0).fit(table, y)
        array = contained("array" if container == "array" else "object")
        parts = [model.predict(array) for model in bags.estimators_]
        np.testing.assert_allclose(bags.predict(table), np.mean(parts, axis=0))
        assert all(len(tasks_of(model)) == 3 for model in bags.estimators_)

    def test_bag_without_a_task(self, estimator):
        bags = BaggingRegressor(estimator, 2, max_samples=2, random_state=0).fit(X, y)
        if isinstance(estimator, PooledGP):  # it predicts tasks that it never saw
            assert np.isfinite(bags.predict(X)).all()
            return
        message = r"Unknown tasks? .*: the model knows .* samples of every task"
        with pytest.raises(ValueError, match=message):
            bags.predict(X)

    def test_transformed_target(self, estimator):
        model = TransformedTargetRegressor(estimator, func=np.cbrt, inverse_func=cube)
        found = model.fit(FRAME, Y).predict(FRAME)
        expected = clone(estimator).fit(FRAME, np.cbrt(Y)).predict(FRAME) ** 3
        np.testing.assert_allclose(found, expected, rtol=1e-9)

    def test_stacking(self, estimator):
        parts = [("one", estimator), ("other", BayesianLinearRegression())]
        stack = StackingRegressor(parts, cv=CV).fit(FRAME, y)
        np.testing.assert_array_equal(
            stack.transform(FRAME)[:, 0], clone(estimator).fit(FRAME, y).predict(FRAME)
        )
        assert stack.score(FRAME, y) > 0.5

    def test_multi_output(self, estimator):
        found = MultiOutputRegressor(estimator).fit(FRAME, Y).predict(FRAME)
        expected = [clone(estimator).fit(FRAME, t).predict(FRAME) for t in Y.T]
        np.testing.assert_array_equal(found, np.transpose(expected))


def test_bagging_passes_arrays():
    """Names of columns are then lost, and a position counts."""
    table = pd.DataFrame({"x": np.linspace(0, 6, 20), "site": [1, 2] * 10})
    model, y = PooledGP("rbf", max_iter=0), np.sin(table["x"])
    bagged = BaggingRegressor(model, n_estimators=2, random_state=0)
    with pytest.raises(ValueError, match="such as BaggingRegressor pass arrays, where"):
        clone(bagged).set_params(estimator__task_feature="site").fit(table, y)
    assert bagged.set_params(estimator__task_feature=1).fit(table, y).score(table, y)
