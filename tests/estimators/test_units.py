"""Units and noise of the tasks: equivariance, and what "auto" decides."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from levelled import KERNEL, draw
from samples import log_densities
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, DotProduct
from strategies import examples, seeds

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC, SingleTaskGP
from skmtgp._estimators import deciding, revising
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.reading import read
from skmtgp.exceptions import ConstantTargetWarning

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
OWN = {"normalize_y": "per_task", "noise": "shared"}
ENGINES = ["dense", "kronecker", "sparse"]


def learner(**options):
    return MultiTaskGPRegressor(
        KERNEL, **{"rank": 2, "learning": "staged", "max_iter": 0} | options
    )


def moments(model, Z):
    mean, std = model.predict(Z, return_std=True, include_noise=True)
    return mean, std, model.predict(Z, return_cov=True)[1]


def assert_close(found, expected, sizes, tol):
    """Relative to the size of each prediction; `sizes` has those of the rows."""
    mean, std, cov = ((a - b) for a, b in zip(found, expected, strict=True))
    assert np.abs(mean / sizes).max() < tol
    assert np.abs(std / sizes).max() < tol
    assert np.abs(cov / np.multiply.outer(sizes, sizes)).max() < tol


@st.composite
def problems(draw, least=3):
    """Unbalanced tasks of at least so many rows, in no order, and new inputs."""
    counts = draw(st.lists(st.integers(least, 7), min_size=2, max_size=4))
    rng = np.random.default_rng(draw(seeds))
    tasks = rng.permutation(np.repeat(np.arange(len(counts)), counts))
    X = np.column_stack([rng.normal(size=(len(tasks), 2)), tasks])
    slopes, offsets = rng.normal(size=(2, len(counts)))
    y = slopes[tasks] * np.sin(X[:, 0]) + offsets[tasks] * (X[:, 1] + 2.0)
    y += 0.1 * rng.standard_normal(len(y))
    Z = np.column_stack([rng.normal(size=(8, 2)), np.arange(8) % len(counts)])
    return X, y, Z


@st.composite
def units(draw, n_tasks=4):
    """A factor and a constant of each task."""
    powers = draw(st.lists(st.floats(-6, 6), min_size=n_tasks, max_size=n_tasks))
    shifts = draw(st.lists(st.floats(-50, 50), min_size=n_tasks, max_size=n_tasks))
    return 10.0 ** np.array(powers), np.array(shifts)


options = st.fixed_dictionaries(
    {
        "task_levels": st.booleans(),
        "diagonal": st.booleans(),
        "noise": st.sampled_from(["shared", "per_task"]),
        "rank": st.sampled_from([1, None]),
    }
)


class TestEquivariance:
    """Each task's targets may have any unit and any zero."""

    def check(self, problem, units, model, tol):
        (X, y, Z), (factor, shift) = problem, units
        unit, zero = (of[X[:, -1].astype(int)] for of in units)
        model.fit(X, y)
        other = clone(model).fit(X, unit * (y + zero))
        tasks = Z[:, -1].astype(int)
        mean, std, cov = moments(model, Z)
        a = factor[tasks]
        expected = a * (mean + shift[tasks]), a * std, cov * np.multiply.outer(a, a)
        sizes = a * (np.abs(mean) + np.abs(shift[tasks]) + std)
        assert_close(moments(other, Z), expected, sizes, tol)
        n = len(model.tasks_)
        levels = factor[:n] * (model.task_level_ + shift[:n])
        np.testing.assert_allclose(
            other.task_level_ / factor[:n],
            levels / factor[:n],
            rtol=tol,
            atol=tol * np.ptp(y),
        )
        jacobian = -np.log(unit).sum()
        value = model.log_marginal_likelihood_value_ + jacobian
        assert other.log_marginal_likelihood_value_ == pytest.approx(value, abs=1e-6)

    @examples(20)
    @given(problems(), units(), options)
    def test_at_the_start(self, problem, units, options):
        model = learner(normalize_y="per_task", **options)
        self.check(problem, units, model, 1e-8)

    @examples(8)
    @given(problems(), units(), options)
    def test_of_a_short_fit(self, problem, units, options):
        model = learner(normalize_y="per_task", **options, max_iter=3)
        self.check(problem, units, model, 1e-8)

    @pytest.mark.parametrize("inference", ENGINES)
    def test_with_every_engine(self, inference):
        X, y = draw(complete=True)
        model = learner(**OWN, inference=inference, n_inducing=9, max_iter=0)
        units = np.array([1e3, 1.0, 0.1, 1e-4]), np.array([5.0, 0.0, -100.0, 20.0])
        self.check((X, y, draw(2, seed=1)[0]), units, model, 1e-8)

    def test_of_independent_tasks(self):
        model = IndependentGP(**OWN, max_iter=0)
        units = np.array([1e3, 1.0, 0.1, 1e-4]), np.array([5.0, 0.0, -100.0, 20.0])
        self.check((*draw(), draw(2, seed=1)[0]), units, model, 1e-8)


