import sys
from enum import Enum

import matplotlib
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from samples import draw
from sklearn.base import clone
from sklearn.compose import make_column_transformer
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    inspection,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import load_puma560
from skmtgp.inspection import (
    CoverageDisplay,
    KernelRelevanceDisplay,
    RankSelectionDisplay,
    TaskCovarianceDisplay,
    TaskLearningCurveDisplay,
    TaskResidualsDisplay,
    TrajectoryDisplay,
)
from skmtgp.inspection._models import task_column
from skmtgp.kernels import ARDLinear, Columns
from skmtgp.metrics import coverage, make_normalized_mse_scorer
from skmtgp.model_selection import TaskStratifiedKFold

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # the backend comes first


class Site(str, Enum):  # noqa: UP042 - as before Python 3.11
    A = "site one"
    B = "site two"


pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")

X, Y = draw(per_task=6, n_outputs=2)
y = Y[:, 0]
TASKS = X[:, -1].astype(int)
NAMES = np.array(["u", "v", "w"])
FRAME = pd.DataFrame({"load": NAMES[TASKS], "a": X[:, 0], "b": X[:, 1]})
QUICK = {"max_iter": 3}
MODELS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=2, **QUICK),
    "IndependentGP": IndependentGP(**QUICK),
    "PooledGP": PooledGP(**QUICK),
    "RankSearchIC": RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2)),
    "SingleTaskGP": SingleTaskGP(**QUICK),
    "BayesianLinearRegression": BayesianLinearRegression(),
}
SHARED = list(MODELS)[:-2]
OF_DATA = CoverageDisplay, TaskResidualsDisplay, TrajectoryDisplay
OF_MODELS = TaskCovarianceDisplay, KernelRelevanceDisplay


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def fitted():
    """Every model, learned from both outputs of an array."""
    with pytest.warns(ConvergenceWarning):
        return {name: clone(model).fit(X, Y) for name, model in MODELS.items()}


@pytest.fixture(scope="module")
def piped():
    """A pipeline that moves the task column of a frame to the end."""
    scaled = make_column_transformer(
        (StandardScaler(), ["a", "b"]), remainder="passthrough"
    )
    model = make_pipeline(scaled, MultiTaskGPRegressor(rank=1, **QUICK))
    with pytest.warns(ConvergenceWarning):
        return model.fit(FRAME, y)


@pytest.fixture(scope="module")
def searched(piped):
    cv = TaskStratifiedKFold(2, task_feature="load")
    search = GridSearchCV(piped, {"multitaskgpregressor__rank": [1]}, cv=cv)
    with pytest.warns(ConvergenceWarning):
        return search.fit(FRAME, y)


def inner(model):
    return getattr(model, "best_estimator_", model)


def texts(labels):
    return [label.get_text() for label in labels]


def finite_points(line):
    points = line.get_xydata()
    return points[np.isfinite(points).all(axis=1)]


class TestAllDisplays:
    @pytest.mark.parametrize("display", OF_DATA)
    @pytest.mark.parametrize("name", MODELS)
    def test_every_model_predicts(self, fitted, display, name):
        shown = display.from_estimator(fitted[name], X, Y, output=1)
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

    @pytest.mark.parametrize("display", [*OF_DATA, *OF_MODELS, RankSelectionDisplay])
    @pytest.mark.parametrize("wrap", [lambda m: m, make_pipeline])
    def test_not_fitted(self, display, wrap):
        data = (X, y) if display in OF_DATA else ()
        with pytest.raises(NotFittedError):
            display.from_estimator(wrap(RankSearchIC()), *data)

    @pytest.mark.parametrize("display", [*OF_DATA, *OF_MODELS])
    @pytest.mark.parametrize("output", [2, -1, 0.0, True])
    def test_output_out_of_range(self, fitted, display, output):
        data = (X, Y) if display in OF_DATA else ()
        message = rf"output={output!r} must be an integer from 0 to 1"
        with pytest.raises(ValueError, match=message):
            display.from_estimator(fitted["PooledGP"], *data, output=output)

    @pytest.mark.parametrize("display", OF_DATA)
    def test_targets_of_another_shape(self, fitted, display):
        with pytest.raises(ValueError, match=r"y has shape \(18,\), but .*\(18, 2\)"):
            display.from_estimator(fitted["PooledGP"], X, y)

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
            *((display, (X, Y)) for display in OF_DATA),
        ]
        _, axes = plt.subplots(1, 6)
        model = fitted["RankSearchIC"]
        for ax, (display, data) in zip(axes, displays, strict=False):
            assert display.from_estimator(model, *data, ax=ax).ax_ is ax
        shown = RankSelectionDisplay.from_estimator(model, ax=axes[5])
        assert shown.ax_ is axes[5]
        assert shown.figure_ is axes[5].figure
        assert len(plt.get_fignums()) == 1
        assert dict(matplotlib.rcParams) == before

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
        assert all(name.endswith("Display") for name in inspection.__all__)
        assert sorted(inspection.__all__) == inspection.__all__


