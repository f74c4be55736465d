"""Rows that join a fitted model, at fixed hyperparameters."""

import pickle

import numpy as np
import pytest
from multitask_models import PAPER
from samples import draw, log_densities, posteriors
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import RBF, Matern, WhiteKernel
from streams import close, fresh, parts, refitted, told

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC
from skmtgp._numerics.updates import UpdatedCholesky
from skmtgp.inference.dense import DensePosterior
from skmtgp.inference.sparse import SparseBound

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
]
QUICK = {"max_iter": 5, "learning": "staged"}
ALONE = {"max_iter": 5}
SAMPLED = {"hyperparameters": "sampled", "n_draws": 4, "max_iter": 2}


def cube(z):
    return z**3


ROOTS = np.cbrt, cube


def learner(**params):
    return MultiTaskGPRegressor(**QUICK | params)


MODELS = {
    "two kernels": MultiTaskGPRegressor([RBF(), RBF(0.3)], rank=[2, 1], max_iter=3),
    "defaults": learner(),
    "paper": learner(rank=2, **PAPER),
    "diagonal": learner(rank=1, diagonal=True, noise="shared"),
    "shared": learner(rank=0, shared=True, diagonal="equal"),
    "noise of each": learner(rank=1, noise="per_task", normalize_y=False),
    "units of each": learner(rank=2, normalize_y="per_task"),
    "transformed": learner(rank=1, target_transform=ROOTS),
    "own noise in the kernel": learner(kernel=RBF([1.0, 1.0]) + WhiteKernel(), rank=1),
    "kink": learner(kernel=Matern(1.0, nu=0.5), rank=2),
    "sampled": MultiTaskGPRegressor(rank=1, **SAMPLED),
    "sampled, transformed": MultiTaskGPRegressor(
        rank=1, target_transform=ROOTS, **SAMPLED
    ),
    "iGP": IndependentGP(**ALONE),
    "iGP, diagonal": IndependentGP(diagonal=True, noise="per_task", **ALONE),
    "pGP": PooledGP(**ALONE),
}
GAUSSIAN = ["defaults", "paper", "diagonal", "units of each", "iGP", "pGP"]
Z = draw(per_task=2, seed=1)[0]


@pytest.fixture(scope="module", params=[None, 2], ids=["one output", "two outputs"])
def n_outputs(request):
    return request.param


# What differs from one output to the next differs in each of these.
TWICE = ["two kernels", "paper", "units of each", "sampled, transformed", "iGP"]
CASES = {name: (name, None) for name in MODELS}
CASES |= {f"{name}, two outputs": (name, 2) for name in TWICE}


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES)
def case(request):
    return request.param


@pytest.fixture(scope="module")
def stream(case):
    """The model after the first call, and after two more; not to be changed."""
    name, n_outputs = case
    first, *later = parts(n_outputs)
    model = clone(MODELS[name]).partial_fit(*first)
    before = fresh(model)
    for rows in later:
        model.partial_fit(*rows)
    return before, model


def all_rows(n_outputs):
    X, y = zip(*parts(n_outputs), strict=True)
    return np.vstack(X), np.concatenate(y)


def test_it_is_what_a_refit_tells(stream):
    _, model = stream
    close(told(model, Z), told(refitted(model), Z))


def test_no_covariance_is_decomposed_again(stream):
    for posterior in stream[1]._posteriors:
        assert isinstance(posterior.cholesky, UpdatedCholesky)


def test_what_was_learned_stays(stream):
    before, model = stream
    for name in ("theta_", "y_mean_", "y_scale_", "task_covariance_", "theta_samples_"):
        if hasattr(before, name):
            np.testing.assert_array_equal(getattr(model, name), getattr(before, name))
    for name in ("kernel_", "noise_", "normalize_y_", "n_hyperparameters_", "n_iter_"):
        assert getattr(model, name) == getattr(before, name)
    assert vars(model).keys() == vars(before).keys()
    assert model.get_params() == before.get_params()


def test_rows_come_in_their_order(stream, case):
    _, model = stream
    _, n_outputs = case
    X, y = all_rows(n_outputs)
    np.testing.assert_array_equal(model.X_train_, X[:, :-1])
    np.testing.assert_array_equal(model.tasks_[model.tasks_train_], X[:, -1])
    y = np.cbrt(y) if model.target_transform else y
    np.testing.assert_array_equal(model.y_train_, y)


