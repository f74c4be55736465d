"""Models of several terms that are learned with inducing inputs."""

import pickle

import building
import numpy as np
import pytest
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared, Matern

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp._numerics import memory
from skmtgp.exceptions import InsufficientMemoryError
from skmtgp.predictor import compile_predictor

M = 3
SLOW, FAST = RBF(2.0, (0.1, 100.0)), RBF(0.3, (0.01, 10.0))
QUICK = {"normalize_y": "shared", "noise": "shared", "inference": "sparse"}
NEW = np.array([[0.3, 0], [4.0, 1], [7.7, 2], [11.0, 2]])


def draw(n=600, seed=0, length=20.0):
    """A slow function and a fast one, each of all tasks with a sign and a size."""
    rng = np.random.default_rng(seed)
    x, task = rng.uniform(0.0, length, n), np.arange(n) % M
    slow = np.array([1.0, -2.0, 0.5])[task] * np.sin(0.6 * x)
    fast = np.array([0.6, 0.4, -0.7])[task] * np.sin(5.0 * x + 1.0)
    y = slow + fast + 0.1 * rng.standard_normal(n)
    return np.column_stack([x, task]), y, slow, fast


@pytest.fixture(scope="module")
def fitted():
    """Of few rows, with few inducing inputs."""
    model = MultiTaskGPRegressor([SLOW, FAST], rank=1, **QUICK, n_exact=120)
    return model.set_params(n_inducing=30).fit(*draw(300, length=6.0)[:2])


def dense_at(model):
    """The likelihood by dense inference at the model's parameters, scaled."""
    [bound] = model._likelihoods
    order = np.argsort(bound.tasks, kind="stable")
    rows = (part[order] for part in (bound.X, bound.tasks, bound.y))
    prior = bound.prior
    of = building.dense(prior.kernel, prior.task_covariance, *rows, levels=prior.levels)
    return of.value_and_grad(model.theta_)


@pytest.mark.long
@pytest.mark.parametrize("kernel", [[SLOW, FAST], [None, None]])
def test_as_dense_inference_of_many_rows(kernel):
    """Two length-scales, 2000 rows and 100 inducing inputs."""
    X, y, *_ = draw(2000)
    model = MultiTaskGPRegressor(kernel, rank=1, **QUICK, n_inducing=100, n_exact=240)
    model.fit(X, y)
    [posterior] = model._posteriors
    exact, gradient = dense_at(model)
    assert posterior.log_likelihood == pytest.approx(exact, abs=0.01)
    assert np.abs(gradient).max() < 20.0  # of 2000 rows: what is left are few nats
    lengths = [kernel.length_scale for kernel in model.kernel_]
    assert lengths[0] > 5.0 * lengths[1]
    assert model.noise_variance_ == pytest.approx(0.01, rel=0.1)
    Z, _, *parts = draw(300, seed=1)
    terms = model.predict_terms(Z)
    np.testing.assert_allclose(terms.sum(axis=1), model.predict(Z), rtol=1e-9)
    assert np.square(terms.sum(axis=1) - sum(parts)).mean() < 0.002
    assert np.corrcoef(terms[:, 0], parts[0])[0, 1] > 0.99
    assert np.corrcoef(terms[:, 1], parts[1])[0, 1] > 0.99
    signs = np.sign(model.task_covariance_)
    expected = [
        [[1, -1, 1], [-1, 1, -1], [1, -1, 1]],
        [[1, 1, -1], [1, 1, -1], [-1, -1, 1]],
    ]
    np.testing.assert_array_equal(signs, expected)


def test_attributes(fitted):
    assert fitted.inference_ == "sparse"
    assert fitted.inducing_inputs_.shape == (30, 1)
    assert [type(kernel) for kernel in fitted.kernel_] == [RBF, RBF]
    assert fitted.task_covariance_.shape == (2, M, M)
    assert fitted.rank_ == [1, 1]
    assert fitted.n_hyperparameters_ == 2 * (1 + M) + 2
    value, gradient = fitted.log_marginal_likelihood(fitted.theta_, eval_gradient=True)
    assert value == pytest.approx(fitted.log_marginal_likelihood_value_, abs=1e-7)
    assert gradient.shape == fitted.theta_.shape
    residual, std = fitted.loo_predict()
    assert residual.shape == std.shape == fitted.y_train_.shape
    assert (fitted.summary()["explained"] > 0.9).all()


