"""A trend in sparse estimators: what dense ones say, where all inputs are inducing."""

import pickle

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from sklearn.preprocessing import SplineTransformer
from strategies import examples, seeds

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC
from skmtgp.predictor import compile_predictor

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
]
N = 48
STEPS = np.array([1.0, -2.0, 0.5])
BETA = np.array([3.0, -40.0])
SPARSE = {"inference": "sparse", "n_inducing": N, "n_exact": N}
NEW = np.array([[1.0, 2.0, 0], [5.0, 30.0, 1], [-3.0, 4.0, 2], [2.0, 2.0, 2]])
JOINING = np.array([[1.0, 2.0, 7], [3.0, 4.0, 7], [2.0, 5.0, 7], [1.0, 5.5, 7]])
OF_JOINING = np.array([5.0, 6.0, 12.0, 11.0])


def draw(seed=0, n=N, slope=2.0):
    rng = np.random.default_rng(seed)
    F, tasks = rng.uniform(0, 6, (n, 2)), np.arange(n) % 3
    y = STEPS[tasks] * np.sin(F[:, 0]) + 2.0 * tasks + slope * F[:, 1]
    return np.column_stack([F, tasks]), y + 0.3 * rng.standard_normal(n)


def model(trend=(0, 1), kernel=None, **options):
    options = {"rank": 1, "learning": "staged", "noise": "shared"} | SPARSE | options
    trend = list(trend) if isinstance(trend, tuple) else trend
    return MultiTaskGPRegressor(kernel or RBF([1.0, 9.0]), trend=trend, **options)


def where_it_begins(**options):
    """Dense and sparse models at the same hyperparameters, learned from nothing."""
    X, y = draw()
    options = {"max_iter": 0} | options
    return [
        model(**options | {"inference": of}).fit(X, y) for of in ("dense", "sparse")
    ]


MODELS = {
    "one set": {},
    "one a task": {"trend_per_task": True},
    "a constant": {"trend": "linear", "normalize_y": "shared"},
    "constants": {"trend": "linear", "trend_per_task": True},
    "units": {"normalize_y": "per_task", "noise": "per_task"},
    "no units": {"normalize_y": False, "task_levels": False},
    "diagonal": {"diagonal": True, "trend": [1]},
    "splines": {"trend": SplineTransformer(3, include_bias=False)},
    "k-means": {"inducing_inputs": "k-means"},
}


@pytest.mark.parametrize("options", MODELS.values(), ids=MODELS)
def test_all_inputs_say_what_dense_inference_says(options):
    dense, sparse = where_it_begins(**options)
    assert (dense.inference_, sparse.inference_) == ("dense", "sparse")
    close = {"rtol": 1e-6, "atol": 1e-6}
    for name in ("coef_", "coef_std_", "task_level_", "task_level_std_"):
        np.testing.assert_allclose(getattr(sparse, name), getattr(dense, name), **close)
    for name in ("trend_mean_", "trend_names_"):
        np.testing.assert_array_equal(getattr(sparse, name), getattr(dense, name))
    value = dense.log_marginal_likelihood_value_
    np.testing.assert_allclose(sparse.log_marginal_likelihood_value_, value, rtol=1e-6)
    predicted = [of.predict(NEW, return_cov=True) for of in (dense, sparse)]
    for one, other in zip(*predicted, strict=True):
        np.testing.assert_allclose(other, one, **close)
    terms = [of.predict_terms(NEW) for of in (dense, sparse)]
    np.testing.assert_allclose(*terms, **close)
    left_out = [of.loo_predict() for of in (dense, sparse)]
    np.testing.assert_allclose(*left_out, **close)
    row = compile_predictor(sparse, task=0)(NEW[0, :2])
    np.testing.assert_allclose(row, sparse.predict(NEW[:1]), rtol=1e-9)
    again = pickle.loads(pickle.dumps(sparse))
    np.testing.assert_array_equal(again.predict(NEW), sparse.predict(NEW))


@pytest.mark.parametrize("per_task", [False, True])
@pytest.mark.parametrize("units", ["shared", "per_task", False])
def test_a_trend_in_y_is_added_to_the_predictions_and_changes_nothing_else(
    per_task, units
):
    X, y = draw()
    few = {"n_inducing": 12, "max_iter": 0}
    start = model(normalize_y=units, trend_per_task=per_task, **few)
    before, after = (clone(start).fit(X, of) for of in (y, y + X[:, :2] @ BETA))
    moved = after.predict(NEW) - before.predict(NEW)
    np.testing.assert_allclose(moved, NEW[:, :2] @ BETA, rtol=1e-8)
    spread = [of.predict(NEW, return_cov=True)[1] for of in (before, after)]
    np.testing.assert_allclose(*spread, rtol=1e-8, atol=1e-8)
    values = [of.log_marginal_likelihood_value_ for of in (before, after)]
    np.testing.assert_allclose(*values, rtol=1e-8)
    change = after.coef_ - before.coef_
    np.testing.assert_allclose(change, np.broadcast_to(BETA, change.shape))


