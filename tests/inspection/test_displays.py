import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal
from pictured import FRAME, MODELS, QUICK, TASKS, X, Y, texts, y
from sklearn.compose import make_column_transformer
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import (
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    WideRegressor,
    inspection,
    stack_tasks,
)
from skmtgp.inspection import (
    CoverageDisplay,
    KernelRelevanceDisplay,
    RankSelectionDisplay,
    TaskCovarianceDisplay,
    TaskLearningCurveDisplay,
    TaskPredictionDisplay,
    TaskResidualsDisplay,
    TrajectoryDisplay,
    TransferDisplay,
)
from skmtgp.inspection._models import task_column
from skmtgp.model_selection import TaskStratifiedKFold

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
SHARED = list(MODELS)[:-2]
OF_DATA = CoverageDisplay, TaskResidualsDisplay, TrajectoryDisplay
ONE = TASKS == 1  # whose sequence is drawn
OF_MODELS = TaskCovarianceDisplay, KernelRelevanceDisplay, TransferDisplay


@pytest.fixture(scope="module")
def searched(piped):
    cv = TaskStratifiedKFold(2, task_feature="load")
    search = GridSearchCV(piped, {"multitaskgpregressor__rank": [1]}, cv=cv)
    with pytest.warns(ConvergenceWarning):
        return search.fit(FRAME, y)


