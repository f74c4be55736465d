"""Estimators whose intervals count what the rows leave open of hyperparameters."""

import pickle

import numpy as np
import pytest
from scipy.stats import norm
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from waves import draw

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    compile_predictor,
)

LAPLACE = {"hyperparameters": "laplace"}


X, y = draw(rows=10)
Z = np.column_stack([np.linspace(0.0, 7.0, 6), [0, 1, 2, 0, 1, 2]])
NEW = np.array([[1.0, 7.0], [4.0, 7.0]])
OF_NEW = 7.0 - np.sin(NEW[:, 0])
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, **LAPLACE),
    "independent": IndependentGP(**LAPLACE),
    "pooled": PooledGP(**LAPLACE),
    "single": SingleTaskGP(**LAPLACE),
}


@pytest.fixture(scope="module")
def model():
    return clone(MODELS["multi-task"]).fit(X, y)


@pytest.fixture(scope="module")
def mode(certain_theta):
    return MultiTaskGPRegressor(rank=1).fit(X, y)


def narrower(model):
    """The deviations that the same theta alone has."""
    [posterior] = model._posteriors
    variances = posterior.variance(Z[:, :1], Z[:, 1].astype(int))
    return np.sqrt(variances) * model.y_scale_


def test_deviations_are_wider_than_those_of_theta(model):
    mean, std = model.predict(Z, return_std=True)
    assert (std > narrower(model)).all()
    assert model.hyperparameters_ == "laplace"
    [posterior] = model._posteriors
    of_theta = posterior.mean(Z[:, :1], Z[:, 1].astype(int))
    np.testing.assert_allclose(mean, of_theta * model.y_scale_ + model.y_mean_)


@pytest.mark.parametrize("name", MODELS)
def test_all_kinds_of_deviations_agree(name):
    model = clone(MODELS[name]).fit(X, y)
    mean, std = model.predict(Z, return_std=True)
    _, cov = model.predict(Z, return_cov=True)
    np.testing.assert_allclose(np.diagonal(cov), std**2, rtol=1e-8)
    lower, upper = model.predict_interval(Z, 0.9, include_noise=False)
    width = norm.ppf(0.95) * std
    np.testing.assert_allclose([lower, upper], [mean - width, mean + width], rtol=1e-8)
    draws = model.sample_y(Z, 4000, random_state=0)
    np.testing.assert_allclose(draws.std(axis=1), std, rtol=0.1)


def test_means_and_parameters_are_those_of_the_mode(model, mode):
    np.testing.assert_array_equal(model.predict(Z), mode.predict(Z))
    np.testing.assert_array_equal(model.theta_, mode.theta_)
    value = mode.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ == value
    assert model.n_evaluations_ > mode.n_evaluations_


def test_levels_and_left_out_rows_are_wider(model):
    least = model._posteriors[0].level_variances()
    assert (model.task_level_std_ > np.sqrt(least) * model.y_scale_).all()
    _, of_f = model.loo_predict()
    _, of_y = model.loo_predict(include_noise=True)
    assert (of_f < of_y).all()
    residual, variance = model._posteriors[0].leave_one_out()
    order = model._training().order(model._engine)
    assert (of_f[order] > np.sqrt(variance) * model.y_scale_).all()
    assert residual.shape == variance.shape == y.shape


def test_pickles_and_predictions_leave_it_as_it_is(model):
    known = pickle.dumps(model)
    expected = model.predict(Z, return_std=True)
    assert pickle.dumps(model) == known
    found = pickle.loads(known).predict(Z, return_std=True)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("inference", ["kronecker", "sparse"])
def test_engines_agree(inference):
    x, task = np.tile(np.linspace(0.0, 6.0, 8), 3), np.repeat([0, 1, 2], 8)
    rows = np.column_stack([x, task])
    t = np.array([1.0, -2.0, 0.5])[task] * np.sin(x)
    t += 0.2 * np.random.default_rng(0).standard_normal(24)
    options = {"rank": 1, "kernel": RBF(1.0), "normalize_y": "shared", **LAPLACE}
    options |= {"noise": "shared", "learning": "staged", "tol": 1e-6}
    found = [
        MultiTaskGPRegressor(inference=name, n_inducing=8, **options)
        .fit(rows, t)
        .predict(Z, return_std=True)
        for name in ("dense", inference)
    ]
    np.testing.assert_allclose(*found, atol=0.02)


