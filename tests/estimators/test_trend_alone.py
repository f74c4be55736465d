"""A trend of tasks alone: universal kriging of each, names, refusals, other tools."""

import pickle

import numpy as np
import pandas as pd
import pytest
import textbook
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sklearn.preprocessing import PolynomialFeatures, SplineTransformer

from skmtgp import PooledGP, SingleTaskGP
from skmtgp.predictor import compile_predictor

SLOPES = np.array([3.0, -2.0])
KERNEL = ConstantKernel(1.0, (1e-3, 1e3)) * RBF([1.0, 9.0])
Z = np.array([[1.0, 2.0, 0], [5.0, 30.0, 1], [-3.0, 4.0, 1], [2.0, 2.0, 0]])


def draw(seed=0, n=40):
    """Rows of two tasks of two features, whose trend is along the second."""
    rng = np.random.default_rng(seed)
    F, tasks = rng.uniform(0, 6, (n, 2)), np.arange(n) % 2
    y = np.sin(F[:, 0]) + 5.0 * tasks + SLOPES[tasks] * F[:, 1]
    return np.column_stack([F, tasks]), y + 0.1 * rng.standard_normal(n)


def model(trend=(1,), **options):
    trend = list(trend) if isinstance(trend, tuple) else trend
    return SingleTaskGP(KERNEL, trend=trend, **options)


def frame(X, labels=("north", "south")):
    table = pd.DataFrame(X[:, :2], columns=["hour", "height"])
    return table.assign(site=np.array(labels)[X[:, 2].astype(int)])


