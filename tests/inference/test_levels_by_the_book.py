"""Levels of the tasks, integrated out: every engine says what the definition does.

cov(y_i, y_j) = v [m_i = m_j] + K^rho k^x + noise, and the levels are part of f.
"""

import gc
import weakref

import numpy as np
import pytest
import textbook
from level_models import (
    ENGINES,
    FORMS,
    KERNEL,
    NEW,
    OF_NEW,
    D,
    M,
    Rows,
    book,
    make,
)
from sklearn.gaussian_process.kernels import RBF

from skmtgp.inference import tiles
from skmtgp.inference.border import BorderLikelihood
from skmtgp.inference.posterior import freedom_of_noise
from skmtgp.model.task_covariance import low_rank

EPS = np.finfo(float).eps
EXACT = [name for name in ENGINES if "sparse" not in name]
CLOSE = {"rtol": 1e-8, "atol": 1e-9}
every_engine = pytest.mark.parametrize("engine", ENGINES)
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
every_noise = pytest.mark.parametrize("n_noise", [1, M], ids=["shared", "per task"])
every_case = pytest.mark.parametrize(
    ("n_noise", "variance"),
    [(1, 0.7), (M, 0.7), (1, 1e4), (M, None)],
    ids=["shared noise", "noise per task", "large levels", "no levels"],
)


def assert_gradient(found, function, x, step=1e-3):
    expected = textbook.derivative(function, x, step)
    atol = 1e-7 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=atol)


@every_engine
@every_form
@every_case
class TestByTheBook:
    def test_value_and_gradient(self, engine, form, n_noise, variance):
        likelihood, theta = make(engine, form, n_noise, variance)
        value, gradient = likelihood.value_and_grad(theta)
        expected = book(likelihood, theta).value()
        for found in (value, likelihood.value(theta)):
            np.testing.assert_allclose(found, expected, rtol=1e-8)
        found = likelihood.posterior(theta).log_likelihood
        np.testing.assert_allclose(found, expected, rtol=1e-8)
        assert_gradient(gradient, lambda t: book(likelihood, t).value(), theta)

    def test_posterior(self, engine, form, n_noise, variance):
        likelihood, theta = make(engine, form, n_noise, variance)
        posterior = likelihood.posterior(theta)
        mean, covariance = book(likelihood, theta).posterior(NEW, OF_NEW)
        np.testing.assert_allclose(posterior.mean(NEW, OF_NEW), mean, **CLOSE)
        of_tasks = posterior.mean_of_tasks(NEW, np.arange(M))
        of_tasks = of_tasks[np.arange(len(NEW)), OF_NEW]
        np.testing.assert_allclose(of_tasks, mean, **CLOSE)
        found = posterior.covariance(NEW, OF_NEW)
        np.testing.assert_allclose(found, covariance, **CLOSE)
        found = posterior.variance(NEW, OF_NEW)
        np.testing.assert_allclose(found, np.diagonal(covariance), **CLOSE)

    def test_levels(self, engine, form, n_noise, variance):
        likelihood, theta = make(engine, form, n_noise, variance)
        posterior = likelihood.posterior(theta)
        means, variances = book(likelihood, theta).levels()
        np.testing.assert_allclose(posterior.levels, means, **CLOSE)
        np.testing.assert_allclose(posterior.level_variances(), variances, **CLOSE)

    def test_leave_one_out(self, engine, form, n_noise, variance):
        likelihood, theta = make(engine, form, n_noise, variance)
        model, posterior = book(likelihood, theta), likelihood.posterior(theta)
        residual, of_f = model.left_out()
        noise = textbook.of_rows(model.noise, likelihood.tasks)
        for include_noise in (False, True):
            found, variances = posterior.leave_one_out(include_noise)
            np.testing.assert_allclose(found, residual, **CLOSE)
            expected = of_f + noise * include_noise
            np.testing.assert_allclose(variances, expected, **CLOSE)

    def test_latent_functions(self, engine, form, n_noise, variance):
        likelihood, theta = make(engine, form, n_noise, variance)
        F, _ = form.latent(likelihood.prior.values(theta).rho)
        means, halves = likelihood.posterior(theta).latent(NEW, F)
        expected, told = book(likelihood, theta).latent(NEW, F)
        np.testing.assert_allclose(means, expected, **CLOSE)
        found = np.einsum("ait,biu->abtu", halves, halves)
        np.testing.assert_allclose(found, told, **CLOSE)


