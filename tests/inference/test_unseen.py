"""Tasks without data: the population of the others' loadings, by the book.

A population of a few rows of loadings has the mean and the covariance that another task
is told by. What the book says of each of these rows is averaged.
"""

from itertools import product

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, Matern
from trend_models import NEW, M, draw, make, make_trend

from skmtgp.model.task_covariance import low_rank

SLOW, FAST = RBF([2.0, 3.0]), Matern(0.4, nu=1.5)
TERMS = {
    "one": [(SLOW, low_rank(M, 1, shared=True))],
    "diagonal": [(SLOW, low_rank(M, 2, diagonal=True, shared=True))],
    "equal diagonal": [(SLOW, low_rank(M, 2, "equal", shared=True))],
    "full rank": [(SLOW, low_rank(M, M, shared=True))],
    "two": [(SLOW, low_rank(M, 1, shared=True)), (FAST, low_rank(M, 2))],
    "shared alone": [(SLOW, low_rank(M, 0, shared=True)), (FAST, low_rank(M, 1, True))],
}
OF_NEW = np.array([M, M + 1, M, 1])  # two tasks without data and one with some
FLAT = 1e7  # variance of a trend's coefficients, as good as flat
CLOSE = {"rtol": 1e-5, "atol": 1e-6}
every_case = pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)


def loadings_of(prior, theta):
    """Of each term F with a column of what all share, and kappa, by hand."""
    found = []
    for (_, form), (_, rho) in zip(
        prior.terms, prior.theta_of_terms(theta), strict=True
    ):
        rank = getattr(form, "rank", 0)
        F, rest = rho[: M * rank].reshape(M, rank), np.exp(rho[M * rank :])
        column = np.full((M, 1), np.sqrt(rest[0]) if form.shared else 0.0)
        kappa = rest[int(form.shared) :]
        kappa = np.broadcast_to(kappa if len(kappa) else 0.0, M)
        found.append((column, F, kappa))
    return found


def population(factor):
    """Rows, all as likely, with the mean and the covariance of another task's row."""
    spread = (M + 1.0) / (M - 1.0) * 3.0  # freedom 3 / (3 - 2)
    S = np.atleast_2d(np.cov(factor.T, bias=True)) * spread
    values, vectors = np.linalg.eigh(S)
    axes = (np.sqrt(len(S) * np.maximum(values, 0.0)) * vectors).T
    return factor.mean(axis=0) + np.vstack([axes, -axes])


def given(likelihood, theta, K_rhos, X, tasks):
    """Mean and covariance of f at new rows, with K^rho of the terms, by the book."""
    prior, values = likelihood.prior, likelihood.prior.values(theta)
    X, tasks = np.vstack([likelihood.X, X]), np.append(likelihood.tasks, tasks)
    K = values.level * np.equal.outer(tasks, tasks)
    for (kernel, _), (part, _), K_rho in zip(
        prior.terms, prior.theta_of_terms(theta), K_rhos, strict=True
    ):
        K = K + K_rho[np.ix_(tasks, tasks)] * kernel.clone_with_theta(part)(X)
    if prior.trend is not None:
        H = prior.trend.columns(X) - prior.trend.centre
        K = K + FLAT * H @ H.T
    n = len(likelihood.y)
    solved = np.linalg.solve(K[:n, :n] + values.noise[0] * np.eye(n), K[:n, n:])
    return solved.T @ likelihood.y, K[n:, n:] - K[n:, :n] @ solved


def book(likelihood, theta, X, tasks):
    """The same of tasks of the population: moments of a mixture."""
    parts = loadings_of(likelihood.prior, theta)
    rows = population(np.hstack([F for _, F, _ in parts]))
    ends = np.cumsum([F.shape[1] for _, F, _ in parts])[:-1]
    means, covariances = [], []
    for pair in product(rows, repeat=2):
        K_rhos = []
        split = np.split(np.array(pair), ends, axis=1)
        for (column, F, kappa), more in zip(parts, split, strict=True):
            of_all = np.hstack([column[[0] * (M + 2)], np.vstack([F, more])])
            K_rho = of_all @ of_all.T + np.diag([*kappa, *[kappa.mean()] * 2])
            K_rhos.append(K_rho)
        mean, covariance = given(likelihood, theta, K_rhos, X, tasks)
        means.append(mean)
        covariances.append(covariance)
    between = np.cov(np.transpose(means), bias=True)
    return np.mean(means, axis=0), np.mean(covariances, axis=0) + between


def agrees(posterior, expected, X=NEW, tasks=OF_NEW):
    mean, covariance = expected
    np.testing.assert_allclose(posterior.mean(X, tasks), mean, **CLOSE)
    variance = posterior.variance(X, tasks)
    np.testing.assert_allclose(variance, np.diagonal(covariance), **CLOSE)
    np.testing.assert_allclose(posterior.covariance(X, tasks), covariance, **CLOSE)
    of_terms = posterior.means_of_terms(X, tasks)
    np.testing.assert_allclose(of_terms.sum(axis=0), mean, **CLOSE)


