"""Hard cases: each ends in a right answer or in an error that says what to do.

What `test_inputs.py` has already is not repeated here.
"""

import numpy as np
import pandas as pd
import pytest
from hard_data import (
    ALL,
    SHARED,
    TASKS,
    F,
    X,
    Y,
    assert_sound,
    columns,
    each_gp,
    fitted,
    learned,
    with_params,
)
from samples import posteriors
from scipy.sparse import csr_array
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import (
    RBF,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
)

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.exceptions import (
    ConstantTargetWarning,
    CorrelatedResidualsWarning,
    UnderflowWarning,
)
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.kernels import Columns

pytestmark = [
    pytest.mark.usefixtures("nothing_is_printed"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning"),
]

each = pytest.mark.parametrize("model", ALL.values(), ids=ALL)
each_shared = pytest.mark.parametrize("model", SHARED.values(), ids=SHARED)


class TestFewRows:
    @each
    def test_one_task(self, model):
        model = fitted(model, columns(F, 7 * np.ones(24)), F[:, 0])
        assert model.score(columns(F, 7 * np.ones(24)), F[:, 0]) > 0.99
        best = getattr(model, "best_estimator_", model)
        assert best.tasks_.tolist() == [7]

    def test_one_task_has_rank_one(self):
        search = RankSearchIC().fit(columns(F, np.zeros(24)), Y)
        assert search.results_["rank"].tolist() == [0, 1]  # which are the same
        assert search.best_estimator_.task_covariance_.shape == (1, 1)

    @each
    def test_one_row(self, model):
        mean, _ = assert_sound(fitted(model, X[:1], Y[:1]), X[:1])
        np.testing.assert_allclose(mean, Y[:1], rtol=1e-6)

    @each
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
    def test_one_row_of_each_task(self, model):
        one = columns(F[:5], np.arange(5))
        mean, std = assert_sound(fitted(model, one, Y[:5]), one)
        assert (np.abs(mean - Y[:5]) <= 5.0 * std).all()

    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.TaskColumnWarning")
    def test_one_row_of_each_task_shows_no_rank(self):
        """Its number in rank 1 would explain it, whatever the function."""
        x, new = np.random.default_rng(0).uniform(0.0, 6.0, (2, 12))
        model = MultiTaskGPRegressor().fit(columns(x, np.arange(12)), np.sin(x))
        mean = model.predict(columns(new, np.arange(12)))
        np.testing.assert_allclose(mean, np.sin(new), atol=0.05)

    @each
    def test_a_task_with_one_row_among_large_ones(self, model):
        tasks = np.where(np.arange(24) == 0, 2, TASKS % 2)
        model = fitted(model, columns(F, tasks), Y)
        mean, std = assert_sound(model, columns(F, np.full(24, 2)))
        assert np.abs(mean[0] - Y[0]) <= 5.0 * std[0]

    @each_gp
    def test_fewer_rows_than_parameters(self, model):
        model = fitted(model, X[:3], Y[:3])
        assert getattr(model, "best_estimator_", model).n_hyperparameters_ > 3
        assert_sound(model, X)


class TestTargets:
    @each_gp
    def test_constants_are_told(self, model):
        one_task, alone = columns(F, np.zeros(24)), isinstance(model, SingleTaskGP)
        one = r"^Output is constant in training: the standard deviations"
        one = "^Task 0: all targets are equal: the standard" if alone else one
        with pytest.warns(ConstantTargetWarning, match=one):
            fitted(model, one_task, np.full(24, 3.0), max_iter=0)
        second = r"^Output \[2\] is constant in training"
        second = "^Task 0: all targets of output 2 are equal" if alone else second
        with pytest.warns(ConstantTargetWarning, match=second):
            fitted(model, one_task, np.column_stack([Y, 0.0 * Y]), max_iter=0)
        fitted(model, X[:9], np.full(9, 3.0), max_iter=0)  # may well be by chance

    @each
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.ConstantTargetWarning")
    def test_constant(self, model):
        mean, _ = assert_sound(fitted(model, X, np.full(24, 3.0)), X)
        np.testing.assert_allclose(mean, 3.0, rtol=1e-6)

    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.ConstantTargetWarning")
    def test_constant_with_a_rounded_mean(self):
        """Its deviation is not zero, but noise of that size cannot be computed."""
        wave = Columns(ExpSineSquared(), [0]) * RBF() + RationalQuadratic() ** 2
        options = {"inference": "sparse", "n_inducing": 3, "n_exact": 7}
        model = IndependentGP(wave, normalize_y=False, task_levels=False, **options)
        X = np.column_stack([np.linspace(0.0, 4.0, 35) ** 2, np.arange(35) % 3])
        y = np.full(35, 0.1)
        assert y.std() > 0.0
        mean, _ = assert_sound(fitted(model, X, y, max_iter=10, tol=3.0), X)
        np.testing.assert_allclose(mean, 0.1, rtol=0.1)

    @each
    def test_as_large_as_1e300(self, model):
        match = r"y has values as large as .*e\+300 in column 0; beyond 1e\+75 the squ"
        with pytest.raises(ValueError, match=match):
            fitted(model, X, 1e300 * Y)

    @each
    @pytest.mark.filterwarnings("ignore:Task:skmtgp.exceptions.UnderflowWarning")
    def test_as_small_as_1e300(self, model):
        with pytest.warns(
            UnderflowWarning, match=r"values of the output are below 1e-150"
        ):
            model = fitted(model, X, 1e-300 * Y)
        assert (np.abs(assert_sound(model, X)[0]) <= 1e-299).all()

    @each_gp
    @pytest.mark.filterwarnings("ignore:Task:skmtgp.exceptions.UnderflowWarning")
    @pytest.mark.parametrize(("of_X", "of_y"), [(2.0**-505, 1.0), (1.0, 2.0**-505)])
    def test_as_small_as_1e152(self, model, of_X, of_y):
        """Not small enough to count as constant, which is not what is said."""
        expected = learned(model).predict(X)
        small = X * [of_X, of_X, 1.0]
        match = r"lose digits or vanish, so they may count as constant[.,]"
        with pytest.warns(UnderflowWarning, match=match):
            found = fitted(model, small, of_y * Y).predict(small) / of_y
        np.testing.assert_allclose(found, expected, atol=1e-3)  # of the noise, 0.01

    def test_features_so_small_that_weights_of_lines_would_overflow(self):
        small, line = X * [1e-155, 1e-155, 1.0], 2.0 * X[:, 0] + 0.1 * Y
        with pytest.warns(UnderflowWarning, match="below 1e-150"):
            assert_sound(fitted(IndependentGP(), small, line), small)

    def test_one_of_them_as_small_as_1e300(self):
        match = r"output \[2\] are .*constant, and standard deviations .*another unit"
        pooled = PooledGP(noise="shared")  # "auto" is decided for all outputs
        with pytest.warns(UnderflowWarning, match=match):
            model = clone(pooled).fit(X, np.column_stack([Y, 1e-300 * Y]))
        np.testing.assert_allclose(model.predict(X)[:, 0], pooled.fit(X, Y).predict(X))

    @each_gp
    @pytest.mark.parametrize("unit", [2.0**230, 2.0**-400])
    def test_of_any_other_unit(self, model, unit):
        """About 1e69 and 1e-120, exact in binary."""
        expected = learned(model).predict(X, return_std=True)
        found = fitted(model, X, unit * Y).predict(X, return_std=True)
        np.testing.assert_allclose(np.divide(found, unit), expected, rtol=1e-5)

    @each_shared
    def test_repeated_rows_that_disagree(self, model):
        """The noise that learning begins with is far too small."""
        twice, far = np.vstack([X, X]), np.r_[Y, Y + 1.0]
        with pytest.warns(CorrelatedResidualsWarning):  # one half after the other
            model = fitted(model, twice, far, noise_variance=1e-10)
        assert_sound(model, X)
        assert model.noise_variance_ > 0.2

    @each_shared
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.JitterWarning")
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.CorrelatedResidualsWarning")
    def test_repeated_rows_that_disagree_without_noise(self, model):
        twice, far = np.vstack([X, X]), np.r_[Y, Y + 1.0]
        params = {"noise_variance": 1e-10, "noise_variance_bounds": "fixed"}
        if hasattr(model, "task_levels"):  # K would not be singular as it is meant
            params["task_levels"] = False
        model = fitted(model, twice, far, kernel=RBF(0.5, "fixed"), **params)
        mean, _ = assert_sound(model, X)
        if not isinstance(model, PooledGP):
            np.testing.assert_allclose(mean, Y + 0.5, atol=0.05)


class TestFeatures:
    @each
    def test_all_rows_equal(self, model):
        same = columns(np.ones((24, 2)), np.zeros(24))
        mean, std = assert_sound(fitted(model, same, Y), same)
        np.testing.assert_allclose(mean, Y.mean(), atol=0.1 * Y.std())
        assert (std >= 0.5 * Y.std()).all()

    @each
    def test_constant_feature(self, model):
        kernels = [{}, {}]
        if not isinstance(model, BayesianLinearRegression):
            kernels = [{"kernel": RBF([1.0] * k), "max_iter": 0} for k in (2, 3)]
        expected = fitted(model, X, Y, **kernels[0]).predict(X)
        more = np.insert(X, 0, 7.0, axis=1)
        found = fitted(model, more, Y, **kernels[1]).predict(more)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)

    @each
    def test_constant_feature_when_learning(self, model):
        more = np.insert(X, 0, 7.0, axis=1)
        assert_sound(fitted(model, more, Y), more)

    @each_gp
    @pytest.mark.parametrize("value", [0.1, -123456789.1])
    def test_constant_that_rounding_makes_vary(self, model, value):
        """Its standard deviation is not zero, but no scale of it either."""
        model = with_params(model, max_iter=0)
        expected, found = (
            clone(model)
            .fit(np.insert(X, 0, v, axis=1), Y)
            .predict(np.insert(X, 0, v + 1e-3, axis=1))
            for v in (0.0, value)
        )
        np.testing.assert_allclose(found, expected, rtol=1e-6)

    @each
    def test_collinear_features(self, model):
        more = columns(np.column_stack([F, -2.0 * F[:, 0]]), TASKS)
        model = fitted(model, more, Y)
        assert_sound(model, more)
        assert model.score(more, Y) > 0.6

    @each_gp
    def test_as_large_as_1e12(self, model):
        """Exact in binary: the default kernel has the features' units."""
        large = columns(2.0**40 * F, TASKS)
        expected = learned(model).predict(X)
        found = fitted(model, large, Y).predict(large)
        np.testing.assert_allclose(found, expected, atol=0.02)  # of the noise, 0.01

    @each_gp
    def test_far_from_zero(self, model):
        """Of the features only four digits are left."""
        far = columns(F + 1e12, TASKS)
        model = fitted(model, far, Y)
        assert_sound(model, far)
        assert model.score(far, Y) > 0.6

    @each
    def test_as_large_as_1e300(self, model):
        large = X.copy()
        large[3, 1] = -1e300
        match = r"X has values as large as 1.0e\+300 in column 1; .* another unit"
        with pytest.raises(ValueError, match=match):
            fitted(model, large, Y)
        with pytest.raises(ValueError, match=match):
            learned(model).predict(large)

    @each
    def test_column_is_named(self, model):
        table = pd.DataFrame({"load": TASKS, "u": F[:, 0], "v": 1e300 * F[:, 1]})
        with pytest.raises(ValueError, match=r"as large as .* in column 'v'; beyond"):
            fitted(model, table, Y, task_feature="load")

    @each
    @pytest.mark.filterwarnings("ignore:Task:skmtgp.exceptions.UnderflowWarning")
    def test_as_small_as_1e300(self, model):
        small = X * [1.0, 1e-300, 1.0]
        match = r"feature \[2\] are below 1e-150: .* constant\. Choose another unit"
        with pytest.warns(UnderflowWarning, match=match):
            model = fitted(model, small, Y)
        assert_sound(model, small)