@every_noise
@pytest.mark.parametrize("form", ["rank 1", "rank 2, diagonal"])
@pytest.mark.parametrize("n_inducing", [2, 7])
def test_gradient_by_inducing_inputs(n_inducing, form, n_noise):
    likelihood, theta = make("sparse", FORMS[form], n_noise)
    likelihood = likelihood.with_inducing(likelihood.Z[:n_inducing])
    value, gradient, d_Z = likelihood.value_and_grads(theta)
    expected = likelihood.value_and_grad(theta)
    assert value == expected[0]
    np.testing.assert_allclose(gradient, expected[1], rtol=1e-12)

    def value_at(z):
        return book(likelihood, theta)._replace(Z=z.reshape(-1, D)).value()

    assert_gradient(d_Z.ravel(), value_at, likelihood.Z.ravel())


@every_engine
@every_noise
@pytest.mark.parametrize("form", ["rank 1", "rank 2, diagonal"])
def test_gradient_by_the_task_covariance(engine, form, n_noise):
    likelihood, theta = make(engine, FORMS[form], n_noise)
    model = book(likelihood, theta)
    upper = np.triu_indices(M)

    def value_at(entries):
        K_rho = np.zeros((M, M))
        K_rho[upper] = entries
        return model._replace(K_rho=K_rho + np.triu(K_rho, 1).T).value()

    found = likelihood.task_gradient(theta)
    np.testing.assert_allclose(found, found.T, rtol=1e-12)
    twice = 2.0 * found - np.diag(np.diagonal(found))  # both halves of K^rho move
    assert_gradient(twice[upper], value_at, model.K_rho[upper], step=1e-4)


@pytest.mark.parametrize("tile", [5, 240], indirect=True)
@pytest.mark.parametrize("engine", EXACT)
def test_tiles_do_not_matter(engine, tile):
    likelihood, theta = make(engine, FORMS["rank 2, diagonal"], M)
    value, gradient = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, book(likelihood, theta).value(), rtol=1e-11)
    assert_gradient(gradient, lambda t: book(likelihood, t).value(), theta)


@pytest.mark.parametrize("size", [3, 8, 240])
@pytest.mark.parametrize("engine", ["dense", "sparse"])
def test_many_tasks_in_a_tile(engine, size, monkeypatch):
    """And tasks in several tiles."""
    monkeypatch.setattr(tiles, "TILE", size)
    rng, counts = np.random.default_rng(2), np.array([1, 2, 9, 0, 1, 1, 3, 1, 2])
    n_tasks, tasks = len(counts), np.repeat(np.arange(len(counts)), counts)
    X = rng.uniform(-2.0, 2.0, (len(tasks), D))
    y, form = rng.standard_normal(len(X)) + tasks, low_rank(n_tasks, 2)
    build, _ = ENGINES[engine]
    likelihood = build(Rows(X, tasks, y), KERNEL, form, levels=True)
    rho = rng.standard_normal(form.n_parameters)
    theta = np.concatenate([KERNEL.theta, rho, np.log([2.0, 0.1])])
    value, gradient = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, book(likelihood, theta).value(), rtol=1e-10)
    assert_gradient(gradient, lambda t: book(likelihood, t).value(), theta)