class TestAConstantMore:
    """It moves the predictions of its own task alone, and its level."""

    @examples(15)
    @given(problems(least=1), options, st.floats(-1e3, 1e3), st.integers(0, 1))
    def test_at_the_start(self, problem, options, constant, task):
        X, y, Z = problem
        assume(
            np.bincount(X[:, -1].astype(int)).max() > 1
        )  # else their unit is not told
        model = learner(normalize_y="per_task", **options).fit(X, y)
        moved = clone(model).fit(X, y + constant * (X[:, -1] == task))
        mean, std, cov = moments(model, Z)
        expected = mean + constant * (Z[:, -1] == task), std, cov
        sizes = std.max() + np.abs(constant) + np.abs(mean)
        assert_close(moments(moved, Z), expected, sizes, 1e-8)
        level = model.task_level_ + constant * (np.arange(len(model.tasks_)) == task)
        np.testing.assert_allclose(
            moved.task_level_, level, rtol=1e-8, atol=1e-8 * sizes.max()
        )
        np.testing.assert_allclose(moved.task_level_std_, model.task_level_std_, 1e-7)

    @pytest.mark.parametrize("inference", ENGINES)
    def test_of_a_fit(self, inference):
        X, y = draw(complete=True)
        given = {"inference": inference, "n_inducing": 9, "max_iter": 3}
        model = learner(**OWN, **given).fit(X, y)
        moved = clone(model).fit(X, y + 64.0 * (X[:, -1] == 2))
        mean, std, cov = moments(model, X)
        expected = mean + 64.0 * (X[:, -1] == 2), std, cov
        assert_close(moments(moved, X), expected, 64.0 + std, 1e-6)
        np.testing.assert_allclose(
            moved.task_level_, model.task_level_ + [0.0, 0.0, 64.0, 0.0], rtol=1e-6
        )


