"""The evidence by Laplace's method, against integrals by brute force."""

import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning.climbing import climb
from skmtgp.learning.evidence import climb_posterior, evidence_around
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.task_covariance import low_rank

M, NOISE = 2, 0.1
KERNEL = RBF(1.0, "fixed")


def problem_of(rank, *, noise_is_learned=False, per_task=30):
    """Two tasks of which the factor alone is to be learned, or the noise too."""
    rng = np.random.default_rng(0)
    tasks = np.repeat(np.arange(M), per_task)
    X = rng.uniform(0.0, 20.0, (len(tasks), 1))
    K = textbook.covariance(KERNEL, np.array([[1.0, 0.5], [0.5, 0.8]]), NOISE, X, tasks)
    y = np.linalg.cholesky(K) @ rng.standard_normal(len(tasks))
    data = building.data(X, tasks, y, M)
    changes = {"log_noise": float(np.log(NOISE)), "tol": 1e-6}
    if not noise_is_learned:
        changes["log_noise_bounds"] = (np.log(NOISE),) * 2
    return building.problem(KERNEL, low_rank(M, rank), data, **changes)


def mode_of(problem):
    return climb(problem, problem.theta(K_rho=np.array([[1.0, 0.5], [0.5, 1.0]])))


def evidence_of(problem):
    return evidence_around(problem.likelihood(), mode_of(problem).theta)


def by_brute_force(problem, n_draws=3_000):
    """log E p(y | theta) over draws from the weak prior."""
    hyperprior, data = Hyperprior(problem.prior), problem.data
    rng, K_x = np.random.default_rng(1), KERNEL(data.X)
    pairs = np.ix_(data.tasks, data.tasks)
    found = []
    for _ in range(n_draws):
        theta = hyperprior.draw(rng)
        K = problem.prior.K_rho_at(theta)[pairs] * K_x
        K.flat[:: len(K) + 1] += np.exp(theta[-1])
        found.append(textbook.log_marginal_likelihood(K, data.y))
    return np.logaddexp.reduce(found) - np.log(n_draws)


@pytest.mark.parametrize("rank", [2, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("noise_is_learned", [False, True])
def test_is_near_the_integral(rank, noise_is_learned):
    problem = problem_of(rank, noise_is_learned=noise_is_learned)
    assert evidence_of(problem) == pytest.approx(by_brute_force(problem), abs=0.5)


@pytest.mark.parametrize("rank", [1, 2])
def test_rotations_do_not_change_it(rank):
    problem = problem_of(rank)
    mode = mode_of(problem)
    Q = np.linalg.qr(np.arange(rank**2).reshape(rank, rank) + 1.0)[0]
    F = mode.theta[problem.prior.of_factor].reshape(M, rank)
    turned = problem.prior.with_rho(mode.theta, (F @ Q).ravel())
    found = evidence_around(problem.likelihood(), turned)
    assert found == pytest.approx(evidence_of(problem), abs=2e-3)


def test_flat_directions_cost_nothing():
    """A length-scale of a feature that is constant."""
    data = problem_of(1).data
    X = np.column_stack([data.X, np.zeros(len(data))])
    found = []
    for bounds in ("fixed", (1e-3, 4e3)):
        kernel = RBF([1.0, 2.0], [(0.999, 1.001), (0.1, 40.0)])
        if bounds == "fixed":
            kernel = RBF([1.0, 2.0], [(0.999, 1.001), (1.999, 2.001)])
        flat = building.problem(
            kernel,
            low_rank(M, 1),
            building.data(X, data.tasks, data.y, M),
            log_noise=float(np.log(NOISE)),
            log_noise_bounds=(np.log(NOISE),) * 2,
        )
        found.append(evidence_of(flat))
    assert found[0] == pytest.approx(found[1], abs=0.3)


def test_a_climb_ends_where_the_posterior_is_flat():
    problem = problem_of(2, noise_is_learned=True)
    peak = climb_posterior(problem.likelihood(), mode_of(problem).theta, tol=1e-8)
    value, gradient = peak.density.polar(peak.x)
    assert value == peak.value
    values, vectors = peak.curvature()
    step = vectors.T @ gradient / np.sqrt(values)  # in deviations
    assert np.abs(step).max() < 1e-2


def test_curvature_is_that_of_the_density():
    problem = problem_of(1, noise_is_learned=True)
    peak = climb_posterior(problem.likelihood(), mode_of(problem).theta)
    values, vectors = peak.curvature()
    H = -textbook.derivative(lambda x: peak.density(x)[1], peak.x)
    np.testing.assert_allclose(vectors @ np.diag(values) @ vectors.T, H, rtol=1e-3)
