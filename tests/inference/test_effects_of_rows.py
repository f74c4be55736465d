"""Variances that count what is open of rows of F, by the book.

To be open, the row of a task has the prior of the population around what was learned:
f of that task then has the covariance mu(x)^T S S^T mu(x') more, with the means mu of
the latent functions and the covariance S S^T of the other tasks' rows.
"""

import pickle

import building
import numpy as np
import pytest
import sparse_terms
import textbook
from pairs import in_pairs
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from trend_models import NEW, OF_NEW, TERMS, M, by_hand, draw, make, make_trend

from skmtgp.inference.leeway import widened
from skmtgp.inference.open_rows import OfRow, open_rows
from skmtgp.model.population import factors_of, scale_of_open_row
from skmtgp.model.task_covariance import low_rank

CLOSE = {"rtol": 1e-8, "atol": 1e-8}
Z = np.vstack([NEW[:3], np.random.default_rng(1).standard_normal((4, 2))])
every_model = in_pairs(
    terms=TERMS,
    trend={"no trend": None, "trend": False, "trend per task": True},
    n_noise={"one noise": 1, "noise per task": M},
    levels={"levels": True, "no levels": False},
    inducing={"exact": None, "sparse": Z},
)


class Book:
    """What a likelihood and a theta say, with n x n matrices."""

    def __init__(self, likelihood, theta):
        self.rows = likelihood.X, likelihood.tasks
        sparse = hasattr(likelihood, "Z")
        Z = likelihood.Z if sparse else likelihood.X
        self.book, self.Z = sparse_terms.book(likelihood, theta, Z), sparse and Z
        self.of = self.book.explained if sparse else self.book.prior
        self.K = self.of(*self.rows, *self.rows) + np.diag(self.book.noise)
        self.factors, self.y = factors_of(likelihood.prior, theta), likelihood.y
        self.trend = likelihood.prior.trend

    def columns(self, X, tasks):
        """Of the trend."""
        if self.trend is None:
            return np.zeros((len(X), 0))
        return by_hand(self.trend, X, tasks)

    def latents(self, X):
        """mu(X), of shape (n_samples, rank)."""
        (rows, tasks), H = self.rows, self.columns(*self.rows)
        solved = np.linalg.solve(self.K, np.column_stack([H, self.y]))
        beta = np.linalg.lstsq(H.T @ solved[:, :-1], H.T @ solved[:, -1])[0]
        alpha = solved[:, -1] - solved[:, :-1] @ beta
        found = []
        for F, (k, _) in zip(self.factors, self.book.terms, strict=True):
            K_x = k(X, rows)
            if self.Z is not False:
                K_x = k(X, self.Z) @ np.linalg.solve(k(self.Z), k(self.Z, rows))
            found.append(K_x @ (F[tasks] * alpha[:, None]))
        return np.hstack(found)

    def scale(self, task):
        """S, which is in units of the latent functions."""
        X = self.rows[0] if self.Z is False else self.Z
        sizes = np.concatenate(
            [
                np.full(F.shape[1], np.sqrt(np.trace(k(X)) / len(X)))
                for F, (k, _) in zip(self.factors, self.book.terms, strict=True)
            ]
        )
        others = np.delete(np.hstack(self.factors), task, axis=0)
        return scale_of_open_row(others * sizes) / sizes[:, None]

    def opened(self, task, X, tasks, of_X, of_tasks):
        """What the prior covariance has more if the row of a task is open."""
        scale = self.scale(task)
        left = (tasks == task)[:, None] * self.latents(X) @ scale
        right = (of_tasks == task)[:, None] * self.latents(of_X) @ scale
        return left @ right.T

    def covariance(self, task, X, tasks):
        """Of f(X) with the row of a task open."""
        new, rows = (X, tasks), self.rows
        H, H_star = self.columns(*rows), self.columns(*new)
        K = self.K + self.opened(task, *rows, *rows)
        K_star = self.of(*rows, *new) + self.opened(task, *rows, *new)
        prior = self.book.prior(*new, *new) + self.opened(task, *new, *new)
        return _kriged(self.y, K, H, K_star, H_star, prior)[1]

    def left_out(self, task, i):
        """Variance of an observation of a task given the others, its row open."""
        rest = np.delete(np.arange(len(self.y)), i)
        K, H = self.K[np.ix_(rest, rest)], self.columns(*self.rows)
        mu = self.latents(self.rows[0])
        G = (self.rows[1] == task)[:, None] * mu
        scale = self.scale(task)
        precision = np.linalg.inv(scale @ scale.T) + G.T @ _projected(self.K, H) @ G
        given = K, H[rest], self.K[rest][:, [i]], H[[i]], self.K[i, i]
        slopes = [mu[i, a] - _kriged(of[rest], *given)[0] for a, of in enumerate(G.T)]
        r = np.concatenate(slopes)
        variance = _kriged(self.y[rest], *given)[1].item()
        if self.Z is not False:
            variance += self.book.left(*self.rows)[i, i]
        return variance + r @ np.linalg.solve(precision, r)