@pytest.mark.parametrize(
    "case",
    [("sampled", None), ("paper", 2), ("iGP", 2)],
    ids=str,
    indirect=True,
    scope="module",
)
def test_the_first_call_is_fit(stream, case):
    before, (name, n_outputs) = stream[0], case
    model = clone(MODELS[name]).fit(*parts(n_outputs)[0])
    np.testing.assert_array_equal(model.predict(Z), before.predict(Z))


@pytest.mark.parametrize("name", GAUSSIAN)
def test_it_is_what_the_book_tells(name, n_outputs):
    first, *later = parts(n_outputs)
    model = clone(MODELS[name]).fit(*first)
    for rows in later:
        model.partial_fit(*rows)
    X, y = all_rows(n_outputs)
    expected = log_densities(model, X, y)
    np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-8)
    theta = model.log_marginal_likelihood(model.theta_)
    assert model.log_marginal_likelihood_value_ == pytest.approx(theta, rel=1e-10)
    mean, cov = model.predict(Z, return_cov=True)
    for j, (f, K) in enumerate(posteriors(model, X, y, Z)):
        found = mean.reshape(len(Z), -1)[:, j], cov.reshape(*cov.shape[:2], -1)[..., j]
        close(found, (f, K * np.ravel(model.variance_factor_)[j]), digits=7)


def test_draws():
    first, later, _ = parts()
    model = learner(rank=2, **PAPER).fit(*first).partial_fit(*later)
    close([model.sample_y(Z, 3)], [refitted(model).sample_y(Z, 3)])


def test_one_row_after_another():
    first, *later = parts()
    model, other = (learner(rank=2).fit(*first) for _ in range(2))
    for X, y in later:
        other.partial_fit(X, y)
        for i in range(len(y)):
            model.partial_fit(X[[i]], y[[i]])
    close(told(model, Z), told(other, Z), digits=10)


def test_a_row_that_is_there_already():
    """Without noise the matrix would be singular: it is made anew, and that is told."""
    X, y = parts()[0]
    model = learner(rank=1, noise_variance=1e-18, noise_variance_bounds="fixed")
    model.set_params(max_iter=0, noise="shared", inference="dense").fit(X, y)
    with pytest.warns(match="is not positive definite in"):
        model.partial_fit(X[:3], y[:3])
    assert model._posteriors[0].jitter > 0.0
    assert np.isfinite(model.predict(Z)).all()


class TestNewTasks:
    NEW = np.array([[0.3, 0.4, 9], [-0.7, 0.1, -4], [1.2, -1.1, 9], [0.1, 0.2, 1]])
    TARGETS = np.array([3.0, -8.0, 11.0, 2.0])

    @pytest.fixture(params=["paper", "defaults", "noise of each", "sampled"])
    def model(self, request):
        return clone(MODELS[request.param]).fit(*parts()[0])

    def test_they_join_as_by_add_task(self, model):
        rows = [self.NEW[[3]], self.NEW[[1]], self.NEW[[0, 2]]]
        y = [self.TARGETS[[3]], self.TARGETS[[1]], self.TARGETS[[0, 2]]]
        expected = fresh(model).partial_fit(rows[0], y[0])
        expected = expected.add_task(rows[1], y[1]).add_task(rows[2], y[2])
        model.partial_fit(self.NEW, self.TARGETS)
        assert model.tasks_.tolist() == [-4, 0, 1, 2, 9]
        new = np.vstack([Z, self.NEW + [0.1, 0.0, 0.0]])
        close(told(model, new), told(expected, new), digits=10)
        np.testing.assert_array_equal(model.y_train_, expected.y_train_)

    def test_the_posterior_is_that_of_a_refit(self, model):
        model.partial_fit(self.NEW, self.TARGETS)
        assert isinstance(model._posteriors[0].cholesky, UpdatedCholesky)
        new = np.vstack([Z, self.NEW + [0.1, 0.0, 0.0]])
        close(told(model, new), told(refitted(model), new))

    def test_more_rows_of_them(self, model):
        model.partial_fit(self.NEW, self.TARGETS)
        model.partial_fit(self.NEW + [0.1, 0.1, 0.0], self.TARGETS + 0.1)
        close(told(model, Z), told(refitted(model), Z))
        assert model.tasks_train_.tolist().count(4) == 4


