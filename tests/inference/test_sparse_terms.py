"""The bound of several terms says what the definition does."""

import pickle

import building
import numpy as np
import pytest
import textbook
from hypothesis import given
from hypothesis import strategies as st
from pairs import in_pairs
from sklearn.gaussian_process.kernels import RBF
from sparse_terms import (
    LINEAR,
    NEW,
    OF_NEW,
    SLOW,
    TERMS,
    D,
    M,
    Rows,
    book,
    dense,
    draw,
    inducing,
    make,
)
from strategies import examples, seeds

from skmtgp.exceptions import JitterWarning
from skmtgp.inference import features
from skmtgp.inference.border import BorderLikelihood
from skmtgp.inference.engines import Sparse
from skmtgp.model.several import Forms, Kernels
from skmtgp.model.task_covariance import low_rank

MODELS = {
    "terms": TERMS,
    "n_noise": {"shared": 1, "per task": M},
    "levels": {"levels": True, "no levels": False},
}
every_model = in_pairs(**MODELS)
every_terms = pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
CLOSE = {"rtol": 1e-8, "atol": 1e-9}


@every_model
class TestByTheBook:
    def test_value_and_gradient(self, terms, n_noise, levels):
        bound, theta = make(terms, n_noise, levels)
        value, gradient = bound.value_and_grad(theta)
        np.testing.assert_allclose(value, book(bound, theta).value(), rtol=1e-10)
        assert bound.value(theta) == value
        expected = textbook.derivative(lambda t: book(bound, t).value(), theta)
        np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-6)

    def test_gradient_by_inducing_inputs(self, terms, n_noise, levels):
        bound, theta = make(terms, n_noise, levels)
        value, gradient, d_Z = bound.value_and_grads(theta)

        def at(Z):
            return book(bound, theta, Z.reshape(-1, D)).value()

        expected = textbook.derivative(at, bound.Z.ravel())
        np.testing.assert_allclose(d_Z.ravel(), expected, rtol=1e-6, atol=1e-6)
        found = bound.value_and_grad(theta)
        np.testing.assert_array_equal(gradient, found[1])
        assert value == found[0]

    def test_task_gradient(self, terms, n_noise, levels):
        bound, theta = make(terms, n_noise, levels)
        theta[-n_noise:] = np.log(0.5)  # what is indefinite is still a covariance
        at = book(bound, theta)

        def value(entries):
            matrices = entries.reshape(-1, M, M)
            pairs = zip(at.terms, matrices, strict=True)
            moved = [(k, 0.5 * (A + A.T)) for (k, _), A in pairs]
            return at._replace(terms=moved).value()

        K_rhos = np.array([K_rho for _, K_rho in at.terms])
        expected = textbook.derivative(value, K_rhos.ravel()).reshape(K_rhos.shape)
        found = bound.task_gradient(theta)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)
        np.testing.assert_array_equal(found, found.swapaxes(1, 2))

    def test_posterior(self, terms, n_noise, levels):
        bound, theta = make(terms, n_noise, levels)
        posterior = bound.posterior(theta)
        mean, covariance = book(bound, theta).posterior(NEW, OF_NEW)
        np.testing.assert_allclose(posterior.mean(NEW, OF_NEW), mean, **CLOSE)
        of_tasks = posterior.mean_of_tasks(NEW, np.arange(M))
        np.testing.assert_allclose(of_tasks[np.arange(4), OF_NEW], mean, **CLOSE)
        found = posterior.covariance(NEW, OF_NEW)
        np.testing.assert_allclose(found, covariance, **CLOSE)
        found = posterior.variance(NEW, OF_NEW)
        np.testing.assert_allclose(found, np.diagonal(covariance), **CLOSE)
        assert posterior.log_likelihood == bound.value(theta)

    def test_leave_one_out(self, terms, n_noise, levels):
        bound, theta = make(terms, n_noise, levels)
        residual, variance = bound.posterior(theta).leave_one_out(True)
        inverse, at = np.linalg.inv(book(bound, theta).K), book(bound, theta)
        expected = 1.0 / np.diagonal(inverse)
        np.testing.assert_allclose(residual, inverse @ bound.y * expected, **CLOSE)
        expected = expected + np.diagonal(at.left(*at.rows[:2]))
        np.testing.assert_allclose(variance, expected, **CLOSE)

    def test_levels(self, terms, n_noise, levels):
        bound, theta = make(terms, n_noise, levels)
        posterior, at = bound.posterior(theta), book(bound, theta)
        with_y = at.level * np.equal.outer(bound.tasks, np.arange(M))
        weights = np.linalg.solve(at.K, with_y)
        np.testing.assert_allclose(posterior.levels, weights.T @ bound.y, **CLOSE)
        expected = at.level - (weights * with_y).sum(axis=0)
        np.testing.assert_allclose(posterior.level_variances(), expected, **CLOSE)

    def test_exact_where_all_inputs_are_inducing(self, terms, n_noise, levels):
        bound, theta = make(terms, n_noise, levels, Z=draw().X)
        exact = dense(terms, n_noise, levels)
        value, gradient = bound.value_and_grad(theta)
        expected = exact.value_and_grad(theta)
        np.testing.assert_allclose(value, expected[0], rtol=1e-8)
        np.testing.assert_allclose(gradient, expected[1], rtol=1e-5, atol=1e-5)
        posterior, of_exact = bound.posterior(theta), exact.posterior(theta)
        for method in ("means_of_terms", "variance", "covariance"):
            found = getattr(posterior, method)(NEW, OF_NEW)
            expected = getattr(of_exact, method)(NEW, OF_NEW)
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)
        found, expected = posterior.leave_one_out(), of_exact.leave_one_out()
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


