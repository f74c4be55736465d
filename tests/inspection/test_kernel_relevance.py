import numpy as np
import pytest
from numpy.testing import assert_allclose
from pictured import FRAME, QUICK, TASKS, X, texts, y
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel
from sklearn.pipeline import make_pipeline

from skmtgp import PooledGP, make_inverse_dynamics_regressor
from skmtgp.datasets import load_puma560
from skmtgp.inspection import KernelRelevanceDisplay
from skmtgp.kernels import ARDLinear, Columns, Spherical

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def finite_points(line):
    points = line.get_xydata()
    return points[np.isfinite(points).all(axis=1)]


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

    def test_spherical(self):
        model = PooledGP(Spherical([2.0, 4.0]), max_iter=0).fit(X, y)
        display = KernelRelevanceDisplay.from_estimator(model)
        assert display.parts == ["spherical: 1 / length_scale"]
        assert_allclose(display.relevances, [[0.5, 0.25]])

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
        message = r"shape \(1, 2\), but there are 1 parts and 1 feature_names"
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
