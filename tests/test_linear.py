"""Bayesian linear regression against explicit matrices and scipy's distributions."""

import pickle
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest
import textbook
from linear_models import POOLED, TARGETS, X, Y, Z, design, regressions, y
from samples import split
from scipy.stats import multivariate_t, t
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression

from skmtgp import BayesianLinearRegression, inference

PRIOR = {"weight_variance": 3.0, "noise_shape": 1.5, "noise_rate": 50.0}
INTERCEPT = pytest.mark.parametrize("fit_intercept", [False, True])


def by_the_book(D, y, *, weight_variance=1e8, noise_shape=1.0, noise_rate=1.0):
    """Mean and V_n of the weights, a_n and b_n."""
    precision = D.T @ D + np.eye(D.shape[1]) / weight_variance
    V = np.linalg.inv(precision)
    mean = V @ D.T @ y
    a = noise_shape + 0.5 * len(y)
    return mean, V, a, noise_rate + 0.5 * (y @ y - mean @ precision @ mean)


def of_output(values, j, target):
    """That of one of the outputs, where these come first."""
    return values if target.ndim == 1 else values[j]


@POOLED
@INTERCEPT
@TARGETS
def test_attributes_are_the_textbooks(target, fit_intercept, pooled):
    model = BayesianLinearRegression(
        pooled=pooled, fit_intercept=fit_intercept, **PRIOR
    ).fit(X, target)
    D = design(split(X)[0], fit_intercept)
    for j, u in enumerate(target.reshape(len(X), -1).T):
        coef, intercept, noise = (
            of_output(values, j, target)
            for values in (model.coef_, model.intercept_, model.noise_variance_)
        )
        assert (coef.shape, intercept.shape, noise.shape) == ((3, 2), (3,), (3,))
        for m in range(3):
            rows = regressions(X, pooled)[0 if pooled else m]
            mean, _, a, b = by_the_book(D[rows], u[rows], **PRIOR)
            np.testing.assert_allclose(coef[m], mean[:2], rtol=1e-10)
            constant = mean[2] if fit_intercept else 0.0
            assert intercept[m] == pytest.approx(constant, rel=1e-10)
            assert noise[m] == pytest.approx(b / (a - 1.0), rel=1e-10)
            assert model.degrees_of_freedom_[m] == pytest.approx(2.0 * a)
    assert model.degrees_of_freedom_.shape == (3,)


@POOLED
@INTERCEPT
@TARGETS
@pytest.mark.parametrize("noisy", [False, True])
def test_predictions_are_the_textbooks(target, fit_intercept, pooled, noisy):
    model = BayesianLinearRegression(
        pooled=pooled, fit_intercept=fit_intercept, **PRIOR
    ).fit(X, target)
    found, std = model.predict(Z, return_std=True, include_noise=noisy)
    cov = model.predict(Z, return_cov=True, include_noise=noisy)[1]
    assert found.shape == std.shape == (len(Z), *target.shape[1:])
    assert cov.shape == (len(Z), *found.shape)
    D, D_star = (design(split(A)[0], fit_intercept) for A in (X, Z))
    for j, u in enumerate(target.reshape(len(X), -1).T):
        expected, expected_cov = np.zeros(len(Z)), np.zeros((len(Z), len(Z)))
        scale, freedom = np.zeros(len(Z)), np.zeros(len(Z))
        pairs = zip(regressions(X, pooled), regressions(Z, pooled), strict=True)
        for own, rows in pairs:
            mean, V, a, b = by_the_book(D[own], u[own], **PRIOR)
            relative = D_star[rows] @ V @ D_star[rows].T + noisy * np.eye(rows.sum())
            expected[rows] = D_star[rows] @ mean
            scale[rows], freedom[rows] = np.sqrt(b / a * np.diag(relative)), 2.0 * a
            expected_cov[np.ix_(rows, rows)] = b / (a - 1.0) * relative
        j = (..., j) if target.ndim == 2 else ...
        np.testing.assert_allclose(found[j], expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(std[j], t(freedom, 0.0, scale).std(), rtol=1e-9)
        close = {"rtol": 1e-9, "atol": 1e-9 * expected_cov.max()}
        np.testing.assert_allclose(cov[j], expected_cov, **close)


@POOLED
@INTERCEPT
@TARGETS
def test_evidence_is_a_student_t_density(target, fit_intercept, pooled):
    model = BayesianLinearRegression(
        pooled=pooled, fit_intercept=fit_intercept, **PRIOR
    ).fit(X, target)
    D = design(split(X)[0], fit_intercept)
    expected = np.zeros(target.size // len(X))
    for rows in regressions(X, pooled):
        relative = np.eye(rows.sum()) + 3.0 * D[rows] @ D[rows].T
        density = multivariate_t(shape=50.0 / 1.5 * relative, df=3.0)
        expected += density.logpdf(target[rows].reshape(rows.sum(), -1).T)
    np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-10)
    value = model.log_marginal_likelihood_value_
    assert value == pytest.approx(expected.sum(), rel=1e-10)


def test_broad_prior_of_the_paper_is_the_default():
    model, D = BayesianLinearRegression().fit(X, y), design(split(X)[0])
    value = 0.0
    for m, rows in enumerate(regressions(X, False)):
        mean, _, a, b = by_the_book(D[rows], y[rows])
        np.testing.assert_allclose(model.coef_[m], mean[:2], rtol=1e-7)
        assert model.noise_variance_[m] == pytest.approx(b / (a - 1.0), rel=1e-7)
        relative = np.eye(rows.sum()) + 1e8 * D[rows] @ D[rows].T
        value += multivariate_t(shape=relative, df=2.0).logpdf(y[rows])
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-6)


