import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pictured import FRAME, MODELS, QUICK, X, texts, y
from sklearn.base import clone

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    RankSearchIC,
    make_inverse_dynamics_regressor,
)
from skmtgp.inspection import TaskLearningCurveDisplay
from skmtgp.inspection._models import task_column
from skmtgp.metrics import make_normalized_mse_scorer
from skmtgp.model_selection import TaskStratifiedKFold

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


CURVES = pd.DataFrame(
    [
        {"model": model, "n": n, "draw": draw, "error": level * draw / n}
        for model, level in (("mGP", 0.1), ("iGP", 1.0))
        for n in (400, 100, 200)
        for draw in (1, 2, 9)
    ]
)


class TestTaskLearningCurve:
    @pytest.mark.parametrize("as_dict", [False, True])
    def test_median_and_range(self, as_dict):
        results = CURVES.to_dict("list") if as_dict else CURVES
        display = TaskLearningCurveDisplay.from_results(results)
        assert list(display.lines_) == ["mGP", "iGP"]
        n = np.array([100, 200, 400])
        assert_array_equal(display.lines_["mGP"].get_xdata(), n)
        assert_allclose(display.lines_["mGP"].get_ydata(), 0.1 * 2 / n)
        corners = display.bands_["iGP"].get_paths()[0].vertices
        assert_allclose(corners[:, 1].max(), 9 / 100)
        assert_allclose(corners[:, 1].min(), 1 / 400)
        assert display.ax_.get_xscale() == display.ax_.get_yscale() == "log"
        assert texts(display.ax_.get_xticklabels()) == ["100", "200", "400"]

    def test_names_of_close_sizes_do_not_overlap(self):
        close = CURVES.replace({"n": {200: 110}})
        display = TaskLearningCurveDisplay.from_results(close, ylabel="MSE")
        assert texts(display.ax_.get_xticklabels()) == ["100", "", "400"]
        assert display.ax_.get_ylabel() == "MSE"

    def test_many_sizes(self):
        sizes = np.arange(10, 30)
        results = {"model": "a", "n": sizes, "draw": 0, "error": 1.0 / sizes}
        assert TaskLearningCurveDisplay(results=results).plot().lines_

    def test_a_fit_that_failed_leaves_the_others(self):
        results = CURVES.copy()
        results.loc[results["draw"] == 9, "error"] = np.nan
        line = TaskLearningCurveDisplay.from_results(results).lines_["iGP"]
        assert_allclose(line.get_ydata(), 1.5 / np.array([100, 200, 400]))

    @pytest.mark.parametrize(
        ("results", "message"),
        [
            (CURVES.drop(columns="draw"), r"results lack \['draw'\]"),
            (CURVES.assign(error=0.0), "Errors must be positive .* the least is 0.0"),
            (CURVES.assign(draw=0), "several errors of one model, n and draw"),
            (CURVES[:0], "no rows"),
        ],
    )
    def test_errors(self, results, message):
        with pytest.raises(ValueError, match=message):
            TaskLearningCurveDisplay.from_results(results)

    def test_fits(self):
        display = TaskLearningCurveDisplay.from_estimator(
            MODELS["PooledGP"], X, y, cv=2, train_sizes=[6, 9]
        )
        results = display.results
        assert set(results["model"]) == {"PooledGP"}
        assert_array_equal(results["n"], [6, 6, 9, 9])
        cv = TaskStratifiedKFold(2, shuffle=True, random_state=0)
        train, test = next(iter(cv.split(X)))
        model = clone(MODELS["PooledGP"]).fit(X[train], y[train])
        expected = -make_normalized_mse_scorer()(model, X[test], y[test])
        assert results["error"][2] == expected

    def test_only_test_sets_are_scored(self):
        """One row of a task in the training set has no variance to normalise by."""
        display = TaskLearningCurveDisplay.from_estimator(
            MODELS["PooledGP"], X, y, cv=2, train_sizes=[3, 9]
        )
        assert_array_equal(display.results["n"], [3, 3, 9, 9])
        assert np.isfinite(display.results["error"]).all()

    @pytest.mark.parametrize("two_outputs", [False, True])
    def test_folds_with_one_row_of_a_task(self, two_outputs):
        """It has no variance there, but among all rows."""
        rows = np.r_[np.flatnonzero(X[:, -1] != 2), np.flatnonzero(X[:, -1] == 2)[:3]]
        few, z = X[rows], y[rows]
        z = np.column_stack([z, z**2]) if two_outputs else z
        cv = TaskStratifiedKFold(3, shuffle=True, random_state=0)
        model = MODELS["PooledGP"]
        display = TaskLearningCurveDisplay.from_estimator(
            model, few, z, cv=3, train_sizes=[1.0]
        )
        y_var = pd.DataFrame(z).groupby(few[:, -1]).var(ddof=0)
        train, test = next(iter(cv.split(few)))
        train = train[: display.results["n"][0]]
        expected = -make_normalized_mse_scorer(y_var=y_var)(
            clone(model).fit(few[train], z[train]), few[test], z[test]
        )
        assert display.results["error"][0] == expected
        assert np.isfinite(display.results["error"]).all()

    def test_shares_of_the_training_set(self):
        found = [
            TaskLearningCurveDisplay.from_estimator(
                MODELS["PooledGP"], X, y, cv=2, train_sizes=sizes
            ).results
            for sizes in ([0.4, 1.0, 1.0], [3, 9])
        ]
        pd.testing.assert_frame_equal(*found)

    @pytest.mark.parametrize(
        "sizes",
        [[0, 3], [3, 10], [0.0, 1.0], [0.5, 1.1], [1.5], [], "a", None, [[0.5]]],
    )
    def test_training_sets_that_there_are_not(self, sizes):
        with pytest.raises(ValueError, match=r"train_sizes=.* from 1 to 9, or share"):
            TaskLearningCurveDisplay.from_estimator(
                MODELS["PooledGP"], X, y, cv=2, train_sizes=sizes
            )

    def test_several_models_of_a_frame(self, piped):
        models = {
            "linear": BayesianLinearRegression(task_feature="load"),
            "search": RankSearchIC(
                MultiTaskGPRegressor(task_feature="load", **QUICK), ranks=(1,)
            ),
        }
        options = {"cv": 2, "train_sizes": [1.0]}
        display = TaskLearningCurveDisplay.from_estimator(models, FRAME, y, **options)
        assert list(display.lines_) == ["linear", "search"]
        options |= {"cv": TaskStratifiedKFold(2, task_feature="load")}
        options |= {"task_feature": "load"}
        display = TaskLearningCurveDisplay.from_estimator(piped, FRAME, y, **options)
        assert list(display.lines_) == ["Pipeline"]

    def test_a_default_search_has_its_tasks_last(self):
        search = RankSearchIC(ranks=(1,))
        models = {"pipe": make_inverse_dynamics_regressor(search), "default": search}
        for model in models.values():
            assert task_column(model, X) == -1