class TestEngines:
    """What becomes of data that are not dense."""

    SPARSE = {"inference": "sparse", "n_inducing": 12, "n_exact": 20}

    @pytest.mark.parametrize("params", [{}, {"normalize_y": "per_task"}])
    @pytest.mark.parametrize("name", ["paper", "diagonal", "sampled", "iGP", "pGP"])
    def test_sparse(self, name, params):
        if name == "pGP" and params:
            pytest.skip("one function has one unit")
        first, *later = parts()
        model = clone(MODELS[name]).set_params(**self.SPARSE, **params).fit(*first)
        Z_before = model.inducing_inputs_
        for rows in later:
            model.partial_fit(*rows)
        np.testing.assert_array_equal(model.inducing_inputs_, Z_before)
        assert len(model.y_train_) == len(all_rows(None)[1])
        close(told(model, Z), told(refitted(model), Z))

    def test_sparse_sums_are_added(self, monkeypatch):
        first, later, last = parts()
        model = learner(rank=2, **self.SPARSE).fit(*first)
        assert model._posteriors[0].sums is None  # they take memory
        sums = model.partial_fit(*later)._posteriors[0].sums
        n, seen = len(first[1]) + len(later[1]), []
        assert sums.n.sum() == n
        original = SparseBound.over_rows

        def over_rows(self, function, *arguments, rows=None, **options):
            seen.append(rows)
            return original(self, function, *arguments, rows=rows, **options)

        monkeypatch.setattr(SparseBound, "over_rows", over_rows)
        [posterior] = model.partial_fit(*last)._posteriors
        assert seen[0].tolist() == list(range(n, n + len(last[1])))
        assert posterior.sums.n.sum() == n + len(last[1])
        assert sums.n.sum() == n  # that of the model before is as it was

    def test_sparse_new_task(self):
        model = learner(rank=2, **self.SPARSE).fit(*parts()[0])
        model.partial_fit(TestNewTasks.NEW, TestNewTasks.TARGETS)
        model.partial_fit(*parts()[1])
        close(told(model, Z), told(refitted(model), Z))

    def complete(self, n_inputs=6, seed=0):
        rng = np.random.default_rng(seed)
        x = np.tile(rng.uniform(-2.0, 2.0, (n_inputs, 2)), (3, 1))
        task = np.repeat([0, 1, 2], n_inputs)
        y = np.sin(x[:, 0]) * (1.0 + task) + task
        return np.column_stack([x, task]), y + 0.1 * rng.standard_normal(len(y))

    def test_complete_data_go_on_densely(self):
        model = learner(rank=2).fit(*self.complete())
        assert model.inference_ == "kronecker"
        model.partial_fit(*parts()[1])
        assert (model.inference_, model.complete_) == ("dense", False)
        close(told(model, Z), told(refitted(model), Z))
        model.partial_fit(*parts()[2])
        assert isinstance(model._posteriors[0].cholesky, UpdatedCholesky)
        close(told(model, Z), told(refitted(model), Z))

    @pytest.mark.parametrize("inference", ["auto", "kronecker"])
    def test_data_that_stay_complete_stay(self, inference):
        model = learner(rank=2, inference=inference).fit(*self.complete())
        model.partial_fit(*self.complete(2, seed=1))
        assert (model.inference_, model.complete_) == ("kronecker", True)
        close(told(model, Z), told(refitted(model), Z))

    def test_kronecker_refuses_others(self):
        model = learner(rank=2, inference="kronecker").fit(*self.complete())
        before = pickle.dumps(model)
        again = [part[:1] for part in self.complete()]
        with pytest.raises(ValueError, match="inference='kronecker' needs"):
            model.partial_fit(*again)
        assert pickle.dumps(model) == before


