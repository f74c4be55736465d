"""Likelihoods in single precision, where data have enough noise for it."""

from dataclasses import replace

import building
import numpy as np
import pytest
from drawn import FACTOR, KERNEL, TRUTH, M, draw, pose, start_of

from skmtgp.inference import dense
from skmtgp.learning.climbing import climb
from skmtgp.learning.tuning import TUNING
from skmtgp.model.task_covariance import low_rank


@pytest.fixture(autouse=True)
def few_are_many(monkeypatch):
    monkeypatch.setattr(dense, "IN_SINGLE", range(30, 4001))


@pytest.fixture
def factorised(monkeypatch):
    """Sides of the matrices that were factorised in single precision."""
    sides, cholesky = [], dense.SingleCholesky

    def factorise(K):
        sides.append(len(K))
        return cholesky(K)

    monkeypatch.setattr(dense, "SingleCholesky", factorise)
    return sides


@pytest.fixture(scope="module")
def data():
    return draw(FACTOR @ FACTOR.T, per_task=20)


def likelihood(data, n_noise=1):
    prior = building.prior(KERNEL, low_rank(M, 2), n_noise)
    return dense.DenseLikelihood(prior, data.X, data.tasks, data.y, data.known)


def at(likelihood, noise):
    """Theta with given noise variances, and with levels where they are learned."""
    rho = np.log(np.full(likelihood.prior.task_covariance.n_parameters, 1.5))
    return np.r_[TRUTH, rho, np.log(np.broadcast_to(noise, likelihood.prior.n_noise))]


@pytest.mark.parametrize("n_noise", [1, M])
@pytest.mark.parametrize("noise", [1.0, 0.1])
def test_noisy(data, noise, n_noise, factorised):
    exact = likelihood(data, n_noise)
    theta, single = at(exact, noise), exact.in_single()
    assert single.single
    assert not exact.single
    (expected, slope), (value, gradient) = (
        of.value_and_grad(theta) for of in (exact, single)
    )
    assert factorised == [len(data)]
    assert single.value(theta) == value != expected
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=1e-2)
    np.testing.assert_allclose(gradient, slope, rtol=0.0, atol=1e-2)
    assert exact.value(theta) == expected  # as before


@pytest.mark.parametrize("noise", [1e-4, [1.0, 1.0, 1e-4]])
def test_little_noise_takes_double_precision(data, noise, factorised):
    exact = likelihood(data, np.size(noise))
    theta = at(exact, noise)
    expected, value = (of.value_and_grad(theta) for of in (exact, exact.in_single()))
    assert not factorised
    assert value[0] == expected[0]
    np.testing.assert_array_equal(value[1], expected[1])


def test_few_rows_take_double_precision():
    few = likelihood(draw(FACTOR @ FACTOR.T, per_task=9))
    assert few.in_single() is few


def test_many_rows_take_double_precision(data, monkeypatch):
    """Of which a copy in single precision takes memory that is not foreseen."""
    monkeypatch.setattr(dense, "IN_SINGLE", range(30, len(data)))
    assert not likelihood(data).in_single().single


@pytest.mark.parametrize("relaxed", [False, True])
def test_climb(data, relaxed, factorised, monkeypatch):
    problem = pose(data, low_rank(M, 2), tol=1e-2)
    theta = start_of(problem)
    found = climb(problem, theta, relaxed=relaxed)
    assert factorised
    assert found.converged
    assert found.value == problem.likelihood().value(found.theta)
    factorised.clear()
    exact = replace(problem, tuning=replace(TUNING, single_tol=np.inf))
    expected = climb(exact, theta, relaxed=relaxed)
    assert not factorised
    assert found.value == pytest.approx(expected.value, abs=0.5 if relaxed else 0.02)


@pytest.mark.parametrize("relaxed", [False, True])
def test_exact_climbs_take_double_precision(data, factorised, relaxed):
    problem = pose(data, low_rank(M, 2), tol=1e-5)
    climb(problem, start_of(problem), relaxed=relaxed)
    assert not factorised


def test_priors_stay(data):
    problem = replace(pose(data, low_rank(M, 2)), weak_priors=True)
    exact, theta = problem.likelihood(), start_of(problem)
    single = exact.in_single()
    assert single.single
    assert single.value(theta) == pytest.approx(exact.value(theta), abs=1e-2)
    assert problem.log_density(theta) < -1.0  # which an approximation cannot hide
