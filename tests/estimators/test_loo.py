"""Each training row predicted from the others, against refits by the textbook."""

import pickle

import numpy as np
import pytest
import textbook
from hypothesis import given, settings
from hypothesis import strategies as st
from multitask_models import PAPER
from samples import draw, outputs, posteriors, split
from scipy.stats import norm
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    metrics,
)
from skmtgp._numerics.linalg import Cholesky

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.usefixtures("certain_theta"),  # variances are those of the definition
]
QUICK = {"max_iter": 5}
WHITE = ConstantKernel(2.0) * RBF([1.0, 3.0]) + WhiteKernel(0.1)
ALL = {"diagonal": True, "noise": "per_task", "normalize_y": False}
SHARED = {"normalize_y": "shared", "noise": "shared"}
UNITS = {"normalize_y": "per_task", "noise": "per_task"}
MODELS = {
    "rank 1": MultiTaskGPRegressor(rank=1, **PAPER),
    "full rank": MultiTaskGPRegressor(**PAPER),
    "noise of each task": MultiTaskGPRegressor(**PAPER | {"noise": "per_task"}),
    "diagonal": MultiTaskGPRegressor(rank=2, diagonal=True, **PAPER),
    "not normalised": MultiTaskGPRegressor(rank=2, **PAPER | {"normalize_y": False}),
    "white": MultiTaskGPRegressor(WHITE, rank=2, **PAPER),
    "all": MultiTaskGPRegressor(rank=2, **PAPER | ALL),
    "levels": MultiTaskGPRegressor(rank=1, **SHARED),
    "units of each task": MultiTaskGPRegressor(rank=2, **UNITS),
    "defaults": MultiTaskGPRegressor(),
    "independent": IndependentGP(),
    "independent, all": IndependentGP(**ALL),
    "independent, units": IndependentGP(**UNITS),
    "pooled": PooledGP(),
    "pooled, all": PooledGP(**ALL),
}
EVERY = {
    **{kind.__name__: kind() for kind in (MultiTaskGPRegressor, IndependentGP)},
    **{kind.__name__: kind() for kind in (PooledGP, SingleTaskGP)},
    "RankSearchIC": RankSearchIC(ranks=(1, 2)),
}
every_model = pytest.mark.parametrize("model", EVERY.values(), ids=EVERY)
several = pytest.mark.parametrize("n_outputs", [None, 2], ids=["one y", "two"])


def quick(model):
    """A copy that learns little: any hyperparameters will do."""
    if isinstance(model, RankSearchIC):
        return clone(model).set_params(estimator=quick(MultiTaskGPRegressor()))
    learning = {"learning": "staged"} if isinstance(model, MultiTaskGPRegressor) else {}
    return clone(model).set_params(**learning, **QUICK)


def left_out(model, X, y):
    """Mean and variance of f at each row, from the posterior of the others."""
    mean, variance = np.empty((2, len(X), len(outputs(model))))
    for i, row in enumerate(X):
        others = np.arange(len(X)) != i
        found = posteriors(model, X[others], y[others], row[None])
        mean[i] = [f.item() for f, _ in found]
        variance[i] = [cov.item() for _, cov in found]
    return mean, variance


def parts_of_each_row(model, X):
    """Prior variance of f and noise variance, of shape (n_samples, n_outputs)."""
    x, tasks = split(X)
    prior = [
        of.K_rho[tasks, tasks] * of.kernel.diag(x) + textbook.of_rows(of.level, tasks)
        for of in outputs(model)
    ]
    noise = [textbook.of_rows(of.noise, tasks) for of in outputs(model)]
    return np.transpose(prior), np.transpose(noise)


def lost(model, X):
    """n eps cond(K): relative error of a solution with the factor of K.

    That of 1 / [K^{-1}]_ii too, and the refits' of the same size: their variances have
    it relative to the prior's, from which they are subtracted.
    """
    condition = [np.linalg.cond(of.covariance(*split(X))) for of in outputs(model)]
    return len(X) * np.finfo(float).eps * max(condition)


