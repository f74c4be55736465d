import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pictured import FRAME, QUICK, X, line_spacing, texts, y

from skmtgp import MultiTaskGPRegressor
from skmtgp.inspection import TaskCovarianceDisplay

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


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

    @pytest.mark.parametrize("units", ["per_task", "shared"])
    def test_tasks_in_units_of_their_own_are_correlated(self, units):
        """Their covariances cannot be compared: one would see the largest alone."""
        model = MultiTaskGPRegressor(rank=1, normalize_y=units, **QUICK).fit(X, y)
        display = TaskCovarianceDisplay.from_estimator(model)
        kind = "correlation" if units == "per_task" else "covariance"
        assert display.colorbar_.ax.get_ylabel() == f"task {kind}"
        display.plot(kind="covariance")
        assert_array_equal(display.im_.get_array(), model.task_covariance_)

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

    @pytest.mark.parametrize(
        ("K", "written"),
        [
            ([[0.5, -0.65], [-0.65, 0.85]], ["0.50", "-0.65", "-0.65", "0.85"]),
            ([[1.0, 2.0], [2.0, 30.0]], ["1.0", "2.0", "2.0", "30.0"]),
            ([[400.0, 8.0], [8.0, 120.0]], ["400", "8", "8", "120"]),
            ([[0.04, 0.0], [0.0, 0.01]], ["0.040", "0.000", "0.000", "0.010"]),
            ([[2e6, 0.0], [0.0, 3.0]], ["2.0e+06", "0.0e+00", "0.0e+00", "3.0e+00"]),
            ([[0.0, 0.0], [0.0, 0.0]], ["0.00"] * 4),
        ],
    )
    def test_values_have_one_format(self, K, written):
        display = TaskCovarianceDisplay(task_covariance=np.array(K))
        shown = texts(display.plot(kind="covariance", include_values=True).text_.flat)
        assert shown == [text.replace("-0", "\N{MINUS SIGN}0") for text in written]

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
            (np.eye(2), {"kind": "both"}, "kind='both' must be one of 'auto', 'cov"),
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