def _projected(K, H):
    """K^{-1} without what the columns of a trend explain."""
    P = np.linalg.inv(K)
    return P - P @ H @ np.linalg.solve(H.T @ P @ H, H.T @ P) if H.shape[1] else P


def _kriged(y, K, H, K_star, H_star, prior):
    """Mean and covariance given y, with a trend or without."""
    if H.shape[1]:
        return textbook.universal_kriging(K, H, y, K_star, H_star, prior)[:2]
    solved = np.linalg.solve(K, K_star)
    return solved.T @ y, prior - K_star.T @ solved


def opened(likelihood, theta, tasks=None):
    posterior = likelihood.posterior(theta)
    tasks = range(likelihood.prior.n_tasks) if tasks is None else tasks
    leeway = open_rows(posterior, likelihood, tasks)
    return widened(posterior, likelihood, leeway)


def check(likelihood, theta, new, of_new):
    found, book = opened(likelihood, theta), Book(likelihood, theta)
    covariance, variance = (
        of(new, of_new) for of in (found.covariance, found.variance)
    )
    np.testing.assert_allclose(np.diagonal(covariance), variance, rtol=1e-9)
    least = found.posterior.covariance(new, of_new)
    for task in np.unique(of_new):
        rows = of_new == task
        expected = book.covariance(task, new, of_new)
        of_task = np.ix_(rows, rows)
        np.testing.assert_allclose(covariance[of_task], expected[of_task], **CLOSE)
        between = np.ix_(rows, ~rows)
        np.testing.assert_array_equal(covariance[between], least[between])
    return found, book


@every_model
def test_variances(terms, trend, n_noise, levels, inducing):
    trend = None if trend is None else make_trend(trend)
    check(*make(terms, n_noise, levels, trend, Z=inducing), NEW, OF_NEW)


@every_model
def test_leave_one_out(terms, trend, n_noise, levels, inducing):
    trend = None if trend is None else make_trend(trend)
    likelihood, theta = make(terms, n_noise, levels, trend, Z=inducing)
    found, book = opened(likelihood, theta), Book(likelihood, theta)
    residual, of_y = found.leave_one_out(include_noise=True)
    _, of_f = found.leave_one_out()
    for i in range(0, len(of_y), 5):
        expected = book.left_out(likelihood.tasks[i], i)
        np.testing.assert_allclose(of_y[i], expected, rtol=1e-7)
    np.testing.assert_allclose(of_y - of_f, book.book.noise, rtol=1e-7)
    known = found.posterior.leave_one_out()[0]
    np.testing.assert_array_equal(residual, known)


def complete(n_tasks=4, kept=slice(None)):
    """Data whose tasks have the same inputs, in an order of their own."""
    rng, x = np.random.default_rng(0), np.linspace(0.0, 6.0, 7)
    order = rng.permutation(7 * n_tasks)[kept]
    X, tasks = np.tile(x, n_tasks)[order, None], np.repeat(range(n_tasks), 7)[order]
    y = np.sin(X[:, 0]) * (tasks - 0.5) + 0.1 * rng.standard_normal(len(X))
    return X, tasks, y


