from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from scipy.stats import multivariate_t
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.inference.border import BorderLikelihood, PairedBorder
from skmtgp.inference.engines import Dense
from skmtgp.learning import novel
from skmtgp.learning.novel import (
    Population,
    Posed,
    learn_border,
    learn_novel,
    leeway_of,
)
from skmtgp.learning.problem import Budget
from skmtgp.learning.tuning import Tuning
from skmtgp.model.population import scale_of_open_row
from skmtgp.model.task_covariance import low_rank

M, RANK, NOISE = 5, 2, 0.01
KERNEL = ConstantKernel(1.0) * RBF([1.0, 1.5])
BUDGET = Budget(max_iter=1000, tol=1e-8)


class Problem:
    """A model with its true parameters, and samples of a novel task."""

    def __init__(self, n_new=8, *, seed=0, diagonal=False, per_task=False):
        rng = np.random.default_rng(seed)
        self.tasks = np.repeat(np.arange(M), 8)
        self.X, self.X_new = rng.normal(size=(8 * M, 2)), rng.normal(size=(n_new, 2))
        self.F, self.row = rng.normal(size=(M, RANK)), rng.normal(size=RANK)
        K_x = KERNEL(np.vstack([self.X, self.X_new]))
        K_x += 1e-10 * np.eye(len(K_x))
        z = np.linalg.cholesky(K_x) @ rng.standard_normal((len(K_x), RANK))
        of_rows = np.vstack([self.F[self.tasks], np.tile(self.row, (n_new, 1))])
        y = (of_rows * z).sum(axis=1) + np.sqrt(NOISE) * rng.standard_normal(len(z))
        self.y, self.y_new = y[: 8 * M], y[8 * M :]
        form = low_rank(M, RANK, diagonal)
        log_noise = np.log(NOISE) + np.arange(M if per_task else 1)
        self.likelihood = building.dense(
            KERNEL, form, self.X, self.tasks, self.y, n_noise=len(log_noise)
        )
        log_kappa = np.full(M if diagonal else 0, np.log(0.01))
        parts = [KERNEL.theta, self.F.ravel(), log_kappa, log_noise]
        self.theta = np.concatenate(parts)
        self.posterior = self.likelihood.posterior(self.theta)

    def border(self, own=False, noise=NOISE, kind=BorderLikelihood):
        return kind(self.posterior, self.F, self.X_new, self.y_new, noise, own)


def learn(problem, own=False, informed=False, **changes):
    border, budget = problem.border(own), replace(BUDGET, **changes)
    return border, learn_border(Posed(border, problem.F), budget, informed=informed)


def objective(border, F, informed):
    """What is maximised, as a function of the row."""
    rows = Population(F, border.own)

    def value(row):
        prior = rows.log_prior(rows.coordinates(row))[0] if informed else 0.0
        return border.value(row) + prior

    return value


class TestPopulation:
    @pytest.mark.parametrize("shape", [(1, 1), (4, 1), (5, 3), (3, 3), (1, 2)])
    @pytest.mark.parametrize("own", [False, True])
    def test_coordinates(self, shape, own):
        rng = np.random.default_rng(0)
        rows, u = (
            Population(rng.normal(size=shape), own),
            rng.normal(size=shape[1] + own),
        )
        assert len(rows.lower) == len(u)
        np.testing.assert_allclose(rows.coordinates(rows.row(u)), u, atol=1e-8)

    def test_the_population_is_that_of_the_rows(self):
        F = np.random.default_rng(0).normal(size=(6, 3))
        rows = Population(F, own=False)
        u = np.array([rows.coordinates(row) for row in F])
        np.testing.assert_allclose(u.mean(axis=0), 0.0, atol=1e-12)
        np.testing.assert_allclose(u.T @ u / 6, np.eye(3), atol=1e-5)

    def test_w_is_measured_by_the_rows(self):
        F = np.array([[3.0, 4.0], [0.0, 5.0]])
        rows = Population(F, own=True)
        np.testing.assert_allclose(rows.row([0.0, 0.0, 2.0]), [1.5, 4.5, 10.0])
        assert rows.row(rows.lower)[-1] == pytest.approx(5e-6)  # it stays positive

    @pytest.mark.parametrize("shape", [(7, 2), (3, 3), (1, 1)])
    @pytest.mark.parametrize("own", [False, True])
    def test_prior_is_a_multivariate_t(self, shape, own):
        rng = np.random.default_rng(0)
        rows, rank = Population(rng.normal(size=shape), own), shape[1]
        student = multivariate_t(
            np.zeros(rank), np.eye(rank), df=max(shape[0] - rank, 1)
        )
        for u in rng.normal(scale=3.0, size=(4, rank + own)):
            value, gradient = rows.log_prior(u)
            shared = np.atleast_1d(u[:rank])
            expected = student.logpdf(shared) - student.logpdf(np.zeros(rank))
            np.testing.assert_allclose(value, expected, rtol=1e-10)
            expected = textbook.derivative(lambda u: rows.log_prior(u)[0], u)
            np.testing.assert_allclose(gradient, expected, rtol=1e-8, atol=1e-9)
            if own:
                assert gradient[-1] == 0.0

    def test_rows_that_do_not_vary(self):
        nothing = np.full((4, 2), 1e-162)  # whose square underflows
        for F in (np.ones((4, 2)), np.zeros((4, 2)), np.array([[1.0, 2.0]]), nothing):
            rows = Population(F, own=True)
            np.testing.assert_allclose(rows.row(np.zeros(3))[:2], F[0])
            assert np.isfinite(rows.scale).all()
            assert (np.diagonal(rows.scale) > 0.0).all()


