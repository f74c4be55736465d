"""Climbs that need not be gone on with."""

import numpy as np
import pytest
from drawn import FACTOR, TRUTH, M, mode_at, pose, start_of

from skmtgp.learning.agreement import Rivals
from skmtgp.learning.climbing import annealed, climb
from skmtgp.model.task_covariance import low_rank


@pytest.fixture(scope="module")
def problem(data):
    return pose(data, low_rank(M, 2))


@pytest.fixture(scope="module")
def mode(problem):
    return climb(problem, start_of(problem))


def rotated(problem, theta, angle=0.3):
    """The same covariance, from another factor."""
    form, rho = problem.prior.task_covariance, problem.prior.values(theta).rho
    c, s = np.cos(angle), np.sin(angle)
    F = form.factor(rho) @ np.array([[c, -s], [s, c]])
    return problem.prior.with_rho(theta, F.T.ravel()), F


class TestNear:
    def test_itself_and_its_rotations(self, problem, mode):
        rivals = Rivals(problem, [mode])
        assert rivals.near(mode.theta, mode.value - 0.5)
        theta, F = rotated(problem, mode.theta)
        K_rho = problem.prior.K_rho_at(theta)
        if not np.allclose(K_rho, F @ F.T):  # the other order of the elements
            theta = problem.prior.with_rho(mode.theta, F.ravel())
        np.testing.assert_allclose(problem.prior.K_rho_at(theta), F @ F.T)
        assert rivals.near(theta, mode.value)

    def test_other_values_noises_and_kernels_are_not(self, problem, mode):
        rivals, n_theta = Rivals(problem, [mode]), len(mode.theta)
        assert not rivals.near(mode.theta, mode.value - 1.1)
        assert not rivals.near(mode.theta, mode.value + 1.1)
        for i, step in [(n_theta - 1, 0.3), (0, 0.5)]:
            theta = mode.theta + step * (np.arange(n_theta) == i)
            assert not rivals.near(theta, mode.value)

    def test_without_modes(self, problem, mode):
        assert not Rivals(problem, []).near(mode.theta, mode.value)


class TestSettle:
    def test_what_cannot_reach_the_least_ends_with_patience(self, problem, mode):
        """Without a mode it is not known whether there is noise."""
        rivals, often = Rivals(problem, [], mode.value), problem.tuning.look_every
        assert not rivals.settle(often, mode.theta, mode.value - 100.0)
        gain = 100.0 / problem.tuning.creeping
        value = mode.value - 100.0 + 1.1 * gain
        assert not rivals.settle(2 * often, mode.theta, value)
        assert rivals.settle(3 * often, mode.theta, value + 0.9 * gain)
        assert not rivals.settle(4 * often, mode.theta, mode.value + 1.0)

    def test_hopeless_climbs_end(self, problem, mode):
        rivals, away = Rivals(problem, [mode]), mode.theta + 3.0
        often = problem.tuning.look_every
        assert not rivals.settle(often, away, mode.value - 200.0)  # the first look
        assert not rivals.settle(often + 1, away, mode.value - 199.0)  # it looks not
        assert not rivals.settle(2 * often, away, mode.value - 100.0)
        assert rivals.settle(3 * often, away, mode.value - 99.0)

    def test_better_ones_go_on(self, problem, mode):
        rivals, often = Rivals(problem, [mode]), problem.tuning.look_every
        for k in range(1, 4):
            assert not rivals.settle(k * often, mode.theta + 3.0, mode.value + 2.0)

    def test_a_climb_to_a_known_mode_is_shorter(self, problem, mode):
        theta = start_of(problem) + 0.5
        alone, beside = climb(problem, theta), climb(problem, theta, known=[mode])
        assert beside.n_evaluations < alone.n_evaluations
        assert mode.value - 1.0 < beside.value < mode.value + 1.0


def test_the_second_climb_is_left_out_where_the_first_one_ended_alike(problem):
    rho = low_rank(M, 2).parameters(FACTOR @ FACTOR.T)
    theta = np.concatenate([TRUTH, rho, [problem.prior.log_noise]])
    first = annealed(problem, theta)
    again = annealed(problem, theta, [first])
    assert again.mode is again.held
    assert again.mode.value <= first.mode.value + 1.0


def test_the_second_climb_is_left_out_where_the_first_one_ended_far_below(problem):
    theta = start_of(problem)
    first = annealed(problem, theta)
    better = first.held._replace(value=first.held.value + 100.0, theta=theta - 9.0)
    again = annealed(problem, theta, [first._replace(held=better)])
    assert again.mode is again.held
    assert mode_at(problem, again.mode.theta).value == again.mode.value
