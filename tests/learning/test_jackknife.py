"""Errors of left-out samples, against learning again without each of them."""

from dataclasses import replace

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp.inference.open_rows import OfRow, OpenRows
from skmtgp.learning import jackknife
from skmtgp.learning.climbing import climb
from skmtgp.learning.evidence import climb_posterior
from skmtgp.learning.jackknife import relearned, with_growth
from skmtgp.model.task_covariance import identity, low_rank

N_TASKS = 3


def problem(rank, rows, skipped=None):
    """Of rows of three tasks, without one of them."""
    rng = np.random.default_rng(3)
    tasks = np.repeat(np.arange(N_TASKS), rows)
    x = rng.uniform(0.0, 6.0, len(tasks))
    y = np.sin(x) * (tasks - 0.5) + 0.2 * rng.standard_normal(len(x))
    kept = np.arange(len(x)) != skipped
    form = low_rank(N_TASKS, rank) if rank else identity(N_TASKS)
    data = building.data(x[kept, None], tasks[kept], y[kept], N_TASKS)
    return building.problem(RBF(1.0), form, data), (x[:, None], tasks, y)


def mode(likelihood, theta):
    peak = climb_posterior(likelihood, theta, tol=1e-9)
    return peak.density.theta(peak.x)


def without_each(rank, rows):
    """Growth of residuals: by the formula, and by learning again; and deviations."""
    whole, (X, tasks, y) = problem(rank, rows)
    likelihood = whole.likelihood()
    theta = mode(likelihood, whole.theta(K_rho=np.eye(N_TASKS) + 0.5))
    residual, variance = likelihood.posterior(theta).leave_one_out(include_noise=True)
    actual = np.empty(len(y))
    for i in range(len(y)):
        left = problem(rank, rows, skipped=i)[0].likelihood()
        posterior = left.posterior(mode(left, theta))
        actual[i] = y[i] - posterior.mean(X[[i]], tasks[[i]])[0] - residual[i]
    return relearned(likelihood, theta)[0], actual, np.sqrt(variance)


@pytest.mark.parametrize("rank", [1, 2])
def test_against_learning_again(rank):
    """Most of what residuals grow by is told."""
    formula, actual, deviation = without_each(rank, 12)
    formula, actual = formula / deviation, actual / deviation
    assert np.square(actual).mean() > 0.09**2
    assert np.square(formula - actual).mean() < 0.25 * np.square(actual).mean()
    assert np.corrcoef(formula, actual)[0, 1] > 0.95


def test_many_rows_stay():
    model, _ = problem(1, 60)
    theta = model.theta(K_rho=np.eye(N_TASKS) + 0.5)
    growth, n_evaluations = relearned(model.likelihood(), theta)
    assert (growth == 0.0).all()
    assert n_evaluations == 0


def test_the_step_hardly_matters(monkeypatch):
    model, _ = problem(1, 8)
    likelihood = model.likelihood()
    theta = mode(likelihood, model.theta(K_rho=np.eye(N_TASKS) + 0.5))
    found, _ = relearned(likelihood, theta)
    monkeypatch.setattr(jackknife, "STEP", 1e-3)
    np.testing.assert_allclose(
        relearned(likelihood, theta)[0], found, rtol=0.15, atol=0.01
    )


class TestFactor:
    """What variances are multiplied by."""

    def learned(self, rows, rank=1, **changes):
        model, _ = problem(rank, rows, **changes)
        mode = climb(model, model.theta(K_rho=np.eye(N_TASKS) + 0.5))
        posterior = model.likelihood_at(mode).posterior(mode.theta)
        return model, mode, posterior

    @pytest.mark.parametrize("open_", [(), (OfRow(1, [np.array([[0.3]])]),)])
    def test_by_its_definition(self, open_):
        model, mode, posterior = self.learned(8)
        mode = mode._replace(leeway=open_)
        likelihood = model.likelihood_at(mode)
        residual, known = posterior.leave_one_out(include_noise=True)
        growth, n_evaluations = relearned(likelihood, mode.theta)
        variance = known
        if open_:
            opened = OpenRows(posterior, likelihood, list(open_))
            _, variance = opened.leave_one_out(include_noise=True)
        after = np.clip((residual + growth) / np.sqrt(variance), -4.0, 4.0)
        before = residual / np.sqrt(known)
        expected = (1.0 + after @ after) / (1.0 + before @ before)
        grown = with_growth(model, mode, posterior)
        assert grown.n_evaluations == mode.n_evaluations + n_evaluations
        found = grown.leeway
        assert found[:-1] == open_
        assert found[-1].times == pytest.approx(expected)
        assert found[-1].times > 1.02

    def test_many_rows_need_none(self):
        model, mode, posterior = self.learned(60)
        grown = with_growth(model, mode, posterior)
        assert grown.leeway == ()
        assert grown.n_evaluations == mode.n_evaluations

    def test_fewer_rows_need_more(self):
        times = [with_growth(*self.learned(n)).leeway[0].times for n in (6, 12, 24)]
        assert times[0] > times[1] > times[2] > 1.0

    def test_nothing_was_learned(self):
        model, mode, posterior = self.learned(8)
        kept = replace(model, budget=replace(model.budget, max_iter=0))
        assert with_growth(kept, mode, posterior) is mode

    def test_what_cannot_be_left_out_stays(self, monkeypatch):
        learned = self.learned(8)

        def fail(*args, **options):
            raise ValueError("Without one of 2 rows nothing tells a coefficient")

        monkeypatch.setattr(jackknife, "_left_out", fail)
        grown = with_growth(*learned)
        assert grown.leeway == ()
        assert grown.n_evaluations > learned[1].n_evaluations

    def test_no_noise(self):
        """Its variance is at the least, and stays there without a row."""
        x, tasks = np.linspace(0.0, 6.0, 45), np.arange(45) % N_TASKS
        X, y = np.column_stack([x, tasks]), np.sin(x) * (1.0 + tasks)
        model = MultiTaskGPRegressor(rank=1).fit(X, y)
        assert model.variance_factor_ < 2.0

    @pytest.mark.parametrize(
        "changed", [{"N_DIRECTIONS": 4}, {"MOST_AXES": 2}, {"MOST_ROWS": 9}]
    )
    def test_many_hyperparameters(self, monkeypatch, changed):
        """In some directions across all, or by the Fisher information."""
        learned = self.learned(12)
        exact = with_growth(*learned).leeway[0].times
        for name, value in changed.items():
            monkeypatch.setattr(jackknife, name, value)
        found = with_growth(*learned).leeway[0].times
        assert found != exact
        assert 0.5 < np.log(found) / np.log(exact) < 2.0