def blocks():
    """Tasks 0, 2, 4 and 1, 3, 5 belong together; the variances differ."""
    R = np.where((np.arange(6)[:, None] - np.arange(6)) % 2, -0.2, 0.9)
    np.fill_diagonal(R, 1.0)
    scale = np.arange(1.0, 7.0)
    return R, R * scale * scale[:, None]


class TestTaskCovariance:
    def test_covariance(self, fitted):
        model = fitted["MultiTaskGPRegressor"]
        display = TaskCovarianceDisplay.from_estimator(model, output=1)
        K = model.task_covariance_[1]
        assert_array_equal(display.im_.get_array(), K)
        assert display.im_.get_clim() == (-np.abs(K).max(), np.abs(K).max())
        assert display.colorbar_.ax.get_ylabel() == "task covariance"

    def test_correlation_and_values(self):
        R, K = blocks()
        display = TaskCovarianceDisplay(task_covariance=K).plot(kind="correlation")
        assert_allclose(display.im_.get_array(), R)
        assert display.im_.get_clim() == (-1.0, 1.0)
        low = "\N{MINUS SIGN}0.20"
        assert texts(display.text_[0]) == ["1.00", low, "0.90", low, "0.90", low]
        assert display.text_[0, 0].get_color() == "white"
        assert display.text_[0, 1].get_color() == "black"

    def test_order_by_similarity(self):
        R, K = blocks()
        labels = list("abcdef")
        display = TaskCovarianceDisplay(task_covariance=K, tasks=labels)
        display.plot(kind="correlation", order="similarity")
        assert {frozenset(part) for part in np.split(display.order_, 2)} == {
            frozenset({0, 2, 4}),
            frozenset({1, 3, 5}),
        }
        order = display.order_
        assert_allclose(display.im_.get_array(), R[np.ix_(order, order)])
        for axis in (display.ax_.xaxis, display.ax_.yaxis):
            assert texts(axis.get_ticklabels()) == [labels[k] for k in order]
        assert_array_equal(display.plot(order="given").order_, np.arange(6))

    def test_deviations(self):
        K = blocks()[1]
        C = np.eye(6) - 1.0 / 6.0
        display = TaskCovarianceDisplay(task_covariance=K).plot(deviations=True)
        assert_allclose(display.im_.get_array(), C @ K @ C)
        assert display.colorbar_.ax.get_ylabel().endswith("of deviations")

    def test_many_tasks(self):
        rng = np.random.default_rng(0)
        L = rng.normal(size=(40, 2))
        names = [f"machine {k}" for k in range(40)]
        display = TaskCovarianceDisplay(task_covariance=L @ L.T, tasks=names)
        display.plot(kind="correlation", order="similarity", colorbar=False)
        assert display.text_ is None
        assert display.colorbar_ is None
        shown = texts(display.ax_.yaxis.get_ticklabels())
        expected = [names[k] for k in display.order_]
        assert shown == expected[:: round(40 / len(shown))]
        assert line_spacing(display.ax_.yaxis) > 1.05
        assert line_spacing(display.ax_.xaxis) > 1.05

    @pytest.mark.parametrize(
        ("n_tasks", "written"), [(3, True), (10, True), (20, False)]
    )
    def test_values_where_they_can_be_read(self, n_tasks, written):
        display = TaskCovarianceDisplay(task_covariance=np.eye(n_tasks))
        assert (display.plot(kind="correlation").text_ is not None) is written
        display.plot(include_values=not written)
        assert (display.text_ is None) is written

    @pytest.mark.parametrize("n_tasks", [1, 2, 3])
    def test_tasks_that_do_not_vary(self, n_tasks):
        display = TaskCovarianceDisplay(task_covariance=np.zeros((n_tasks, n_tasks)))
        display.plot(kind="correlation", order="similarity")
        assert_array_equal(display.im_.get_array(), np.eye(n_tasks))
        display.plot()
        assert display.im_.get_clim() == (-1.0, 1.0)

    def test_labels_of_a_frame(self):
        model = MultiTaskGPRegressor(rank=1, task_feature="load", **QUICK)
        display = TaskCovarianceDisplay.from_estimator(model.fit(FRAME, y))
        assert texts(display.ax_.get_xticklabels()) == ["u", "v", "w"]

    @pytest.mark.parametrize(
        ("K", "options", "message"),
        [
            (np.eye(2), {"kind": "both"}, "kind='both' must be one of 'covariance'"),
            (np.eye(2), {"order": "sorted"}, "order='sorted' must be one of 'given'"),
            (np.ones((2, 3)), {}, r"shape \(2, 3\); it must be square"),
            ([[np.nan]], {}, "task_covariance contains NaN"),
        ],
    )
    def test_errors(self, K, options, message):
        with pytest.raises(ValueError, match=message):
            TaskCovarianceDisplay(task_covariance=K).plot(**options)

    def test_tasks_of_another_number(self):
        with pytest.raises(ValueError, match="inconsistent numbers of samples"):
            TaskCovarianceDisplay(task_covariance=np.eye(2), tasks=["a"]).plot()


