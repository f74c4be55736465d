"""The evidence by Laplace's method, against integrals by brute force."""

from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning.climbing import climb
from skmtgp.learning.evidence import beside_likelihood
from skmtgp.model.task_covariance import low_rank

M, NOISE = 2, 0.1
KERNEL = RBF(1.0, "fixed")


def problem_of(rank, n_noise_free=False, per_task=30):
    """Two tasks of which the factor alone is to be learned, or the noise too."""
    rng = np.random.default_rng(0)
    tasks = np.repeat(np.arange(M), per_task)
    X = rng.uniform(0.0, 20.0, (len(tasks), 1))
    K = textbook.covariance(KERNEL, np.array([[1.0, 0.5], [0.5, 0.8]]), NOISE, X, tasks)
    y = np.linalg.cholesky(K) @ rng.standard_normal(len(tasks))
    data = building.data(X, tasks, y, M)
    changes = {"log_noise": float(np.log(NOISE)), "tol": 1e-6}
    if not n_noise_free:
        changes["log_noise_bounds"] = (np.log(NOISE),) * 2
    return building.problem(KERNEL, low_rank(M, rank), data, **changes)


def mode_of(problem):
    return climb(problem, problem.theta(K_rho=np.array([[1.0, 0.5], [0.5, 1.0]])))


def by_brute_force(problem, mode, n_draws=40_000):
    """log E p(y | F, noise) over draws from the weak prior, near the mode alone."""
    prior, likelihood = problem.prior, problem.likelihood()
    rng, rank = np.random.default_rng(1), prior.task_covariance.rank
    F = rng.standard_normal((n_draws, M, rank)) * prior.scale / np.sqrt(rank)
    data = problem.data
    K_x, pairs = KERNEL(data.X), np.ix_(data.tasks, data.tasks)
    found = []
    for part in np.array_split(F, 40):
        K = np.einsum("kmr,klr->kml", part, part)[(slice(None), *pairs)] * K_x
        K[:, np.arange(len(K_x)), np.arange(len(K_x))] += NOISE
        C = np.linalg.cholesky(K)
        half = np.linalg.solve(
            C, np.broadcast_to(data.y[:, None], (len(C), len(K_x), 1))
        )
        log_det = 2.0 * np.log(np.diagonal(C, axis1=1, axis2=2)).sum(axis=1)
        fit = np.square(half).sum(axis=(1, 2))
        found.append(-0.5 * (fit + log_det + len(K_x) * np.log(2.0 * np.pi)))
    found = np.concatenate(found)
    assert likelihood.value(mode.theta) >= found.max() - 1e-6
    return np.logaddexp.reduce(found) - np.log(n_draws)


@pytest.mark.parametrize("rank", [1, 2])
def test_is_near_the_integral(rank):
    problem = problem_of(rank)
    mode = mode_of(problem)
    found = mode.value + beside_likelihood(problem.likelihood(), mode.theta)
    assert found == pytest.approx(by_brute_force(problem, mode), abs=0.3)


@pytest.mark.parametrize("rank", [1, 2])
def test_rotations_do_not_change_it(rank):
    problem = problem_of(rank)
    mode, Q = (
        mode_of(problem),
        np.linalg.qr(np.arange(rank**2).reshape(rank, rank) + 1.0),
    )
    F = mode.theta[problem.prior.of_factor].reshape(M, rank)
    turned = problem.prior.with_rho(mode.theta, (F @ Q[0]).ravel())
    likelihood = problem.likelihood()
    found = beside_likelihood(likelihood, turned)
    assert found == pytest.approx(beside_likelihood(likelihood, mode.theta), abs=1e-4)


def test_what_is_learned_is_paid_for():
    fixed, learned = problem_of(1), problem_of(1, n_noise_free=True)
    modes = mode_of(fixed), mode_of(learned)
    beside = [
        beside_likelihood(problem.likelihood(), mode.theta)
        for problem, mode in zip((fixed, learned), modes, strict=True)
    ]
    # a variance of 60 rows: log(deviation of its logarithm / that of the prior)
    assert -4.0 < beside[1] - beside[0] < -1.5


def test_flat_directions_cost_nothing():
    """A length-scale of a feature that is constant."""
    problem = problem_of(1)
    data = problem.data
    X = np.column_stack([data.X, np.zeros(len(data))])
    kernels = [
        RBF([1.0, 2.0], [(0.999, 1.001), b]) for b in ((0.1, 50), (1.999, 2.001))
    ]
    found = []
    for kernel in kernels:
        flat = building.problem(
            kernel,
            low_rank(M, 1),
            building.data(X, data.tasks, data.y, M),
            log_noise=float(np.log(NOISE)),
            log_noise_bounds=(np.log(NOISE),) * 2,
        )
        mode = mode_of(flat)
        found.append(beside_likelihood(flat.likelihood(), mode.theta))
    assert found[0] == pytest.approx(found[1], abs=1e-3)


def test_it_does_not_matter_where_what_the_rows_do_not_tell_was_left():
    """The variance of levels of tasks that have none."""
    problem = problem_of(1)
    problem = replace(problem, prior=replace(problem.prior, levels=True))
    mode, found = mode_of(problem), []
    at, likelihood = problem.prior.n_theta - 2, problem.likelihood()
    for log_level in (problem.prior.log_level_bounds[0], np.log(1e-8), np.log(1e-4)):
        theta = np.where(np.arange(len(mode.theta)) == at, log_level, mode.theta)
        value = likelihood.value(theta) + beside_likelihood(likelihood, theta)
        found.append(value)
    assert np.ptp(found) < 0.1


def test_noise_stays_as_it_was_learned():
    problem = problem_of(1, n_noise_free=True)
    mode, likelihood = mode_of(problem), problem.likelihood()
    theta = mode.theta.copy()
    theta[-1] = problem.prior.log_noise_bounds[0] + 0.1
    far = likelihood.value(theta) + beside_likelihood(likelihood, theta)
    assert far < mode.value + beside_likelihood(likelihood, mode.theta) - 15.0


@pytest.mark.parametrize("size", [0.0, 1e-9])
def test_columns_of_zeros_are_no_rotations(size):
    """Two columns more than the rows need, as where a rank is made of a lower one's."""
    problem = problem_of(1)
    K_rho, tasks = np.outer([1.0, 0.8, -0.5], [1.0, 0.8, -0.5]), np.repeat(range(3), 20)
    X = np.random.default_rng(0).uniform(0.0, 20.0, (60, 1))
    K = textbook.covariance(KERNEL, K_rho, NOISE, X, tasks)
    y = np.linalg.cholesky(K) @ np.random.default_rng(1).standard_normal(60)
    data = building.data(X, tasks, y, 3)
    low, high = (
        replace(problem, prior=problem.prior.with_form(low_rank(3, r)), data=data)
        for r in (1, 3)
    )
    mode = climb(low, low.theta(K_rho=K_rho))
    F = np.pad(mode.theta[low.prior.of_factor][:, None], ((0, 0), (0, 2)))
    F[:, 1:] = size
    theta = high.prior.with_rho(mode.theta, F.ravel())
    beside = beside_likelihood(high.likelihood(), theta)
    assert -20.0 < beside - beside_likelihood(low.likelihood(), mode.theta) < 0.0