class TestSmallTasks:
    """Tasks of one or two rows, or of a constant, have the unit that is usual."""

    @pytest.mark.parametrize("n_rows", [1, 2, 5])
    @pytest.mark.parametrize("inference", ["dense", "sparse"])
    def test_their_units(self, n_rows, inference):
        X, y = draw()
        rows = np.append(
            np.flatnonzero(X[:, -1] != 1), np.flatnonzero(X[:, -1] == 1)[:n_rows]
        )
        X, y = X[rows], np.where(X[:, -1] == 1, 7.0, y)[rows]
        if n_rows == 2:
            y[-1] = 8.0
        model = learner(**OWN, inference=inference, n_inducing=9).fit(X, y)
        deviations = np.array([y[X[:, -1] == m].std() for m in (0, 2, 3)])
        np.testing.assert_allclose(model.y_scale_[[0, 2, 3]], deviations)
        usual = np.exp(np.log(deviations).mean())
        np.testing.assert_allclose(model.y_scale_[1], usual)
        assert model.y_mean_[1] == pytest.approx(7.5 if n_rows == 2 else 7.0)
        mean, std, _ = moments(model, X)
        assert np.isfinite(mean).all()
        assert (std > 0.0).all()
        assert np.abs(mean[X[:, -1] == 1] - 7.0).max() < 2.0 * usual

    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.ConstantTargetWarning")
    def test_all_are_small_or_constant(self):
        X = np.column_stack([np.arange(6.0), np.arange(6.0) ** 2, [0, 1, 1, 2, 2, 2]])
        model = learner(**OWN, rank=1).fit(X, [5.0, 1.0, 2.0, 3.0, 3.0, 3.0])
        around_means = np.sqrt(2 * 0.5**2 / 6)
        np.testing.assert_allclose(model.y_scale_, np.full(3, around_means))
        np.testing.assert_allclose(model.y_mean_, [5.0, 1.5, 3.0])
        assert np.isfinite(moments(model, X)[0]).all()
        model.fit(X[[0, 1, 3]], [5.0, 1.0, 3.0])
        np.testing.assert_allclose(model.y_scale_, np.full(3, np.std([5.0, 1.0, 3.0])))
        model.fit(X, np.full(6, 3.0))
        np.testing.assert_allclose(model.predict(X), 3.0)

    def test_large_targets_that_hardly_vary(self):
        """Deviations that are rounding are no units."""
        X, y = draw()
        y[X[:, -1] == 2] = 1e15 + np.arange(7) % 2 * 0.125
        model = learner(**OWN).fit(X, y)
        assert model.y_scale_[2] > 0.1
        assert np.isfinite(moments(model, X)[0]).all()


def n_noises(model):
    """How many noise variances theta of the first output has."""
    [theta, *_] = np.split(model.theta_, np.size(model.log_marginal_likelihoods_))
    kernel = model.kernel_[0] if isinstance(model.kernel_, list) else model.kernel_
    n_rho = len(model.tasks_) * model.rank_
    return len(theta) - kernel.n_dims - n_rho - model.task_levels


def decided(X, y, model=None, **options):
    """Whether units and noise are those of each task, by their numbers."""
    rank = min(2, len(np.unique(np.asarray(X)[:, -1])))
    model = model or MultiTaskGPRegressor(rank=rank, max_iter=10)
    model = clone(model).set_params(**options).fit(X, y)
    per_task = np.shape(model.y_scale_) != np.shape(
        model.log_marginal_likelihood_value_
    )
    if isinstance(model.kernel_, list):
        per_task = model.y_scale_.ndim > 1
    noise = "per_task" if n_noises(model) > 1 else "shared"
    return "per_task" if per_task else "shared", noise


def functions(amplitudes, levels=0.0, noises=0.1, counts=40, seed=0):
    """A sine of each task, of its own phase; X and y in no order."""
    rng, n = np.random.default_rng(seed), len(amplitudes)
    tasks = rng.permutation(np.repeat(np.arange(n), counts))
    x = rng.uniform(0.0, 6.0, len(tasks))
    amplitudes, levels, noises = (
        np.broadcast_to(of, n)[tasks] for of in (amplitudes, levels, noises)
    )
    f = amplitudes * np.sin(x + 0.5 * tasks)
    y = levels + f + noises * rng.standard_normal(len(x))
    return np.column_stack([x, tasks]), y


ONES = np.ones(4)
UNITS = np.array([1.0, 1e3, 1.0, 1e-2])
CASES = {
    "alike": (functions(ONES), ("shared", "shared")),
    "levels": (functions(ONES, [-5.0, 40.0, 0.0, 11.0]), ("shared", "shared")),
    "amplitudes": (functions([1.0, 3.0, 0.3, 2.0]), ("shared", "shared")),
    "units": (functions(UNITS, 5.0 * UNITS, 0.1 * UNITS), ("per_task", "shared")),
    "noise": (functions(ONES, noises=[0.05, 0.5, 0.05, 0.05]), ("shared", "per_task")),
    "noise of a part": (
        functions(ONES[:2], noises=[0.05, 0.5], counts=[90, 20]),
        ("shared", "per_task"),
    ),
    "one task": (functions([2.0]), ("shared", "shared")),
}
each_case = pytest.mark.parametrize(("data", "expected"), CASES.values(), ids=CASES)