def line_spacing(axis):
    """Distance of neighbouring labels over the size of their letters."""
    axis.axes.figure.draw_without_rendering()
    labels = axis.get_ticklabels()
    ends = axis.axes.transData.transform([(k, k) for k in axis.get_ticklocs()[:2]])
    pixels = np.abs(np.diff(ends, axis=0))[0, 0 if axis.axis_name == "x" else 1]
    return 72.0 * pixels / axis.axes.figure.dpi / labels[0].get_fontsize()


class TestRankSelection:
    def test_one_criterion(self, fitted):
        search = fitted["RankSearchIC"]
        display = RankSelectionDisplay.from_estimator(make_pipeline(search))
        (line,) = display.lines_
        assert_array_equal(line.get_xdata(), search.results_["rank"])
        assert_array_equal(line.get_ydata(), search.results_["bic"])
        assert set(display.chosen_.get_xdata()) == {search.best_rank_}
        assert display.ax_.get_ylabel() == "BIC"
        assert texts(display.ax_.get_xticklabels()) == ["1", "2"]

    def test_the_criterion_of_the_search(self):
        search = clone(MODELS["RankSearchIC"]).set_params(criterion="aic").fit(X, y)
        display = RankSelectionDisplay.from_estimator(search)
        assert display.ax_.get_ylabel() == "AIC"

    @pytest.mark.parametrize("container", [dict, pd.DataFrame])
    def test_several_less_their_minimum(self, container):
        results = {"rank": [2, 4], "bic": [30.0, 10.0], "aic": [5.0, 7.0]}
        display = RankSelectionDisplay(results=container(results), best_rank=4)
        display.plot(criteria=["bic", "aic"])
        found = [line.get_ydata().tolist() for line in display.lines_]
        assert found == [[20.0, 0.0], [0.0, 2.0]]
        labels = texts(display.ax_.get_legend().get_texts())
        assert labels == ["rank 4, chosen", "BIC", "AIC"]

    @pytest.mark.parametrize(("worst", "scale"), [(9.0, "linear"), (90.0, "symlog")])
    def test_several_near_and_far(self, worst, scale):
        results = {"rank": [2, 4], "bic": [worst, 0.0], "aic": [5.0, 7.0]}
        display = RankSelectionDisplay(results=results, best_rank=4)
        display.plot(criteria=["bic", "aic"])
        assert display.ax_.get_yscale() == scale

    @pytest.mark.parametrize("criteria", ["cv", ["bic", "cv"], []])
    def test_unknown_criteria(self, criteria):
        display = RankSelectionDisplay(results={}, best_rank=1)
        with pytest.raises(ValueError, match="must be one of 'bic', 'aic', 'hqc'"):
            display.plot(criteria=criteria)

    def test_a_model_without_search(self, fitted):
        with pytest.raises(TypeError, match="PooledGP has compared no ranks"):
            RankSelectionDisplay.from_estimator(fitted["PooledGP"])


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

    def test_shares_of_the_training_set(self):
        found = [
            TaskLearningCurveDisplay.from_estimator(
                MODELS["PooledGP"], X, y, cv=2, train_sizes=sizes
            ).results
            for sizes in ([0.4, 1.0, 1.0], [3, 9])
        ]
        pd.testing.assert_frame_equal(*found)

    @pytest.mark.parametrize(
        "sizes", [[0, 3], [3, 10], [0.0, 1.0], [0.5, 1.1], [1.5], []]
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


class TestTrajectory:
    def test_data_in_the_order_of_time(self):
        time = [2.0, 0.0, 1.0]
        display = TrajectoryDisplay.from_predictions(
            [1.0, 2.0, 3.0], [1.5, 2.5, 3.5], [0.1, 0.2, 0.3], time=time, level=0.9
        )
        assert_array_equal(display.observed_.get_xydata(), [[0, 2], [1, 3], [2, 1]])
        assert_array_equal(display.line_.get_ydata(), [2.5, 3.5, 1.5])
        corners = display.band_.get_paths()[0].vertices
        assert_allclose(corners[:, 1].max(), 3.5 + 1.6448536 * 0.3)
        assert_allclose(corners[:, 1].min(), 1.5 - 1.6448536 * 0.1)
        labels = texts(display.ax_.get_legend().get_texts())
        assert labels == ["90 % interval", "observed", "predicted"]

    def test_of_new_observations(self, fitted):
        model, rows = fitted["RankSearchIC"], TASKS == 1
        display = TrajectoryDisplay.from_estimator(model, X[rows], Y[rows], output=1)
        mean, std = model.predict(X[rows], return_std=True, include_noise=True)
        assert_array_equal(display.y_mean, mean[:, 1])
        assert_array_equal(display.y_std, std[:, 1])
        assert_array_equal(display.observed_.get_ydata(), Y[rows, 1])
        assert display.ax_.get_xlabel() == "sample"

    def test_series_and_dates(self):
        index = pd.date_range("2024-01-01", periods=3)
        columns = [pd.Series([1.0, 2.0, 3.0], index=index)] * 3
        display = TrajectoryDisplay.from_predictions(*columns, time=index.to_series())
        assert len(display.line_.get_xdata()) == 3

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"level": 1.0}, "level=1.0 must be a number between 0 and 1"),
            ({"y_mean": [[1.0], [2.0]]}, r"y_mean has shape \(2, 1\), but must have"),
            ({"y_std": [0.1, -0.1]}, "y_std must not be negative, as -0.1 is"),
            ({"time": [1.0]}, "inconsistent numbers of samples"),
        ],
    )
    def test_errors(self, change, message):
        given = {"y_true": [1.0, 2.0], "y_mean": [1.0, 2.0], "y_std": [0.1, 0.1]}
        with pytest.raises(ValueError, match=message):
            TrajectoryDisplay.from_predictions(**given | change)