BAD_DATA = {
    "complex X": (X + 1j, Y, ValueError, "Complex data not supported"),
    "complex y": (X, Y + 1j, ValueError, "Complex data not supported"),
    "X in three dimensions": (X[None], Y, ValueError, "array with dim 3"),
    "sparse X": (csr_array(X), Y, TypeError, "Sparse data was passed for X"),
    "ragged X": ([[1.0, 2.0], [1.0]], Y[:2], ValueError, "inhomogeneous"),
    "an outlandish label": (
        columns(F.astype(object), [10**30] * 24),
        Y,
        ValueError,
        r"must lie within 2\*\*63, but 10{30} does not",
    ),
    "NaN among strings in a list": (
        [[0.5, "a"], [0.1, float("nan")]],
        Y[:2],
        ValueError,
        "1 missing label",
    ),
    "a number among strings in a list": (
        [[0.5, "a"], [0.1, 1]],
        Y[:2],
        ValueError,
        "Task labels must all be integers or all be strings",
    ),
}


@pytest.mark.parametrize(
    ("table", "target", "error", "match"), BAD_DATA.values(), ids=BAD_DATA
)
@each
def test_bad_data(model, table, target, error, match):
    model = clone(model)
    with pytest.raises(error, match=match):
        model.fit(table, target)
    with pytest.raises(NotFittedError):
        model.predict(X)