class TestAuto:
    @each_case
    def test_what_is_decided(self, data, expected):
        assert decided(*data) == expected

    @each_case
    def test_names_of_tasks_and_order_of_rows_do_not_matter(self, data, expected):
        X, y = data
        order = np.random.default_rng(1).permutation(len(y))
        names = np.array(["w", "b", "x", "a"])[X[order, -1].astype(int)]
        table = pd.DataFrame({"x": X[order, 0], "task": names})
        assert decided(table, y[order]) == expected

    @pytest.mark.parametrize("case", ["levels", "units", "noise"])
    def test_the_unit_of_all_does_not_matter(self, case):
        (X, y), expected = CASES[case]
        assert decided(X, 1e8 * y) == expected

    @each_case
    def test_without_iterations_all_is_shared(self, data, expected):
        assert decided(*data, max_iter=0) == ("shared", "shared")

    @pytest.mark.parametrize("name", ["normalize_y", "noise"])
    @pytest.mark.parametrize("value", ["shared", "per_task"])
    def test_what_is_asked_for_is_not_decided(self, name, value):
        place = ["normalize_y", "noise"].index(name)
        for case in ("units", "noise"):
            asked = {name: value, "max_iter": 3}
            assert decided(*CASES[case][0], **asked)[place] == value

    @pytest.mark.parametrize(("counts", "most"), [(5, 2), (8, 1), (12, 0)])
    def test_small_tasks_with_the_same_noise(self, counts, most):
        model, found = MultiTaskGPRegressor(), []
        for seed in range(6):
            data = functions([0.0, 0.1, 3.0, 0.2], noises=0.2, counts=counts, seed=seed)
            found.append(decide(model, read(model, *data)).units.own_scales)
        assert sum(found) <= most

    @pytest.mark.parametrize("seed", range(3))
    def test_noise_that_may_be_taken_for_large_functions(self, seed):
        rng = np.random.default_rng(seed)
        tasks = np.repeat(np.arange(12), 20)
        X = rng.uniform(-2.0, 2.0, (len(tasks), 3))  # few rows nearby
        exact = np.sin(1.5 * X[:, 0] + X[:, 1])
        X, drawn = np.column_stack([X, tasks]), rng.standard_normal(len(tasks))
        y = exact + np.where(tasks % 4 == 1, 1.0, 0.01) * drawn
        model = MultiTaskGPRegressor(rank=1, kernel="rbf")
        assert decided(X, y, model) == ("shared", "per_task")
        y = exact + np.where(tasks % 4 == 1, 1.0, 0.05) * drawn
        found = decide(MultiTaskGPRegressor(), read(MultiTaskGPRegressor(), X, y))
        assert (found.units.own_scales, found.noise) == (False, "per_task")

    def test_fast_functions_are_not_taken_for_noise(self):
        rng = np.random.default_rng(2)
        x, tasks = rng.uniform(0.0, 30.0, 1100), rng.integers(0, 3, 1100)
        y = np.array([1.0, -2.0, 0.5])[tasks] * np.sin(x)
        y += 0.1 * rng.standard_normal(1100)
        model = MultiTaskGPRegressor()
        found = decide(model, read(model, np.column_stack([x, tasks]), y))
        assert (found.units.own_scales, found.noise) == (False, "shared")

    def test_fixed_noise_is_shared(self):
        data, _ = CASES["noise"]
        found = decided(*data, noise_variance_bounds="fixed")
        assert found == ("shared", "shared")

    @pytest.mark.parametrize("cls", [MultiTaskGPRegressor, RankSearchIC, IndependentGP])
    def test_is_the_model_with_what_it_decides(self, cls):
        model = cls() if cls is IndependentGP else MultiTaskGPRegressor(rank=2)
        model.set_params(max_iter=5)
        (X, y), expected = CASES["units"]
        told = dict(zip(("normalize_y", "noise"), expected, strict=True))
        found, same = clone(model), clone(model).set_params(**told)
        if cls is RankSearchIC:
            found, same = (cls(each, ranks=(1, 2)) for each in (found, same))
        found, same = found.fit(X, y), same.fit(X, y)
        np.testing.assert_array_equal(found.predict(X), same.predict(X))
        value = same.log_marginal_likelihood()
        assert found.log_marginal_likelihood() == value

    def test_outputs_decide_together(self):
        (X, y), _ = CASES["alike"]
        (_, other), _ = CASES["units"]
        Y = np.column_stack([y, other])
        assert decided(X, Y) == ("per_task", "shared")
        assert decided(X, np.column_stack([y, 3.0 * y])) == ("shared", "shared")

    @pytest.mark.parametrize(
        "case",
        [
            "noise",
            *(
                pytest.param(case, marks=pytest.mark.long)
                for case in ("alike", "units")
            ),
        ],
    )
    def test_small_and_constant_tasks_do_not_matter(self, case):
        (X, y), expected = CASES[case]
        more = np.array([[1.0, 7], [2.0, 7], [3.0, 7], [4.0, 8], [5.0, 9], [1.0, 9]])
        X = np.vstack([X, more])
        y = np.append(y, [4.0, 4.0, 4.0, 2.0, 0.5, 1.0])
        model = MultiTaskGPRegressor(rank=1, max_iter=10)
        found = decided(X, y, model)
        assert found == expected
        assert np.isfinite(model.fit(X, y).predict(X)).all()

    @pytest.mark.parametrize("case", ["levels", "units", "noise"])
    def test_attributes_reproduce_the_likelihood(self, case):
        data, _ = CASES[case]
        model = MultiTaskGPRegressor(rank=1, max_iter=5).fit(*data)
        expected = log_densities(model, *data)
        found = model.log_marginal_likelihoods_
        np.testing.assert_allclose(found, expected, rtol=1e-7)

    @pytest.mark.parametrize("seed", [0, 1])
    def test_metals_differ_in_units_though_noise_of_each_would_do(self, seed):
        """Functions that differ by their units, with noise of one's own."""
        rng, tasks = np.random.default_rng(seed), np.repeat([0, 1, 2], 40)
        x, noise = rng.uniform(0.0, 6.0, 120), np.array([0.5, 0.15, 0.25])
        y = np.sin(1.5 * x + 0.6 * tasks) + 3.0
        y += noise[tasks] * rng.standard_normal(120)
        y *= np.array([1.0, 10.0, 30.0])[tasks]
        found = decided(np.column_stack([x, tasks]), y, MultiTaskGPRegressor())
        assert found == ("per_task", "per_task")

    def test_small_units_are_predicted_as_well_as_large_ones(self):
        (X, y), _ = CASES["units"]
        model = MultiTaskGPRegressor(rank=2).fit(X, y)
        error = y - model.predict(X)
        for m, unit in enumerate(UNITS):
            assert np.sqrt(np.square(error[X[:, -1] == m]).mean()) < 0.15 * unit