class TestCoverage:
    def test_is_that_of_the_metric(self, fitted):
        model, levels = fitted["MultiTaskGPRegressor"], [0.3, 0.6, 0.9]
        display = CoverageDisplay.from_estimator(model, X, Y, output=1, levels=levels)
        mean, std = model.predict(X, return_std=True, include_noise=True)
        columns = Y[:, 1], mean[:, 1], std[:, 1]
        expected = [coverage(*columns, level=p, tasks=TASKS) for p in levels]
        assert_allclose(display.line_.get_ydata(), expected)
        alone = [values[TASKS == 1] for values in columns]
        of_task = [coverage(*alone, level=p) for p in levels]
        assert_allclose(display.task_lines_[1].get_ydata(), of_task)
        assert display.task_lines_[1].get_label() == "_1"
        labels = texts(display.ax_.get_legend().get_texts())
        assert labels == ["calibrated", "each task", "mean of 3 tasks"]

    def test_a_calibrated_model_is_on_the_diagonal(self):
        z = np.random.default_rng(0).standard_normal(4000)
        display = CoverageDisplay.from_predictions(z, 0.0 * z, 0.0 * z + 1.0)
        found = display.line_.get_xydata()
        assert_allclose(found[:, 1], found[:, 0], atol=0.03)
        assert display.task_lines_ == []
        assert_array_equal(display.diagonal_.get_xydata(), [[0, 0], [1, 1]])

    def test_names_of_tasks(self):
        y, std = pd.Series([0.0, 1.0, 2.0]), np.ones(3)
        tasks = pd.Series(["b", "a", "b"], dtype="category")
        display = CoverageDisplay.from_predictions(y, y, std, tasks=tasks)
        assert [line.get_label() for line in display.task_lines_] == ["_a", "_b"]

    @pytest.mark.parametrize("labels", [[*Site], [2**53, 2**53 + 1]])
    def test_labels_are_never_merged(self, labels):
        y, tasks = np.arange(4.0), labels * 2
        display = CoverageDisplay.from_predictions(y, y, y + 1.0, tasks=tasks)
        assert list(display.tasks) == labels
        display = TaskResidualsDisplay.from_predictions(y, y, tasks=tasks)
        assert list(display.tasks_) == labels

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"levels": [0.5, 1.0]}, "level=1.0 must be a number between 0 and 1"),
            ({"y_std": [0.0, 1.0]}, "y_std must be positive"),
            ({"tasks": ["a"]}, "inconsistent numbers of samples"),
            ({"tasks": ["a", None]}, "1 missing labels"),
        ],
    )
    def test_errors(self, change, message):
        given = {"y_true": [1.0, 2.0], "y_mean": [1.0, 2.0], "y_std": [0.1, 0.1]}
        with pytest.raises(ValueError, match=message):
            CoverageDisplay.from_predictions(**given | change)