@examples(10)
@given(seeds, st.booleans(), st.sampled_from([1e-6, 7.0, 1e6]))
def test_orders_of_rows_and_units_of_columns_do_not_matter(seed, per_task, unit):
    X, y = draw(seed, n=24)
    few = {"n_inducing": 24, "n_exact": 24, "max_iter": 0}
    fitted = model(trend_per_task=per_task, **few).fit(X, y)
    told = fitted.predict(NEW, return_std=True)
    close = {"rtol": 1e-6, "atol": 1e-6}
    order = np.random.default_rng(seed).permutation(24)
    other = clone(fitted).fit(X[order], y[order])
    np.testing.assert_allclose(other.predict(NEW, return_std=True), told, **close)
    factor = np.array([1.0, unit, 1.0])
    kernel = RBF([1.0, 9.0 * unit], (1e-9, 1e9))
    rescaled = clone(fitted).set_params(kernel=kernel).fit(X * factor, y)
    found = rescaled.predict(NEW * factor, return_std=True)
    np.testing.assert_allclose(found, told, **close)
    np.testing.assert_allclose(rescaled.coef_ * factor[:2], fitted.coef_, **close)


@pytest.mark.parametrize("options", [{}, {"inducing_inputs": "optimised"}])
def test_learning(options):
    X, y = draw(n=300)
    fitted = model([1], n_inducing=25, n_exact=90, **options).fit(X, y)
    assert abs(fitted.coef_[0] - 2.0) < 4.0 * fitted.coef_std_[0]
    assert fitted.coef_std_[0] < 0.5
    at_first = clone(fitted).set_params(max_iter=0).fit(X, y)
    gained = (
        fitted.log_marginal_likelihood_value_ - at_first.log_marginal_likelihood_value_
    )
    assert gained > 50.0
    far = np.array([[3.0, 200.0, 0], [3.0, 200.0, 1]])
    truth = STEPS[[0, 1]] * np.sin(3.0) + [0.0, 2.0] + 400.0
    mean, std = fitted.predict(far, return_std=True)
    assert (np.abs(mean - truth) < 4.0 * std).all()
    gradient = fitted.log_marginal_likelihood(fitted.theta_, eval_gradient=True)[1]
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize("per_task", [False, True])
def test_rows_and_tasks_that_join(per_task):
    X, y = draw()
    options = {"trend_per_task": per_task, "normalize_y": "shared", "max_iter": 0}
    whole, streamed = (model(**options).fit(X, y) for _ in range(2))
    new = X[:6] + [0.3, 0.2, 0.0]
    streamed.partial_fit(new[:4], y[:4]).partial_fit(new[4:], y[4:6])
    anew = whole.partial_fit(new, y[:6])
    close = {"rtol": 1e-7, "atol": 1e-9}
    for name in ("coef_", "coef_std_", "log_marginal_likelihood_value_"):
        found, expected = getattr(streamed, name), getattr(anew, name)
        np.testing.assert_allclose(found, expected, **close)
    np.testing.assert_allclose(streamed.predict(NEW), anew.predict(NEW), **close)
    dense = model(**options | {"inference": "dense"}).fit(X, y)
    joined = [
        of.add_task(JOINING, OF_JOINING) for of in (dense, model(**options).fit(X, y))
    ]
    assert joined[1].coef_.shape == ((4, 2) if per_task else (2,))
    np.testing.assert_allclose(joined[1].coef_, joined[0].coef_, rtol=1e-3)
    means = [of.predict(JOINING) for of in joined]
    np.testing.assert_allclose(*means, rtol=1e-2)


@pytest.mark.parametrize("asked", ["map", "sampled"])
def test_hyperparameters_of_the_posterior(asked):
    X, y = draw(n=24)
    few = {"n_inducing": 12, "n_exact": 24, "max_iter": 20}
    fitted = model(hyperparameters=asked, n_draws=4, **few).fit(X, y)
    assert fitted.hyperparameters_ == asked
    assert abs(fitted.coef_[1] - 2.0) < 4.0 * fitted.coef_std_[1]
    row = np.array([[1.0, 2.0, 0.0]])
    compiled = compile_predictor(fitted, task=0)
    np.testing.assert_allclose(compiled(row[0, :2]), fitted.predict(row), rtol=1e-9)
    assert np.isfinite(fitted.predict(NEW, return_std=True)).all()
    again = fitted.partial_fit(X[:2] + [0.1, 0.1, 0.0], y[:2])
    assert np.isfinite(again.coef_std_).all()