@pytest.mark.parametrize("word", ["auto", "per_task", "shared"])
def test_a_gp_for_each_task_has_units_of_its_own(word):
    X, y = draw()
    as_usual = SingleTaskGP(KERNEL, max_iter=3).fit(X, y)
    model = clone(as_usual).set_params(normalize_y=word).fit(X, y)
    np.testing.assert_array_equal(model.predict(X), as_usual.predict(X))


def test_noise_of_tasks_is_not_asked_where_one_has_no_row_for_it(monkeypatch):
    """One row of a task is for its level."""
    rng = np.random.default_rng(0)
    tasks = np.repeat([0, 1, 2], [40, 40, 1])
    x = rng.uniform(0.0, 6.0, 81)
    y = np.sin(x) + np.array([0.01, 1.0, 0.1])[tasks] * rng.standard_normal(81)
    X = np.column_stack([x, tasks])
    asked = []
    plain = revising.differ_in_noise
    monkeypatch.setattr(
        revising, "differ_in_noise", lambda *of: asked.append(of) or plain(*of)
    )
    monkeypatch.setattr(
        deciding, "screened", lambda _, training, __: (0.0, training, [])
    )
    model = MultiTaskGPRegressor(rank=1).fit(X, y)
    assert model.noise_ == "shared"
    assert not asked
    model.fit(X[tasks < 2], y[tasks < 2])
    assert model.noise_ == "per_task"
    assert asked