@pytest.mark.parametrize("own", [False, True], ids=["shared", "own"])
@pytest.mark.parametrize("informed", [False, True])
class TestLearnBorder:
    @pytest.mark.parametrize("n_new", [1, 2, 8])
    @pytest.mark.parametrize("seed", range(3))
    def test_no_row_nearby_and_no_start_is_better(self, own, informed, n_new, seed):
        problem = Problem(n_new, seed=seed)
        border, best = learn(problem, own, informed)
        value = objective(border, problem.F, informed)
        found = value(best.x)
        assert -best.value == pytest.approx(found, rel=1e-9)
        w = [0.1 * np.sqrt(np.square(problem.F).sum(axis=1).mean())] * own
        starts = [*problem.F, problem.F.mean(axis=0), np.zeros(RANK), problem.row]
        rng = np.random.default_rng(0)
        size = np.linalg.norm(best.x)
        near = [
            best.x + step * size * rng.standard_normal(len(best.x))
            for step in (1e-3, 1e-2, 0.1)
            for _ in range(50)
        ]
        for row in [*(np.append(start, w) for start in starts), *near]:
            if own and row[-1] < w[0] * 1e-5:
                continue  # beyond the bound
            assert value(row) < found + 1e-5

    @pytest.mark.parametrize("seed", range(3))
    def test_the_gradient_vanishes(self, own, informed, seed):
        problem = Problem(seed=seed)
        border, best = learn(problem, own, informed)
        rows = Population(problem.F, own)
        u = rows.coordinates(best.x)

        def gradient(u):
            slope = rows.scale.T @ border.value_and_grad(rows.row(u))[1]
            return slope + informed * rows.log_prior(u)[1]

        inside = u > rows.lower * (1.0 + 1e-6)
        assert inside[:RANK].all()
        assert best.converged
        assert np.abs(gradient(u)[inside]).max() < 1e-2
        assert (gradient(u)[~inside] <= 1e-6).all()
        assert np.abs(gradient(u + 0.1)).max() > 1.0

    @pytest.mark.parametrize("n_new", [8, pytest.param(260, marks=pytest.mark.long)])
    def test_evaluations_are_counted(self, own, informed, n_new, monkeypatch):
        problem, count = Problem(n_new), []
        evaluate = PairedBorder.evaluate

        class Counting(BorderLikelihood):
            def value_and_grad(self, row):
                count.append(row)
                return super().value_and_grad(row)

        def counted(pairs, rows):
            count.extend(rows)
            return evaluate(pairs, rows)

        monkeypatch.setattr(PairedBorder, "evaluate", counted)
        border = problem.border(own, kind=Counting)
        best = learn_border(Posed(border, problem.F), BUDGET, informed=informed)
        assert best.n_evaluations == len(count) > 0
        assert len(best.x) == RANK + own

    @pytest.mark.parametrize("n_new", [1, 2, 8])
    @pytest.mark.parametrize("seed", range(3))
    def test_both_searches_find_it(self, own, informed, n_new, seed, monkeypatch):
        """Of few samples all starts go at once, of many one after another."""
        problem = Problem(n_new, seed=seed)
        together = learn(problem, own, informed)[1]
        monkeypatch.setattr(novel, "TUNING", Tuning(together=0))
        each = learn(problem, own, informed)[1]
        assert together.value <= each.value + 1e-5

    def test_without_iterations_the_best_start_is_kept(self, own, informed):
        problem = Problem()
        border, best = learn(problem, own, informed, max_iter=0)
        value = objective(border, problem.F, informed)
        fitted = np.linalg.lstsq(border.means.T, border.y, rcond=None)[0]
        starts = [*problem.F, problem.F.mean(axis=0), fitted]
        w = [0.1 * np.sqrt(np.square(problem.F).sum(axis=1).mean())] * own
        starts = [np.append(start, w) for start in starts]
        expected = max(starts, key=value)
        np.testing.assert_allclose(best.x, expected, rtol=1e-9)
        assert best.n_iter == 0

    def test_few_starts_are_followed(self, own, informed, monkeypatch):
        problem = Problem()
        full = learn(problem, own, informed)[1]
        monkeypatch.setattr(novel, "TUNING", Tuning(followed=1))
        quick = learn(problem, own, informed)[1]
        assert quick.value >= full.value - 1e-9
        assert quick.n_evaluations < full.n_evaluations