class TestTaskResiduals:
    def test_a_box_for_each_task(self):
        residuals = np.array([1.0, 5.0, 2.0, 6.0, 3.0, 7.0])
        tasks = ["b", "a"] * 3
        display = TaskResidualsDisplay.from_predictions(
            residuals + 1.0, np.ones(6), tasks=tasks
        )
        medians = [line.get_ydata()[0] for line in display.boxes_["medians"]]
        assert medians == [6.0, 2.0]
        assert texts(display.ax_.get_xticklabels()) == ["a", "b"]
        assert display.ax_.get_ylabel() == "residual"

    def test_standardized(self, fitted):
        model = fitted["SingleTaskGP"]
        display = TaskResidualsDisplay.from_estimator(
            model, X, Y, output=1, kind="standardized"
        )
        mean, std = model.predict(X, return_std=True, include_noise=True)
        scaled = ((Y - mean) / std)[:, 1]
        expected = [np.median(scaled[m == TASKS]) for m in range(3)]
        medians = [line.get_ydata()[0] for line in display.boxes_["medians"]]
        assert_allclose(medians, expected)
        assert_array_equal(display.tasks_, [0, 1, 2])

    def test_one_task(self):
        display = TaskResidualsDisplay(residuals=[1.0, 2.0]).plot()
        assert texts(display.ax_.get_xticklabels()) == ["all"]

    def test_many_tasks(self):
        tasks = np.repeat([f"machine {k}" for k in range(40)], 3)
        display = TaskResidualsDisplay(residuals=np.arange(120.0), tasks=tasks).plot()
        assert len(display.boxes_["boxes"]) == 40
        assert line_spacing(display.ax_.xaxis) > 1.05

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"kind": "squared"}, "kind='squared' must be one of 'residual', 'stand"),
            ({"kind": "standardized"}, "kind='standardized' needs y_std"),
            ({"kind": "standardized", "y_std": [1, 0]}, "y_std must be positive"),
            ({"y_mean": [1.0]}, "inconsistent numbers of samples"),
        ],
    )
    def test_errors(self, change, message):
        given = {"y_true": [1.0, 2.0], "y_mean": [1.0, 2.0]}
        with pytest.raises(ValueError, match=message):
            TaskResidualsDisplay.from_predictions(**given | change)


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


