"""A trend with flat coefficients in sparse inference: by the book, and by dense."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import sparse_terms
import textbook
from hypothesis import given
from hypothesis import strategies as st
from pairs import in_pairs
from strategies import examples, seeds
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

from skmtgp.inference.border import BorderLikelihood
from skmtgp.inference.engines import Sparse
from skmtgp.inference.sparse import SparseBound
from skmtgp.model.task_covariance import low_rank

FEW = np.array([[0.1, -0.6], [1.0, 0.9]])
MORE = np.vstack([FEW, np.random.default_rng(1).standard_normal((5, 2))])
CLOSE = {"rtol": 1e-8, "atol": 1e-8}
parts = {
    "terms": TERMS,
    "per_task": {"shared": False, "own": True},
    "n_noise": {"one noise": 1, "noise per task": M},
    "levels": {"levels": True, "no levels": False},
}
every_model = in_pairs(
    **parts,
    units={"units": np.array([0.5, 2.0, 30.0]), "shared units": np.array([3.0])},
    Z={"few inputs": FEW, "more inputs": MORE},
)
every_exact_model = in_pairs(**parts)


def by_the_book(bound, theta):
    """What the bound is of, and the trend's columns."""
    H = by_hand(bound.prior.trend, bound.X, bound.tasks)
    return sparse_terms.book(bound, theta), H


def textbook_value(bound, theta):
    """Titsias (2009), eq. 9, with the restricted likelihood in it."""
    book, H = by_the_book(bound, theta)
    left = np.diagonal(book.left(*book.rows[:2]))
    value = textbook.restricted_likelihood(book.K, H, bound.y)
    return value - 0.5 * (left / book.noise).sum()


@every_model
def test_value_and_gradient(terms, per_task, n_noise, levels, units, Z):
    bound, theta = make(terms, n_noise, levels, make_trend(per_task, units), Z=Z)
    value, gradient = bound.value_and_grad(theta)
    np.testing.assert_allclose(value, textbook_value(bound, theta), rtol=1e-9)
    assert bound.value(theta) == value
    expected = textbook.derivative(lambda t: textbook_value(bound, t), theta)
    np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("per_task", [False, True])
@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_gradient_by_inducing_inputs(terms, per_task):
    bound, theta = make(terms, M, True, make_trend(per_task), Z=MORE)

    def expected(Z):
        return textbook_value(bound.with_inducing(Z.reshape(MORE.shape)), theta)

    d_Z = bound.value_and_grads(theta)[2].ravel()
    by_differences = textbook.derivative(expected, MORE.ravel())
    np.testing.assert_allclose(d_Z, by_differences, rtol=1e-6, atol=1e-6)


@every_model
def test_posterior(terms, per_task, n_noise, levels, units, Z):
    trend = make_trend(per_task, units)
    bound, theta = make(terms, n_noise, levels, trend, Z=Z)
    posterior, (book, H) = bound.posterior(theta), by_the_book(bound, theta)
    H_star = by_hand(trend, NEW, OF_NEW)
    cross = book.explained(*book.rows[:2], NEW, OF_NEW)
    prior = book.prior(NEW, OF_NEW, NEW, OF_NEW)
    mean, spread, beta, of_beta = textbook.universal_kriging(
        book.K, H, bound.y, cross, H_star, prior
    )
    np.testing.assert_allclose(posterior.mean(NEW, OF_NEW), mean, **CLOSE)
    np.testing.assert_allclose(posterior.covariance(NEW, OF_NEW), spread, **CLOSE)
    variance = posterior.variance(NEW, OF_NEW)
    np.testing.assert_allclose(variance, np.diagonal(spread), **CLOSE)
    found, deviation = posterior.coefficients_in_units()
    np.testing.assert_allclose(found.ravel(), beta, **CLOSE)
    np.testing.assert_allclose(deviation.ravel() ** 2, np.diagonal(of_beta), **CLOSE)
    assert posterior.log_likelihood == bound.value(theta)
    terms_of_mean = posterior.means_of_terms(NEW, OF_NEW)
    np.testing.assert_allclose(terms_of_mean.sum(axis=0), mean, **CLOSE)
    np.testing.assert_allclose(terms_of_mean[-2], H_star @ beta, **CLOSE)
    without = posterior.mean_of_tasks(NEW, np.arange(M))[np.arange(4), OF_NEW]
    np.testing.assert_allclose(without, mean - H_star @ beta, **CLOSE)