class TestMaxRows:
    @pytest.mark.parametrize("name", ["paper", "defaults", "sampled", "iGP", "pGP"])
    def test_the_rest_is_what_a_refit_tells(self, name, n_outputs):
        first, *later = parts(n_outputs)
        model = clone(MODELS[name]).fit(*first)
        for rows in later:
            model.partial_fit(*rows, max_rows=20)
            assert len(model.y_train_) == len(model.X_train_) == 20
            close(told(model, Z), told(refitted(model), Z))
        close(told(model, Z), told(refitted(model), Z))

    def test_the_least_informative_go(self):
        """Of rows at one input, of which the others tell all but noise."""
        X, y = parts()[0]
        model = learner(rank=2, **PAPER).fit(X, y)
        again = np.repeat(X[:1], 5, axis=0)
        model.partial_fit(again, y[0] + 1e-3 * np.arange(5), max_rows=len(y))
        left = (model.X_train_ == X[0, :2]).all(axis=1).sum()
        assert left <= 2
        kept = {tuple(x) for x in model.X_train_.tolist()}
        assert len(kept) >= len(y) - 1

    def test_it_is_the_row_whose_information_is_least(self):
        X, y = all_rows(None)
        model = learner(rank=2, **PAPER).fit(X, y)
        covariance = model._posteriors[0].cholesky
        order = np.argsort(model.tasks_train_, kind="stable")
        precision = covariance.inverse_diagonal()
        expected = order[np.argmax(precision)]  # they share their noise
        model._drop(len(y) - 1)
        np.testing.assert_array_equal(model.y_train_, np.delete(y, expected))

    def test_a_task_keeps_a_row(self):
        X, y = parts()[0]
        model = learner(rank=1).fit(X, y).partial_fit(X[:2], y[:2], max_rows=3)
        assert sorted(model.tasks_train_.tolist()) == [0, 1, 2]
        with pytest.raises(ValueError, match=r"max_rows=2 is below the number of task"):
            model.partial_fit(X[:2], y[:2], max_rows=2)

    def test_with_the_first_call(self):
        X, y = all_rows(None)
        model = learner(rank=2).partial_fit(X, y, max_rows=30)
        assert len(model.y_train_) == 30
        np.testing.assert_array_equal(model.theta_, learner(rank=2).fit(X, y).theta_)

    def test_a_long_stream_keeps_its_digits(self):
        """Factors are made anew after as many rows as they have."""
        model = learner(rank=2, **PAPER).fit(*parts()[0])
        rng, made = np.random.default_rng(0), 0
        for _ in range(60):
            X = np.column_stack([rng.uniform(-2, 2, (2, 2)), rng.integers(0, 3, 2)])
            model.partial_fit(X, np.sin(X[:, 0]), max_rows=24)
            made += not isinstance(model._posteriors[0].cholesky, UpdatedCholesky)
        assert 3 <= made <= 6
        close(told(model, Z), told(refitted(model), Z))

    def test_complete_data(self):
        X, y = TestEngines().complete()
        model = learner(rank=2).partial_fit(X, y, max_rows=12)
        assert (model.inference_, len(model.y_train_)) == ("dense", 12)
        close(told(model, Z), told(refitted(model), Z))

    @pytest.mark.parametrize(
        "params", [TestEngines.SPARSE, {"inference": "kronecker"}], ids=repr
    )
    def test_other_engines_refuse(self, params):
        X, y = TestEngines().complete()
        model = learner(rank=2, **params)
        message = r"max_rows=12 drops rows, which \w+ inference cannot"
        with pytest.raises(ValueError, match=message):
            model.partial_fit(X, y, max_rows=12)
        assert not hasattr(model, "tasks_")
        model.partial_fit(X, y, max_rows=18)  # none has to go

    @pytest.mark.parametrize("max_rows", [0, -3])
    def test_wrong_numbers(self, max_rows):
        with pytest.raises(ValueError, match=f"max_rows == {max_rows}, must be >= 1"):
            learner().partial_fit(*parts()[0], max_rows=max_rows)
        with pytest.raises(TypeError, match="max_rows must be an instance of"):
            learner().partial_fit(*parts()[0], max_rows="all")


def interrupt(*_, **__):
    raise KeyboardInterrupt


