"""Several terms K^rho_q x k_q: dense inference says what the definition does.

cov(y_i, y_j) = v [m_i = m_j] + sum_q K^rho_q k_q + noise; the terms and levels are f.
"""

import pickle
from typing import NamedTuple

import building
import numpy as np
import pytest
import textbook
from hypothesis import given
from hypothesis import strategies as st
from pairs import in_pairs
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern
from strategies import examples, seeds

from skmtgp.inference import tiles
from skmtgp.kernels import ARDLinear
from skmtgp.model.several import Forms, Kernels
from skmtgp.model.task_covariance import low_rank

M, D = 3, 2
SLOW, FAST = RBF([2.0, 3.0]), ConstantKernel(0.5) * Matern([0.3, 0.4], nu=1.5)
TERMS = {
    "two of rank 1": [(SLOW, low_rank(M, 1)), (FAST, low_rank(M, 1))],
    "a shared one": [(SLOW, low_rank(M, 0, shared=True)), (FAST, low_rank(M, 2))],
    "diagonals": [
        (ARDLinear(1.2), low_rank(M, 1, diagonal=True)),
        (RBF(0.4, "fixed"), low_rank(M, 0, "equal")),
    ],
    "three": [
        (SLOW, low_rank(M, M)),
        (FAST, low_rank(M, 1, "equal", shared=True)),
        (ARDLinear([0.1, 0.2], 0.3), low_rank(M, 1, shared=True)),
    ],
}
every_model = in_pairs(
    "tile",
    terms=TERMS,
    n_noise={"shared": 1, "per task": M},
    levels={"levels": True, "no levels": False},
    tile={"small tiles": 7, "one tile": 288},
)
NEW = np.array([[0.3, -0.4], [1.1, 0.6], [-0.8, 0.9], [0.3, -0.4]])
OF_NEW = np.array([0, 2, 1, 1])


class Rows(NamedTuple):
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray


def draw(seed=0, n=22):
    rng = np.random.default_rng(seed)
    tasks = np.sort(np.r_[0, 1, 2, rng.integers(0, M, n - M)])
    return Rows(rng.standard_normal((n, D)), tasks, rng.standard_normal(n))


def make(terms, n_noise=1, levels=False, rows=None, seed=0):
    """The likelihood, and parameters near where learning starts."""
    rows = rows or draw()
    kernels, forms = zip(*terms, strict=True)
    likelihood = building.dense(
        Kernels(kernels), Forms(forms), *rows, n_noise, levels=levels
    )
    theta = likelihood.prior.theta()
    noise = 0.2 * np.random.default_rng(seed).standard_normal(len(theta))
    return likelihood, theta + noise


def k_of(kernel, theta, X, Z):
    return kernel.clone_with_theta(theta)(X, Z)


def covariance(likelihood, terms, theta, X, tasks, Z, of_Z):
    """Of f, term by term, with theta taken apart by hand: kernels, then K^rho, v."""
    at, total = 0, 0.0
    of_kernels, of_forms = [], []
    for kernel, _ in terms:
        of_kernels.append(theta[at : at + kernel.n_dims])
        at += kernel.n_dims
    for _, form in terms:
        of_forms.append(theta[at : at + form.n_parameters])
        at += form.n_parameters
    for (kernel, form), k, rho in zip(terms, of_kernels, of_forms, strict=True):
        total = total + form.matrix(rho)[np.ix_(tasks, of_Z)] * k_of(kernel, k, X, Z)
    if likelihood.prior.levels:
        total = total + np.exp(theta[at]) * np.equal.outer(tasks, of_Z)
    return total


def of_y(likelihood, terms, theta):
    X, tasks = likelihood.X, likelihood.tasks
    noise = np.exp(theta[-likelihood.prior.n_noise :])
    K = covariance(likelihood, terms, theta, X, tasks, X, tasks)
    return K + np.diag(textbook.of_rows(noise, tasks))


def value(likelihood, terms, theta):
    K = of_y(likelihood, terms, theta)
    return textbook.log_marginal_likelihood(K, likelihood.y)