def theta_of(prior):
    theta = 0.3 * np.random.default_rng(2).standard_normal(prior.n_theta)
    theta[prior.of_noise] = np.log([0.05, 0.1, 0.02, 0.04])[: prior.n_noise]
    return theta


@pytest.mark.parametrize("levels", [False, True])
@pytest.mark.parametrize("kept", [slice(None), slice(3, None)], ids=["all", "gaps"])
def test_complete_data(kept, levels):
    form, new = low_rank(4, 2), np.linspace(-1.0, 7.0, 9)[:, None]
    likelihood = building.kronecker(
        RBF(1.0), form, *complete(kept=kept), n_noise=4, levels=levels
    )
    theta, of_new = theta_of(likelihood.prior), np.arange(9) % 4
    found, book = check(likelihood, theta, new, of_new)
    _, variance = found.leave_one_out(include_noise=True)
    for i in range(0, len(variance), 5):
        expected = book.left_out(likelihood.tasks[i], i)
        np.testing.assert_allclose(variance[i], expected, rtol=1e-7)


@pytest.mark.parametrize("levels", [False, True])
def test_novel_tasks_beside_complete_data(levels):
    X, tasks, y = complete(kept=slice(2, None))
    rows = np.vstack([X, [[0.3], [4.4], [2.2]]]), np.append(tasks, [4, 4, 5])
    rows = *rows, np.append(y, [0.4, -0.2, 0.1])
    form, new = low_rank(6, 2, diagonal=True), np.linspace(-1.0, 7.0, 12)[:, None]
    likelihood = building.extended(
        RBF(1.0), form, *rows, 1, novel=[4, 5], levels=levels
    )
    check(likelihood, theta_of(likelihood.prior), new, np.arange(12) % 6)


@pytest.mark.parametrize("rank", [2, 4])
def test_next_to_no_noise(rank):
    """Variances are still what the data leave open."""
    X, tasks, y = complete()
    given, form = (X, tasks, y), low_rank(4, rank)
    models = [
        building.dense(RBF(1.0), form, *given),
        building.kronecker(RBF(1.0), form, *given),
        building.sparse(RBF(1.0), form, *given, np.unique(X)[:, None]),
    ]
    theta = theta_of(models[0].prior)
    theta[-1], new = np.log(1e-8), np.linspace(-1.0, 7.0, 9)[:, None]
    of_new = np.arange(9) % 4
    dense, *others = (opened(model, theta).variance(new, of_new) for model in models)
    for found in others:
        np.testing.assert_allclose(found, dense, rtol=1e-4, atol=1e-8)


def test_some_tasks_are_open():
    likelihood, theta = make(TERMS["one"])
    found = opened(likelihood, theta, [1])
    variance, least = (
        of.variance(NEW, OF_NEW) for of in (found, likelihood.posterior(theta))
    )
    assert (variance[OF_NEW == 1] > least[OF_NEW == 1]).all()
    np.testing.assert_array_equal(variance[OF_NEW != 1], least[OF_NEW != 1])
    np.testing.assert_array_equal(
        found.mean(NEW, OF_NEW), found.posterior.mean(NEW, OF_NEW)
    )


def test_a_task_without_rows_is_one_of_the_population():
    X, tasks, y = draw()
    kept = tasks != 1
    likelihood, theta = make(TERMS["one"], rows=(X[kept], tasks[kept], y[kept]))
    check(likelihood, theta, NEW, OF_NEW)


@pytest.mark.parametrize("inducing", [None, Z], ids=["exact", "sparse"])
def test_order_of_rows_and_axes_of_the_factor_do_not_matter(inducing):
    (X, tasks, y), turn = draw(), np.linalg.qr([[1.0, 2.0], [3.0, 1.0]])[0]
    likelihood, theta = make(TERMS["one"], Z=inducing)
    mask, turned = likelihood.prior.of_factor, theta.copy()
    turned[mask] = (theta[mask].reshape(M, 2) @ turn).ravel()
    order = np.random.default_rng(0).permutation(len(y))
    if inducing is None:  # whose rows are sorted by task
        order = order[np.argsort(tasks[order], kind="stable")]
    other, _ = make(TERMS["one"], rows=(X[order], tasks[order], y[order]), Z=inducing)
    of_both = [opened(likelihood, theta), opened(other, turned)]
    found = [of.variance(NEW, OF_NEW) for of in of_both]
    np.testing.assert_allclose(*found, rtol=1e-9)