@every_model
def test_leave_one_out(terms, per_task, n_noise, levels, units, Z):
    bound, theta = make(terms, n_noise, levels, make_trend(per_task, units), Z=Z)
    residual, variance = bound.posterior(theta).leave_one_out(include_noise=True)
    book, H = by_the_book(bound, theta)
    left, y = np.diagonal(book.left(*book.rows[:2])), bound.y
    for i in range(0, len(y), 5):
        rest = np.delete(np.arange(len(y)), i)
        K = book.K[np.ix_(rest, rest)]
        told = y[rest], book.K[rest][:, [i]], H[[i]], book.K[i, i]
        mean, spread, *_ = textbook.universal_kriging(K, H[rest], *told)
        np.testing.assert_allclose(y[i] - residual[i], mean, **CLOSE)
        np.testing.assert_allclose(variance[i], spread + left[i], rtol=1e-8)


@pytest.mark.parametrize("per_task", [False, True])
def test_levels(per_task):
    bound, theta = make(TERMS["one"], M, True, make_trend(per_task), Z=MORE)
    posterior, (book, H) = bound.posterior(theta), by_the_book(bound, theta)
    of_tasks = np.equal.outer(bound.tasks, np.arange(M)) * book.level
    nothing, prior = np.zeros((M, H.shape[1])), book.level * np.eye(M)
    mean, spread, *_ = textbook.universal_kriging(
        book.K, H, bound.y, of_tasks, nothing, prior
    )
    np.testing.assert_allclose(posterior.levels, mean, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(posterior.level_variances(), np.diagonal(spread))


@every_exact_model
def test_exact_where_all_inputs_are_inducing(terms, per_task, n_noise, levels):
    given = terms, n_noise, levels, make_trend(per_task)
    (exact, theta), (bound, _) = make(*given), make(*given, Z=draw()[0])
    value, gradient = exact.value_and_grad(theta)
    found = bound.value_and_grad(theta)
    np.testing.assert_allclose(found[0], value, rtol=1e-10)
    np.testing.assert_allclose(found[1], gradient, rtol=1e-8, atol=1e-8)
    D_rho = bound.task_gradient(theta), exact.task_gradient(theta)
    np.testing.assert_allclose(*D_rho, rtol=1e-7, atol=1e-7)
    of_both = [of.posterior(theta) for of in (exact, bound)]
    for method in ("mean", "variance", "covariance"):
        values = [getattr(of, method)(NEW, OF_NEW) for of in of_both]
        np.testing.assert_allclose(*values, **CLOSE)
    told = [of.coefficients_in_units() for of in of_both]
    np.testing.assert_allclose(*told, **CLOSE)
    left = [of.without_trend(bound.y, bound.X, bound.tasks) for of in of_both]
    np.testing.assert_allclose(*left, **CLOSE)
    np.testing.assert_allclose(*(of.leave_one_out() for of in of_both), rtol=1e-7)
    information = [of.fisher_information(theta) for of in (exact, bound)]
    np.testing.assert_allclose(*information, rtol=1e-10)


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
@pytest.mark.parametrize("per_task", [False, True])
def test_next_to_no_noise(terms, per_task):
    # what is left of the digits of the Gram matrices is no worse than without a trend
    (exact, theta), (bound, _) = (
        make(terms, 1, True, make_trend(per_task), Z=Z) for Z in (None, draw()[0])
    )
    theta[-1] = np.log(1e-8)
    value, gradient = exact.value_and_grad(theta)
    found = bound.value_and_grad(theta)
    np.testing.assert_allclose(found[0], value, rtol=1e-6)
    size = np.abs(gradient).max()
    np.testing.assert_allclose(found[1], gradient, atol=1e-5 * size)
    posteriors = [of.posterior(theta) for of in (exact, bound)]
    means = [of.mean(NEW, OF_NEW) for of in posteriors]
    np.testing.assert_allclose(*means, rtol=1e-8, atol=1e-8)
    told = [of.coefficients_in_units() for of in posteriors]
    np.testing.assert_allclose(*told, rtol=1e-8)


def test_a_steep_trend_and_next_to_no_noise():
    # b of the first pass has few digits: the second gives them back
    (X, tasks, y), trend = draw(n=60), make_trend(True)
    steep = y + 1e8 * by_hand(trend, X, tasks).sum(axis=1)
    (plain, theta), (bound, _) = (
        make(TERMS["one"], 1, True, trend, rows=(X, tasks, of), Z=X)
        for of in (y, steep)
    )
    theta[-1] = np.log(1e-6)
    np.testing.assert_allclose(bound.value(theta), plain.value(theta), rtol=1e-7)
    one, two = (of.posterior(theta).coefficients_in_units()[0] for of in (plain, bound))
    np.testing.assert_allclose(two - one, 1e8, rtol=1e-8)


@pytest.mark.parametrize("levels", [False, True])
@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_weights_are_those_of_each_column_alone(terms, levels):
    # refined, too: without noise half of their digits are lost before
    X, tasks, y = draw(n=60)
    bound, theta = make(terms, 1, levels, make_trend(True), rows=(X, tasks, y), Z=X)
    theta[-1] = np.log(1e-9)
    posterior = bound.posterior(theta)
    left, *others = posterior.columns.of(tasks, bound.targets).T
    found = [posterior.omega, *posterior.told.omega]
    for omega, targets in zip(found, [left, *others], strict=True):
        plain, _ = make(terms, 1, levels, rows=(X, tasks, targets), Z=X)
        expected = plain.posterior(theta).omega
        size = np.abs(expected).max()
        np.testing.assert_allclose(omega, expected, atol=1e-9 * size)


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_the_limit_of_a_wide_prior(terms):
    # the bound by the book with 1e7 of variance along each column, and what that costs
    bound, theta = make(terms, M, True, make_trend(of=lambda X: X), Z=MORE)
    theta[-M:] = np.log(0.5)  # of coefficients of the size of 1
    book, H = by_the_book(bound, theta)
    H_star, wide, p = by_hand(bound.prior.trend, NEW, OF_NEW), 1e7, H.shape[1]
    K, left = book.K + wide * H @ H.T, np.diagonal(book.left(*book.rows[:2]))
    value = textbook.log_marginal_likelihood(K, bound.y)
    value -= 0.5 * (left / book.noise).sum()
    value += 0.5 * (p * np.log(2 * np.pi * wide) + np.linalg.slogdet(H.T @ H)[1])
    assert abs(value - bound.value(theta)) < 1e-6
    cross = book.explained(*book.rows[:2], NEW, OF_NEW) + wide * H @ H_star.T
    mean = cross.T @ np.linalg.solve(K, bound.y)
    found = bound.posterior(theta).mean(NEW, OF_NEW)
    np.testing.assert_allclose(found, mean, rtol=1e-5)


def test_columns_in_other_units_change_nothing():
    rescaled = replace(make_trend(), centre=np.array([[1e4, -1e-3]]))
    rescaled = replace(rescaled, columns=lambda X: columns(X) * [1e9, 1e-9])
    as_they_are = replace(make_trend(), centre=np.array([[1e-5, -1e6]]))
    found = []
    for trend in (rescaled, as_they_are):
        bound, theta = make(TERMS["one"], 1, False, trend, Z=MORE)
        posterior = bound.posterior(theta)
        coefficients = posterior.coefficients_in_units()[0][0]
        found.append([posterior.log_likelihood, *posterior.mean(NEW, OF_NEW)])
        found.append(coefficients)
    np.testing.assert_allclose(found[0], found[2], rtol=1e-7)
    np.testing.assert_allclose(found[1] * [1e9, 1e-9], found[3], rtol=1e-7)


@pytest.mark.parametrize("size", [1.0, 1e5])
@pytest.mark.parametrize("per_task", [False, True])
def test_a_steep_trend_is_added_to_predictions_and_changes_nothing_else(size, per_task):
    trend, (X, tasks, y) = make_trend(per_task), draw()
    beta = size * np.resize([3.0, -2.0, 0.5], trend.n_coefficients)
    steep, of_new = (by_hand(trend, *of) @ beta for of in ((X, tasks), (NEW, OF_NEW)))
    plain, theta = make(TERMS["two"], M, True, trend, Z=MORE)
    other, _ = make(TERMS["two"], M, True, trend, rows=(X, tasks, y + steep), Z=MORE)
    values = [of.value_and_grad(theta) for of in (plain, other)]
    np.testing.assert_allclose(*(np.append(*of) for of in values), atol=1e-9 * size)
    before, after = (of.posterior(theta) for of in (plain, other))
    moved = after.mean(NEW, OF_NEW) - before.mean(NEW, OF_NEW)
    np.testing.assert_allclose(moved, of_new, rtol=1e-9, atol=1e-9)
    coefficients = [of.coefficients_in_units()[0].ravel() for of in (before, after)]
    np.testing.assert_allclose(coefficients[1] - coefficients[0], beta, rtol=1e-9)
    loo = [of.leave_one_out() for of in (before, after)]
    np.testing.assert_allclose(*loo, atol=1e-9 * size)


def test_columns_that_some_rows_do_not_tell():
    twice = make_trend(of=lambda X: X[:, [0, 0]])
    twice = replace(twice, centre=np.zeros((1, 2)))
    once = make_trend(of=lambda X: X[:, [0]])
    once = replace(once, centre=np.zeros((1, 1)))
    found = [make(TERMS["one"], trend=trend, Z=MORE) for trend in (twice, once)]
    values = [np.append(*of.value_and_grad(theta)) for of, theta in found]
    np.testing.assert_allclose(*values, rtol=1e-9)


def test_columns_that_are_zero_at_all_rows():
    zero = make_trend(of=lambda X: np.zeros((len(X), 2)))
    zero = replace(zero, centre=np.zeros((1, 2)))
    (plain, theta), (other, _) = (
        make(TERMS["one"], trend=of, Z=MORE) for of in (None, zero)
    )
    values = [np.append(*of.value_and_grad(theta)) for of in (plain, other)]
    np.testing.assert_array_equal(*values)
    means = [of.posterior(theta).mean(NEW, OF_NEW) for of in (plain, other)]
    np.testing.assert_array_equal(*means)


@pytest.mark.parametrize("per_task", [False, True])
def test_an_updated_posterior_sums_over_new_rows_alone(per_task, monkeypatch):
    (X, tasks, y), new = draw(), [2, 9, 20]
    whole, theta = make(TERMS["two"], M, True, make_trend(per_task), Z=MORE)
    kept, origin = np.delete(np.arange(len(y)), new), np.full(len(y), -1)
    origin[kept] = np.arange(len(kept))
    some = SparseBound(whole.prior, X[kept], tasks[kept], y[kept], MORE)
    same = some.posterior(theta), some, theta, np.arange(len(kept))
    before = Sparse().updated(*same)  # which keeps the sums
    summed, over_rows = [], SparseBound.over_rows

    def counted(bound, *arguments, rows=None, **options):
        summed.append(rows)
        return over_rows(bound, *arguments, rows=rows, **options)

    monkeypatch.setattr(SparseBound, "over_rows", counted)
    found = Sparse().updated(before, whole, theta, origin)
    assert [None if of is None else of.tolist() for of in summed] == [new, None]
    expected = whole.posterior(theta)
    for method in ("mean", "variance"):
        values = [getattr(of, method)(NEW, OF_NEW) for of in (found, expected)]
        np.testing.assert_allclose(*values, rtol=1e-9)
    told = [of.coefficients_in_units() for of in (found, expected)]
    np.testing.assert_allclose(*told, rtol=1e-9)


def test_sums_are_made_anew_where_coefficients_are_told_by_new_rows():
    (X, tasks, y), trend = draw(), make_trend(of=lambda X: X)
    trend, X = replace(trend, centre=np.zeros((1, 2))), X * (np.arange(24) > 9)[:, None]
    whole, theta = make(TERMS["one"], 1, False, trend, rows=(X, tasks, y), Z=MORE)
    some = SparseBound(whole.prior, X[:11], tasks[:11], y[:11], MORE)
    assert (some.basis.rank, whole.basis.rank) == (1, 2)
    kept = np.arange(11)
    before = Sparse().updated(some.posterior(theta), some, theta, kept)
    origin = np.append(kept, np.full(13, -1))
    found = Sparse().updated(before, whole, theta, origin)
    assert found.log_likelihood == whole.value(theta)


@pytest.mark.parametrize("n_rows", [3, 40])
@pytest.mark.parametrize("per_task", [False, True])
def test_the_border_of_a_novel_task(per_task, n_rows):
    rng = np.random.default_rng(3)
    X, row = rng.standard_normal((n_rows, 2)), np.array([0.8, -0.6])
    y, borders = X[:, 0] + rng.standard_normal(n_rows), []
    for Z in (None, draw()[0]):
        likelihood, theta = make(TERMS["one"], 1, True, make_trend(per_task), Z=Z)
        prior, posterior = likelihood.prior, likelihood.posterior(theta)
        F, T = prior.latents(theta)[0][0], columns(X) - prior.trend.centre
        given = posterior, F, X, y, 0.3, False, 0.2
        borders.append(BorderLikelihood(*given, trend=T))
    values = [np.append(*of.value_and_grad(row)) for of in borders]
    np.testing.assert_allclose(*values, rtol=1e-7)
    information = [of.fisher_information(row) for of in borders]
    np.testing.assert_allclose(*information, rtol=1e-7, atol=1e-9)


def test_tasks_without_data():
    form = [(TERMS["two"][0][0], low_rank(M, 1, shared=True))]
    X, tasks = np.vstack([NEW, NEW]), np.repeat([0, M, M + 1, 2], 2)
    told = []
    for Z in (None, draw()[0]):
        likelihood, theta = make(form, M, True, make_trend(), Z=Z)
        posterior = likelihood.posterior(theta).with_unseen(2)
        told.append([posterior.mean(X, tasks), posterior.variance(X, tasks)])
    np.testing.assert_allclose(*told, **CLOSE)


def test_pickling_and_rows_that_go():
    bound, theta = make(TERMS["two"], trend=make_trend(True), Z=MORE)
    again = pickle.loads(pickle.dumps(bound))
    assert again.value(theta) == bound.value(theta)
    posterior = pickle.loads(pickle.dumps(again.posterior(theta)))
    again.forget_rows()
    assert again.targets is None
    expected = bound.posterior(theta).variance(NEW, OF_NEW)
    np.testing.assert_array_equal(posterior.variance(NEW, OF_NEW), expected)


@pytest.mark.parametrize("log_noise", [-800.0, 800.0, np.inf, np.nan])
def test_steps_too_far_are_rejected(log_noise):
    bound, theta = make(TERMS["one"], 1, True, make_trend(), Z=MORE)
    theta[-1] = log_noise
    with np.errstate(all="ignore"):
        value, gradient = bound.value_and_grad(theta)
        assert bound.value(theta) == -np.inf
    assert value == -np.inf
    assert np.isnan(gradient).all()


def test_a_row_that_tells_a_coefficient_alone():
    alone = make_trend(of=lambda X: X[:, :1] == draw()[0][3, 0])
    alone = replace(alone, centre=np.zeros((1, 1)))
    bound, theta = make(TERMS["one"], 1, False, alone, Z=MORE)
    residual, variance = bound.posterior(theta).leave_one_out()
    assert np.isfinite(residual).all()
    assert variance[3] > 1e10
    assert np.delete(variance, 3).max() < 100.0


@examples(25)
@given(seeds, st.sampled_from(sorted(TERMS)), st.booleans(), st.integers(1, 30))
def test_orders_of_rows_and_blocks_do_not_matter(seed, name, own, size):
    rng, trend, (X, tasks, y) = np.random.default_rng(seed), make_trend(own), draw(seed)
    bound, theta = make(TERMS[name], 1, True, trend, seed, (X, tasks, y), MORE)
    rows = rng.permutation(len(y))
    other = SparseBound(bound.prior, X[rows], tasks[rows], y[rows], MORE, size)
    one, two = bound.value_and_grad(theta), other.value_and_grad(theta)
    scale = np.abs(one[1]).max(initial=abs(one[0]))
    np.testing.assert_allclose(two[0], one[0], rtol=0.0, atol=1e-9 * scale)
    np.testing.assert_allclose(two[1], one[1], rtol=0.0, atol=1e-9 * scale)


@examples(15)
@given(seeds, st.booleans(), st.permutations(range(M)))
def test_names_of_tasks_do_not_matter(seed, own, names):
    trend, (X, tasks, y), new = make_trend(own), draw(seed), np.array(names)
    bound, theta = make(TERMS["one"], M, True, trend, seed, (X, tasks, y), MORE)
    relabelled = SparseBound(bound.prior, X, new[tasks], y, MORE)
    values, old = bound.prior.values(theta), np.argsort(new)
    moved = theta.copy()
    at = len(values.kernel)
    moved[at : at + 2 * M] = values.rho.reshape(M, 2)[old].ravel()
    moved[-M:] = theta[-M:][old]
    one, two = bound.posterior(theta), relabelled.posterior(moved)
    np.testing.assert_allclose(two.log_likelihood, one.log_likelihood, rtol=1e-9)
    means = one.mean(NEW, OF_NEW), two.mean(NEW, new[OF_NEW])
    np.testing.assert_allclose(*means, **CLOSE)
    coefficients = [np.array(of.coefficients_in_units()) for of in (one, two)]
    coefficients[1] = coefficients[1][:, new] if own else coefficients[1]
    np.testing.assert_allclose(*coefficients, **CLOSE)
