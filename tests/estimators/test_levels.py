"""Levels of the tasks: likelihoods, predictions, what is told, tasks that join."""

import pickle
import warnings
from copy import copy
from functools import cache

import numpy as np
import pytest
import textbook
from levelled import KERNEL, OPTIONS, M, draw, levels_by_hand
from rarely import rarely
from samples import log_densities, outputs, posteriors, split
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from sparse_models import SPARSE

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
each_option = pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
each_exact = pytest.mark.parametrize("inference", ["dense", "kronecker"])
SHARED = {"normalize_y": "shared", "noise": "shared"}
PER_TASK = {"normalize_y": "per_task", "noise": "per_task"}


def learner(**options):
    return MultiTaskGPRegressor(
        KERNEL, **{"rank": 2, "learning": "staged", "max_iter": 3} | options
    )


@cache
def fitted(options, **of_data):
    """A model that tests share and leave alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # three iterations are few
        return learner(**dict(options)).fit(*draw(**of_data))


def of_outputs(attribute, model):
    """With an axis of the outputs first."""
    return np.asarray(attribute).reshape(len(outputs(model)), -1)


@each_option
@pytest.mark.parametrize("n_outputs", [None, 2])
class TestAttributes:
    @pytest.fixture
    def data(self, n_outputs):
        return draw(n_outputs=n_outputs)

    @pytest.fixture
    def model(self, options, n_outputs):
        return fitted(tuple(options.items()), n_outputs=n_outputs)

    def test_they_reproduce_the_likelihood(self, model, data):
        expected = log_densities(model, *data)
        np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-8)

    def test_they_reproduce_the_predictions(self, model, data):
        Z, _ = draw(3, seed=1)
        mean, std = model.predict(Z, return_std=True)
        covs = model.predict(Z, return_cov=True)[1].reshape(len(Z), len(Z), -1)
        noisy = model.predict(Z, return_std=True, include_noise=True)[1]
        tasks = split(Z)[1]
        for j, (f, K) in enumerate(posteriors(model, *data, Z)):
            sizes = np.sqrt(np.diag(K))
            mean_j, std_j, noisy_j = (
                of.reshape(len(Z), -1)[:, j] for of in (mean, std, noisy)
            )
            np.testing.assert_allclose((mean_j - f) / sizes, 0.0, atol=1e-6)
            scaled = (covs[..., j] - K) / np.multiply.outer(sizes, sizes)
            np.testing.assert_allclose(scaled, 0.0, atol=1e-6)
            np.testing.assert_allclose(std_j, sizes, rtol=1e-6)
            noise = textbook.of_rows(outputs(model)[j].noise, tasks)
            np.testing.assert_allclose(noisy_j**2, std_j**2 + noise, rtol=1e-8)

    def test_levels_are_those_of_the_definition(self, model, data):
        X, y = data
        levels, stds = (
            of_outputs(of, model) for of in (model.task_level_, model.task_level_std_)
        )
        for j, output in enumerate(outputs(model)):
            mean, cov = levels_by_hand(output, X, y.reshape(len(y), -1)[:, j])
            size = np.ptp(y.reshape(len(y), -1)[:, j])
            np.testing.assert_allclose(levels[j], mean, rtol=1e-7, atol=1e-9 * size)
            atol = 1e-7 * np.sqrt(np.ravel(output.level).max())
            np.testing.assert_allclose(stds[j], np.sqrt(np.diag(cov)), atol=atol)

    def test_shapes(self, model, options, n_outputs):
        first = (n_outputs,) if n_outputs else ()
        units = options["normalize_y"] == "per_task"
        noise = units or options["noise"] == "per_task"
        for name in ("y_mean_", "y_scale_", "level_variance_"):
            assert np.shape(getattr(model, name)) == first + (M,) * units
        assert np.shape(model.noise_variance_) == first + (M,) * noise
        assert np.shape(model.task_level_) == (*first, M)
        assert np.shape(model.task_level_std_) == (*first, M)
        zero = np.array_equal(model.level_variance_, np.zeros(first + (M,) * units))
        assert zero == (not options["task_levels"])


@each_option
@pytest.mark.parametrize("inference", ["dense", "kronecker", "sparse"])
def test_gradient_of_the_likelihood(options, inference):
    X, y = draw(6, complete=True)
    given = {"inference": inference, "n_inducing": 9, "max_iter": 0}
    model = learner(**options, **given, diagonal=options["noise"] == "shared")
    model.fit(X, y)
    theta = model.theta_ + 0.2 * np.random.default_rng(0).standard_normal(
        len(model.theta_)
    )
    value, found = model.log_marginal_likelihood(theta, eval_gradient=True)
    assert value == pytest.approx(model.log_marginal_likelihood(theta), rel=1e-11)
    expected = textbook.derivative(model.log_marginal_likelihood, theta)
    atol = 1e-7 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=atol)


class TestEngines:
    """All find the same levels, predictions and likelihoods."""

    @pytest.mark.parametrize("options", [SHARED, PER_TASK], ids=["shared", "per task"])
    def test_kronecker_is_dense(self, options):
        X, y = draw(complete=True)
        dense = learner(**options, inference="dense").fit(X, y)
        product = clone(dense).set_params(inference="kronecker", max_iter=0).fit(X, y)
        theta = dense.theta_
        value = dense.log_marginal_likelihood(theta)
        found = product.log_marginal_likelihood(theta)
        assert found == pytest.approx(value, rel=1e-10)
        plain = clone(dense).set_params(max_iter=0).fit(X, y)
        for name in ("task_level_", "task_level_std_"):
            expected = getattr(plain, name)
            np.testing.assert_allclose(getattr(product, name), expected, rtol=1e-7)
        for a, b in zip(moments(product, X), moments(plain, X), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9 * np.abs(b).max())

    @pytest.mark.parametrize("options", [SHARED, PER_TASK], ids=["shared", "per task"])
    def test_sparse_is_dense_where_all_inputs_are_inducing(self, options):
        X, y = draw()
        given = {"max_iter": 0, "noise_variance": 0.05, **options}
        dense = learner(**given).fit(X, y)
        sparse = learner(**given, inference="sparse", n_inducing=len(X)).fit(X, y)
        value = dense.log_marginal_likelihood_value_
        found = sparse.log_marginal_likelihood(dense.theta_)
        assert found == pytest.approx(value, abs=1e-3)
        mean, cov = levels_by_hand(outputs(sparse)[0], X, y)
        size = np.sqrt(np.diag(cov))
        np.testing.assert_allclose((sparse.task_level_ - mean) / size, 0.0, atol=1e-3)
        np.testing.assert_allclose(sparse.task_level_std_, size, rtol=1e-3)

    @pytest.mark.parametrize("options", [SHARED, PER_TASK], ids=["shared", "per task"])
    def test_dask_is_numpy(self, options):
        da = pytest.importorskip("dask.array")
        X, y = draw(20)
        model = learner(**options, **SPARSE | {"max_iter": 2})
        expected = clone(model).fit(X, y)
        chunks = da.from_array(X, chunks=(17, 3)), da.from_array(y, chunks=17)
        found = clone(model).fit(*chunks)
        for name in (
            "log_marginal_likelihood_value_",
            "y_mean_",
            "y_scale_",
            "level_variance_",
            "noise_variance_",
            "task_level_",
            "task_level_std_",
        ):
            expected_ = getattr(expected, name)
            np.testing.assert_allclose(getattr(found, name), expected_, rtol=1e-6)
        np.testing.assert_allclose(found.predict(X), expected.predict(X), rtol=1e-6)


def moments(model, X):
    return *model.predict(X, return_std=True), model.predict(X, return_cov=True)[1]


def tasks_apart(times):
    """Six tasks of one function, as far apart as levels are large; noise is small."""
    rng = np.random.default_rng(4)
    tasks, x = np.repeat(np.arange(6), 12), rng.uniform(0.0, 8.0, 72)
    levels, factor = rng.standard_normal((2, 6))
    f = (1.0 + 0.3 * factor)[tasks] * np.sin(x)
    y = f + 0.15 * rng.standard_normal(72) + times * levels[tasks]
    return np.column_stack([x, tasks]), y


@pytest.fixture(scope="module")
def near():
    """The search of those that are not far apart."""
    return RankSearchIC().fit(*tasks_apart(1.0))


class TestRecovery:
    @pytest.mark.parametrize("cls", [MultiTaskGPRegressor, IndependentGP])
    def test_true_levels(self, cls):
        rng = np.random.default_rng(0)
        n_tasks, per_task = 12, 8
        levels = 10.0 + 4.0 * rng.standard_normal(n_tasks)
        x, tasks = rng.uniform(0.0, 6.0, 96), np.repeat(np.arange(n_tasks), per_task)
        K = RBF(1.0)(x[:, None]) + 1e-10 * np.eye(96)
        options = {"rank": 1}
        if cls is IndependentGP:
            K, options = K * np.equal.outer(tasks, tasks), {}
        f = np.linalg.cholesky(K) @ rng.standard_normal(96)
        y = levels[tasks] + 0.5 * f + 0.1 * rng.standard_normal(96)
        model = cls(**options, **SHARED).fit(np.column_stack([x, tasks]), y)
        error = (model.task_level_ - levels) / model.task_level_std_
        assert (np.abs(error) < 4.0).all()
        assert 0.3 < np.square(error).mean() < 3.0
        assert 2.0 < np.sqrt(model.level_variance_) < 8.0
        assert np.corrcoef(model.task_level_, levels)[0, 1] > 0.99

    def test_no_levels_where_there_are_none(self):
        X, y = draw(10, units=False)
        tasks = X[:, -1].astype(int)
        means = np.bincount(tasks, y) / np.bincount(tasks)
        y = np.cos(X[:, 0]) + 0.1 * (y - means[tasks])
        model = IndependentGP(**SHARED).fit(X, y)
        assert model.level_variance_ < 0.05 * y.var()

    @pytest.mark.parametrize("size", [10.0, *rarely(100.0, 1000.0), 1e6])
    def test_large_levels_change_nothing_else(self, near, size):
        """What is chosen, and by which criterion."""
        small, large = near, RankSearchIC().fit(*tasks_apart(size))
        assert small.criterion_ == large.criterion_ == "laplace"
        assert large.best_model_ == small.best_model_
        pair = small.best_estimator_, large.best_estimator_
        noise = [model.noise_variance_ for model in pair]
        assert noise[1] == pytest.approx(noise[0], rel=0.05)
        scales = [np.exp(model.kernel_.theta) for model in pair]
        np.testing.assert_allclose(*scales, rtol=0.05)


class TestAddTask:
    """The new task's level comes from its samples and the levels' variance."""

    @pytest.mark.parametrize("n_new", [1, 2, 6])
    @pytest.mark.parametrize("informed", ["tasks", None])
    @pytest.mark.parametrize("complete", [False, True])
    @pytest.mark.parametrize("options", [SHARED, PER_TASK], ids=["shared", "per task"])
    def test_by_the_definition(self, n_new, informed, complete, options):
        X, y = draw(complete=complete)
        model = fitted((*options.items(), ("diagonal", True)), complete=complete)
        model = copy(model).set_params(max_iter=50)
        rng = np.random.default_rng(1)
        X_new = np.column_stack([rng.uniform(-2.0, 2.0, (n_new, 2)), np.full(n_new, M)])
        y_new = 7.0 + np.sin(X_new[:, 0])
        extended = model.add_task(X_new, y_new, prior=informed)
        per_task = options is PER_TASK
        kept = extended.level_variance_[:M] if per_task else extended.level_variance_
        np.testing.assert_allclose(kept, model.level_variance_, rtol=1e-12)
        X, y = np.vstack([X, X_new]), np.append(y, y_new)
        [output] = outputs(extended)
        mean, cov = levels_by_hand(output, X, y)
        size = np.sqrt(np.diag(cov))
        np.testing.assert_allclose((extended.task_level_ - mean) / size, 0.0, atol=1e-6)
        np.testing.assert_allclose(extended.task_level_std_, size, rtol=1e-6)
        found = extended.log_marginal_likelihood_value_
        assert found == pytest.approx(*log_densities(extended, X, y), rel=1e-8)
        Z, _ = draw(2, seed=2)
        Z[:3, -1] = M
        [(f, K)] = posteriors(extended, X, y, Z)
        mean, std = extended.predict(Z, return_std=True)
        least, certain = np.sqrt(np.diag(K)), (Z[:, -1] != M) | (informed is None)
        np.testing.assert_allclose((mean - f) / least, 0.0, atol=1e-5)
        np.testing.assert_allclose(std[certain], least[certain], rtol=1e-5)
        assert (std[~certain] > least[~certain]).all()  # the row of F is open

    def test_few_samples_tell_where_a_task_is(self):
        """Predictions of a task whose level is far away, from two samples of it."""
        rng = np.random.default_rng(0)
        x, tasks = rng.uniform(0.0, 6.0, 90), np.repeat(np.arange(6), 15)
        levels = np.array([3.0, -20.0, 11.0, 40.0, -35.0, 15.0])
        y = levels[tasks] + np.sin(x) + 0.05 * rng.standard_normal(90)
        model = MultiTaskGPRegressor(rank=1, **SHARED)
        model.fit(np.column_stack([x, tasks]), y)
        z = np.column_stack([np.linspace(0.0, 6.0, 30), np.full(30, 9)])
        f = -50.0 + np.sin(z[:, 0])
        extended = model.add_task(z[[4, 20]], f[[4, 20]])
        assert np.abs(extended.predict(z) - f).max() < 0.5
        assert extended.task_level_[-1] == pytest.approx(-50.0, abs=0.5)


@pytest.mark.parametrize("options", [SHARED, PER_TASK], ids=["shared", "per task"])
@each_exact
@pytest.mark.parametrize("n_outputs", [None, 2])
def test_leave_one_out_is_the_posterior_given_the_others(options, inference, n_outputs):
    X, y = draw(5, n_outputs, complete=True)
    model = learner(**options, inference=inference).fit(X, y)
    mean, std = model.loo_predict()
    noisy = model.loo_predict(include_noise=True)[1]
    x, tasks = split(X)
    for j, output in enumerate(outputs(model)):
        y_j, mean_j, std_j, noisy_j = (
            of.reshape(len(X), -1)[:, j] for of in (y, mean, std, noisy)
        )
        noise = textbook.of_rows(output.noise, tasks)
        for i in range(0, len(X), 3):
            others = np.arange(len(X)) != i
            given = x[others], tasks[others], y_j[others], x[[i]], tasks[[i]]
            [f], [[K]] = output.posterior(*given)
            assert mean_j[i] == pytest.approx(f, abs=1e-5 * np.sqrt(K))
            assert std_j[i] == pytest.approx(np.sqrt(K), rel=1e-5)
            assert noisy_j[i] == pytest.approx(np.sqrt(K + noise[i]), rel=1e-6)


@pytest.mark.parametrize("options", [SHARED, PER_TASK, {}], ids=["one", "own", "auto"])
class TestCitizenship:
    def test_pickle_and_clone(self, options):
        X, y = draw()
        model = learner(**options, task_levels=True).fit(X, y)
        again = pickle.loads(pickle.dumps(model))
        for found, expected in zip(moments(again, X), moments(model, X), strict=True):
            np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(again.task_level_, model.task_level_)
        fresh = clone(model)
        assert fresh.get_params() == model.get_params()
        assert not hasattr(fresh, "task_level_")
        np.testing.assert_array_equal(fresh.fit(X, y).theta_, model.theta_)

    @pytest.mark.parametrize("noise", [False, True])
    def test_samples_have_the_moments_of_predictions(self, options, noise):
        X, y = draw()
        model, n = learner(**options).fit(X, y), 20_000
        Z = draw(1, seed=3)[0]
        mean, cov = model.predict(Z, return_cov=True, include_noise=noise)
        samples = model.sample_y(Z, n, include_noise=noise)
        size = np.sqrt(np.diag(cov))
        scaled = (samples - mean[:, None]) / size[:, None]
        assert (np.abs(scaled.mean(axis=1)) < 5.0 / np.sqrt(n)).all()
        expected = cov / np.multiply.outer(size, size)
        np.testing.assert_allclose(np.cov(scaled), expected, atol=0.05)


def test_one_function_has_no_levels():
    assert "task_levels" not in PooledGP().get_params()
    model = PooledGP(max_iter=3).fit(*draw())
    assert model.level_variance_ == 0.0
    np.testing.assert_array_equal(model.task_level_, np.full(M, model.y_mean_))
    np.testing.assert_array_equal(model.task_level_std_, np.zeros(M))


@pytest.mark.parametrize("inference", ["dense", "sparse"])
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_task_joins_what_all_share(inference):
    """Of rank 0 there is nothing to learn: the rows count, with what is known."""
    X, y = draw(units=False)[:2]
    new = X[:, -1] == 2
    options = {"rank": 0, "shared": True, "noise": "shared", "normalize_y": False}
    model = MultiTaskGPRegressor(
        KERNEL, inference=inference, n_inducing=28, max_iter=3, **options
    )
    before = model.fit(X[~new], y[~new])
    joined = before.add_task(X[new], y[new])
    assert joined.rank_ == 0
    np.testing.assert_array_equal(joined.theta_, before.theta_)
    if inference == "dense":
        level, K = before.level_variance_, before.kernel_(X[:, :-1])
        same = np.equal.outer(X[:, -1], X[:, -1])
        K = before.task_covariance_[0, 0] * K + level * same
        noise = before.noise_variance_ * np.eye(len(K))
        mean = K @ np.linalg.solve(K + noise, y - before.y_mean_)
        np.testing.assert_allclose(joined.predict(X) - before.y_mean_, mean, rtol=1e-7)