@every_model
class TestByTheBook:
    def test_value_and_gradient(self, terms, n_noise, levels, tile):
        likelihood, theta = make(terms, n_noise, levels)
        found, gradient = likelihood.value_and_grad(theta)
        np.testing.assert_allclose(found, value(likelihood, terms, theta), rtol=1e-11)
        assert likelihood.value(theta) == found
        expected = textbook.derivative(lambda t: value(likelihood, terms, t), theta)
        np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-7)

    def test_posterior(self, terms, n_noise, levels, tile):
        likelihood, theta = make(terms, n_noise, levels)
        posterior, rows = likelihood.posterior(theta), (likelihood.X, likelihood.tasks)
        inverse = np.linalg.inv(of_y(likelihood, terms, theta))
        cross = covariance(likelihood, terms, theta, *rows, NEW, OF_NEW)
        prior = covariance(likelihood, terms, theta, NEW, OF_NEW, NEW, OF_NEW)
        mean = cross.T @ inverse @ likelihood.y
        np.testing.assert_allclose(posterior.mean(NEW, OF_NEW), mean, rtol=1e-9)
        of_tasks = posterior.mean_of_tasks(NEW, np.arange(M))
        np.testing.assert_allclose(of_tasks[np.arange(4), OF_NEW], mean, rtol=1e-9)
        expected = prior - cross.T @ inverse @ cross
        found = posterior.covariance(NEW, OF_NEW)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10)
        found = posterior.variance(NEW, OF_NEW)
        np.testing.assert_allclose(found, np.diagonal(expected), rtol=1e-9, atol=1e-10)

    def test_leave_one_out(self, terms, n_noise, levels, tile):
        likelihood, theta = make(terms, n_noise, levels)
        residual, variance = likelihood.posterior(theta).leave_one_out(True)
        K, y, i = of_y(likelihood, terms, theta), likelihood.y, 5
        others = np.delete(np.arange(len(y)), i)
        weights = np.linalg.solve(K[np.ix_(others, others)], K[others, i])
        np.testing.assert_allclose(residual[i], y[i] - weights @ y[others], rtol=1e-9)
        expected = K[i, i] - weights @ K[others, i]
        np.testing.assert_allclose(variance[i], expected, rtol=1e-9)

    def test_fisher_information(self, terms, n_noise, levels, tile):
        likelihood, theta = make(terms, n_noise, levels)
        dK = textbook.derivative(lambda t: of_y(likelihood, terms, t), theta)
        scores = np.linalg.inv(of_y(likelihood, terms, theta)) @ dK
        expected = 0.5 * np.einsum("pij,qji->pq", scores, scores)
        found = likelihood.fisher_information(theta)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("levels", [False, True])
def test_terms_add_up_to_the_mean(levels):
    likelihood, theta = make(TERMS["a shared one"], levels=levels)
    posterior, rows = likelihood.posterior(theta), (likelihood.X, likelihood.tasks)
    found = posterior.means_of_terms(NEW, OF_NEW)
    np.testing.assert_allclose(found.sum(axis=0), posterior.mean(NEW, OF_NEW))
    # the first term alone: its own covariance with y, times K^-1 y
    (kernel, form), *_ = TERMS["a shared one"]
    of_kernel, of_rho = likelihood.prior.theta_of_terms(theta)[0]
    K_rho = form.matrix(of_rho)[np.ix_(rows[1], OF_NEW)]
    cross = K_rho * k_of(kernel, of_kernel, rows[0], NEW)
    alpha = np.linalg.solve(
        of_y(likelihood, TERMS["a shared one"], theta), likelihood.y
    )
    np.testing.assert_allclose(found[0], cross.T @ alpha, rtol=1e-9)
    assert levels == found[-1].any()


@given(seed=seeds, order=st.permutations(range(3)))
@examples(15)
def test_the_order_of_terms_does_not_matter(seed, order):
    terms, rows = TERMS["three"], draw(seed)
    likelihood, theta = make(terms, 1, True, rows, seed)
    other, _ = make([terms[q] for q in order], 1, True, rows)
    of_terms = likelihood.prior.theta_of_terms(theta)
    moved = other.prior.with_theta_of_terms(theta, [of_terms[q] for q in order])
    np.testing.assert_allclose(other.value(moved), likelihood.value(theta), rtol=1e-10)
    means = likelihood.posterior(theta).means_of_terms(NEW, OF_NEW)
    found = other.posterior(moved).means_of_terms(NEW, OF_NEW)
    np.testing.assert_allclose(found, means[[*order, 3]], rtol=1e-7, atol=1e-8)


