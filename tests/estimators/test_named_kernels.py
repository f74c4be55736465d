"""Kernels by name: scaled to the features, and citizens like any other parameter."""

import pickle

import numpy as np
import pandas as pd
import pytest
from samples import draw
from sklearn import clone
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    ExpSineSquared,
    Matern,
    Product,
)
from sklearn.model_selection import GridSearchCV

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    compile_predictor,
)
from skmtgp._estimators.named_kernels import KERNELS, named_kernel
from skmtgp.kernels import ARDLinear, Columns
from skmtgp.model_selection import TaskStratifiedKFold

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")

TYPES = {
    "rbf": RBF,
    "exponential": Matern,
    "matern": Matern,
    "matern52": Matern,
    "periodic": Product,
    "linear": ARDLinear,
}
SMOOTHNESS = {"exponential": 0.5, "matern": 1.5, "matern52": 2.5}
GPS = [MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP]
NAMES = pytest.mark.parametrize("name", KERNELS)
EACH = pytest.mark.parametrize("cls", GPS)
SHORT = {"max_iter": 3, "tol": 1.0}
FIRST = {"max_iter": 0}  # as learning starts
X, y = draw()
Z = X[:5]


@NAMES
def test_a_length_scale_for_each_feature(name):
    """It follows the units of the feature."""
    features, units = X[:, :-1], np.array([1e4, 1e-3])
    kernel, other = named_kernel(name, features), named_kernel(name, features * units)
    assert type(kernel) is TYPES[name]
    assert kernel.n_dims >= 2
    np.testing.assert_allclose(other(features * units), kernel(features), rtol=1e-9)
    np.testing.assert_allclose(np.diff(other.bounds), np.diff(kernel.bounds))
    assert (kernel.bounds[:, 0] <= kernel.theta).all()
    assert (kernel.theta <= kernel.bounds[:, 1]).all()


def test_the_length_scales_are_those_of_the_default():
    expected = X[:, :2].std(axis=0) * np.sqrt(2)
    for name in ("rbf", *SMOOTHNESS):
        kernel = named_kernel(name, X[:, :2])
        np.testing.assert_allclose(kernel.length_scale, expected)
        assert getattr(kernel, "nu", None) == SMOOTHNESS.get(name)


def test_a_period_of_each_feature():
    kernel = named_kernel("periodic", X[:, :2])
    of_features = kernel.k1, kernel.k2
    assert [of.columns for of in of_features] == [[0], [1]]
    assert all(type(of) is Columns for of in of_features)
    assert type(named_kernel("periodic", X[:, :1])) is ExpSineSquared


def test_bounds_of_periods():
    """One below twice the gap of even rows repeats what a longer one does."""
    even = np.arange(24.0)[:, None]
    kernel = named_kernel("periodic", even)
    assert kernel.periodicity_bounds[0] == pytest.approx(2.0)
    assert kernel.periodicity == pytest.approx(12.0, rel=0.01)
    uneven = np.append(even, [[0.01]], axis=0)
    assert named_kernel("periodic", uneven).periodicity_bounds[0] < 0.05
    few = named_kernel("periodic", even[:3])
    assert few.periodicity_bounds[0] == few.periodicity == pytest.approx(2.0)


def test_columns_that_have_no_period():
    dummy = np.column_stack([np.arange(8.0), np.tile([0.0, 1.0], 4), np.ones(8)])
    parts = named_kernel("periodic", dummy)
    assert type(parts.k1.k1.kernel) is ExpSineSquared
    for of in (parts.k1.k2, parts.k2, named_kernel("periodic", dummy[:, [1]])):
        assert type(getattr(of, "kernel", of)) is RBF


def test_a_line_far_from_zero():
    """Years, say: the intercept is as far from zero as the slope makes it."""
    x = np.repeat(np.linspace(2000.0, 2020.0, 15), 2)[:, None]
    task = np.tile([0, 1], 15)
    data = np.column_stack([x, task]), (1.0 + task) * (x[:, 0] - 2007.0)
    model = MultiTaskGPRegressor("linear", rank=1).fit(*data)
    assert model.score([[2025.0, 0], [2025.0, 1]], [18.0, 36.0]) > 0.999


@EACH
@NAMES
def test_every_estimator_takes_names(cls, name):
    model = cls(name, max_iter=0).fit(X, y)
    assert np.isfinite(model.predict(Z)).all()
    assert model.kernel == name
    if cls is MultiTaskGPRegressor:
        assert type(model.kernel_) is TYPES[name]
    elif cls is not SingleTaskGP:  # whose amplitude K^rho does not have
        assert type(model.kernel_.k1) is ConstantKernel
        assert type(model.kernel_.k2) is TYPES[name]


@EACH
def test_rbf_is_the_default(cls):
    """Of functions that are so smooth, and the same in all tasks."""
    f = np.sin(X[:, :-1].sum(axis=1))
    expected, found = (cls(of, max_iter=20).fit(X, f) for of in (None, "rbf"))
    np.testing.assert_array_equal(found.predict(Z), expected.predict(Z))