@every_engine
@every_noise
def test_tasks_without_data(engine, n_noise):
    """Their levels are the prior's, whatever the others' are."""
    build, draw = ENGINES[engine]
    rows, form = draw(), low_rank(M + 2, 2)
    tasks, rng = np.array([0, 1, 3])[rows.tasks], np.random.default_rng(3)
    n_noise = 1 if n_noise == 1 else M + 2
    rows = rows._replace(tasks=tasks)
    likelihood = build(rows, KERNEL, form, n_noise=n_noise, levels=True)
    rho, noise = rng.standard_normal(form.n_parameters), 0.1 + rng.random(n_noise)
    theta = np.concatenate([KERNEL.theta, rho, [np.log(0.6)], np.log(noise)])
    model, posterior = book(likelihood, theta), likelihood.posterior(theta)
    value, gradient = likelihood.value_and_grad(theta)
    np.testing.assert_allclose(value, model.value(), rtol=1e-8)
    assert_gradient(gradient, lambda t: book(likelihood, t).value(), theta)
    Z = np.random.default_rng(4).uniform(-2.0, 2.0, (8, D))
    of_Z = np.array([2, 4, 2, 0, 1, 3, 4, 4])
    mean, covariance = model.posterior(Z, of_Z)
    np.testing.assert_allclose(posterior.mean(Z, of_Z), mean, **CLOSE)
    np.testing.assert_allclose(posterior.covariance(Z, of_Z), covariance, **CLOSE)
    variance = posterior.variance(Z, of_Z)
    np.testing.assert_allclose(variance, np.diagonal(covariance), **CLOSE)
    means, variances = posterior.levels, posterior.level_variances()
    np.testing.assert_allclose((means, variances), model.levels(), **CLOSE)
    np.testing.assert_allclose(means[[2, 4]], 0.0, atol=1e-15)
    np.testing.assert_allclose(variances[[2, 4]], 0.6, rtol=1e-14)


@pytest.mark.parametrize(
    ("variance", "noise"),
    [(1e-10, 1e-6), (1.0, 1e-10), (1e4, 1e-2), (1e4, 1e-6), (1e4, 1e-10), (1e8, 1e-2)],
)
@pytest.mark.parametrize("engine", [*EXACT, "sparse"])
def test_accuracy(engine, variance, noise):
    """Against fifty digits.

    Where levels are in a matrix beside the noise, some v / sigma^2 of the digits are
    lost; in Kronecker and sparse algebra they are not.
    """
    likelihood, theta = make(engine, low_rank(M, 1), 1, variance, RBF(1.0))
    theta[0], theta[-1] = 0.0, np.log(noise)
    model = book(likelihood, theta)
    given = model.K_rho, model.noise[0], *model.rows
    lost = EPS / noise * (1.0 + variance * (engine in ("dense", "extended")))
    exact = textbook.exact_log_marginal_likelihood(*given, level=model.level)
    value = likelihood.value(theta)
    np.testing.assert_allclose(value, exact, rtol=1e-13 + 5.0 * lost)
    exact = textbook.exact_mean(*given, NEW, OF_NEW, level=model.level)
    found = likelihood.posterior(theta).mean(NEW, OF_NEW)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-12 + 20.0 * lost)


@every_engine
def test_levels_of_next_to_no_variance(engine):
    """The model without levels is their limit."""
    form, n_noise = FORMS["rank 2, diagonal"], M
    likelihood, theta = make(engine, form, n_noise, 1e-13)
    without, simpler = make(engine, form, n_noise, None)[0], np.delete(theta, -1 - M)
    value, gradient = likelihood.value_and_grad(theta)
    expected = without.value_and_grad(simpler)
    np.testing.assert_allclose(value, expected[0], rtol=1e-10)
    rest = np.delete(gradient, -1 - M)
    atol = 1e-9 * np.abs(rest).max()
    np.testing.assert_allclose(rest, expected[1], rtol=1e-9, atol=atol)
    assert abs(gradient[-1 - M]) < 1e-9
    assert not without.posterior(simpler).levels.any()
    assert not without.posterior(simpler).level_variances().any()


def test_memory_is_free_with_the_last_reference():
    """Matrices of each evaluation do not wait for the collection of cycles."""
    likelihood, theta = make("kronecker", FORMS["rank 1"])
    eigen = likelihood.eigen(theta)
    gone = weakref.ref(eigen)
    gc.disable()
    try:
        del eigen
        assert gone() is None
    finally:
        gc.enable()


