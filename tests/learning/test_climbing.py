from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from drawn import (
    KERNEL,
    RANKS,
    M,
    every_form,
    is_stationary,
    mode_at,
    pose,
    start_of,
)

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.learning import climbing, nesting, stages
from skmtgp.learning.climbing import annealed, climb, lower, shake
from skmtgp.learning.problem import Mode
from skmtgp.learning.ranks import learn_ranks
from skmtgp.model.task_covariance import identity, low_rank, ones


@pytest.mark.parametrize("fine", [pytest.param(False, marks=pytest.mark.long), True])
def test_a_diagonal_does_not_cost_likelihood(data, fine, monkeypatch):
    """Even if no climb of the model with a diagonal finds anything."""

    def lost(way):
        def follow(problem, theta, **options):
            if problem.prior.task_covariance.n_kappa:
                problem = replace(problem, budget=replace(problem.budget, max_iter=0))
            return way(problem, theta, **options)

        return follow

    for module in (stages, climbing, nesting):
        monkeypatch.setattr(module, "climb", lost(climb))
    few = {"coarse": 18, "coarse_per_task": 2} if fine else {}
    problem = pose(data, max_iter=15, **few)
    [without] = learn_ranks([problem], RANKS)
    forms = [low_rank(M, r, diagonal=True) for r in (1, 2, 3)]
    [modes] = learn_ranks([problem], forms)
    for form, mode, simpler in zip(forms, modes, without, strict=True):
        assert mode.value > simpler.value - 1e-7
        found = problem.with_form(form).likelihood().value(mode.theta)
        np.testing.assert_allclose(mode.value, found, rtol=1e-12)
        assert mode.n_evaluations > simpler.n_evaluations
        assert mode.n_samples == 36


def test_a_diagonal_that_matters_is_found_where_noise_is_tiny():
    rng = np.random.default_rng(3)
    tasks, X = np.repeat(np.arange(M), 12), rng.uniform(-2.0, 2.0, (36, 2))
    own = np.sin(4.0 * X[:, 0]) * np.array([0.0, 0.0, 0.05])[tasks]
    y = np.cos(X[:, 0]) * np.array([1.0, -0.5, 0.7])[tasks] + own
    problem = pose(building.data(X, tasks, y - y.mean(), M), tol=1e-2)
    found = {}
    for diagonal in (False, True):
        form = low_rank(M, 1, diagonal)
        [[mode]] = learn_ranks([problem], [form])
        found[diagonal] = mode.value
    assert found[True] > found[False] + 5.0


class TestClimb:
    @every_form
    @pytest.mark.parametrize("seed", range(3))
    def test_never_ends_below_its_start(self, data, form, seed):
        problem = pose(data, form, max_iter=10)
        theta = start_of(problem, seed)
        mode = climb(problem, theta)
        value = problem.likelihood().value
        assert mode.value > value(theta)
        np.testing.assert_allclose(mode.value, value(mode.theta), rtol=1e-12)
        lower, upper = problem.prior.bounds()
        assert (lower <= mode.theta).all()
        assert (mode.theta <= upper).all()

    @every_form
    def test_ends_at_a_mode(self, data, form):
        problem = pose(data, form, tol=1e-6, max_iter=1000)
        mode = climb(problem, start_of(problem))
        assert mode.converged
        assert is_stationary(problem, mode.theta)
        assert not is_stationary(problem, start_of(problem))

    def test_budget(self, data):
        problem = pose(data, low_rank(M, 2), max_iter=3)
        mode = climb(problem, start_of(problem))
        assert mode.n_iter == 3 < mode.n_evaluations
        assert not mode.converged
        assert mode.seconds > 0.0

    def test_start_beyond_the_bounds(self, data):
        problem = pose(data, ones(M), max_iter=5)
        theta = np.r_[np.full(6, 50.0), 50.0]
        mode = climb(problem, theta)
        clipped = np.clip(theta, *problem.prior.bounds())
        assert mode.value > problem.likelihood().value(clipped)

    @pytest.mark.parametrize("relaxed", [False, True])
    def test_start_where_the_likelihood_fails(self, data, monkeypatch, relaxed):
        def fail(self, theta):
            return -np.inf, np.full(len(theta), np.nan)

        monkeypatch.setattr(DenseLikelihood, "value_and_grad", fail)
        problem = pose(data, ones(M))
        mode = climb(problem, start_of(problem), relaxed=relaxed)
        assert mode.value == -np.inf
        assert not mode.converged

    def test_relaxed_climb_climbs_the_penalised_likelihood(self, data):
        problem = pose(data, identity(M), relaxed=0.3)
        likelihood = problem.likelihood()

        def penalised(theta):
            away = theta[:6] - KERNEL.theta
            return likelihood.value(theta) - 0.5 * away @ away / 0.3**2

        theta = start_of(problem) + 0.5
        mode = climb(problem, theta, relaxed=True)
        assert penalised(mode.theta) > penalised(theta)
        np.testing.assert_allclose(mode.value, likelihood.value(mode.theta), rtol=1e-12)
        slope = textbook.derivative(penalised, mode.theta)
        assert (
            np.abs(slope).max()
            < 1.0
            < np.abs(textbook.derivative(penalised, theta)).max()
        )

    def test_penalty_holds_the_kernel_alone(self, data):
        problem = pose(data, low_rank(M, 2), relaxed=1e-5)
        theta = start_of(problem)
        mode = climb(problem, theta, relaxed=True)
        away = np.abs(mode.theta - theta)
        assert away[:6].max() < 1e-6
        assert away[6:-1].min() > 1e-3
        assert away[-1] > 0.1