@every_case
@pytest.mark.parametrize("inducing", [False, True], ids=["dense", "sparse"])
@pytest.mark.parametrize("levels", [False, True], ids=["no levels", "levels"])
def test_by_the_book(terms, inducing, levels):
    rows = draw()
    likelihood, theta = make(
        terms, levels=levels, rows=rows, Z=rows[0] if inducing else None
    )
    posterior = likelihood.posterior(theta)
    agrees(posterior.with_unseen(2), book(likelihood, theta, NEW, OF_NEW))
    assert posterior.K_rho.shape[-1] == M  # it is another one


@pytest.mark.parametrize("inducing", [False, True], ids=["dense", "sparse"])
@pytest.mark.parametrize("name", ["one", "two"])
def test_with_a_trend(name, inducing):
    rows, trend = draw(), make_trend()
    likelihood, theta = make(
        TERMS[name], trend=trend, rows=rows, Z=rows[0] if inducing else None
    )
    X = NEW * [1.0, 0.9]
    posterior = likelihood.posterior(theta).with_unseen(2)
    mean, covariance = book(likelihood, theta, X, OF_NEW)
    np.testing.assert_allclose(posterior.mean(X, OF_NEW), mean, rtol=1e-4)
    found = posterior.covariance(X, OF_NEW)
    np.testing.assert_allclose(found, covariance, rtol=1e-4, atol=1e-5)
    found = posterior.variance(X, OF_NEW)
    np.testing.assert_allclose(found, np.diagonal(covariance), rtol=1e-4)


@pytest.mark.parametrize("levels", [False, True], ids=["no levels", "levels"])
@pytest.mark.parametrize("name", ["one", "diagonal", "full rank"])
def test_complete_data(name, levels):
    [(kernel, form)] = TERMS[name]
    inputs = draw()[0][:5]
    X, tasks = np.tile(inputs, (M, 1)), np.repeat(np.arange(M), 5)
    y = np.random.default_rng(2).standard_normal(len(X))
    likelihood = building.kronecker(kernel, form, X, tasks, y, levels=levels)
    theta = likelihood.prior.theta(K_rho=np.eye(M) + 0.5)
    theta += 0.3 * np.random.default_rng(3).standard_normal(len(theta))
    expected = book(likelihood, theta, NEW, OF_NEW)
    agrees(likelihood.posterior(theta).with_unseen(2), expected)


@pytest.mark.parametrize("levels", [False, True], ids=["no levels", "levels"])
def test_complete_data_and_others(levels):
    [(kernel, form)] = TERMS["one"]
    inputs = draw()[0][:5]
    X = np.vstack([np.tile(inputs, (M - 1, 1)), NEW[:2] + 0.2])
    tasks = np.r_[np.repeat(np.arange(M - 1), 5), [M - 1] * 2]
    y = np.random.default_rng(2).standard_normal(len(X))
    likelihood = building.extended(kernel, form, X, tasks, y, 1, [M - 1], levels=levels)
    theta = likelihood.prior.theta(K_rho=np.eye(M) + 0.5)
    theta += 0.3 * np.random.default_rng(3).standard_normal(len(theta))
    expected = book(likelihood, theta, NEW, OF_NEW)
    agrees(likelihood.posterior(theta).with_unseen(2), expected)


def test_tasks_without_data_have_the_mean_function_in_common():
    likelihood, theta = make(TERMS["one"], levels=True)
    posterior = likelihood.posterior(theta).with_unseen(2)
    X = NEW[[0, 0, 0]]
    C = posterior.covariance(X, np.array([M, M, M + 1]))
    assert 0.0 < C[0, 2] < 0.9 * C[0, 1]
    np.testing.assert_allclose(C[0, 1], C[0, 0])
    of_mean = posterior.posterior.covariance(X, np.array([M, M, M + 1]))
    np.testing.assert_allclose(C[0, 2], of_mean[0, 2])


def test_a_single_task_tells_nothing_of_what_tasks_differ_by():
    X, y = NEW[:3], np.array([0.3, -0.2, 0.5])
    form, tasks = low_rank(1, 1, shared=True), np.zeros(3, dtype=int)
    likelihood = building.dense(RBF(1.0), form, X, tasks, y)
    theta = likelihood.prior.theta()
    posterior = likelihood.posterior(theta).with_unseen(1)
    known, unseen = np.zeros(3, dtype=int), np.ones(3, dtype=int)
    np.testing.assert_allclose(posterior.mean(X, unseen), posterior.mean(X, known))
    variance = posterior.variance(X, unseen)
    assert (variance > posterior.variance(X, known) + 0.01).all()


@pytest.mark.parametrize("diagonal", [False, True, "equal"])
def test_rank_0_has_nothing_that_varies(diagonal):
    form = low_rank(M, 0, diagonal, shared=True)
    likelihood, theta = make([(SLOW, form)])
    before = likelihood.posterior(theta)
    posterior = before.with_unseen(1)
    assert type(posterior) is type(before)
    a, *kappa = np.exp(likelihood.prior.values(theta).rho)
    expected = [a] * M + [a + (np.mean(kappa) if kappa else 0.0)]
    np.testing.assert_allclose(posterior.K_rho[M], expected)
    np.testing.assert_array_equal(posterior.K_rho[:M, :M], before.K_rho)