def test_in_lists():
    model = MultiTaskGPRegressor(["linear", RBF(1.0), None], rank=1, **SHORT).fit(X, y)
    assert [type(of) for of in model.kernel_] == [ARDLinear, RBF, RBF]
    assert model.kernel_[1].length_scale.shape == ()
    assert model.kernel_[2].length_scale.shape == (2,)


@EACH
def test_a_name_that_does_not_exist(cls):
    match = f"'kernel' parameter of {cls.__name__} must be .*'matern52'"
    with pytest.raises(ValueError, match=match) as caught:
        cls("matern32").fit(X, y)
    assert all(f"'{name}'" in str(caught.value) for name in KERNELS)


def test_a_name_that_does_not_exist_in_a_list():
    names = ", ".join(map(repr, KERNELS))
    match = rf"has 'cubic'\. It must .* names of kernels \({names}\), or None"
    with pytest.raises(ValueError, match=match):
        MultiTaskGPRegressor(["rbf", "cubic"]).fit(X, y)


def test_grid_search():
    grid = {"kernel": ["rbf", "matern", ["rbf", "linear"]]}
    model = MultiTaskGPRegressor(rank=1, **SHORT)
    search = GridSearchCV(model, grid, cv=TaskStratifiedKFold(2)).fit(X, y)
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()
    assert search.best_estimator_.kernel in grid["kernel"]


def test_rank_search():
    search = RankSearchIC(MultiTaskGPRegressor("matern", **SHORT), ranks=(1, 2)).fit(
        X, y
    )
    assert type(search.best_estimator_.kernel_) is Matern


@NAMES
def test_clones_copies_and_compiled_predictors(name):
    model = MultiTaskGPRegressor(name, rank=1, max_iter=0).fit(X, y)
    assert clone(model).get_params() == model.get_params()
    assert f"kernel='{name}'" in repr(model) or name in repr(model)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(Z), model.predict(Z))
    predict = compile_predictor(model, task=Z[0, -1])
    assert predict(Z[0, :-1]) == pytest.approx(model.predict(Z[:1])[0])


class TestNamesOfColumns:
    """Of a frame, in place of their positions."""

    FRAME = pd.DataFrame(X[:, :-1], columns=["hour", "warmth"])
    FRAME.insert(1, "site", np.array(["u", "v", "w"])[X[:, -1].astype(int)])

    def kernel(self, hour, warmth):
        slow = Columns(RBF(2.0), [warmth])
        return 1.5 * Columns(ExpSineSquared(1.0, 2.0), [hour]) * slow

    @pytest.mark.parametrize("cls", [*GPS, RankSearchIC])
    def test_are_those_of_the_features(self, cls):
        """The task column, which is between them, is not counted."""

        def fitted(hour, warmth):
            options = {"kernel": self.kernel(hour, warmth), "task_feature": "site"}
            if cls is RankSearchIC:
                model = MultiTaskGPRegressor(**FIRST, **options)
                return RankSearchIC(model, ranks=(1,)).fit(self.FRAME, y)
            return cls(**FIRST, **options).fit(self.FRAME, y)

        found = fitted("hour", "warmth").predict(self.FRAME)
        np.testing.assert_array_equal(found, fitted(0, 1).predict(self.FRAME))
        assert np.abs(found - fitted(1, 0).predict(self.FRAME)).max() > 1e-6

    def test_learned_kernels_have_positions(self):
        kernel = self.kernel("hour", "warmth")
        model = MultiTaskGPRegressor(kernel, rank=1, task_feature="site", **FIRST)
        model.fit(self.FRAME, y)
        assert "[0]" in str(model.kernel_)
        assert "[1]" in str(model.kernel_)
        assert model.kernel is kernel
        assert kernel.k2.columns == ["warmth"]
        again = clone(model).fit(self.FRAME, y)
        np.testing.assert_array_equal(again.theta_, model.theta_)

    def test_descriptors_are_not_counted(self):
        frame = self.FRAME.assign(weight=X[:, -1])[["weight", "hour", "site", "warmth"]]
        model = MultiTaskGPRegressor(
            [self.kernel("hour", "warmth")],
            rank=1,
            task_feature="site",
            task_descriptors=["weight"],
            **FIRST,
        )
        assert str(model.fit(frame, y).kernel_).count("[1]") == 1
        model.set_params(kernel=Columns(RBF(), ["weight"]))
        with pytest.raises(ValueError, match=r"'weight' is not a column: \['hour', 'w"):
            model.fit(frame, y)

    @pytest.mark.parametrize("cls", GPS)
    def test_errors(self, cls):
        model = cls(Columns(RBF(), ["Hour"]), task_feature="site", **FIRST)
        match = "columns of the kernel='Hour' is not a column: .* Did you mean 'hour'"
        with pytest.raises(ValueError, match=match):
            model.fit(self.FRAME, y)
        with pytest.raises(ValueError, match="'Hour' names a column, but X has no"):
            model.set_params(task_feature=-1).fit(X, y)
        with pytest.raises(ValueError, match="fitted to a frame takes names"):
            Columns(RBF(), ["hour"])(X)