KERNEL = (
    ARDLinear([1.0, 2.0, 3.0])
    + ConstantKernel() * Columns(RBF([4.0, 5.0]), [2, 0])
    + Matern(10.0) ** 2
    + WhiteKernel()
)


class TestKernelRelevance:
    def test_every_part_of_the_kernel(self):
        wide = np.column_stack([X[:, :2], X[:, 0] * X[:, 1], TASKS])
        kernel = clone(KERNEL)
        model = PooledGP(kernel, max_iter=0).fit(wide, y)
        display = KernelRelevanceDisplay.from_estimator(model)
        names = ["linear: weight", "squared exponential", "Matern: 1 / length_scale"]
        assert [
            part[: len(n)] for part, n in zip(display.parts, names, strict=True)
        ] == (names)
        expected = [[1.0, 2.0, 3.0], [0.2, np.nan, 0.25], [0.1, 0.1, 0.1]]
        assert_allclose(display.relevances, expected)
        assert_allclose(finite_points(display.lines_[1]), [[0.2, 0], [0.25, 2]])
        assert texts(display.ax_.get_yticklabels()) == ["x0", "x1", "x2"]
        assert display.ax_.get_xscale() == "log"

    def test_output(self, fitted):
        model = fitted["RankSearchIC"]
        display = KernelRelevanceDisplay.from_estimator(model, output=1)
        learned = model.best_estimator_.kernel_[1].length_scale
        assert_allclose(display.lines_[0].get_xdata(), 1.0 / learned)

    def test_names_without_the_task_column(self):
        model = PooledGP(task_feature="load", **QUICK).fit(FRAME, y)
        display = KernelRelevanceDisplay.from_estimator(model)
        assert list(display.feature_names) == ["a", "b"]
        array = FRAME.to_numpy(dtype=object)
        model = PooledGP(task_feature=0, **QUICK).fit(array, y)
        display = KernelRelevanceDisplay.from_estimator(model)
        assert list(display.feature_names) == ["x1", "x2"]

    def test_names_of_a_pipeline(self):
        data, tau = load_puma560(
            n_per_load=3, loads=[1, 2], return_X_y=True, as_frame=True
        )
        model = PooledGP(max_iter=0)
        model = make_inverse_dynamics_regressor(model).fit(data, tau["tau1"])
        display = KernelRelevanceDisplay.from_estimator(model)
        assert display.feature_names[:2] == ["q1", "q2"]
        assert display.feature_names[-1] == "sgn(qd6)"
        assert np.isnan(display.relevances[1][-6:]).all()
        assert texts(display.ax_.get_yticklabels()) == display.feature_names

    def test_names_given(self, piped):
        names = ["warm", "wet"]
        display = KernelRelevanceDisplay.from_estimator(piped, feature_names=names)
        assert texts(display.ax_.get_yticklabels()) == names
        display = KernelRelevanceDisplay.from_estimator(piped)
        assert display.feature_names[0] == "standardscaler__a"

    def test_a_step_that_tells_no_names(self):
        model = make_pipeline(PooledGP(max_iter=0)).fit(X, y)
        display = KernelRelevanceDisplay.from_estimator(model)
        assert display.feature_names == ["x0", "x1"]

    def test_another_number_of_names(self, fitted):
        message = r"shape \(1, 2\); 1 parts and 1 features need \(1, 1\)"
        with pytest.raises(ValueError, match=message):
            KernelRelevanceDisplay.from_estimator(
                fitted["PooledGP"], feature_names=["a"]
            )

    def test_a_kernel_without_relevances(self):
        model = PooledGP(ConstantKernel(1.0), max_iter=0).fit(X, y)
        with pytest.raises(ValueError, match="has no part with relevances: RBF"):
            KernelRelevanceDisplay.from_estimator(model)

    def test_nothing_positive(self):
        display = KernelRelevanceDisplay(
            relevances=[[0.0]], parts=["linear"], feature_names=["a"]
        )
        with pytest.raises(ValueError, match="No relevance is positive"):
            display.plot()
