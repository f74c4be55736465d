"""A trend with flat coefficients in dense inference, by the book and by its limit."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import textbook
from pairs import in_pairs
from trend_models import (
    NEW,
    OF_NEW,
    TERMS,
    M,
    by_hand,
    columns,
    draw,
    make,
    make_trend,
)

from skmtgp._data.data import Data
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.engines import Dense

every_model = in_pairs(
    terms=TERMS,
    per_task={"shared": False, "own": True},
    n_noise={"one noise": 1, "noise per task": M},
    levels={"levels": True, "no levels": False},
    units={"units": np.array([0.5, 2.0, 30.0]), "shared units": np.array([3.0])},
)


def covariances(likelihood, theta, X=NEW, tasks=OF_NEW):
    """cov(y), cov(y, f) and cov(f) without a trend."""
    prior, rows = likelihood.prior, (likelihood.X, likelihood.tasks)
    both = np.vstack([rows[0], X]), np.append(rows[1], tasks)
    K = prior.covariance(theta, *both)
    n = len(rows[0])
    noise = prior.values(theta).noise[likelihood.noise_of_row]
    return K[:n, :n] + np.diag(noise), K[:n, n:], K[n:, n:]


@every_model
def test_value_and_gradient(terms, per_task, n_noise, levels, units):
    trend = make_trend(per_task, units)
    likelihood, theta = make(terms, n_noise, levels, trend)
    H = by_hand(trend, likelihood.X, likelihood.tasks)

    def value(t):
        K = covariances(likelihood, t)[0]
        return textbook.restricted_likelihood(K, H, likelihood.y)

    found, gradient = likelihood.value_and_grad(theta)
    assert abs(found - value(theta)) < 1e-8
    assert likelihood.value(theta) == found
    expected = textbook.derivative(value, theta)
    np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-7)


@every_model
def test_posterior(terms, per_task, n_noise, levels, units):
    trend = make_trend(per_task, units)
    likelihood, theta = make(terms, n_noise, levels, trend)
    posterior = likelihood.posterior(theta)
    K, K_star, prior = covariances(likelihood, theta)
    H = by_hand(trend, likelihood.X, likelihood.tasks)
    H_star = by_hand(trend, NEW, OF_NEW)
    mean, spread, beta, of_beta = textbook.universal_kriging(
        K, H, likelihood.y, K_star, H_star, prior
    )
    close = {"rtol": 1e-8, "atol": 1e-8}
    np.testing.assert_allclose(posterior.mean(NEW, OF_NEW), mean, **close)
    np.testing.assert_allclose(posterior.covariance(NEW, OF_NEW), spread, **close)
    variance = posterior.variance(NEW, OF_NEW)
    np.testing.assert_allclose(variance, np.diagonal(spread), **close)
    found, deviation = posterior.coefficients_in_units()
    np.testing.assert_allclose(found.ravel(), beta, **close)
    np.testing.assert_allclose(deviation.ravel() ** 2, np.diagonal(of_beta), **close)
    assert posterior.log_likelihood == likelihood.value(theta)
    parts = posterior.means_of_terms(NEW, OF_NEW)
    np.testing.assert_allclose(parts.sum(axis=0), mean, **close)
    np.testing.assert_allclose(parts[-2], H_star @ beta, **close)
    np.testing.assert_allclose(parts[-1], posterior.levels[OF_NEW], **close)


@every_model
def test_leave_one_out(terms, per_task, n_noise, levels, units):
    trend = make_trend(per_task, units)
    likelihood, theta = make(terms, n_noise, levels, trend)
    residual, variance = likelihood.posterior(theta).leave_one_out(include_noise=True)
    X, tasks, y = likelihood.X, likelihood.tasks, likelihood.y
    H = by_hand(trend, X, tasks)
    K, _, _ = covariances(likelihood, theta)
    for i in range(0, len(y), 5):
        rest = np.delete(np.arange(len(y)), i)
        mean, spread, *_ = textbook.universal_kriging(
            K[np.ix_(rest, rest)],
            H[rest],
            y[rest],
            K[rest][:, [i]],
            H[[i]],
            K[i, i],
        )
        np.testing.assert_allclose(y[i] - residual[i], mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(variance[i], spread, rtol=1e-8)


@pytest.mark.parametrize("per_task", [False, True])
def test_levels(per_task):
    trend = make_trend(per_task)
    likelihood, theta = make(TERMS["one"], M, True, trend)
    posterior = likelihood.posterior(theta)
    K, _, _ = covariances(likelihood, theta)
    H = by_hand(trend, likelihood.X, likelihood.tasks)
    of_tasks = np.equal.outer(likelihood.tasks, np.arange(M)) * posterior.level
    prior = posterior.level * np.eye(M)
    nothing = np.zeros((M, H.shape[1]))
    given = K, H, likelihood.y, of_tasks, nothing, prior
    mean, spread, *_ = textbook.universal_kriging(*given)
    np.testing.assert_allclose(posterior.levels, mean, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(posterior.level_variances(), np.diagonal(spread))


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_the_limit_of_a_wide_prior(terms):
    # ordinary inference with 1e7 of variance along each column, and what that costs
    trend = make_trend(of=lambda X: X)
    likelihood, theta = make(terms, M, True, trend)
    theta[-M:] = np.log(0.5)  # of coefficients of the size of 1
    H = by_hand(trend, likelihood.X, likelihood.tasks)
    H_star = by_hand(trend, NEW, OF_NEW)
    K, K_star, prior = covariances(likelihood, theta)
    wide = 1e7
    K, K_star = K + wide * H @ H.T, K_star + wide * H @ H_star.T
    prior = prior + wide * H_star @ H_star.T
    y, solved = likelihood.y, np.linalg.solve(K, K_star)
    posterior = likelihood.posterior(theta)
    mean, covariance = solved.T @ y, prior - K_star.T @ solved
    np.testing.assert_allclose(posterior.mean(NEW, OF_NEW), mean, rtol=1e-5)
    np.testing.assert_allclose(posterior.covariance(NEW, OF_NEW), covariance, atol=1e-5)
    p = H.shape[1]
    value = textbook.log_marginal_likelihood(K, y)
    value += 0.5 * (p * np.log(2 * np.pi * wide) + np.linalg.slogdet(H.T @ H)[1])
    assert abs(value - likelihood.value(theta)) < 1e-6


def test_columns_in_other_units_change_nothing():
    rescaled = replace(make_trend(), centre=np.array([[1e4, -1e-3]]))
    rescaled = replace(rescaled, columns=lambda X: columns(X) * [1e9, 1e-9])
    as_they_are = replace(make_trend(), centre=np.array([[1e-5, -1e6]]))
    found = []
    for trend in (rescaled, as_they_are):
        likelihood, theta = make(TERMS["one"], 1, False, trend)
        posterior = likelihood.posterior(theta)
        coefficients = posterior.coefficients_in_units()[0][0]
        found.append([posterior.log_likelihood, *posterior.mean(NEW, OF_NEW)])
        found.append(coefficients)
    np.testing.assert_allclose(found[0], found[2], rtol=1e-8)
    np.testing.assert_allclose(found[1] * [1e9, 1e-9], found[3], rtol=1e-8)


@pytest.mark.parametrize("size", [1.0, 1e5])
def test_a_steep_trend_is_added_to_predictions_and_changes_nothing_else(size):
    trend, (X, tasks, y) = make_trend(), draw()
    steep = size * by_hand(trend, X, tasks) @ [3.0, -2.0]
    of_new = size * by_hand(trend, NEW, OF_NEW) @ [3.0, -2.0]
    plain, theta = make(TERMS["two"], M, True, trend)
    other, _ = make(TERMS["two"], M, True, trend, rows=(X, tasks, y + steep))
    values = [of.value_and_grad(theta) for of in (plain, other)]
    np.testing.assert_allclose(*(np.append(*of) for of in values), atol=1e-9 * size)
    before, after = (of.posterior(theta) for of in (plain, other))
    moved = after.mean(NEW, OF_NEW) - before.mean(NEW, OF_NEW)
    np.testing.assert_allclose(moved, of_new, rtol=1e-9, atol=1e-9)
    loo = [of.leave_one_out() for of in (before, after)]
    np.testing.assert_allclose(*loo, atol=1e-9 * size)


def test_slopes_only_move_targets():
    trend, (X, tasks, y) = make_trend(), draw()
    sloped = make_trend(slopes=2.0)
    moved = y - sloped.fitted(X, tasks)
    plain, theta = make(TERMS["one"], trend=trend)
    other, _ = make(TERMS["one"], trend=sloped, rows=(X, tasks, moved))
    before, after = (of.posterior(theta) for of in (plain, other))
    np.testing.assert_allclose(before.log_likelihood, after.log_likelihood)
    means = [of.mean(NEW, OF_NEW) for of in (before, after)]
    np.testing.assert_allclose(*means, rtol=1e-10)
    left = [of.without_trend(z, X, tasks) for of, z in ((before, y), (after, moved))]
    np.testing.assert_allclose(*left, rtol=1e-9, atol=1e-9)


def test_columns_that_some_rows_do_not_tell():
    # of a part of the rows; here the second column is the first
    twice = make_trend(of=lambda X: X[:, [0, 0]])
    twice = replace(twice, centre=np.zeros((1, 2)))
    once = make_trend(of=lambda X: X[:, [0]])
    once = replace(once, centre=np.zeros((1, 1)))
    found = [make(TERMS["one"], trend=trend) for trend in (twice, once)]
    values = [np.append(*of.value_and_grad(theta)) for of, theta in found]
    np.testing.assert_allclose(*values, rtol=1e-9)


def test_columns_that_are_zero_at_some_rows():
    zero = make_trend(of=lambda X: np.zeros((len(X), 2)))
    zero = replace(zero, centre=np.zeros((1, 2)))
    (plain, theta), (other, _) = (make(TERMS["one"], trend=of) for of in (None, zero))
    values = [np.append(*of.value_and_grad(theta)) for of in (plain, other)]
    np.testing.assert_array_equal(*values)
    means = [of.posterior(theta).mean(NEW, OF_NEW) for of in (plain, other)]
    np.testing.assert_array_equal(*means)
    information = [of.fisher_information(theta) for of in (plain, other)]
    np.testing.assert_allclose(*information)


def test_fisher_information_is_without_the_trend():
    trend = make_trend()
    likelihood, theta = make(TERMS["one"], M, True, trend)
    H = by_hand(trend, likelihood.X, likelihood.tasks)

    def K_at(t):
        return covariances(likelihood, t)[0]

    inverse = np.linalg.inv(K_at(theta))
    middle = np.linalg.inv(H.T @ inverse @ H)
    P = inverse - inverse @ H @ middle @ H.T @ inverse
    dK = textbook.derivative(K_at, theta)
    expected = 0.5 * np.einsum("ij,pjk,kl,qli->pq", P, dK, P, dK, optimize=True)
    found = likelihood.fisher_information(theta)
    np.testing.assert_allclose(found, expected, rtol=1e-2, atol=1e-3)
    near = likelihood.prior.precision(K_at(theta), likelihood.X, likelihood.tasks)
    np.testing.assert_allclose(near, P, atol=1e-9)


def test_an_updated_posterior():
    trend, (X, tasks, y) = make_trend(), draw()
    likelihood, theta = make(TERMS["one"], M, True, trend)
    kept = np.delete(np.arange(len(y)), [2, 9])
    some = DenseLikelihood(likelihood.prior, X[kept], tasks[kept], y[kept])
    origin = np.full(len(y), -1)
    origin[kept] = np.arange(len(kept))
    found = Dense().updated(some.posterior(theta), likelihood, theta, origin)
    expected = likelihood.posterior(theta)
    for method in ("mean", "variance"):
        values = [getattr(of, method)(NEW, OF_NEW) for of in (found, expected)]
        np.testing.assert_allclose(*values, rtol=1e-9)


def test_pickling():
    likelihood, theta = make(TERMS["two"], trend=make_trend(of=columns))
    again = pickle.loads(pickle.dumps(likelihood))
    assert again.value(theta) == likelihood.value(theta)


def test_thinned_data_keep_the_trend():
    X, tasks, y = draw()
    prior = replace(make(TERMS["one"])[0].prior, trend=make_trend(per_task=True))
    data = Data(X, tasks, y, M).thinned(6)  # two rows of each task, two coefficients
    likelihood = Dense().likelihood(prior, data)
    assert likelihood.basis.rank == 6 or len(data) > 6
    assert np.isfinite(likelihood.value(prior.theta()))