def assert_left_out(model, X, y, found=None):
    """That what the model says of f and of the observations is what refits find."""
    (mean, variance), share = left_out(model, X, y), lost(model, X)
    prior, noise = parts_of_each_row(model, X)
    for include in (False, True):
        f, std = (found or model.loo_predict)(include)
        assert f.shape == std.shape == y.shape
        errors = f.reshape(mean.shape) - mean
        assert (np.abs(errors) <= share * np.ptp(y, axis=0)).all()
        errors = np.square(std).reshape(mean.shape) - variance - include * noise
        assert (np.abs(errors) <= share * (prior + noise)).all()


@several
@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_is_what_refits_find(model, n_outputs):
    X, y = draw(n_outputs=n_outputs)
    assert (np.diff(X[:, -1]) < 0.0).any()  # the rows are not sorted by task
    assert_left_out(quick(model).fit(X, y), X, y)


@several
@pytest.mark.parametrize("normalize_y", [True, False])
def test_single_is_what_refits_of_each_task_find(n_outputs, normalize_y):
    X, y = draw(n_outputs=n_outputs)
    model = SingleTaskGP(normalize_y=normalize_y, **QUICK).fit(X, y)
    np.testing.assert_array_equal(model.tasks_[model.tasks_train_], X[:, -1])
    for m, alone in enumerate(model.estimators_):
        rows = X[:, -1] == m
        own = np.column_stack([X[rows, :-1], np.zeros(rows.sum())])

        def found(include, rows=rows):
            return [part[rows] for part in model.loo_predict(include)]

        assert_left_out(alone, own, y[rows], found)


@pytest.mark.parametrize("kind", [MultiTaskGPRegressor, IndependentGP, PooledGP])
def test_one_task(kind):
    X, y = draw(n_tasks=1, per_task=12)
    assert_left_out(kind(**QUICK).fit(X, y), X, y)


def test_names_of_tasks_and_their_order():
    X, y = draw()
    expected = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, y).loo_predict()
    named = X.astype(object)
    named[:, -1] = np.array(["a", "b", "c"])[split(X)[1]]
    found = MultiTaskGPRegressor(rank=2, **QUICK).fit(named, y).loo_predict()
    np.testing.assert_array_equal(found, expected)


class TestOneRowOfATask:
    """The last row is the only one of task 2."""

    @pytest.fixture
    def data(self):
        X, y = draw()
        others, own = (np.flatnonzero(k) for k in (X[:, -1] != 2, X[:, -1] == 2))
        rows = np.append(others, own[0])
        return X[rows], y[rows]

    @pytest.mark.parametrize("kind", [MultiTaskGPRegressor, IndependentGP, PooledGP])
    def test_is_what_refits_find(self, data, kind):
        assert_left_out(kind(**QUICK).fit(*data), *data)

    def test_the_other_tasks_predict_it(self, data):
        model = MultiTaskGPRegressor(rank=1, **PAPER, **QUICK).fit(*data)
        mean, std = (part[-1] for part in model.loo_predict())
        prior = parts_of_each_row(model, data[0])[0][-1, 0]
        assert mean != pytest.approx(model.y_mean_, rel=1e-3)
        assert std**2 < 0.9 * prior

    def test_nothing_predicts_it_where_tasks_are_independent(self, data):
        model = IndependentGP(**QUICK).fit(*data)
        mean, std = (part[-1] for part in model.loo_predict())
        prior = parts_of_each_row(model, data[0])[0][-1, 0]
        assert mean == pytest.approx(model.y_mean_, rel=1e-12)
        assert std**2 == pytest.approx(prior, rel=1e-12)

    @pytest.mark.parametrize("normalize_y", [True, False])
    def test_single_has_its_prior(self, data, normalize_y):
        X, y = data
        model = SingleTaskGP(WHITE, normalize_y=normalize_y, **QUICK).fit(X, y)
        mean, std = (part[-1] for part in model.loo_predict())
        alone = model.estimators_[2]
        assert alone.y_scale_ == 1.0
        assert mean == pytest.approx(y[-1] if normalize_y else 0.0, rel=1e-12)
        prior = alone.task_covariance_.item() * alone.kernel_.diag(X[-1:, :-1]).item()
        assert std**2 == pytest.approx(prior, rel=1e-10)