@POOLED
def test_mean_does_not_depend_on_the_prior_of_the_noise(pooled):
    model = BayesianLinearRegression(pooled=pooled).fit(X, Y)
    other = clone(model).set_params(noise_shape=7.0, noise_rate=1e6).fit(X, Y)
    np.testing.assert_array_equal(other.predict(Z), model.predict(Z))
    assert (other.noise_variance_ > 2.0 * model.noise_variance_).all()


@POOLED
@INTERCEPT
@pytest.mark.parametrize(("weight_variance", "rtol"), [(1e8, 1e-6), (1e14, 1e-10)])
def test_mean_with_a_broad_prior_is_least_squares(
    weight_variance, rtol, fit_intercept, pooled
):
    model = BayesianLinearRegression(
        pooled=pooled, fit_intercept=fit_intercept, weight_variance=weight_variance
    ).fit(X, Y)
    found = model.predict(Z)
    pairs = zip(regressions(X, pooled), regressions(Z, pooled), strict=True)
    for own, rows in pairs:
        reference = LinearRegression(fit_intercept=fit_intercept)
        reference.fit(split(X)[0][own], Y[own])
        expected = reference.predict(split(Z)[0][rows])
        np.testing.assert_allclose(found[rows], expected, rtol=rtol)


def test_pooled_is_one_task():
    pooled = BayesianLinearRegression(pooled=True).fit(X, Y)
    alone = BayesianLinearRegression().fit(X * [1.0, 1.0, 0.0], Y)
    found = pooled.predict(Z, return_cov=True)
    expected = alone.predict(Z * [1.0, 1.0, 0.0], return_cov=True)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(pooled.coef_, np.repeat(alone.coef_, 3, axis=1))
    value = alone.log_marginal_likelihood_value_
    assert pooled.log_marginal_likelihood_value_ == value


def test_coefficients_predict():
    model = BayesianLinearRegression().fit(X, Y)
    z, tasks = split(Z)
    expected = np.einsum("jnd,nd->nj", model.coef_[:, tasks], z)
    expected += model.intercept_[:, tasks].T
    np.testing.assert_allclose(model.predict(Z), expected, rtol=1e-12, atol=1e-12)