class TestFailures:
    @pytest.fixture
    def model(self):
        return learner(rank=1).fit(*parts(2)[0])

    @pytest.mark.parametrize("method", ["_drop", "_store_posteriors", "_store_levels"])
    def test_interrupted(self, model, monkeypatch, method):
        before, kept = pickle.dumps(model), dict(vars(model))
        monkeypatch.setattr(MultiTaskGPRegressor, method, interrupt)
        with pytest.raises(KeyboardInterrupt):
            model.partial_fit(*parts(2)[1], max_rows=24)
        assert pickle.dumps(model) == before
        assert all(vars(model)[name] is value for name, value in kept.items())

    def test_in_the_second_output(self, model, monkeypatch):
        before, calls = pickle.dumps(model), iter(range(1))
        original = DensePosterior.__init__

        def second(self, *args):
            if next(calls, None) is None:
                raise KeyboardInterrupt
            original(self, *args)

        monkeypatch.setattr(DensePosterior, "__init__", second)
        with pytest.raises(KeyboardInterrupt):
            model.partial_fit(*parts(2)[1])
        assert pickle.dumps(model) == before

    def test_in_the_first_call(self, monkeypatch):
        model = learner(rank=1)
        monkeypatch.setattr(MultiTaskGPRegressor, "_drop", interrupt)
        with pytest.raises(KeyboardInterrupt):
            model.partial_fit(*parts()[0], max_rows=10)
        with pytest.raises(NotFittedError):
            model.predict(Z)

    def test_a_bad_new_task_leaves_known_rows_out(self, model, monkeypatch):
        before = pickle.dumps(model)
        monkeypatch.setattr(MultiTaskGPRegressor, "_extend", interrupt)
        X, y = TestNewTasks.NEW, np.ones((4, 2))
        with pytest.raises(KeyboardInterrupt):
            model.partial_fit(X, y)
        assert pickle.dumps(model) == before

    @pytest.mark.parametrize(
        ("X", "y", "message"),
        [
            ([[0.0, 0.0, 1]], [1.0], r"y has shape \(1,\); the model was fitted to"),
            ([[0.0, 1]], [[1.0, 1.0]], "X has 2 features, but .* is expecting 3"),
            ([[0.0, np.nan, 1]], [[1.0, 1.0]], "NaN"),
            ([[0.0, 0.0, 1]], [[1.0, np.inf]], "infinity"),
            ([[0.0, 0.0, "a"]], [[1.0, 1.0]], "These labels are strings"),
            ([[0.0, 0.0, 0.5]], [[1.0, 1.0]], "fractional numbers such as 0.5"),
            ([[0.0, 0.0, 1]], None, "requires y to be passed"),
            (np.empty((0, 3)), np.empty((0, 2)), "0 sample"),
        ],
    )
    def test_rows_that_cannot_be_used(self, model, X, y, message):
        before = pickle.dumps(model)
        X = np.array(X, dtype=object) if isinstance(X, list) else X
        with pytest.raises(ValueError, match=message):
            model.partial_fit(X, y)
        assert pickle.dumps(model) == before

    def test_data_are_not_changed(self, model):
        X, y = parts(2)[1]
        kept = X.copy(), y.copy()
        model.partial_fit(X, y, max_rows=20)
        y[:] = 0.0
        np.testing.assert_array_equal(X, kept[0])
        assert not (model.y_train_ == 0.0).any()

    def test_dask_is_refused(self, model):
        da = pytest.importorskip("dask.array")
        X, y = map(da.from_array, parts(2)[1])
        for estimator in (model, learner(), RankSearchIC()):
            with pytest.raises(TypeError, match=r"X is a collection .* Pass X.compute"):
                estimator.partial_fit(X, y)

    def test_a_model_of_dask_rows_refuses(self):
        da = pytest.importorskip("dask.array")
        X, y = all_rows(None)
        model = learner(rank=1, **TestEngines.SPARSE)
        model.fit(da.from_array(X, 15), da.from_array(y, 15))
        with pytest.raises(ValueError, match="whose rows it does not keep"):
            model.partial_fit(X[:2], y[:2])


class TestSearch:
    def test_rows_join_the_best_model(self):
        first, later, _ = parts()
        search = RankSearchIC(learner(), ranks=(1, 2), keep_estimators=True)
        search.partial_fit(*first)
        best, rank = search.best_estimator_, search.best_rank_
        expected = fresh(best).partial_fit(*later, max_rows=20)
        assert search.partial_fit(*later, max_rows=20) is search
        assert len(best.y_train_) == len(first[1])  # of nobody else's model
        assert search.best_rank_ == rank
        assert not hasattr(search, "estimators_")
        np.testing.assert_array_equal(search.predict(Z), expected.predict(Z))

    def test_the_first_call_can_drop(self):
        search = RankSearchIC(learner(), ranks=(1,)).partial_fit(
            *parts()[0], max_rows=20
        )
        assert len(search.best_estimator_.y_train_) == 20

    def test_a_failure_leaves_it(self):
        search = RankSearchIC(learner(), ranks=(1,)).fit(*parts()[0])
        before = pickle.dumps(search)
        with pytest.raises(ValueError, match="below the number of tasks"):
            search.partial_fit(*parts()[1], max_rows=1)
        assert pickle.dumps(search) == before