class TestTasks:
    @pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
    def test_five_hundred(self):
        rng = np.random.default_rng(0)
        tasks, x = np.arange(1000) % 500, rng.uniform(-1.0, 1.0, 1000)
        slopes = rng.normal(size=500)
        y = slopes[tasks] * np.sin(2.0 * x)
        paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
        model = MultiTaskGPRegressor(rank=1, max_iter=2, learning="staged", **paper)
        model.fit(columns(x, tasks), y)
        assert model.task_factor_.shape == (500, 1)
        assert_sound(model, columns(x, tasks)[:50])
        assert model.score(columns(x, tasks), y) > 0.9

    @each
    @pytest.mark.parametrize("container", [np.asarray, np.ndarray.tolist])
    def test_strings_that_look_like_numbers(self, model, container):
        names = np.array(["1", "2", "10"])[TASKS]
        table = columns(F.astype(object), names)
        start = {} if isinstance(model, BayesianLinearRegression) else {"max_iter": 0}
        model = fitted(model, container(table), Y, **start)
        best = getattr(model, "best_estimator_", model)
        assert best.tasks_.tolist() == ["1", "10", "2"]
        order = np.argsort(["1", "2", "10"])  # tasks as numbers, in that order
        numbers = columns(F, np.argsort(order)[TASKS])
        expected = clone(model).fit(numbers, Y).predict(numbers)
        np.testing.assert_allclose(model.predict(table), expected)
        with pytest.raises(ValueError, match="Unknown tasks 1, 2"):
            model.predict(columns(F, TASKS % 2 + 1))

    def test_labels_of_half_precision(self):
        model = BayesianLinearRegression().fit(X.astype(np.float16), Y)
        assert model.tasks_.tolist() == [0, 1, 2]

    @pytest.mark.parametrize(
        ("n_samples", "error"), [(-1, ValueError), (1.5, TypeError), (None, TypeError)]
    )
    def test_number_of_draws(self, n_samples, error):
        model = BayesianLinearRegression().fit(X, Y)
        with pytest.raises(error, match="n_samples"):
            model.sample_y(X, n_samples)


