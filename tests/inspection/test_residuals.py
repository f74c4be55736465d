import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pictured import QUICK, TASKS, X, Y, line_spacing, texts, y

from skmtgp import MultiTaskGPRegressor
from skmtgp.inspection import TaskResidualsDisplay

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


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

    @pytest.mark.parametrize("units", ["per_task", "shared"])
    def test_tasks_in_units_of_their_own_are_standardized(self, units):
        model = MultiTaskGPRegressor(rank=1, normalize_y=units, **QUICK).fit(X, y)
        display = TaskResidualsDisplay.from_estimator(model, X, y)
        divided = display.ax_.get_ylabel() == "residual / standard deviation"
        assert divided == (units == "per_task")
        display.plot(kind="residual")
        assert display.ax_.get_ylabel() == "residual"

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
            ({"kind": "squared"}, "kind='squared' must be one of 'auto', 'residual"),
            ({"kind": "standardized"}, "kind='standardized' needs y_std"),
            ({"kind": "standardized", "y_std": [1, 0]}, "y_std must be positive"),
            ({"y_mean": [1.0]}, "inconsistent numbers of samples"),
        ],
    )
    def test_errors(self, change, message):
        given = {"y_true": [1.0, 2.0], "y_mean": [1.0, 2.0]}
        with pytest.raises(ValueError, match=message):
            TaskResidualsDisplay.from_predictions(**given | change)