@every_engine
def test_constants_of_tasks_are_levels(engine):
    """What is added to a task's targets only its level knows, if that may be large."""
    rows, added = ENGINES[engine][1](), np.array([5.0, -3.0, 0.5])
    moved = rows._replace(y=rows.y + added[rows.tasks])
    before, after = (
        likelihood.posterior(theta)
        for likelihood, theta in (
            make(engine, FORMS["rank 1"], 1, 1e8, rows=some) for some in (rows, moved)
        )
    )
    change = after.mean(NEW, OF_NEW) - before.mean(NEW, OF_NEW)
    np.testing.assert_allclose(change, added[OF_NEW], atol=1e-5)


@every_form
@every_noise
@pytest.mark.parametrize("engine", ["dense", "kronecker", "sparse"])
def test_fisher_information(engine, form, n_noise):
    """1/2 tr(K^-1 dK_p K^-1 dK_q), with derivatives by differences."""
    likelihood, theta = make(engine, form, n_noise)
    dK = textbook.derivative(lambda t: book(likelihood, t).K, theta)
    scores = np.linalg.solve(book(likelihood, theta).K, dK)
    expected = 0.5 * np.einsum("pij,qji->pq", scores, scores)
    found = likelihood.fisher_information(theta)
    atol = 1e-7 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=atol)


@pytest.mark.parametrize("engine", ["dense", "kronecker", "extended"])
@every_noise
def test_freedom_of_noise(engine, n_noise):
    """The trace of what is left of the identity by the matrix that smooths."""
    likelihood, theta = make(engine, FORMS["rank 1"], n_noise)
    model = book(likelihood, theta)
    noise = textbook.of_rows(model.noise, likelihood.tasks)
    left = 1.0 - np.diagonal(np.linalg.solve(model.K, model.K - np.diag(noise)))
    expected = np.bincount(likelihood.noise_of_row, left)
    found = freedom_of_noise(likelihood, likelihood.posterior(theta))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


class TestBorder:
    """A task that joins, with a level of its own."""

    LEVEL, NOISE = 0.4, 0.07

    @pytest.fixture(params=[False, True], ids=["shared", "own"])
    def own(self, request):
        return request.param

    @pytest.fixture(params=[*EXACT, "sparse"])
    def joining(self, request, own):
        """The border, its row, and mean and covariance of the new given the old."""
        likelihood, theta = make(request.param, low_rank(M, 2), M, self.LEVEL)
        F, rng = theta[3:9].reshape(M, 2), np.random.default_rng(6)
        y, row = rng.standard_normal(len(NEW)), rng.standard_normal(2 + own)
        old = likelihood.posterior(theta), F, NEW, y
        border = BorderLikelihood(*old, self.NOISE, own, self.LEVEL)
        model = book(likelihood, theta)
        X, tasks, old_y = model.rows
        X = np.vstack([X, NEW])
        tasks, n = np.append(tasks, np.full(len(NEW), M)), len(old_y)

        def conditional(row):
            shared, w = row[:2], row[2:]
            K_rho = np.block(
                [
                    [model.K_rho, (F @ shared)[:, None]],
                    [F @ shared, shared @ shared + w @ w],
                ]
            )
            noise = np.append(model.noise, self.NOISE)
            K = textbook.covariance(
                model.kernel, K_rho, noise, X, tasks, level=self.LEVEL
            )
            weights = np.linalg.solve(K[:n, :n], K[:n, n:]).T
            return weights @ old_y, K[n:, n:] - weights @ K[:n, n:]

        return border, row, conditional, y

    def test_density(self, joining):
        border, row, conditional, y = joining

        def density(row):
            mean, S = conditional(row)
            return textbook.log_marginal_likelihood(S, y - mean)

        value, gradient = border.value_and_grad(row)
        np.testing.assert_allclose(value, density(row), rtol=1e-8)
        assert_gradient(gradient, density, row)

    def test_fisher_information(self, joining):
        border, row, conditional, _ = joining
        dm = textbook.derivative(lambda row: conditional(row)[0], row)
        dS = textbook.derivative(lambda row: conditional(row)[1], row)
        inverse = np.linalg.inv(conditional(row)[1])
        scores = inverse @ dS
        expected = dm @ inverse @ dm.T
        expected += 0.5 * np.einsum("pij,qji->pq", scores, scores)
        found = border.fisher_information(row)
        atol = 1e-8 * np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=atol)