@INTERCEPT
@pytest.mark.parametrize("block", [1, 2**20])
def test_many_tasks_are_those_of_each_alone(monkeypatch, fit_intercept, block):
    """Decomposed together where they have equally many rows."""
    rng, counts = np.random.default_rng(0), np.arange(105) % 7 + 1
    tasks = rng.permutation(np.arange(105).repeat(counts))
    x = 3.0 + rng.normal(size=(len(tasks), 2))
    table, u = np.column_stack([x, tasks]), rng.normal(size=(len(tasks), 2))
    made, qr = [], np.linalg.qr
    monkeypatch.setattr(np.linalg, "qr", lambda *a, **k: made.append(1) or qr(*a, **k))
    monkeypatch.setattr(inference.linear, "BLOCK_SIZE", block)
    model = BayesianLinearRegression(fit_intercept=fit_intercept, **PRIOR)
    model.fit(table, u)
    assert len(made) == (7 if block > 1 else 105)
    new = np.column_stack([rng.normal(size=(40, 2)), rng.integers(0, 20, 40)])
    mean, std = model.predict(new, return_std=True)
    cov, draws = model.predict(new, return_cov=True)[1], model.sample_y(new, 3)
    evidence, close = 0.0, {"rtol": 1e-11, "atol": 1e-11}
    for task in range(20):
        own, rows = tasks == task, new[:, -1] == task
        alone = clone(model).fit(table[own], u[own])
        for name in ("coef_", "intercept_", "noise_variance_"):
            values = getattr(model, name)[:, task], getattr(alone, name)[:, 0]
            np.testing.assert_allclose(*values, **close)
        if rows.any():
            found = alone.predict(new[rows], return_std=True)
            np.testing.assert_allclose(found, (mean[rows], std[rows]), **close)
            block = cov[np.ix_(rows, rows)]
            expected = alone.predict(new[rows], return_cov=True)[1]
            np.testing.assert_allclose(block, expected, **close)
            np.testing.assert_array_equal(cov[np.ix_(rows, ~rows)], 0.0)
    for task in range(105):
        own = tasks == task
        evidence += clone(model).fit(table[own], u[own]).log_marginal_likelihoods_
    np.testing.assert_allclose(model.log_marginal_likelihoods_, evidence, rtol=1e-11)
    assert draws.shape == (40, 2, 3)


def test_outputs_are_independent():
    both = BayesianLinearRegression().fit(X, Y)
    mean, std = both.predict(Z, return_std=True)
    for j in range(2):
        alone = BayesianLinearRegression().fit(X, Y[:, j])
        found = alone.predict(Z, return_std=True)
        np.testing.assert_allclose(found, (mean[:, j], std[:, j]), rtol=1e-12)
        value = alone.log_marginal_likelihood_value_
        assert both.log_marginal_likelihoods_[j] == pytest.approx(value, rel=1e-12)
    column = BayesianLinearRegression().fit(X, y[:, None])
    assert column.predict(Z).shape == (12, 1)
    assert column.coef_.shape == (1, 3, 2)
    assert column.sample_y(Z, 5).shape == (12, 1, 5)