def test_inducing_inputs_are_those_of_both_kernels(fitted):
    """A fast term needs more of them than a slow one finds."""
    alone = [len(np.unique(fitted.inducing_inputs_))]
    for kernel in (SLOW, FAST):
        model = clone(fitted).set_params(kernel=kernel, n_inducing=500, max_iter=0)
        alone.append(len(model.fit(*draw(300, length=6.0)[:2]).inducing_inputs_))
    assert alone[1] < alone[0] < alone[2]


@pytest.mark.parametrize(
    "choice", ["k-means", pytest.param("optimised", marks=pytest.mark.long)]
)
def test_other_inducing_inputs(fitted, choice):
    X, y, *_ = draw(300, length=6.0)
    model = clone(fitted).set_params(inducing_inputs=choice, n_inducing=16)
    model.fit(X, y)
    assert model.inducing_inputs_.shape == (16, 1)
    found = model.log_marginal_likelihood_value_
    assert found < fitted.log_marginal_likelihood_value_
    if choice == "optimised":
        greedy = clone(fitted).set_params(n_inducing=16).fit(X, y)
        assert found > greedy.log_marginal_likelihood_value_


def test_kernels_without_derivative_are_refused_before_learning():
    kernels = [SLOW, ExpSineSquared(1.0, 2.0)]
    model = MultiTaskGPRegressor(kernels, inducing_inputs="optimised", **QUICK)
    with pytest.raises(ValueError, match="not known of kernel=ExpSineSquared"):
        model.fit(*draw()[:2])


def test_a_list_of_one_is_no_list():
    X, y, *_ = draw(150)
    settings = QUICK | {"n_inducing": 20, "n_exact": 60, "rank": 1}
    one = MultiTaskGPRegressor(FAST, **settings).fit(X, y)
    listed = MultiTaskGPRegressor([FAST], **settings).fit(X, y)
    np.testing.assert_array_equal(listed.theta_, one.theta_)
    np.testing.assert_array_equal(listed.predict(X), one.predict(X))


def test_a_task_that_joins(fitted):
    x = np.linspace(0.5, 5.5, 40)
    y = -0.5 * np.sin(0.6 * x) + 0.9 * np.sin(5.0 * x + 1.0)
    new = np.column_stack([x, np.full(40, 7)])
    model = fitted.add_task(new[::2], y[::2])
    assert np.square(model.predict(new[1::2]) - y[1::2]).mean() < 0.02
    assert model.task_covariance_.shape == (2, M + 1, M + 1)
    assert len(model.inducing_inputs_) >= 30
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(new), model.predict(new))


def test_rows_that_join(fitted):
    X, y, *_ = draw(60, seed=3, length=6.0)
    model = pickle.loads(pickle.dumps(fitted)).partial_fit(X[:30], y[:30])
    model.partial_fit(X[30:], y[30:])
    [bound], [posterior] = model._likelihoods, model._posteriors
    whole = bound.posterior(model.theta_)
    assert posterior.log_likelihood == pytest.approx(whole.log_likelihood, abs=1e-6)
    found = posterior.mean(NEW[:, :1], NEW[:, 1].astype(int))
    expected = whole.mean(NEW[:, :1], NEW[:, 1].astype(int))
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)
    with pytest.raises(ValueError, match=r"max_rows=100 .* sparse inference cannot"):
        model.partial_fit(X, y + 0.1, max_rows=100)


def test_compiled_predictions(fitted):
    predict = compile_predictor(fitted)
    found = [predict(row[:-1], int(row[-1])) for row in NEW]
    np.testing.assert_allclose(np.ravel(found), fitted.predict(NEW), rtol=1e-9)