def test_annealed_holds_the_noise_up_at_first(data, monkeypatch):
    problem, climbs = pose(data, low_rank(M, 2), max_iter=20), []

    def spy(*arguments, **options):
        climbs.append((arguments[-1], options, climb(*arguments, **options)))
        return climbs[-1][2]

    monkeypatch.setattr(climbing, "climb", spy)
    first, mode = annealed(problem, start_of(problem) - 5.0)
    (_, held, up), (start, free, end) = climbs
    assert held == {"relaxed": True, "held": "up", "known": []}
    assert first is up
    assert up.theta[-1] >= problem.log_held
    np.testing.assert_array_equal(start, up.theta)
    assert free == {"known": []}
    np.testing.assert_array_equal(mode.theta, end.theta)
    assert mode.n_evaluations == up.n_evaluations + end.n_evaluations


class TestShake:
    @pytest.fixture
    def problem(self, data):
        return pose(data, low_rank(M, 2))

    @pytest.fixture
    def mode(self, problem):
        """A poor one: almost no noise, and the kernel as it was."""
        return mode_at(problem, np.append(start_of(problem)[:-1], -16.0))

    @pytest.mark.parametrize("times", [0, 1, 2])
    def test_never_worse(self, data, mode, times):
        problem = pose(data, low_rank(M, 2), tol=1e-6, max_iter=1000)
        best = shake(problem, mode, times)
        assert best.value > mode.value + 1.0 or times == 0
        value = problem.likelihood().value(best.theta)
        np.testing.assert_allclose(best.value, value, rtol=1e-10)
        if times:
            assert is_stationary(problem, best.theta)
            assert best.seconds > mode.seconds
            assert best.n_iter > mode.n_iter

    @pytest.mark.parametrize(
        ("values", "n", "expected"),
        [
            ([-70.0, -50.0, -60.0], 3, -50.0),
            ([-70.0, -69.5, -40.0], 2, -69.5),  # gained little
            ([-90.0, -50.0, -70.0], 1, -80.0),
        ],
    )
    def test_each_begins_where_the_last_ended_until_that_gains_little(
        self, problem, mode, monkeypatch, values, n, expected
    ):
        starts, values, mode = [], iter(values), mode._replace(value=-80.0)

        def jump(problem, theta, known):
            starts.append((theta[-1], len(known)))
            theta = np.append(theta[:-1], -15.0 - len(starts))
            return Mode(theta, next(values), 7, 8, True, False, 1.0, 36)

        monkeypatch.setattr(climbing, "climb", jump)
        best = shake(problem, mode, 3)
        assert starts == [(np.log(1e-5), 1), (np.log(1e-5), 2), (np.log(1e-5), 3)][:n]
        assert best.value == expected
        assert best.seconds == mode.seconds + n
        assert best.n_evaluations == mode.n_evaluations + 8 * n

    def test_noisy_data_are_not_shaken(self, problem, mode):
        theta = np.append(mode.theta[:-1], np.log(0.1))
        noisy = mode._replace(theta=theta, value=-80.0)
        assert shake(problem, noisy, 2) == noisy

    def test_noise_of_noisy_data_is_held_down_at_first(
        self, problem, mode, monkeypatch
    ):
        begun, values = [], iter([-99.0, -50.0, -98.0, -60.0])

        def jump(problem, theta, *, relaxed=False, held=None, known=()):
            begun.append((round(np.exp(theta[-1]), 9), relaxed, held, len(known)))
            theta = np.append(theta[:-1], np.log(0.01 if held else 0.02))
            return Mode(theta, next(values), 7, 8, True, False, 1.0, 36)

        monkeypatch.setattr(climbing, "climb", jump)
        theta = np.append(mode.theta[:-1], np.log(0.1))
        noisy = mode._replace(theta=theta, value=-80.0)
        found = lower(problem, noisy)
        down, free = (True, "down", 0), (False, None, 1)
        assert begun == [(1e-4, *down), (0.01, *free), (2e-3, *down), (0.01, *free)]
        assert [mode.value for mode in found] == [-50.0, -60.0]
        assert [mode.n_evaluations for mode in found] == [16, 16]

    def test_noise_that_is_held_down_does_not_rise(self, problem, mode):
        theta = np.append(mode.theta[:-1], np.log(1e-4))
        low = climb(problem, theta, held="down")
        assert low.theta[-1] <= np.log(1e-4)
        assert climb(problem, theta).theta[-1] > np.log(1e-4)

    def test_fixed_noise_is_not_lowered(self, data, mode, monkeypatch):
        monkeypatch.setattr(climbing, "climb", lambda *_, **__: pytest.fail("climbed"))
        noise = np.log(0.1)
        given = {"log_noise": noise, "log_noise_bounds": (noise, noise)}
        fixed = pose(data, low_rank(M, 2), **given)
        noisy = mode._replace(theta=np.append(mode.theta[:-1], noise))
        assert lower(fixed, noisy) == []


def test_a_futile_climb_ends(data):
    problem, asked = pose(data, max_iter=40), []

    def futile(theta):
        asked.append(theta)
        return len(asked) == 2

    mode = climb(problem, start_of(problem), futile=futile)
    assert mode.n_iter == 2 * problem.tuning.look_every
    np.testing.assert_array_equal(mode.theta, asked[-1])