def test_one_row_of_all():
    model = PooledGP(max_iter=0).fit([[0.5, 0]], [3.0])
    mean, std = model.loo_predict()
    _, noisy = model.loo_predict(include_noise=True)
    prior = model.task_covariance_.item() * model.kernel_.diag(np.array([[0.5]]))
    np.testing.assert_allclose(mean, [3.0])
    np.testing.assert_allclose(std**2, prior)
    np.testing.assert_allclose(noisy**2, prior + model.noise_variance_)


def test_data_without_noise():
    # The condition number of 1e8 leaves six digits in the worst case; exact numbers at
    # 1e11 are in test_dense_precision.py.
    X, _ = draw(per_task=12, n_tasks=2)
    y = np.sin(X[:, 0]) * (1.0 + X[:, -1]) + X[:, 1]
    model = MultiTaskGPRegressor(
        RBF([2.0, 4.0], "fixed"),
        noise_variance=1e-10,
        noise_variance_bounds="fixed",
        max_iter=0,
    ).fit(X, y)
    assert lost(model, X) > 1e8 * len(X) * np.finfo(float).eps
    assert model.noise_variance_ == pytest.approx(1e-10 * y.var())
    assert_left_out(model, X, y)


def test_noise_is_that_of_the_rows_task():
    X, y = draw()
    model = MultiTaskGPRegressor(rank=2, noise="per_task", **QUICK).fit(X, y)
    (mean, std), (same, noisy) = (model.loo_predict(flag) for flag in (False, True))
    np.testing.assert_array_equal(mean, same)
    assert np.unique(model.noise_variance_).size == 3
    expected = model.noise_variance_[split(X)[1]]
    np.testing.assert_allclose(noisy**2 - std**2, expected, rtol=1e-9)


class TestScores:
    """Metrics of what is predicted."""

    @pytest.fixture
    def case(self):
        X, y = draw()
        model = MultiTaskGPRegressor(rank=2, noise="per_task", max_iter=5)
        return model.fit(X, y), X, y

    def test_are_those_of_refits(self, case):
        model, X, y = case
        mean, variance = (part[:, 0] for part in left_out(model, X, y))
        std = np.sqrt(variance + parts_of_each_row(model, X)[1][:, 0])
        tasks = split(X)[1]
        loss = metrics.mean_standardized_log_loss
        found = model.loo_predict(include_noise=True)
        for metric, expected, actual, options in (
            (metrics.normalized_mean_squared_error, [mean], found[:1], {}),
            (metrics.coverage, [mean, std], found, {"level": 0.5}),
            (loss, [mean, std], found, {"y_train": y}),
        ):
            score = metric(y, *actual, tasks=tasks, **options)
            again = metric(y, *expected, tasks=tasks, **options)
            assert score == pytest.approx(again, rel=1e-8)
            assert np.isfinite(score)

    def test_log_loss_is_that_of_the_likelihoods(self, case):
        # eq. 5.10: log p(y_i | the others) = log p(y) - log p(the others)
        model, X, y = case
        [output] = outputs(model)
        x, tasks = split(X)

        def log_density(rows):
            return output.log_density(x[rows], tasks[rows], y[rows])

        rows = np.arange(len(y))
        expected = [log_density(rows) - log_density(rows[rows != i]) for i in rows]
        found = model.loo_predict(include_noise=True)
        np.testing.assert_allclose(norm.logpdf(y, *found), expected, rtol=1e-8)
        msll = metrics.mean_standardized_log_loss(y, *found, y_train=y, tasks=X[:, -1])
        trivial = norm.logpdf(y, y.mean(), y.std())  # as many rows of each task
        assert msll == pytest.approx(np.mean(trivial - expected), rel=1e-8)


@pytest.mark.parametrize("noise", ["shared", "per_task"])
@several
def test_rows_of_an_added_task_come_last(noise, n_outputs):
    X, y = draw(n_tasks=4, n_outputs=n_outputs)
    new = X[:, -1] == 1  # between the others
    model = MultiTaskGPRegressor(rank=2, noise=noise, **QUICK).fit(X[~new], y[~new])
    extended = model.add_task(X[new], y[new], prior=None)
    order = np.argsort(new, kind="stable")
    assert_left_out(extended, X[order], y[order])