def test_several_outputs_at_once():
    X, y, *_ = draw(150, length=6.0)
    settings = QUICK | {"n_inducing": 20, "n_exact": 60, "max_iter": 5, "tol": 1.0}
    model = MultiTaskGPRegressor([SLOW, FAST], rank=1, **settings)
    both = model.fit(X, np.column_stack([y, 2.0 * y]))
    assert len(both.inducing_inputs_) == 2
    assert both.predict_terms(NEW).shape == (4, 2, 3)
    one = clone(model).fit(X, y)
    np.testing.assert_allclose(both.predict(NEW)[:, 0], one.predict(NEW), rtol=1e-6)


def test_a_function_that_all_share():
    X, y, *_ = draw(300, length=6.0)
    model = MultiTaskGPRegressor([SLOW, FAST], rank=[0, 1], shared=[True, False])
    model.set_params(**QUICK, n_inducing=20, n_exact=60, max_iter=20, tol=1.0).fit(X, y)
    unseen = np.column_stack([NEW[:, 0], np.full(len(NEW), 9)])
    _, std = model.predict(unseen, return_std=True)
    _, known = model.predict(NEW, return_std=True)
    assert (std > known).all()
    of_task = [np.column_stack([NEW[:, 0], np.full(len(NEW), m)]) for m in model.tasks_]
    known = np.mean([model.predict_terms(of) for of in of_task], axis=0)
    np.testing.assert_allclose(model.predict_terms(unseen)[:, :2], known[:, :2])


def test_weak_priors(fitted):
    X, y, *_ = draw(150, length=6.0)
    model = clone(fitted).set_params(hyperparameters="map", n_exact=60, tol=1.0)
    assert model.fit(X, y).hyperparameters_ == "map"
    assert np.isfinite(model.predict(X)).all()


@pytest.fixture(scope="module")
def search():
    model = MultiTaskGPRegressor([SLOW, FAST], **QUICK, n_inducing=30, n_exact=120)
    model.set_params(tol=1.0)
    search = RankSearchIC(model, ranks=[(1,), (1, 1), (2, 1)], keep_estimators=True)
    return search.fit(*draw(length=6.0)[:2])


class TestSearch:
    def test_same_inducing_inputs(self, search):
        first, *others = (model.inducing_inputs_ for model in search.estimators_)
        for other in others:
            np.testing.assert_array_equal(first, other)

    def test_likelihoods_do_not_fall(self, search):
        values = search.results_["log_marginal_likelihood"]
        assert (np.diff(values) >= 0.0).all()
        found = [of.log_marginal_likelihood_value_ for of in search.estimators_]
        np.testing.assert_allclose(found, values, rtol=1e-9)

    def test_choice(self, search):
        assert search.best_rank_ == (1, 1)
        assert search.best_estimator_.inference_ == "sparse"
        terms = search.predict_terms(NEW)
        np.testing.assert_allclose(terms.sum(axis=1), search.predict(NEW), rtol=1e-9)


def test_memory_that_cannot_suffice(monkeypatch):
    """Each term has features of its own."""
    X, y, *_ = draw(90)
    matrices = 7 * (M + 1) + 7 * 8  # of 90 x 90 numbers, and tiles
    monkeypatch.setattr(memory, "available_memory", lambda: 8.0 * 90**2 * matrices)
    model = MultiTaskGPRegressor(SLOW, rank=1, n_exact=1, max_iter=0, **QUICK)
    assert model.fit(X, y).inference_ == "sparse"
    model.set_params(kernel=[SLOW, FAST, Matern(1.0)])
    match = "Sparse inference with n_inducing=90, 3 tasks and rank 3 needs about"
    with pytest.raises(InsufficientMemoryError, match=match):
        model.fit(X, y)


def test_skops(fitted):
    skops = pytest.importorskip("skops.io")
    data = skops.dumps(fitted)
    types = skops.get_untrusted_types(data=data)
    ours = {name for name in types if name.startswith("skmtgp.")}
    assert {f"skmtgp.model.several.{name}" for name in ("Kernels", "Forms")} <= ours
    assert all(name.startswith(("skmtgp.", "sklearn.")) for name in types)
    again = skops.loads(data, trusted=types)
    np.testing.assert_array_equal(again.predict(NEW), fitted.predict(NEW))