@given(st.sampled_from(sorted(TERMS)), seeds, st.integers(1, 20))
@examples(30)
def test_never_above_the_likelihood(name, seed, m):
    rng, rows = np.random.default_rng(seed), draw(seed)
    n_noise, levels = int(rng.choice([1, M])), bool(rng.integers(2))
    model = [*TERMS[name], *[LINEAR] * int(rng.integers(2))], n_noise, levels
    bound, theta = make(*model, Z=inducing(m, seed), rows=rows, seed=seed)
    theta[-n_noise:] += rng.uniform(-4.0, 3.0)
    exact = dense(*model, rows).value(theta)
    value = bound.value(theta)
    assert value <= exact + 1e-9 * (1.0 + abs(exact))
    fewer = bound.with_inducing(bound.Z[: rng.integers(1, m + 1)])
    assert fewer.value(theta) <= value + 1e-9 * (1.0 + abs(value))


@given(seed=seeds, order=st.permutations(range(3)))
@examples(10)
def test_the_order_of_terms_does_not_matter(seed, order):
    terms, rows = TERMS["three"], draw(seed)
    bound, theta = make(terms, M, True, rows=rows, seed=seed)
    other, _ = make([terms[q] for q in order], M, True, rows=rows)
    of_terms = bound.prior.theta_of_terms(theta)
    moved = other.prior.with_theta_of_terms(theta, [of_terms[q] for q in order])
    np.testing.assert_allclose(other.value(moved), bound.value(theta), rtol=1e-9)
    means = bound.posterior(theta).means_of_terms(NEW, OF_NEW)
    found = other.posterior(moved).means_of_terms(NEW, OF_NEW)
    np.testing.assert_allclose(found, means[[*order, 3]], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", ["diagonals", "three"])
def test_a_term_split_in_two_equal_ones_is_one(name):
    """Even where both parts have a diagonal, which are integrated out in turn."""
    form = low_rank(M, 2, diagonal=True)
    rows, Z = draw(), inducing()
    whole = building.sparse(SLOW, form, *rows, Z, levels=True)
    split, _ = make([(SLOW, form)] * 2, 1, True, Z=Z, rows=rows)
    rng = np.random.default_rng(0)
    theta = whole.prior.theta() + 0.2 * rng.standard_normal(whole.prior.n_theta)
    [(kernel, rho)] = whole.prior.theta_of_terms(theta)
    F, kappa = rho[: 2 * M], rho[2 * M :]
    share = 0.3 if name == "three" else 1e-9  # of one diagonal next to nothing
    parts = [
        (kernel, np.r_[np.sqrt(of) * F, np.log(of) + kappa])
        for of in (share, 1 - share)
    ]
    of_parts = split.prior.with_theta_of_terms(theta, parts)
    np.testing.assert_allclose(split.value(of_parts), whole.value(theta), rtol=1e-9)
    expected = whole.posterior(theta).means_of_terms(NEW, OF_NEW)[0]
    found = split.posterior(of_parts).means_of_terms(NEW, OF_NEW)
    close = {"rtol": 1e-6, "atol": 1e-8}
    np.testing.assert_allclose(found[0], share * expected, **close)
    np.testing.assert_allclose(found[1], (1 - share) * expected, **close)


@pytest.mark.parametrize("noise", [1e-4, 1e-7])
@every_terms
def test_small_noise(terms, noise):
    rows = draw()
    rows = rows._replace(y=np.sin(rows.X.sum(axis=1)) * (1.0 + rows.tasks))
    bound, theta = make(terms, levels=True, Z=rows.X, rows=rows)
    theta[-1] = np.log(noise)
    exact = dense(terms, levels=True, rows=rows)
    loss = 1e-13 / noise
    expected = exact.value(theta)
    scale = max(len(rows.y), abs(expected))
    np.testing.assert_allclose(bound.value(theta), expected, atol=loss * scale)
    found = bound.posterior(theta).mean(NEW, OF_NEW)
    expected = exact.posterior(theta).mean(NEW, OF_NEW)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("n", [3, 12])
@pytest.mark.parametrize("name", ["two of rank 1", "a diagonal", "a shared one"])
def test_border_of_a_novel_task(name, n):
    """Joint covariances of the latent functions of all terms."""
    terms, rows = TERMS[name], draw()
    bound, theta = make(terms, Z=rows.X[:9], rows=rows)
    exact = make(terms, Z=rows.X, rows=rows)[0]
    of_terms = zip(terms, bound.prior.theta_of_terms(theta), strict=True)
    factors = [form.latent(rho)[0] for (_, form), (_, rho) in of_terms]
    rng = np.random.default_rng(3)
    X, y = rng.standard_normal((n, D)), rng.standard_normal(n)
    known = factors, X, y, 0.1, *([of] * 2 for of in (False,))

    def border(posterior):
        return BorderLikelihood(posterior, *known, shared=[None] * 2, equal=[0.0] * 2)

    row = rng.standard_normal(border(bound.posterior(theta)).rank)
    # of the joint covariance, with a novel task that shares those functions alone
    value, gradient = border(exact.posterior(theta)).value_and_grad(row)
    expected = border(dense(terms, rows=rows).posterior(theta)).value_and_grad(row)
    np.testing.assert_allclose(value, expected[0], rtol=1e-6)
    np.testing.assert_allclose(gradient, expected[1], rtol=1e-4, atol=1e-5)
    few = border(bound.posterior(theta))
    slopes = textbook.derivative(few.value, row)
    np.testing.assert_allclose(few.value_and_grad(row)[1], slopes, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("Z", [inducing(), draw().X], ids=["few", "all"])
def test_a_task_without_data(Z):
    bound, theta = make(TERMS["a shared one"], levels=True, Z=Z)
    posterior = bound.posterior(theta).with_unseen(2)
    unseen = np.full(len(NEW), M + 1)
    *of_terms, level = posterior.means_of_terms(NEW, unseen)
    known = [posterior.means_of_terms(NEW, np.full(len(NEW), m)) for m in range(M)]
    np.testing.assert_allclose(of_terms, np.mean(known, axis=0)[:2], rtol=1e-7)
    np.testing.assert_array_equal(level, 0.0)
    if len(Z) == len(bound.y):
        exact = dense(TERMS["a shared one"], levels=True)
        expected = exact.posterior(theta).with_unseen(2)
        for method in ("means_of_terms", "variance", "covariance"):
            found = getattr(posterior, method)(NEW, unseen)
            of_exact = getattr(expected, method)(NEW, unseen)
            np.testing.assert_allclose(found, of_exact, rtol=1e-6, atol=1e-7)


def test_summands_sum_to_the_mean():
    bound, theta = make(TERMS["three"], levels=True)
    posterior, tasks = bound.posterior(theta), np.array([2, 0])
    found = 0.0
    for part in posterior.summands(tasks):
        found = found + part.kernel(NEW, part.inputs) @ part.weights.T + part.constants
    np.testing.assert_allclose(found, posterior.mean_of_tasks(NEW, tasks), rtol=1e-9)


@every_terms
def test_rows_that_join(terms):
    rows, kept = draw(n=30), np.arange(24)
    before, theta = make(terms, M, True, rows=Rows(*(of[kept] for of in rows)))
    after, _ = make(terms, M, True, rows=rows)
    origin = np.where(np.arange(30) < 24, np.arange(30), -1)
    engine, posterior = Sparse(), before.posterior(theta)
    for _ in range(2):  # the second time by sums that are kept
        posterior = engine.updated(posterior, after, theta, origin)
        origin = np.arange(30)
    expected = after.posterior(theta)
    for method in ("means_of_terms", "variance"):
        found = getattr(posterior, method)(NEW, OF_NEW)
        whole = getattr(expected, method)(NEW, OF_NEW)
        np.testing.assert_allclose(found, whole, rtol=1e-7, atol=1e-9)


def test_pickles():
    bound, theta = make(TERMS["three"], levels=True)
    again = pickle.loads(pickle.dumps(bound))
    assert again.value(theta) == bound.value(theta)
    posterior = bound.posterior(theta)
    again = pickle.loads(pickle.dumps(posterior))
    for method in ("mean", "variance"):
        expected = getattr(posterior, method)(NEW, OF_NEW)
        np.testing.assert_array_equal(getattr(again, method)(NEW, OF_NEW), expected)


def test_fisher_information():
    bound, theta = make(TERMS["three"], M, True)
    expected = dense(TERMS["three"], M, True).fisher_information(theta)
    found = bound.fisher_information(theta)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)


def test_close_inducing_inputs_of_a_slow_term_are_not_told(monkeypatch):
    """A fast term needs them. They are told where all terms are singular."""
    monkeypatch.setattr(features, "LEAST_JITTER", 1e-19)
    X = np.linspace(0.0, 3.0, 60)[:, None]
    rows, one = (X, np.arange(60) % M, np.sin(X[:, 0])), low_rank(M, 1)

    def posterior(*lengths):
        kernels = Kernels(map(RBF, lengths))
        bound = building.sparse(kernels, Forms([one] * 2), *rows, X[::2])
        return bound.posterior(bound.prior.theta(K_rho=np.ones((M, M))))

    slow, fast = posterior(2.0, 0.05).features.terms
    assert slow.jitter > fast.jitter
    with pytest.warns(JitterWarning, match="30 inducing inputs"):
        posterior(2.0, 3.0)