def test_tasks_without_data():
    likelihood, theta = make([(RBF(1.0), low_rank(M, 2, shared=True))])
    found, unseen = opened(likelihood, theta), np.full(len(NEW), M)
    larger, known = (of.with_unseen(1) for of in (found, likelihood.posterior(theta)))
    np.testing.assert_array_equal(
        larger.variance(NEW, unseen), known.variance(NEW, unseen)
    )
    np.testing.assert_allclose(
        larger.variance(NEW, OF_NEW), found.variance(NEW, OF_NEW), rtol=1e-12
    )


def test_nothing_is_computed_before_it_is_asked_for():
    found = opened(*make(TERMS["two"]))
    known = pickle.dumps(found)
    found.mean(NEW, OF_NEW)
    found.level_variances()
    assert not found.effects
    variance = found.variance(NEW, OF_NEW)
    assert sorted(found.effects) == [0, 1, 2]
    assert pickle.dumps(found) == known
    np.testing.assert_array_equal(pickle.loads(known).variance(NEW, OF_NEW), variance)


def test_units_of_terms_do_not_matter():
    """Amplitudes of kernels, times rows of F that are as much smaller."""
    terms, found = TERMS["two"], []
    for amplitude in (1.0, 1e6):
        kernels = ConstantKernel(1.0, "fixed"), ConstantKernel(amplitude, "fixed")
        given = [(a * k, form) for a, (k, form) in zip(kernels, terms, strict=True)]
        likelihood, theta = make(given)
        second = likelihood.prior.of_factors[1]
        theta[second] /= np.sqrt(amplitude)
        found.append(opened(likelihood, theta).variance(NEW, OF_NEW))
    np.testing.assert_allclose(*found, rtol=1e-6)


def test_a_column_that_one_task_has_is_not_open():
    likelihood, theta = make(TERMS["one"])
    F = theta[likelihood.prior.of_factor].reshape(M, 2)
    F[:2, 1] = 0.0
    theta[likelihood.prior.of_factor] = F.ravel()
    leeway = open_rows(likelihood.posterior(theta), likelihood, range(M))
    assert all((of.axes[0][:, 0] != 0.0).all() for of in leeway)
    assert all((of.axes[0][:, 1] == 0.0).all() for of in leeway)
    F[1] = F[2] = 0.0
    theta[likelihood.prior.of_factor] = F.ravel()
    assert open_rows(likelihood.posterior(theta), likelihood, range(M)) == ()


def test_rows_that_have_gone_are_not_forgotten():
    """What is open is that of the rows from which it was learned."""
    likelihood, theta = make(TERMS["one"])
    kept = np.arange(len(likelihood.y)) % 3 > 0
    rows = [of[kept] for of in (likelihood.X, likelihood.tasks, likelihood.y)]
    fewer, _ = make(TERMS["one"], rows=rows)
    leeway = opened(likelihood, theta).axes
    leeway = tuple(OfRow(task, axes) for task, axes in leeway.items())
    learned, again = (
        widened(fewer.posterior(theta), fewer, leeway).variance(NEW, OF_NEW),
        opened(fewer, theta).variance(NEW, OF_NEW),
    )
    assert (learned < again).all()


def test_a_task_with_a_column_of_its_own_has_joined():
    likelihood, theta = make(TERMS["one"])
    leeway = open_rows(likelihood.posterior(theta), likelihood, range(M))
    larger = low_rank(M, 3)
    joined = building.dense(TERMS["one"][0][0], larger, *draw(), n_noise=1, levels=True)
    wider = np.insert(theta, likelihood.prior.of_factor.nonzero()[0][1::2] + 1, 0.0)
    found = [
        widened(of.posterior(at), of, leeway).variance(NEW, OF_NEW)
        for of, at in ((likelihood, theta), (joined, wider))
    ]
    np.testing.assert_allclose(*found, rtol=1e-10)
