import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pictured import TASKS, X, Y, texts

from skmtgp.inspection import TrajectoryDisplay

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


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

    def test_several_tasks(self, fitted):
        message = r"rows of 3 tasks, \[0, 1, 2\].*by TaskPredictionDisplay"
        with pytest.raises(ValueError, match=message):
            TrajectoryDisplay.from_estimator(fitted["RankSearchIC"], X, Y)

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
            ({"time": [1.0]}, "time has 1 values, but there are 2 samples"),
            ({"y_mean": [1.0]}, "inconsistent numbers of samples"),
        ],
    )
    def test_errors(self, change, message):
        given = {"y_true": [1.0, 2.0], "y_mean": [1.0, 2.0], "y_std": [0.1, 0.1]}
        with pytest.raises(ValueError, match=message):
            TrajectoryDisplay.from_predictions(**given | change)
