"""Noise that is correlated between neighbouring rows."""

from dataclasses import replace

import numpy as np
import pytest
import textbook
from drawn import FACTOR, KERNEL, NOISE, TRUTH, M, draw, mode_at, pose
from scipy.signal import lfilter

from skmtgp.learning import neighbours
from skmtgp.learning.neighbours import CORRELATION, correlated_share
from skmtgp.model.task_covariance import low_rank

PER_TASK = 40
N = M * PER_TASK


def at_truth(data):
    """The problem, and its mode: the parameters that the data are drawn with."""
    problem = pose(data, low_rank(M, 2), noise=NOISE)
    theta = problem.theta(kernel=TRUTH, K_rho=FACTOR @ FACTOR.T)
    return problem, mode_at(problem, theta)


def covariance(data):
    kernel = KERNEL.clone_with_theta(TRUTH)
    K_rho = FACTOR @ FACTOR.T
    return textbook.covariance(kernel, K_rho, NOISE, data.X, data.tasks)


@pytest.fixture(scope="module")
def white():
    return draw(FACTOR @ FACTOR.T, per_task=PER_TASK)


@pytest.fixture(scope="module")
def walking(white):
    """The same with three times as much noise that is correlated along the rows."""
    steps = np.random.default_rng(0).standard_normal((M, PER_TASK))
    walk = lfilter([1.0], [1.0, -0.8], steps, axis=1) * np.sqrt(3.0 * 0.36 * NOISE)
    walk -= walk.mean(axis=1, keepdims=True)  # of which the order would not matter
    return replace(white, y=white.y + walk.ravel())


def test_it_is_found_in_the_order_of_the_rows(white, walking):
    assert correlated_share(*at_truth(walking)) > 0.5
    assert correlated_share(*at_truth(white)) == 0.0
    order = np.random.default_rng(1).permutation(N)
    order = order[np.argsort(walking.tasks[order], kind="stable")]
    parts = {name: getattr(walking, name)[order] for name in ("X", "tasks", "y")}
    assert correlated_share(*at_truth(replace(walking, **parts))) == 0.0


@pytest.mark.parametrize("variance", [0.0, -1e-9, np.nan])
def test_a_variance_that_rounding_took_tells_nothing(variance):
    assert not neighbours._is_rare(variance, variance, 1.0)
    assert neighbours._is_rare(9.0, 1.0, 1e-9)


def test_levels_that_are_not_in_the_model_are_no_noise(white):
    data = replace(white, y=white.y + 0.3 * (white.tasks - 1.0))
    assert correlated_share(*at_truth(data)) == 0.0


def test_rows_need_not_be_sorted_by_task(walking):
    """Sparse inference takes them as they are."""
    order = np.argsort(np.tile(np.arange(PER_TASK), M), kind="stable")
    parts = {name: getattr(walking, name)[order] for name in ("X", "tasks", "y")}
    mixed = correlated_share(*at_truth(replace(walking, **parts)))
    assert mixed == pytest.approx(correlated_share(*at_truth(walking)))


def test_it_is_a_step_along_the_derivative(walking):
    K, tasks = covariance(walking), walking.tasks
    apart = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    pairs = np.equal.outer(tasks, tasks) & (apart > 0)
    A = NOISE * CORRELATION**apart * pairs
    A -= A[tasks == 0].sum() / pairs[tasks == 0].sum() * pairs
    h = 1e-4
    more, less = (
        textbook.log_marginal_likelihood(K + s * h * A, walking.y) for s in (1, -1)
    )
    WA = np.linalg.solve(K, A)
    expected = (more - less) / (2.0 * h) / (0.5 * np.trace(WA @ WA))
    found = correlated_share(*at_truth(walking))
    assert found == pytest.approx(expected, rel=1e-4)


def test_independent_noise_is_not_accused(white):
    rng, C = np.random.default_rng(2), np.linalg.cholesky(covariance(white))
    problem, mode = at_truth(white)
    for _ in range(200):
        data = replace(white, y=C @ rng.standard_normal(N))
        assert correlated_share(problem.with_data(data), mode) == 0.0


def test_of_many_rows_stretches_are_looked_at(walking, monkeypatch):
    problem = at_truth(walking)
    whole = correlated_share(*problem)
    monkeypatch.setattr(neighbours, "BY_CHANCE", 1e-2)
    monkeypatch.setattr(neighbours, "MOST", 90)
    monkeypatch.setattr(neighbours, "RUN", 30)
    rows, places = neighbours._neighbours(walking.tasks)
    assert len(rows) == 90
    assert (np.diff(places.reshape(3, 30)) == 1).all()
    assert correlated_share(*problem) == pytest.approx(whole, rel=0.5)


def test_noise_for_each_task(walking):
    problem, mode = at_truth(walking)
    prior, theta = problem.prior.with_own_noise(mode.theta)
    own = replace(problem, prior=prior), mode._replace(theta=theta)
    assert correlated_share(*own) == pytest.approx(correlated_share(problem, mode))


def test_few_rows_and_data_without_noise_are_not_asked(walking):
    assert correlated_share(*at_truth(walking._part(np.arange(29)))) == 0.0
    problem, mode = at_truth(walking)
    theta = problem.theta(kernel=TRUTH, K_rho=FACTOR @ FACTOR.T, log_noise=np.log(1e-6))
    assert correlated_share(problem, mode._replace(theta=theta)) == 0.0


@pytest.mark.parametrize("per_task", [1, 2])
def test_tasks_of_one_or_two_rows_do_not_tell(per_task):
    data = draw(np.eye(40), per_task=per_task, M=40)
    problem = pose(data, low_rank(40, 1), noise=NOISE)
    theta = problem.theta(kernel=TRUTH, K_rho=np.ones((40, 40)))
    with np.errstate(all="raise"):
        assert correlated_share(problem, mode_at(problem, theta)) == 0.0
