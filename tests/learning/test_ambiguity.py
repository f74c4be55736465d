"""Modes that are nearly as likely, and predict differently."""

from dataclasses import replace

import numpy as np
import pytest
from drawn import FACTOR, TRUTH, M, draw, mode_at, pose

from skmtgp.learning.ambiguity import Rival, doubt_about
from skmtgp.learning.problem import best_of
from skmtgp.model.task_covariance import low_rank

K_RHO = FACTOR @ FACTOR.T


@pytest.fixture(scope="module")
def problem():
    return pose(draw(K_RHO, per_task=12), low_rank(M, 2))


@pytest.fixture(scope="module")
def modes(problem):
    """At the truth; and where tasks have nothing in common, but with the sign."""
    truth = mode_at(problem, problem.theta(kernel=TRUTH, K_rho=K_RHO))
    other = problem.theta(kernel=TRUTH + 3.0, K_rho=1e-4 * K_RHO)
    return truth, mode_at(problem, other)._replace(value=truth.value - 1.5)


def test_another_mode_within_reach(problem, modes):
    chosen = best_of(modes)
    assert chosen.rivals == (Rival(modes[1].theta, modes[1].value),)
    doubt = doubt_about(problem, chosen)
    assert doubt.nats == pytest.approx(1.5)
    posteriors = [problem.likelihood().posterior(mode.theta) for mode in modes]
    X, y, tasks = problem.data.X, problem.data.y, problem.data.tasks
    one, other = (p.mean_of_tasks(X, np.arange(M)) for p in posteriors)
    deviation = np.sqrt(np.mean([y[tasks == m].var() for m in range(M)]))
    expected = np.sqrt(np.square(one - other).mean()) / deviation
    assert doubt.apart == pytest.approx(expected)


def test_what_is_no_rival(problem, modes):
    truth, other = modes
    for changes in (
        {"value": truth.value - 2.5},
        {"converged": False},
        {"theta": truth.theta},  # predicts the same
    ):
        best = best_of([truth, other._replace(**changes)])
        assert doubt_about(problem, best) is None
    assert doubt_about(problem, truth) is None


def test_climbs_that_failed_are_no_rivals(modes):
    failed = [of._replace(value=-np.inf) for of in modes]
    assert best_of(failed).rivals == ()


def test_rivals_of_those_that_were_preferred_count(problem, modes):
    truth, other = modes
    better = truth._replace(value=truth.value + 0.3)
    for first in (best_of([other, truth]), best_of(modes)):
        assert [of.value for of in best_of([first, better]).rivals] == [
            truth.value,
            other.value,
        ]
    assert best_of(
        [best_of(modes), truth._replace(value=0.8 + truth.value)]
    ).rivals == (Rival(truth.theta, truth.value),)


def test_few_rows_and_data_without_noise_are_not_asked(problem, modes):
    chosen = best_of(modes)
    few = problem.with_data(problem.data._part(np.arange(29)))
    assert doubt_about(few, chosen) is None
    bounds = tuple(np.log([1e-12, 1e3]))
    noiseless = replace(problem.prior, log_noise_bounds=bounds)
    theta = chosen.theta.copy()
    theta[-1] = np.log(1e-9)
    quiet = replace(problem, prior=noiseless)
    assert doubt_about(quiet, chosen._replace(theta=theta)) is None