def test_several_outputs_are_each_by_itself():
    rows, Y = draw(rows=10, n_outputs=2)
    options = {"normalize_y": "shared", "noise": "shared", "kernel": "rbf"}
    both = MultiTaskGPRegressor(rank=1, learning="staged", **options, **LAPLACE)
    mean, std = clone(both).fit(rows, Y).predict(Z, return_std=True)
    for output, found in enumerate(zip(mean.T, std.T, strict=True)):
        one = clone(both).fit(rows, Y[:, output])
        np.testing.assert_allclose(found, one.predict(Z, return_std=True), rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_units_order_and_labels_do_not_matter(model, scale):
    order = np.random.default_rng(0).permutation(len(y))
    names = np.array([5, -2, 9])
    rows, new = X[order].copy(), Z.copy()
    for of in (rows, new):
        of[:, 1] = names[of[:, 1].astype(int)]
    other = clone(model).fit(rows, scale * y[order] + 3.0 * scale)
    mean, std = other.predict(new, return_std=True)
    expected = model.predict(Z, return_std=True)
    np.testing.assert_allclose(mean / scale - 3.0, expected[0], atol=0.02)
    np.testing.assert_allclose(std / scale, expected[1], rtol=0.1)


class TestRowsThatJoin:
    def test_of_known_tasks(self, model):
        """As the posterior of all rows by the same theta, at all ends."""
        online = clone(model).fit(X, y)
        more, t = draw(rows=3, seed=1)
        online.partial_fit(more, t)
        [widened], [leeway] = online._predictive, online._leeway
        rows = Z[:, :1], Z[:, 1].astype(int)
        at = online._likelihoods[0].posterior
        ends = [[at(end).mean(*rows) for end in pair] for pair in leeway[0].ends]
        spread = np.square([0.5 * (a - b) for a, b in ends]).sum(axis=0)
        expected = widened.posterior.variance(*rows) + spread
        _, std = online.predict(Z, return_std=True)
        np.testing.assert_allclose(std, np.sqrt(expected) * online.y_scale_, rtol=1e-6)

    def test_of_a_new_task(self, model):
        joined = model.add_task(NEW, OF_NEW)
        _, std = joined.predict(Z, return_std=True)
        _, before = model.predict(Z, return_std=True)
        np.testing.assert_allclose(std, before, rtol=0.2)
        assert (std > narrower(joined)).all()
        again = joined.partial_fit(NEW + [0.5, 0.0], OF_NEW)
        assert np.isfinite(again.predict([[2.0, 7.0]], return_std=True)).all()
        np.testing.assert_array_equal(model.tasks_, [0, 1, 2])

    @pytest.mark.parametrize("name", ["independent", "pooled"])
    def test_of_simpler_models(self, name):
        online = clone(MODELS[name]).fit(X, y).partial_fit(NEW, OF_NEW)
        assert (online.predict(NEW, return_std=True)[1] > 0.0).all()

    def test_rows_that_leave(self, model):
        online = clone(model).fit(X, y).partial_fit(*draw(rows=2, seed=1), max_rows=20)
        assert len(online.y_train_) == 20
        assert (online.predict(Z, return_std=True)[1] > narrower(online)).all()


def test_tasks_that_were_not_seen():
    options = {"rank": 1, "shared": True, "normalize_y": "shared", **LAPLACE}
    model = MultiTaskGPRegressor(**options).fit(X, y)
    unseen = np.column_stack([Z[:, 0], np.full(6, 9)])
    _, std = model.predict(unseen, return_std=True)
    [posterior] = model._posteriors
    variance = posterior.with_unseen(1).variance(Z[:, :1], np.full(6, 3))
    assert (std > np.sqrt(variance) * model.y_scale_).all()


def test_trend():
    model = MultiTaskGPRegressor(rank=1, trend="linear", **LAPLACE).fit(X, y)
    [deviations] = model._posteriors[0].coefficients_in_units()[1]
    assert (model.coef_std_ > deviations).all()
    assert (model.predict(Z, return_std=True)[1] > 0.0).all()


def test_compiled_predictors(model):
    compiled = compile_predictor(model, task=1, std=True)
    expected = np.ravel(model.predict([[2.5, 1.0]], return_std=True))
    found = compiled([2.5]), compiled.std([2.5])
    np.testing.assert_allclose(np.ravel(found), expected)


def test_search_approximates_what_it_chose():
    search = RankSearchIC(MultiTaskGPRegressor(**LAPLACE), ranks=(0, 1)).fit(X, y)
    mode = RankSearchIC(ranks=(0, 1)).fit(X, y)
    assert search.best_rank_ == mode.best_rank_
    assert search.best_estimator_.hyperparameters_ == "laplace"
    columns = ["log_marginal_likelihood", "bic"]
    np.testing.assert_array_equal(search.results_[columns], mode.results_[columns])


def test_without_learning_there_is_only_theta():
    model = MultiTaskGPRegressor(rank=1, max_iter=0, **LAPLACE).fit(X, y)
    assert model.hyperparameters_ == "mode"
    np.testing.assert_allclose(model.predict(Z, return_std=True)[1], narrower(model))


@pytest.mark.parametrize("model", [PooledGP, IndependentGP])
def test_with_nothing_to_learn_nothing_is_open(model):
    options = {"kernel": RBF(1.0, "fixed"), "noise_variance_bounds": "fixed"}
    options |= {"task_levels": False} if model is IndependentGP else {}
    found = [
        model(hyperparameters=name, **options).fit(X, y).predict(Z, return_std=True)
        for name in ("mode", "laplace")
    ]
    np.testing.assert_array_equal(*found)


def test_several_kernels_are_refused():
    model = MultiTaskGPRegressor([RBF(1.0), RBF(3.0)], **LAPLACE)
    with pytest.raises(ValueError, match="hyperparameters='laplace' takes one term"):
        model.fit(X, y)


def test_dask_is_refused():
    da = pytest.importorskip("dask.array")
    model = MultiTaskGPRegressor(rank=1, inference="sparse", **LAPLACE)
    with pytest.raises(ValueError, match="hyperparameters='laplace' needs the rows in"):
        model.fit(da.from_array(X), da.from_array(y))


class TestRowsOfFactors:
    """A task that joins by few rows leaves its row of F open."""

    def test_a_task_that_joins_is_widened_alone(self, mode):
        joined = mode.add_task(NEW, OF_NEW)
        certain = mode.add_task(NEW, OF_NEW, prior=None)
        _, std = joined.predict(Z, return_std=True)
        np.testing.assert_allclose(std, narrower(joined))
        assert not any(certain._leeway)
        new = np.array([[2.0, 7.0], [5.0, 7.0]])
        [posterior] = joined._posteriors
        variances = posterior.variance(new[:, :1], np.array([3, 3]))
        _, std = joined.predict(new, return_std=True)
        assert (std > 1.1 * np.sqrt(variances) * joined.y_scale_).all()

    def test_more_rows_leave_less_open(self, mode):
        added, rng = [], np.random.default_rng(0)
        new = np.array([[2.0, 7.0], [5.0, 7.0]])
        for n in (2, 30):
            x = rng.uniform(0.0, 6.0, n)
            rows = np.column_stack([x, np.full(n, 7.0)])
            joined = mode.add_task(rows, 7.0 - np.sin(x) + 0.2 * rng.standard_normal(n))
            [opened] = joined._predictive
            of = new[:, :1], np.array([3, 3])
            alone = opened.posterior.variance(*of)
            added.append(np.mean(opened.variance(*of) - alone))
        assert 0.0 < added[1] < 0.3 * added[0]

    def test_tasks_that_join_keep_their_own(self, mode):
        """One that joins before the other changes its position."""
        first = mode.add_task(NEW, OF_NEW)
        both = first.add_task(NEW - [0.0, 9.0], -OF_NEW)  # its label is the least
        [of_first, of_second] = both._leeway[0]
        assert (of_first.task, of_second.task) == (4, 0)
        found = [of.predict(NEW, return_std=True)[1] for of in (first, both)]
        np.testing.assert_allclose(*found, rtol=0.2)

    def test_intervals_hold_more(self):
        """Of one row of a sixth task: 20 test points of each of twelve draws."""
        held = {"tasks": [], None: []}
        for seed in range(12):
            rng = np.random.default_rng(seed)
            x, task = rng.uniform(0.0, 8.0, 122), np.repeat(np.arange(6), 20)
            task = np.append(task, [5, 5])
            F = rng.standard_normal(6)
            K = np.exp(-0.5 * (x[:, None] - x) ** 2) * np.outer(F[task], F[task])
            f = rng.multivariate_normal(np.zeros(122), K, check_valid="ignore")
            rows, t = np.column_stack([x, task]), f + 0.2 * rng.standard_normal(122)
            model = MultiTaskGPRegressor(rank=1, kernel="rbf", learning="staged")
            model.fit(rows[:100], t[:100])
            for prior, of in held.items():
                joined = model.add_task(rows[120:121], t[120:121], prior=prior)
                lower, upper = joined.predict_interval(rows[100:120])
                of.append(np.mean((lower <= t[100:120]) & (t[100:120] <= upper)))
        assert np.mean(held["tasks"]) > 0.8
        assert np.mean(held["tasks"]) > np.mean(held[None]) + 0.1


@pytest.mark.long
@pytest.mark.usefixtures("certain_theta")
def test_intervals_hold_where_those_of_the_mode_are_too_narrow():
    """Of data drawn from the model: 60 test points of each of twelve draws.

    The mode's would count what is open of rows of F.
    """
    held = {"mode": [], "laplace": []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        x, task = rng.uniform(0.0, 8.0, 105), np.arange(105) % 3
        K = np.exp(-0.5 * (x[:, None] - x) ** 2) * np.cos(task[:, None] - task)
        f = rng.multivariate_normal(np.zeros(105), K, check_valid="ignore")
        t, rows = f + 0.2 * rng.standard_normal(105), np.column_stack([x, task])
        for name, of in held.items():
            model = MultiTaskGPRegressor(rank=2, hyperparameters=name)
            mean, std = model.fit(rows[:45], t[:45]).predict(rows[45:], return_std=True)
            of.append(np.mean(np.abs(f[45:] - mean) < norm.ppf(0.975) * std))
    assert np.mean(held["laplace"]) > np.mean(held["mode"]) + 0.03
    assert np.mean(held["laplace"]) > 0.88