@given(seed=seeds, share=st.floats(0.1, 0.9))
@examples(15)
def test_a_term_split_in_two_equal_ones_is_one(seed, share):
    rows, form = draw(seed), low_rank(M, 2)
    whole = building.dense(SLOW, form, *rows, levels=True)
    split, _ = make([(SLOW, form)] * 2, 1, True, rows)
    rng = np.random.default_rng(seed)
    theta = whole.prior.theta() + 0.2 * rng.standard_normal(whole.prior.n_theta)
    [(kernel, rho)] = whole.prior.theta_of_terms(theta)
    parts = [(kernel, np.sqrt(share) * rho), (kernel, np.sqrt(1.0 - share) * rho)]
    of_parts = split.prior.with_theta_of_terms(theta, parts)
    np.testing.assert_allclose(split.value(of_parts), whole.value(theta), rtol=1e-10)
    expected = whole.posterior(theta).means_of_terms(NEW, OF_NEW)[0]
    found = split.posterior(of_parts).means_of_terms(NEW, OF_NEW)
    np.testing.assert_allclose(found[0], share * expected, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(found[1], (1 - share) * expected, rtol=1e-7, atol=1e-8)


def test_a_task_without_data():
    likelihood, theta = make(TERMS["a shared one"], levels=True)
    posterior = likelihood.posterior(theta).with_unseen(1)
    unseen = np.full(len(NEW), M)
    of_terms = posterior.means_of_terms(NEW, unseen)
    # the means of the tasks, but for the level, as loadings of the others say
    tasks = np.repeat(np.arange(M), len(NEW))
    known = posterior.means_of_terms(np.tile(NEW, (M, 1)), tasks)
    known = known.reshape(3, M, len(NEW)).mean(axis=1)
    np.testing.assert_allclose(of_terms[:2], known[:2], rtol=1e-7)
    np.testing.assert_array_equal(of_terms[2], 0.0)
    assert (posterior.variance(NEW, unseen) > np.exp(theta[-2])).all()


def test_priors_and_posteriors_can_be_pickled():
    likelihood, theta = make(TERMS["three"])
    again = pickle.loads(pickle.dumps(likelihood))
    assert again.value(theta) == likelihood.value(theta)
    posterior = pickle.loads(pickle.dumps(likelihood.posterior(theta)))
    expected = likelihood.posterior(theta).mean(NEW, OF_NEW)
    np.testing.assert_array_equal(posterior.mean(NEW, OF_NEW), expected)


def test_prior_of_terms():
    prior = make(TERMS["three"], 1, True)[0].prior
    free = sum(k.n_dims for k, _ in TERMS["three"])
    free += M * (M + 1) // 2 + (M + 2) + (M + 1)  # full; rank 1 and 2, or 1, more
    assert prior.n_hyperparameters == free + 2
    assert prior.n_terms == 3
    assert prior.bounds().shape == (2, prior.n_theta)
    assert prior.of_factor.sum() == M * M + 2 * M
    assert prior.of_factors.sum(axis=1).tolist() == [M * M, M, M]
    # the one diagonal that is beside a factor, and the noise
    assert np.flatnonzero(prior.unexplained).size == 2
    names = "rank 3", "shared and rank 1 and equal diagonal", "shared and rank 1"
    assert str(prior) == " + ".join(names) + ", with levels"


def test_one_term_is_no_list():
    prior = make(TERMS["three"])[0].prior
    one = prior.with_terms(prior.terms[:1])
    assert one.kernel is prior.kernel[0]
    assert one.task_covariance is prior.task_covariance[0]
    theta = prior.theta()
    same = one.with_theta_of_terms(theta, prior.theta_of_terms(theta)[:1])
    assert len(same) == one.n_theta
    np.testing.assert_array_equal(one.K_rho_at(same), prior.K_rho_at(theta)[0])


@pytest.mark.parametrize("size", [3, 22])
def test_tiles_do_not_matter(size, monkeypatch):
    likelihood, theta = make(TERMS["diagonals"], M, True)
    expected = likelihood.value_and_grad(theta)
    monkeypatch.setattr(tiles, "TILE", size)
    found = make(TERMS["diagonals"], M, True)[0].value_and_grad(theta)
    np.testing.assert_allclose(np.r_[found], np.r_[expected], rtol=1e-10)