class TestSingular:
    """Found by tests/fuzz.py: NumPy's LinAlgError came through."""

    @pytest.mark.parametrize("value", ["singular", np.nan])
    def test_information(self, monkeypatch, value):
        """Learning goes on without it, to the same mode."""
        expected = PooledGP("rbf").fit(X, Y).log_marginal_likelihood_value_

        def information(self, theta):
            if value == "singular":
                return np.linalg.inv(np.zeros((2, 2)))
            return np.full((len(theta), len(theta)), value)

        monkeypatch.setattr(DenseLikelihood, "fisher_information", information)
        found = PooledGP("rbf").fit(X, Y).log_marginal_likelihood_value_
        assert found == pytest.approx(expected, abs=0.1)

    @pytest.mark.parametrize("learning", ["annealed", "staged"])
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.ConstantTargetWarning")
    def test_first_estimate_of_the_task_covariance(self, learning):
        """Nothing to explain, and inputs that the kernel cannot tell apart."""
        kernel = RBF(1e12, "fixed")
        model = MultiTaskGPRegressor(kernel, learning=learning).fit(X, 0.0 * Y)
        np.testing.assert_allclose(model.predict(X), 0.0, atol=1e-12)


class TestWideInputs:
    """Times in seconds over years, in bursts, with a length-scale of a minute."""

    @pytest.fixture(params=[10, 100])
    def data(self, request):
        rng = np.random.default_rng(0)
        begin = rng.integers(0, request.param * 365 * 86_400, 8)
        times = np.add.outer(begin, np.arange(0.0, 180.0, 30.0)).ravel()
        X = columns(np.tile(times, 2), np.repeat([0, 1], 48))
        y = (1.0 + X[:, 1]) * np.sin(X[:, 0] / 60.0) + 0.1 * rng.standard_normal(96)
        Z = columns(X[::5, 0] + 7.0, X[::5, 1])
        return X, y, Z

    @pytest.mark.parametrize("inference", ["dense", "kronecker", "sparse"])
    @pytest.mark.parametrize(
        "kernel",
        [
            RBF(60.0, "fixed"),
            Matern(60.0, "fixed", nu=0.5),
            Matern(60.0, "fixed", nu=1.5),
            RationalQuadratic(60.0, 1.0, "fixed", "fixed"),
            RBF(60.0, "fixed") * Matern(120.0, "fixed", nu=2.5),
        ],
    )
    def test_predictions(self, data, inference, kernel):
        X, y, Z = data
        model = MultiTaskGPRegressor(
            kernel,
            rank=1,
            noise_variance=0.01,
            inference=inference,
            n_inducing=96,
            max_iter=0,
        ).fit(X, y)
        [(mean, cov)] = posteriors(model, X, y, Z)
        # scikit-learn's kernels, which are in there, round times in minutes: 1e-8
        found, of_Z = model.predict(Z, return_cov=True)
        np.testing.assert_allclose(found, mean, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(of_Z, cov, rtol=0.0, atol=1e-6)
        std = model.predict(Z, return_std=True)[1]
        np.testing.assert_allclose(np.square(std), np.diag(cov), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("inference", ["dense", "sparse"])
def test_likelihood_far_from_any_data(inference):
    X, y = columns(np.linspace(0.0, 1.0, 12), np.arange(12) % 2), np.arange(12.0)
    model = MultiTaskGPRegressor(rank=1, max_iter=0, inference=inference)
    model.fit(X, y)
    for theta in (1e5, -1e5):
        theta = np.full_like(model.theta_, theta)
        assert model.log_marginal_likelihood(theta) == -np.inf
        value, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
        assert value == -np.inf
        assert np.isnan(gradient).all()
