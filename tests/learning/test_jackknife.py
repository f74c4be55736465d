"""Errors of left-out samples, against learning again without each of them."""

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning import jackknife
from skmtgp.learning.evidence import climb_posterior
from skmtgp.learning.jackknife import relearned
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
    return relearned(likelihood, theta), actual, np.sqrt(variance)


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
    assert (relearned(model.likelihood(), theta) == 0.0).all()


def test_the_step_hardly_matters(monkeypatch):
    model, _ = problem(1, 8)
    likelihood = model.likelihood()
    theta = mode(likelihood, model.theta(K_rho=np.eye(N_TASKS) + 0.5))
    found = relearned(likelihood, theta)
    monkeypatch.setattr(jackknife, "STEP", 1e-3)
    np.testing.assert_allclose(
        relearned(likelihood, theta), found, rtol=0.05, atol=2e-3
    )