@pytest.mark.parametrize("noise", ["auto", "per_task"])
@pytest.mark.parametrize(
    "model", [MultiTaskGPRegressor(), MultiTaskGPRegressor(rank=1), IndependentGP()]
)
def test_a_task_of_one_target_does_not_spoil_the_others(model, noise):
    """With noise of its own, which vanished, k^x was that of a constant."""
    rng = np.random.default_rng(1)
    x, task = rng.uniform(0.0, 6.0, (60, 2)), np.repeat([0, 1, 2], 20)
    f = np.array([0.0, 1.5, -1.0])[task] * np.sin(x[:, 0])
    y = np.where(task == 0, 0.5, f + 0.2 * rng.standard_normal(60))
    X, others = np.column_stack([x, task]), task > 0
    model = clone(model).set_params(noise=noise)
    with pytest.warns(ConstantTargetWarning, match="the other tasks alone tell how"):
        model.fit(X, y)
    assert model.noise_ == noise.replace("auto", "shared")
    error = model.predict(X[others]) - f[others]
    assert np.sqrt(np.mean(error**2)) < 0.25  # the functions have 0.9


def test_a_task_of_one_target_tells_nothing_of_noise_that_is_fixed():
    X = np.column_stack([np.arange(12.0), np.repeat([0, 1], 6)])
    y = np.where(X[:, 1] == 0, 0.5, np.sin(X[:, 0]))
    model = MultiTaskGPRegressor(noise_variance_bounds="fixed", max_iter=3)
    with pytest.warns(ConstantTargetWarning, match=r"were no noise\. Check y"):
        model.fit(X, y)


def test_single_tasks_are_no_candidate_where_one_has_one_target():
    X, y = CASES["alike"][0]
    y = np.where(X[:, -1] == X[0, -1], 1.0, y)
    search = RankSearchIC(MultiTaskGPRegressor(max_iter=3), ranks=(1,), simpler=True)
    with pytest.warns(ConstantTargetWarning):
        found = search.fit(X, y).results_["model"]
    assert "single tasks" not in set(found)


@pytest.mark.parametrize(("own", "seed"), [(False, 2), (True, 0)])
def test_means_of_repeats_decide_as_all_measurements(own, seed):
    """Their spread tells the noise of each task, and they count as often."""
    rng, repeats, n = np.random.default_rng(seed), 8, 18
    x, task = rng.uniform(0.0, 6.0, n), np.arange(n) % 3
    of = np.repeat(np.arange(n), repeats)
    noise = np.array([0.2, 0.2, 0.4 if own else 0.2])[task[of]]
    y = np.sin(x[of]) * (1.0 + task[of]) + noise * rng.standard_normal(len(of))
    mean = np.bincount(of, y) / repeats
    spread = np.bincount(of, (y - mean[of]) ** 2) / repeats
    X, options = np.column_stack([x, task]), {"rank": 1, "kernel": "rbf"}
    options |= {"normalize_y": "shared", "inference": "dense", "max_iter": 15}
    all_rows = MultiTaskGPRegressor(**options).fit(X[of], y)
    known = {"sample_weight": np.full(n, repeats), "repeat_variance": spread}
    averaged = MultiTaskGPRegressor(**options).fit(X, mean, **known)
    assert averaged.noise_ == all_rows.noise_ == ("per_task" if own else "shared")


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.JitterWarning")
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
def test_noise_is_shared_where_every_covariance_is_singular():
    """Seconds since 1970 in a linear kernel: no likelihood is known to compare."""
    rng = np.random.default_rng(0)
    x, tasks = 1.7e9 + rng.uniform(0.0, 1e4, 20), np.arange(20) % 2
    y = np.sin(x / 2e3) + 0.1 * rng.standard_normal(20)
    model = MultiTaskGPRegressor(
        DotProduct(1.0) + RBF(1e3), noise_variance=1e-8, task_levels=False, max_iter=10
    )
    assert model.fit(np.column_stack([x, tasks]), y).noise_ == "shared"