@pytest.mark.parametrize("centred", [True, False])
@pytest.mark.parametrize("trend", [(0, 1), "constant", "linear"])
def test_each_task_is_kriged_by_the_book(trend, centred):
    X, y = draw()
    fitted = model(trend, normalize_y=centred, max_iter=0).fit(X, y)
    expected = 0.0
    for m, alone in enumerate(fitted.estimators_):
        F, G = X[X[:, 2] == m, :2], Z[Z[:, 2] == m, :2]
        ones = not isinstance(trend, tuple)
        H, H_star = ([np.ones(len(of))] * ones + [*of.T] for of in (F, G))
        H, H_star = np.transpose(H), np.transpose(H_star)
        if trend == "constant":
            H, H_star = H[:, :1], H_star[:, :1]
        target, centre = y[X[:, 2] == m], 0.0
        if centred and not ones:
            centre = target.mean()
            H, H_star = H - H.mean(axis=0), H_star - H.mean(axis=0)
        k, scale = alone.kernel_, alone.task_covariance_.item()
        K = scale * k(F) + alone.noise_variance_ * np.eye(len(F))
        mean, spread, beta, of_beta = textbook.universal_kriging(
            K, H, target - centre, scale * k(F, G), H_star, scale * k(G)
        )
        rows = Z[:, 2] == m
        found = fitted.predict(Z[rows], return_cov=True)
        np.testing.assert_allclose(found[0], mean + centre, rtol=1e-6)
        np.testing.assert_allclose(found[1], spread, rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose(fitted.coef_[m], beta, rtol=1e-6)
        deviation = np.sqrt(np.diagonal(of_beta))
        np.testing.assert_allclose(fitted.coef_std_[m], deviation, rtol=1e-6)
        expected += textbook.restricted_likelihood(K, H, target - centre)
    value = fitted.log_marginal_likelihood_value_
    np.testing.assert_allclose(value, expected, rtol=1e-7)


def test_it_is_a_pooled_model_of_each_task():
    X, y = draw()
    Y = np.column_stack([y, -2.0 * y])
    fitted = model().fit(X, Y)
    assert fitted.coef_.shape == fitted.coef_std_.shape == (2, 2, 1)
    assert fitted.trend_mean_.shape == (2, 1)
    for m in range(2):
        rows = X[:, 2] == m
        alone = PooledGP(KERNEL, trend=[1], noise="shared").fit(X[rows], Y[rows])
        np.testing.assert_allclose(fitted.coef_[:, m], alone.coef_, rtol=1e-6)
        np.testing.assert_allclose(fitted.trend_mean_[m], alone.trend_mean_)
        of_task = Z[Z[:, 2] == m]
        found = fitted.predict(of_task, return_std=True)
        for one, other in zip(
            found, alone.predict(of_task, return_std=True), strict=True
        ):
            np.testing.assert_allclose(one, other, rtol=1e-6)
    assert np.abs(fitted.coef_[0, :, 0] - SLOPES).max() < 0.5


def test_columns_by_name_and_transformers_of_frames():
    X, y = draw()
    named = model(["height"], task_feature="site").fit(frame(X), y)
    assert named.trend_names_.tolist() == ["height"]
    np.testing.assert_allclose(named.predict(frame(Z)), model().fit(X, y).predict(Z))
    first = frame(X)[["site", "hour", "height"]]  # positions count the task column
    moved = model((2,), task_feature=0).fit(first, y)
    np.testing.assert_array_equal(moved.coef_, named.coef_)
    quadratic = model(PolynomialFeatures(2, include_bias=False), task_feature="site")
    names = quadratic.fit(frame(X), y).trend_names_.tolist()
    assert names == ["hour", "height", "hour^2", "hour height", "height^2"]
    assert quadratic.predict(frame(Z)).shape == (4,)


def test_a_transformer_is_fitted_to_the_rows_of_all_tasks():
    """Its columns are then the same functions of x in every task."""
    X, y = draw()
    X[X[:, 2] == 1, 1] += 6.0  # the tasks do not overlap
    spline = SplineTransformer(3, degree=1, include_bias=False)
    trend = clone(spline).fit(X[:, :2]).transform(X[:, :2])
    fitted = model(spline).fit(X, y)
    columns = fitted.estimators_[0].trend.columns(X[:, :2])
    np.testing.assert_array_equal(columns, trend)
    assert not hasattr(spline, "bsplines_")


def test_what_the_other_models_do_with_a_trend():
    X, y = draw()
    fitted = model("linear", inference="sparse", n_inducing=12, tol=1.0).fit(X, y)
    assert np.abs(fitted.coef_[:, 2] - SLOPES).max() < 0.5
    compiled = compile_predictor(fitted, task=1)
    np.testing.assert_allclose(compiled(Z[1, :2]), fitted.predict(Z[[1]]), rtol=1e-9)
    again = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(again.predict(Z), fitted.predict(Z))
    forgotten = clone(fitted).fit(X, y).set_params(trend=None, inference="auto")
    assert not hasattr(forgotten.fit(X, y), "coef_")


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")  # short chains
def test_noise_that_is_known_draws_and_transformed_targets():
    X, y = draw()
    known = model(max_iter=20).fit(X, y, alpha=np.full(40, 0.01))
    assert np.abs(known.coef_[:, 0] - SLOPES).max() < 0.5
    drawn = model(hyperparameters="sampled", n_draws=12).fit(X, y)
    parts = drawn.estimators_[1]._predictive[0].parts
    coefficients = [of.coefficients_in_units()[0][0] for of in parts]
    np.testing.assert_allclose(drawn.coef_[1], np.mean(coefficients, axis=0))
    logs = model(target_transform=(np.log, np.exp)).fit(X, np.exp(y / 10.0))
    assert np.abs(logs.coef_[:, 0] - SLOPES / 10.0).max() < 0.05


REFUSED = {
    "the task": ({"trend": [0, 2]}, r"trend=\[0, 2\] has the task column, 2: a label"),
    "kronecker": ({"inference": "kronecker"}, "'kronecker' takes no trend, and trend"),
    "a word": ({"trend": "quadratic"}, "'trend' parameter .*PolynomialFeatures"),
    "many": (
        {"trend": PolynomialFeatures(6)},
        r"n_samples=20 of task 0 is too few for the 28 .* or leave the task out\.",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case):
    options, message = REFUSED[case]
    X, y = draw()
    with pytest.raises(ValueError, match=message):
        model(**options).fit(X, y)


def test_tasks_that_do_not_tell_their_trend_are_named():
    X, y = draw()
    few = (X[:, 2] == 0) | (np.arange(40) < 3)
    with pytest.raises(ValueError, match="n_samples=1 of task 'south' is too few"):
        model(["hour", "height"], task_feature="site").fit(frame(X[few]), y[few])
    two = (X[:, 2] == 0) | (np.arange(40) < 4)
    with pytest.raises(ValueError, match="n_samples=2 of task 1 and 2 coefficients"):
        model((0, 1)).fit(X[two], y[two])
    X[X[:, 2] == 1, 1] = 2.0
    with pytest.raises(ValueError, match=r"of task 1 .* or leave the task out"):
        model("linear").fit(X, y)


def test_skops():
    io = pytest.importorskip("skops.io")
    X, y = draw()
    fitted = model("linear", max_iter=0).fit(X, y)
    data = io.dumps(fitted)
    found = io.get_untrusted_types(data=data)
    assert "skmtgp._data.trend.ReadTrend" in found
    again = io.loads(data, trusted=found)
    np.testing.assert_array_equal(again.predict(Z), fitted.predict(Z))
    np.testing.assert_array_equal(again.coef_, fitted.coef_)