class TestAllDisplays:
    @pytest.mark.parametrize("display", OF_DATA)
    @pytest.mark.parametrize("name", MODELS)
    def test_every_model_predicts(self, fitted, display, name):
        rows = ONE if display is TrajectoryDisplay else slice(None)
        shown = display.from_estimator(fitted[name], X[rows], Y[rows], output=1)
        assert shown.figure_ is shown.ax_.figure

    @pytest.mark.parametrize("display", OF_MODELS)
    @pytest.mark.parametrize("name", SHARED)
    def test_every_model_with_shared_parameters(self, fitted, display, name):
        shown = display.from_estimator(fitted[name], output=1)
        assert shown.figure_ is shown.ax_.figure

    @pytest.mark.parametrize("display", OF_MODELS)
    @pytest.mark.parametrize("name", ["SingleTaskGP", "BayesianLinearRegression"])
    def test_models_without_them(self, fitted, display, name):
        with pytest.raises(TypeError, match=rf"{name} has no (task_cov|kernel).*its"):
            display.from_estimator(fitted[name])

    @pytest.mark.parametrize("display", [*OF_DATA, *OF_MODELS])
    @pytest.mark.parametrize("search", [False, True])
    def test_models_of_other_packages(self, display, search):
        model = make_pipeline(StandardScaler(), GaussianProcessRegressor(alpha=0.1))
        model = GridSearchCV(model, {}, cv=2) if search else model
        data = (X[ONE], y[ONE]) if display in OF_DATA else ()
        match = "GaussianProcessRegressor is no model of skmtgp: pass one that is"
        if display in (*OF_DATA, TransferDisplay):
            match += ", or give its predictions to from_predictions"
        with pytest.raises(TypeError, match=match):
            display.from_estimator(model.fit(X, y), *data)

    def test_columns_of_tasks(self):
        """What the model is, is shown; data need rows with a task."""
        wide = WideRegressor(MultiTaskGPRegressor("rbf", rank=1, **QUICK))
        table = pd.DataFrame(X[:9, :2], columns=["a", "b"])
        targets = pd.DataFrame({"u": Y[:9, 0], "v": Y[:9, 1]})
        with pytest.raises(NotFittedError):
            TaskCovarianceDisplay.from_estimator(wide)
        with pytest.raises(TypeError, match="this display takes rows with a task"):
            TaskLearningCurveDisplay.from_estimator(wide, table, targets)
        with pytest.warns(ConvergenceWarning):
            wide.fit(table, targets)
        shown = TaskCovarianceDisplay.from_estimator(wide)
        assert texts(shown.ax_.get_xticklabels()) == ["u", "v"]
        for display in OF_MODELS:
            display.from_estimator(make_pipeline(wide))
        for display in (*OF_DATA, TaskPredictionDisplay):
            with pytest.raises(TypeError, match="pass estimator_ of the WideRegressor"):
                display.from_estimator(make_pipeline(wide), table, targets)
        rows, y = stack_tasks(table.join(targets), ["u", "v"])
        shown = CoverageDisplay.from_estimator(wide.estimator_, rows, y)
        assert shown.figure_ is shown.ax_.figure

    @pytest.mark.parametrize("display", [*OF_DATA, *OF_MODELS, RankSelectionDisplay])
    @pytest.mark.parametrize("wrap", [lambda m: m, make_pipeline])
    def test_not_fitted(self, display, wrap):
        data = (X, y) if display in OF_DATA else ()
        with pytest.raises(NotFittedError):
            display.from_estimator(wrap(RankSearchIC()), *data)

    @pytest.mark.parametrize("display", [*OF_DATA, *OF_MODELS])
    @pytest.mark.parametrize("output", [2, -1, 0.0, True])
    def test_output_out_of_range(self, fitted, display, output):
        data = (X[ONE], Y[ONE]) if display in OF_DATA else ()
        message = rf"output={output!r} must be an integer from 0 to 1"
        with pytest.raises(ValueError, match=message):
            display.from_estimator(fitted["PooledGP"], *data, output=output)

    @pytest.mark.parametrize("display", OF_DATA)
    def test_targets_of_another_shape(self, fitted, display):
        with pytest.raises(ValueError, match=r"y has shape \(6,\), but .*\(6, 2\)"):
            display.from_estimator(fitted["PooledGP"], X[ONE], y[ONE])

    @pytest.mark.parametrize("display", OF_DATA)
    def test_pipeline_and_search_over_it(self, piped, searched, display):
        task = {} if display is TrajectoryDisplay else {"task_feature": "load"}
        for estimator in (piped, searched):
            assert display.from_estimator(estimator, FRAME, y, **task).ax_

    @pytest.mark.parametrize("display", [CoverageDisplay, TaskResidualsDisplay])
    def test_task_column_of_a_pipeline(self, piped, display):
        with pytest.raises(ValueError, match="ColumnTransformer does not tell which"):
            display.from_estimator(piped, FRAME, y)

    @pytest.mark.parametrize("display", [CoverageDisplay, TaskResidualsDisplay])
    @pytest.mark.parametrize("search", [False, True])
    def test_task_column_that_the_model_of_a_pipeline_names(self, display, search):
        model = MultiTaskGPRegressor(rank=1, task_feature="load", **QUICK)
        model = RankSearchIC(model, ranks=[1]) if search else model
        scaled = make_column_transformer(
            (StandardScaler(), ["a", "b"]),
            remainder="passthrough",
            verbose_feature_names_out=False,
        )
        pipe = make_pipeline(scaled, model).set_output(transform="pandas").fit(FRAME, y)
        found = display.from_estimator(pipe, FRAME, y)
        expected = display.from_estimator(pipe, FRAME, y, task_feature="load")
        assert len(found.figure_.axes[0].lines) == len(expected.figure_.axes[0].lines)
        renamed = FRAME.rename(columns={"load": "site"})
        with pytest.raises(ValueError, match="ColumnTransformer does not tell which"):
            task_column(pipe, renamed)

    def test_axes_are_used_and_settings_kept(self, fitted):
        before = dict(matplotlib.rcParams)
        displays = [
            (TaskCovarianceDisplay, ()),
            (KernelRelevanceDisplay, ()),
            (TransferDisplay, ()),
            *((display, (X[ONE], Y[ONE])) for display in OF_DATA),
        ]
        _, axes = plt.subplots(1, 7)
        model = fitted["RankSearchIC"]
        for ax, (display, data) in zip(axes, displays, strict=False):
            assert display.from_estimator(model, *data, ax=ax).ax_ is ax
        shown = RankSelectionDisplay.from_estimator(model, ax=axes[6])
        assert shown.ax_ is axes[6]
        assert shown.figure_ is axes[6].figure
        assert len(plt.get_fignums()) == 1
        assert dict(matplotlib.rcParams) == before

    @pytest.mark.parametrize("ax", ["left", [1]])
    def test_axes_must_be_axes(self, fitted, ax):
        match = r"ax=.* must be an Axes of matplotlib, or None"
        with pytest.raises(TypeError, match=match):
            TaskCovarianceDisplay.from_estimator(fitted["PooledGP"], ax=ax)
        with pytest.raises(TypeError, match=match):  # before it fits
            TaskLearningCurveDisplay.from_estimator(None, None, None, ax=ax)

    @pytest.mark.parametrize("display", OF_DATA)
    def test_targets_in_another_order(self, display):
        model = PooledGP(task_feature="load", **QUICK).fit(FRAME, y)
        rows = FRAME[ONE]
        shuffled = pd.Series(y[ONE], rows.index)[::-1]
        with pytest.raises(ValueError, match="labels of X in another order"):
            display.from_estimator(model, rows, shuffled)

    def test_truth_and_names_of_features_are_checked(self, fitted):
        model = fitted["PooledGP"]
        for truth in (3, [1, 2, 3]):
            with pytest.raises(TypeError, match=r"truth=.* a pair of inputs and targ"):
                TaskPredictionDisplay.from_estimator(
                    model, X, Y, feature=0, truth=truth
                )
        for names in (3, "ab"):
            with pytest.raises(TypeError, match=r"feature_names=.* list of 2 names"):
                KernelRelevanceDisplay.from_estimator(model, feature_names=names)

    def test_figure_of_its_own_fits(self, fitted):
        shown = TaskCovarianceDisplay.from_estimator(fitted["PooledGP"])
        shown.figure_.draw_without_rendering()
        box = shown.figure_.get_tightbbox()
        assert box.x0 >= 0.0
        assert box.x1 <= shown.figure_.get_figwidth()

    def test_without_matplotlib(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
        display = TaskCovarianceDisplay(task_covariance=np.eye(2))
        with pytest.raises(ImportError, match=r'pip install "skmtgp\[plot\]"'):
            display.plot()
        with pytest.raises(ImportError, match="skmtgp"):
            TaskLearningCurveDisplay.from_estimator(PooledGP(), X, y)

    def test_public_names(self):
        named = set(inspection.__all__) - {"color_of", "variogram_table"}
        assert all(name.endswith("Display") for name in named)
        assert sorted(inspection.__all__) == inspection.__all__


def test_tasks_are_in_the_order_of_the_model():
    """Sorted, wherever they first appear: text by its letters, numbers by size."""
    text = np.array(["machine 2", "machine 10", "machine 1"])[TASKS]
    for labels in (text, np.array([2, 10, 1])[TASKS]):
        frame = pd.DataFrame({"x": X[:, 0], "machine": labels})
        model = PooledGP(task_feature="machine", **QUICK).fit(frame, y)
        expected = np.unique(labels).astype(str).tolist()
        matrix = TaskCovarianceDisplay.from_estimator(model)
        boxes = TaskResidualsDisplay.from_estimator(model, frame, y)
        curves = CoverageDisplay.from_estimator(model, frame, y)
        assert texts(matrix.ax_.get_xticklabels()) == expected
        assert texts(boxes.ax_.get_xticklabels()) == expected
        lines = [line.get_label() for line in curves.task_lines_]
        assert lines == [f"_{name}" for name in expected]
        found = TaskResidualsDisplay.from_predictions(y, 0.0 * y, tasks=labels)
        assert_array_equal(found.tasks_, model.tasks_)
    assert expected == ["1", "2", "10"]
