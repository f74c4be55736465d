"""Tasks that are left out, at the hyperparameters that were learned with them."""

from copy import copy

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp.inference.left_out import inflation, some_of_each

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
]
M, N = 8, 12
RNG = np.random.default_rng(0)
TASK, STATES = np.repeat(np.arange(M), N), RNG.uniform(0.0, 6.0, M * N)
AGE, SIZE = RNG.uniform(1.0, 5.0, (2, M))


def fitted(noise, inference="dense"):
    """A model of tasks that are linear in two descriptors."""
    X = np.column_stack([STATES, AGE[TASK], SIZE[TASK], TASK])
    y = AGE[TASK] * np.sin(STATES) + SIZE[TASK] * np.cos(2.0 * STATES)
    y = y + noise * np.random.default_rng(1).standard_normal(len(y))
    model = MultiTaskGPRegressor(
        RBF(1.0),
        rank=2,
        task_descriptors=[1, 2],
        task_levels=False,
        normalize_y=False,
        learning="staged",
        max_iter=40,
        inference=inference,
        n_inducing=40,
    )
    return model.fit(X, y)


@pytest.fixture(scope="module")
def models():
    return {noise: fitted(noise) for noise in (0.0, 0.3)}


def of_model(model):
    """Its likelihood, and theta."""
    return model._likelihoods[0], model._posteriors[0].theta


FEW = np.full(M, 0.1)  # of the variances, so that the inflation is more than 1


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_by_conditioning_on_the_other_tasks(models, noise):
    likelihood, theta = of_model(models[noise])
    likelihood = copy(likelihood)
    more = np.random.default_rng(3).standard_normal(M * N)
    likelihood.y = likelihood.y + 0.5 * more  # so that errors are larger than usual
    K = likelihood.prior.covariance(theta, likelihood.X, likelihood.tasks)
    variance = likelihood.prior.values(theta).noise[0]
    usual = np.linspace(0.02, 0.1, M)
    found, expected = 1.0, 1.0
    for task in range(M):
        i, others = likelihood.tasks == task, likelihood.tasks != task
        K_others = K[np.ix_(others, others)] + variance * np.eye(others.sum())
        solved = np.linalg.solve(K_others, K[np.ix_(others, i)])
        v = np.diagonal(K)[i] - np.einsum("ij,ij->j", K[np.ix_(others, i)], solved)
        error = likelihood.y[i] - likelihood.y[others] @ solved
        w = v / (v + variance)
        found += np.mean(w * np.square(error) / (v + variance))
        expected += np.mean(w * (usual[task] * w + 1.0 - w))
    assert found > expected
    told = inflation(likelihood, theta, usual)
    assert told == pytest.approx(found / expected, rel=0.02)


def test_rows_that_are_all_noise_tell_nothing(models):
    likelihood, theta = of_model(models[0.3])
    theta = theta.copy()
    theta[likelihood.prior.of_factor] = 0.0
    assert inflation(likelihood, theta, FEW) == pytest.approx(1.0)


def test_it_is_never_less_than_one(models):
    for of in models.values():
        assert inflation(*of_model(of), np.full(M, 100.0)) == 1.0


def test_tasks_that_leave_no_freedom(models):
    for of in models.values():
        assert np.isfinite(inflation(*of_model(of), np.zeros(M)))


def test_targets_that_are_further_off_tell_of_more(models):
    likelihood, theta = of_model(models[0.0])
    before, y = inflation(likelihood, theta, FEW), likelihood.y
    try:
        likelihood.y = y + 0.1 * np.random.default_rng(2).standard_normal(len(y))
        assert inflation(likelihood, theta, FEW) > 10.0 * before
    finally:
        likelihood.y = y


def test_some_of_many_rows_and_inducing_inputs(models, monkeypatch):
    likelihood, theta = of_model(models[0.3])
    whole = inflation(likelihood, theta, FEW)
    monkeypatch.setattr("skmtgp.inference.left_out.MOST_ROWS", 60)
    assert whole > 1.0
    assert inflation(likelihood, theta, FEW) == pytest.approx(whole, rel=1.0)
    assert inflation(*of_model(fitted(0.3, "sparse")), FEW) >= 1.0


@pytest.mark.parametrize("n", [3997, 3996, 50])
def test_each_task_has_its_share_of_the_rows(n):
    """Whatever their order: every fourth row may be of one task."""
    interleaved = np.arange(n) % 4
    rng = np.random.default_rng(0)
    for tasks in (interleaved, np.sort(interleaved), rng.permutation(interleaved)):
        rows = some_of_each(tasks, 1000)
        assert len(rows) == min(n, 1000)
        assert (np.diff(rows) > 0).all()
        shares = np.bincount(tasks[rows], minlength=4)
        assert np.ptp(shares) <= 2


def test_inflation_does_not_depend_on_the_order_of_tasks(models, monkeypatch):
    likelihood, theta = of_model(models[0.3])
    monkeypatch.setattr("skmtgp.inference.left_out.MOST_ROWS", 12)
    expected, order = (
        inflation(likelihood, theta, FEW),
        np.arange(M * N).reshape(M, N).T,
    )
    mixed = copy(likelihood)  # row k of each task before row k + 1 of any
    mixed.X, mixed.tasks, mixed.y = (
        of[order.ravel()] for of in (likelihood.X, likelihood.tasks, likelihood.y)
    )
    assert expected > 1.0
    assert inflation(mixed, theta, FEW) == pytest.approx(expected)