@several
def test_an_added_task_is_less_certain(n_outputs):
    X, y = draw(n_tasks=4, n_outputs=n_outputs)
    new = X[:, -1] == 3
    model = MultiTaskGPRegressor(rank=2, **QUICK).fit(X[~new], y[~new])
    extended = model.add_task(X[new][:4], y[new][:4])
    _, std = extended.loo_predict()
    found = [posterior.leave_one_out()[1] for posterior in extended._posteriors]
    least = np.sqrt(np.transpose(found)).reshape(std.shape) * extended.y_scale_
    order = extended._training().order(extended._engine)
    std, of_new = std[order], extended.tasks_train_[order] == 3
    np.testing.assert_allclose(std[~of_new], least[~of_new])
    assert (std[of_new] > least[of_new]).all()


@several
def test_search_is_its_best_estimator(n_outputs):
    X, y = draw(n_outputs=n_outputs)
    search = quick(EVERY["RankSearchIC"]).fit(X, y)
    for include in (False, True):
        found = search.loo_predict(include_noise=include)
        expected = search.best_estimator_.loo_predict(include_noise=include)
        np.testing.assert_array_equal(found, expected)
    assert not np.array_equal(found[1], search.loo_predict()[1])
    assert_left_out(search.best_estimator_, X, y, search.loo_predict)


@several
@every_model
def test_model_is_left_as_it_was(model, n_outputs):
    X, y = draw(n_outputs=n_outputs)
    model = quick(model).fit(X, y)
    before, predicted = pickle.dumps(model), model.predict(X, return_std=True)
    mean, std = model.loo_predict()
    expected = mean.copy(), std.copy()
    mean[:], std[:] = -1.0, -1.0  # they are the caller's
    assert pickle.dumps(model) == before
    np.testing.assert_array_equal(model.predict(X, return_std=True), predicted)
    np.testing.assert_array_equal(model.loo_predict(), expected)
    np.testing.assert_array_equal(pickle.loads(before).loo_predict(), expected)


@every_model
def test_not_fitted(model):
    with pytest.raises(NotFittedError, match="not fitted yet"):
        clone(model).loo_predict()


@pytest.mark.parametrize("model", [MODELS["all"], SingleTaskGP()], ids=["all", "own"])
@given(seed=st.integers(0, 10_000), random=st.randoms(use_true_random=False))
@settings(max_examples=8, deadline=None, derandomize=True)
def test_order_of_rows_does_not_matter(model, seed, random):
    X, y = draw(per_task=5, seed=seed, n_outputs=2)
    order = random.sample(range(len(X)), len(X))
    model = quick(model).set_params(max_iter=0, noise_variance=1e-2)
    expected = [part[order] for part in model.fit(X, y).loo_predict()]
    found = model.fit(X[order], y[order]).loo_predict()
    # condition numbers of up to 1e4 or so, and sums in another order
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.ptp(y))


def test_diagonal_of_the_inverse():
    A = np.random.default_rng(0).standard_normal((30, 40))
    K = A @ A.T
    lower = np.asfortranarray(np.tril(K) + np.triu(np.full_like(K, np.nan), 1))
    cholesky = Cholesky(lower)  # whose upper triangle is never written
    factor = cholesky.factor.copy()
    expected = np.diagonal(np.linalg.inv(K))
    np.testing.assert_allclose(cholesky.inverse_diagonal(), expected, rtol=1e-11)
    np.testing.assert_array_equal(cholesky.factor, factor)
    assert np.isnan(factor).any()


def test_rows_that_alone_tell_a_coefficient_of_a_trend():
    """A task of one row, with a constant of its own."""
    rng = np.random.default_rng(0)
    x, task = rng.uniform(0, 6, 31), np.append(np.arange(30) % 2, 2)
    X, y = np.column_stack([x, task]), np.sin(x) + task
    options = {"rank": 1, "trend": "constant", "noise": "shared", "max_iter": 5}
    own = MultiTaskGPRegressor(**options, trend_per_task=True).fit(X, y)
    with pytest.raises(ValueError, match=r"Without one of 1 rows .* of the trend"):
        own.loo_predict()
    shared = MultiTaskGPRegressor(**options).fit(X, y)
    assert np.isfinite(shared.loo_predict()).all()
    search = RankSearchIC(own, ranks=(1,), criterion="loo")
    with pytest.raises(ValueError, match=r"Without one of 1 rows .* of the trend"):
        search.fit(X, y)