@pytest.mark.parametrize("criterion", ["bic", "loo", "laplace"])
def test_rank_search(criterion):
    X, y = draw()
    options = {"n_inducing": 20, "max_iter": 20}
    search = RankSearchIC(model(**options), ranks=(1, 2), criterion=criterion)
    search.fit(X, y)
    assert search.best_estimator_.coef_.shape == (2,)
    assert np.isfinite(search.predict(NEW)).all()


def test_several_kernels_and_outputs_and_frames():
    X, y = draw()
    frame = pd.DataFrame(X, columns=["east", "north", "metal"])
    kernels = [RBF([2.0, 9.0]), RBF([0.5, 5.0])]
    options = {"rank": [1, 1], "n_inducing": 15, "max_iter": 3, "learning": "annealed"}
    fitted = model(["north"], kernels, **options).fit(frame, np.c_[y, -2.0 * y])
    assert fitted.coef_.shape == (2, 1)
    np.testing.assert_allclose(fitted.coef_[1], -2.0 * fitted.coef_[0], rtol=0.2)
    terms = fitted.predict_terms(frame)
    predicted = fitted.predict(frame)
    np.testing.assert_allclose(terms.sum(axis=2), predicted, rtol=1e-9, atol=1e-9)


def test_the_other_models():
    X, y = draw()
    independent = IndependentGP(trend=[1], trend_per_task=True, **SPARSE).fit(X, y)
    assert independent.coef_.shape == (3, 1)
    pooled = PooledGP(trend=[1], **SPARSE).fit(X, y)
    assert abs(pooled.coef_[0] - 2.0) < 1.0
    far = np.array([[1.0, 100.0, 9.0]])  # a task that was never seen
    np.testing.assert_allclose(pooled.predict(far), 200.0, atol=60.0)


def test_tasks_that_were_never_seen():
    X, y = draw()
    new = np.array([[1.0, 100.0, 9.0]])
    shared = model(shared=True, normalize_y="shared", max_iter=20).fit(X, y)
    assert abs(shared.predict(new)[0] - 200.0) < 60.0
    own = clone(shared).set_params(trend_per_task=True).fit(X, y)
    with pytest.raises(ValueError, match="trend_per_task=True a task needs rows"):
        own.predict(new)


def test_rows_that_do_not_tell_the_trend():
    X, y = draw()
    X = np.column_stack([X[:, 0], 3.0 * X[:, 0] - 1.0, np.ones(N), X])
    for inference in ("dense", "sparse"):
        with pytest.raises(ValueError, match=r"trend's 'x.' is a linear combination"):
            model((0, 1, 2), RBF(), inference=inference).fit(X, y)


def test_rows_that_lie_in_partitions_are_refused():
    da = pytest.importorskip("dask.array")
    X, y = draw()
    with pytest.raises(ValueError, match=r"trend needs the rows in memory.*-mapped"):
        model().fit(da.from_array(X), da.from_array(y))


@pytest.mark.parametrize("per_task", [False, True])
def test_rows_on_disk(tmp_path, per_task):
    X, y = draw(n=400)
    np.save(tmp_path / "X.npy", X)
    mapped = np.load(tmp_path / "X.npy", mmap_mode="r")
    start = model(trend_per_task=per_task, n_inducing=10, max_iter=0)
    found, expected = clone(start).fit(mapped, y), start.fit(X, y)
    assert np.shares_memory(found.X_train_, mapped)
    np.testing.assert_allclose(found.coef_, expected.coef_, rtol=1e-12)
    told = [of.predict(NEW, return_std=True) for of in (found, expected)]
    np.testing.assert_allclose(*told, rtol=1e-10)


def test_many_tasks_with_trends_of_their_own():
    n_tasks, n, rng = 40, 800, np.random.default_rng(0)
    F, tasks = rng.uniform(0, 6, (n, 2)), np.arange(n) % n_tasks
    slopes = rng.standard_normal(n_tasks)
    y = np.sin(F[:, 0]) * (tasks % 3 - 1) + slopes[tasks] * F[:, 1]
    y += 0.1 * rng.standard_normal(n)
    options = {"n_inducing": 30, "n_exact": 200, "max_iter": 10}
    fitted = model([1], trend_per_task=True, **options)
    fitted.fit(np.column_stack([F, tasks]), y)
    error = fitted.coef_[:, 0] - slopes
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.mean(np.abs(error) < 2.0 * fitted.coef_std_[:, 0]) > 0.85


def test_skops(tmp_path):
    io = pytest.importorskip("skops.io")
    X, y = draw()
    fitted, file = model("linear", max_iter=0).fit(X, y), tmp_path / "a.skops"
    io.dump(fitted, file)
    found = io.get_untrusted_types(file=file)
    own = {"restricted.Columns", "flat.Coefficients", "sparse.SparseBound"}
    assert {f"skmtgp.inference.{name}" for name in own} <= set(found)
    again = io.load(file, trusted=found)
    told = [of.predict(NEW, return_std=True) for of in (again, fitted)]
    np.testing.assert_array_equal(*told)