def test_features_far_from_zero():
    rng = np.random.default_rng(0)
    far = 1e6 * np.array([1.0, -3.0]) + rng.normal(size=(30, 2))
    u = far[:, 0] - 1e6 + 0.1 * rng.normal(size=30)
    table = np.column_stack([far, np.zeros(30)])
    model = BayesianLinearRegression().fit(table, u)
    D = [decimals(row) for row in design(far)]
    columns = list(zip(*D, strict=True))
    K = [[dot(a, b) for b in columns] for a in columns]
    for i in range(3):
        K[i][i] += Decimal(10) ** -8
    beta, _ = textbook.exact_solve(K, [dot(a, decimals(u)) for a in columns])
    expected = [float(dot(row, beta)) for row in D]
    np.testing.assert_allclose(model.predict(table), expected, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(model.coef_[0], [float(b) for b in beta[:2]], rtol=1e-12)


def decimals(values):
    return [Decimal(value) for value in values.tolist()]


def dot(a, b):
    return sum(u * v for u, v in zip(a, b, strict=True))


def with_tasks(features, n_tasks=1):
    return np.column_stack([features, np.arange(len(features)) % n_tasks])


def difficult():
    """Covariates that least squares does not tell apart, and more than samples."""
    rng = np.random.default_rng(0)
    a = rng.normal(size=(20, 2))
    return {
        "twice the same": a[:, [0, 0, 1]],
        "sum": np.column_stack([a, a.sum(axis=1)]),
        "constant": np.column_stack([a, np.full(20, 5.0)]),
        "zero": np.column_stack([a, np.zeros(20)]),
        "more covariates than samples": rng.normal(size=(4, 9)),
    }


@INTERCEPT
@pytest.mark.parametrize("features", difficult().values(), ids=difficult())
def test_covariates_that_are_collinear(features, fit_intercept):
    rng = np.random.default_rng(1)
    u = features[:, 0] + 0.1 * rng.normal(size=len(features))
    T, D = with_tasks(features), design(features, fit_intercept)
    model = BayesianLinearRegression(fit_intercept=fit_intercept)
    found = clone(model).set_params(**PRIOR).fit(T, u).predict(T, return_cov=True)
    mean, V, a, b = by_the_book(D, u, **PRIOR)
    np.testing.assert_allclose(found[0], D @ mean, rtol=1e-10)
    np.testing.assert_allclose(found[1], D @ V @ D.T * b / (a - 1.0), atol=1e-9)
    model.fit(T, u)
    weights = np.linalg.pinv(D) @ u  # the smallest ones, which a broad prior prefers
    np.testing.assert_allclose(model.coef_[0], weights[: features.shape[1]], atol=1e-5)
    np.testing.assert_allclose(model.predict(T), D @ weights, atol=1e-6)
    new = rng.normal(size=(5, features.shape[1]))
    unseen = model.predict(with_tasks(new), return_std=True)[1]
    unknown = np.linalg.matrix_rank(D) < D.shape[1]  # some direction
    assert ((unseen > 100.0) == unknown).all()


def test_prior_that_is_flat_beyond_the_digits():
    features = difficult()["twice the same"] * [1.0, 1.0, 1e9]
    u = 3.0 + features @ [1.0, 1.0, -1e-9]
    model = BayesianLinearRegression(weight_variance=1e60).fit(with_tasks(features), u)
    np.testing.assert_allclose(model.predict(with_tasks(features)), u, rtol=1e-6)
    assert model.coef_[0, :2].sum() == pytest.approx(2.0, rel=1e-6)
    assert (model.coef_[0, :2] > 0.5).all()  # and not large ones that cancel
    assert np.isfinite(model.log_marginal_likelihood_value_)


def test_one_row_of_each_task():
    one, u = X[[0]] * [1.0, 1.0, 0.0] + [[0.0, 0.0, m] for m in range(3)], y[:3]
    model = BayesianLinearRegression().fit(one, u)
    mean, std = model.predict(one, return_std=True)
    np.testing.assert_allclose(mean, u, rtol=1e-6)
    np.testing.assert_array_equal(model.degrees_of_freedom_, [3.0, 3.0, 3.0])
    np.testing.assert_allclose(model.noise_variance_, 2.0, rtol=1e-3)
    np.testing.assert_allclose(std, np.sqrt(2.0), rtol=1e-3)
    assert (model.predict(one + [1.0, 1.0, 0.0], return_std=True)[1] > 1e3).all()


def test_zero_without_a_constant_is_certain():
    model = BayesianLinearRegression(fit_intercept=False, noise_shape=0.5)
    origin = [[0.0, 0.0, 0.0]]
    for rows in (X[:, -1] == 0, np.flatnonzero(X[:, -1] == 0)[:1]):
        model.fit(X[rows], Y[rows])
        for spread in ("return_std", "return_cov"):
            mean, certain = model.predict(origin, **{spread: True})
            assert (mean == 0.0).all()
            assert (certain == 0.0).all()


def test_pickle():
    model = BayesianLinearRegression(pooled=True).fit(X, Y)
    again = pickle.loads(pickle.dumps(model))
    found, expected = (m.predict(Z, return_cov=True) for m in (again, model))
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(again.sample_y(Z), model.sample_y(Z))


def frame(X, names=("c", "a", "b")):
    table = pd.DataFrame(X[:, :2], columns=["u", "v"])
    table.insert(1, "load", np.array(names)[split(X)[1]])
    return table


@pytest.mark.parametrize("task_feature", ["load", 1, -2])
def test_frames_with_named_tasks(task_feature):
    model = BayesianLinearRegression(task_feature=task_feature).fit(frame(X), y)
    assert model.tasks_.tolist() == ["a", "b", "c"]
    assert model.feature_names_in_.tolist() == ["u", "load", "v"]
    assert model.n_features_in_ == 3
    numbered = BayesianLinearRegression().fit(X, y)
    np.testing.assert_allclose(model.coef_, numbered.coef_[[1, 2, 0]])
    np.testing.assert_allclose(model.predict(frame(Z)), numbered.predict(Z))


def test_parameters_may_change_after_fit():
    model = BayesianLinearRegression().fit(X, y)
    before = model.predict(Z, return_cov=True)
    model.set_params(pooled=True, fit_intercept=False, noise_shape=9.0)
    for a, b in zip(model.predict(Z, return_cov=True), before, strict=True):
        np.testing.assert_array_equal(a, b)


BAD_PARAMETERS = {
    "pooled": ({"pooled": "yes"}, ValueError, "'pooled' .* must be"),
    "constant": ({"fit_intercept": None}, ValueError, "'fit_intercept' .* must be"),
    "variance": ({"weight_variance": 0.0}, ValueError, r"range \(0.0, inf\)"),
    "flat": ({"weight_variance": np.inf}, ValueError, r"range \(0.0, inf\)"),
    "shape": ({"noise_shape": 0.0}, ValueError, r"'noise_shape' .* \(0.0, inf\)"),
    "rate": ({"noise_rate": -1.0}, ValueError, r"'noise_rate' .* \(0.0, inf\)"),
    "fraction": ({"task_feature": 1.0}, ValueError, "'task_feature' .* must be"),
    "position": ({"task_feature": 3}, ValueError, "3 is out of range: X has 3 columns"),
    "name": ({"task_feature": "load"}, ValueError, "but X has no column names"),
    "truth": ({"task_feature": True}, TypeError, r"True must be the position \(int\)"),
}


@pytest.mark.parametrize(
    ("params", "error", "match"), BAD_PARAMETERS.values(), ids=BAD_PARAMETERS
)
def test_bad_parameters(params, error, match):
    with pytest.raises(error, match=match):
        BayesianLinearRegression(**params).fit(X, y)


BAD_DATA = {
    "NaN feature": (np.where(X[0, 0] == X, np.nan, X), y, "Input X contains NaN"),
    "fractional labels": (X[:, ::-1], y, "30 of 30 are fractional"),
    "no target": (X, None, "requires y to be passed, but the target y is None"),
    "NaN target": (X, np.full(30, np.nan), "Input y contains NaN"),
    "short target": (X, y[:-1], r"inconsistent numbers of samples: \[30, 29\]"),
}


@pytest.mark.parametrize(("table", "target", "match"), BAD_DATA.values(), ids=BAD_DATA)
def test_failed_fit_changes_nothing(table, target, match):
    model = BayesianLinearRegression().fit(frame(X)[["u", "v", "load"]], y)
    before = dict(vars(model))
    with pytest.raises(ValueError, match=match):
        model.fit(table, target)
    assert vars(model).keys() == before.keys()
    assert all(vars(model)[name] is value for name, value in before.items())


@POOLED
@pytest.mark.parametrize("method", ["predict", "sample_y"])
def test_new_data_are_checked(method, pooled):
    model = BayesianLinearRegression(pooled=pooled)
    with pytest.raises(NotFittedError):
        getattr(model, method)(Z)
    model.fit(X, y)
    with pytest.raises(ValueError, match="Unknown tasks 3, 4: the model knows 0, 1, 2"):
        getattr(model, method)(Z[[0, 0]] * [1, 1, 0] + [[0, 0, 4], [0, 0, 3]])
    with pytest.raises(ValueError, match=r"X has 4 features, but .* expecting 3"):
        getattr(model, method)(np.insert(Z, 0, 1.0, axis=1))