def test_samples_without_information_leave_the_mean_of_the_rows():
    problem = Problem()
    border = problem.border(noise=1e12)
    best = learn_border(Posed(border, problem.F), BUDGET, informed=True)
    np.testing.assert_allclose(best.x, problem.F.mean(axis=0), atol=1e-5)


def test_many_samples_outweigh_the_prior():
    problem = Problem(60)
    for informed in (False, True):
        _, best = learn(problem, informed=informed)
        np.testing.assert_allclose(best.x, problem.row, atol=0.1)


def test_what_is_the_tasks_own_is_found():
    """The novel task is nothing like the others; w is its standard deviation."""
    problem = Problem(40)
    rng = np.random.default_rng(1)
    K = KERNEL(problem.X_new) + NOISE * np.eye(40)
    problem.y_new = 2.0 * np.linalg.cholesky(K) @ rng.standard_normal(40)
    _, best = learn(problem, own=True)
    assert 1.0 < best.x[-1] < 4.0
    assert np.abs(best.x[:RANK]).max() < 0.5 * best.x[-1]
    _, none = learn(Problem(40), own=True)  # a combination of the others
    assert none.x[-1] < 0.2


@pytest.mark.parametrize("position", [0, 2, M])
@pytest.mark.parametrize("diagonal", [False, True])
@pytest.mark.parametrize("per_task", [False, True])
@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("informed", [False, True])
def test_parameters_of_the_extended_model(position, diagonal, per_task, own, informed):
    own = own or diagonal
    problem = Problem(diagonal=diagonal, per_task=per_task)
    prior, mode = learn_novel(
        problem.likelihood,
        problem.posterior,
        problem.theta,
        problem.X_new,
        problem.y_new,
        position=position,
        own=own,
        own_noise=per_task,
        informed=informed,
        budget=BUDGET,
    )
    form = prior.task_covariance
    assert form.n_tasks == M + 1
    assert form.rank == RANK + (own and not diagonal)
    assert form.n_kappa == (M + 1 if diagonal else 0)
    tasks = problem.tasks + (problem.tasks >= position)
    tasks = np.append(tasks, np.full(8, position))
    order = np.argsort(tasks, kind="stable")
    X, y = np.vstack([problem.X, problem.X_new]), np.append(problem.y, problem.y_new)
    data = building.data(X[order], tasks[order], y[order], M + 1)
    assert prior.n_noise == (M + 1 if per_task else 1)
    larger = Dense().joined(problem.likelihood, prior, data, position, KERNEL)
    value = larger.value(mode.theta)
    added = value - problem.likelihood.value(problem.theta)
    np.testing.assert_allclose(added, mode.value, rtol=1e-7)
    kernel, _, log_noise = building.parts(larger, mode.theta)
    np.testing.assert_array_equal(kernel, KERNEL.theta)
    old = building.parts(problem.likelihood, problem.theta)[2]
    if per_task:  # the geometric mean of the others, which have as many rows
        old = np.insert(old, position, old.mean())
    np.testing.assert_allclose(log_noise, old, rtol=1e-15)
    assert mode.n_samples == 8
    assert mode.n_evaluations > mode.n_iter > 0
    assert mode.converged
    assert mode.seconds > 0.0


def test_nothing_is_open_where_nothing_is_known(monkeypatch):
    """Where the information is not finite."""
    problem = Problem()
    posed = Posed(problem.border(), problem.F)
    assert len(leeway_of(posed, problem.row, M)) == 1
    nothing = np.full((RANK, RANK), np.nan), np.zeros(RANK)
    monkeypatch.setattr(posed.border, "weighted", lambda row: nothing)
    assert leeway_of(posed, problem.row, M) == ()


@pytest.mark.parametrize("own", [False, True])
def test_what_is_open_of_a_row_by_the_book(own):
    """Coefficients of a regression on the latent functions, beside the population."""
    problem = Problem()
    posed, row = Posed(problem.border(own=own), problem.F), problem.row
    [of] = leeway_of(posed, np.append(row, [0.3] * own), 0)
    K = textbook.covariance(
        KERNEL, problem.F @ problem.F.T, NOISE, problem.X, problem.tasks
    )
    K_new, cross = KERNEL(problem.X_new), KERNEL(problem.X, problem.X_new)
    latents = [F[problem.tasks][:, None] * cross for F in problem.F.T]
    G = np.transpose([c.T @ np.linalg.solve(K, problem.y) for c in latents])
    c = np.tensordot(row, latents, axes=1)
    S = (row @ row + 0.09 * own) * K_new - c.T @ np.linalg.solve(K, c)
    S += NOISE * np.eye(len(S))
    size = np.sqrt(np.diagonal(K_new).mean())
    scale = scale_of_open_row(problem.F * size) / size
    precision = np.linalg.inv(scale @ scale.T) + G.T @ np.linalg.solve(S, G)
    found = of.axes[0].T @ of.axes[0]
    np.testing.assert_allclose(found, np.linalg.inv(precision), rtol=1e-6)
