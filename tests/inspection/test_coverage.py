from enum import Enum

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pictured import TASKS, X, Y, texts

from skmtgp.inspection import CoverageDisplay, TaskResidualsDisplay
from skmtgp.metrics import coverage


class Site(str, Enum):  # noqa: UP042 - as before Python 3.11
    A = "site one"
    B = "site two"


pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


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
            ({"tasks": ["a", None]}, "1 missing label"),
        ],
    )
    def test_errors(self, change, message):
        given = {"y_true": [1.0, 2.0], "y_mean": [1.0, 2.0], "y_std": [0.1, 0.1]}
        with pytest.raises(ValueError, match=message):
            CoverageDisplay.from_predictions(**given | change)
