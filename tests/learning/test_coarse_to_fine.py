import time
from dataclasses import replace
from itertools import pairwise

import building
import numpy as np
import pytest
from drawn import (
    FACTOR,
    NOISE,
    RANKS,
    TRUTH,
    M,
    draw,
    is_stationary,
    mode_at,
    pose,
    start_of,
)
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning import climbing
from skmtgp.learning.climbing import climb, refine
from skmtgp.learning.ranks import learn_ranks
from skmtgp.learning.stages import learn_fixed
from skmtgp.model.task_covariance import identity, low_rank, ones

SMALL = {"coarse": 12, "coarse_per_task": 2, "refinement": 2.0}


class TestCoarseToFine:
    @pytest.mark.parametrize("n_samples", [3, 10, 18, 35, 36])
    def test_thinned(self, data, n_samples):
        few = data.thinned(n_samples)
        assert n_samples <= len(few.y) <= n_samples + M - 1
        counts = np.bincount(few.tasks, minlength=M)
        assert counts.min() >= 1
        assert np.ptp(counts) <= 1  # all tasks have as many rows
        assert (np.diff(few.tasks) >= 0).all()
        where = [np.flatnonzero(data.y == y).item() for y in few.y]
        np.testing.assert_array_equal(data.X[where], few.X)
        np.testing.assert_array_equal(data.tasks[where], few.tasks)
        assert len(set(where)) == len(where)

    def test_every_task_is_kept(self):
        tasks = np.repeat([0, 1, 2], [1, 2, 97])
        X = np.arange(100.0)[:, None]
        few = building.data(X, tasks, X[:, 0], 3).thinned(10)
        np.testing.assert_array_equal(np.bincount(few.tasks), [1, 1, 10])

    @pytest.mark.parametrize(("part", "shares"), [("thinned", {2}), ("drawn", {0, 4})])
    def test_time_does_not_grow_with_the_tasks_times_the_rows(self, part, shares):
        n, n_tasks = 200_000, 20_000
        tasks = np.arange(n) // (n // n_tasks)
        data = building.data(np.zeros((n, 1)), tasks, np.zeros(n), n_tasks)
        begin = time.process_time()
        some = getattr(data, part)(40_000)
        assert time.process_time() - begin < 2.0  # 10 s, were it so
        assert len(some) == 40_000
        assert set(np.bincount(some.tasks, minlength=n_tasks)) == shares

    def test_problems_are_nested(self, data):
        problem = pose(data, **SMALL)
        problems = problem.coarse_to_fine()
        assert [len(each.data) for each in problems] == [12, 21, 36]
        assert problems[-1] is problem
        for few, more in pairwise(problems):
            assert set(few.data.y) < set(more.data.y)

    @pytest.mark.parametrize(
        ("n", "M", "sizes"),
        [
            (259, 6, [259]),
            (288, 6, [130, 288]),
            (288, 14, [288]),
            (600, 3, [200, 600]),
            (900, 3, [300, 900]),
        ],
    )
    def test_sizes_of_noisy_data(self, n, M, sizes):
        """Fewer rows of few features tell where there is noise."""
        tasks = np.sort(np.arange(n) % M)
        data = building.data(np.zeros((n, 1)), tasks, np.zeros(n), M)
        problem = replace(pose(data, kernel=RBF()), noisy=True)
        found = [len(each.data) for each in problem.coarse_to_fine()]
        np.testing.assert_allclose(found, sizes, atol=M)
        many = replace(pose(data, kernel=RBF(np.ones(16))), noisy=True)
        assert len(many.coarse_to_fine()[0].data) >= min(n, 300)

    @pytest.mark.parametrize(
        ("n", "M", "sizes"),
        [
            (280, 14, [280]),
            (599, 14, [599]),
            (896, 14, [300, 896]),
            (2800, 14, [300, 916, 2800]),
            (5600, 100, [2000, 5600]),
        ],
    )
    def test_sizes(self, n, M, sizes):
        tasks = np.sort(np.arange(n) % M)
        data = building.data(np.zeros((n, 1)), tasks, np.zeros(n), M)
        found = [len(each.data) for each in pose(data).coarse_to_fine()]
        np.testing.assert_allclose(found, sizes, atol=M)
        assert len(found) == len(sizes)

    def test_refine_ends_at_a_mode_of_all_rows(self, data):
        problem = pose(data, low_rank(M, 2), tol=1e-6, max_iter=1000, **SMALL)
        coarse = problem.coarse_to_fine()[0]
        first = climb(coarse, start_of(problem))
        mode = refine(problem, first)
        assert mode.n_samples == len(data.y)
        assert mode.n_iter > first.n_iter
        assert mode.n_evaluations > first.n_evaluations
        assert mode.seconds > first.seconds
        assert is_stationary(problem, mode.theta)

    @pytest.mark.parametrize("noisy", [True, False])
    def test_refine_tries_levels_anew_that_vanished_of_few_noisy_rows(self, noisy):
        data = draw(FACTOR @ FACTOR.T, kernel=RBF([1.0, 1.0]))
        data = replace(data, y=data.y + 9.0 * data.tasks)
        problem = pose(data, identity(M), kernel=RBF([1.0, 1.0]), **SMALL)
        prior = replace(problem.prior, levels=True)
        problem = replace(problem, prior=prior, noisy=noisy)
        theta = prior.with_least_levels(prior.less_levels(problem.theta()))
        few = problem.coarse_to_fine()[0]
        mode = climb(few, theta)
        assert prior.levels_vanish(mode.theta)
        found = refine(problem, mode)
        assert prior.levels_vanish(found.theta) is not noisy

    def test_refine_starts_with_noise_that_is_not_too_small(self, data, monkeypatch):
        starts, problem = [], pose(data, low_rank(M, 2), **SMALL)
        mode = mode_at(problem, np.r_[start_of(problem)[:-1], -22.0])

        def stay(problem, theta, **options):
            starts.append((len(problem.data), theta[-1], *options))
            return mode

        monkeypatch.setattr(climbing, "climb", stay)
        refine(problem, mode)
        held = np.log(1e-5)
        first = [(21, held, "relaxed", "held", "known"), (21, -22.0, "known")]
        assert starts == [*first, (36, held)]
        assert mode.theta[-1] == -22.0

    @pytest.mark.parametrize("far", [True, False])
    def test_refine_raises_the_noise_where_k_became_singular(
        self, data, monkeypatch, far
    ):
        """A climb that stalls at a mode, as many do at the last digit, is not."""
        problem = pose(data, low_rank(M, 2), **SMALL | {"refinement": 4.0})
        theta = np.r_[start_of(problem)[:-1], -22.0]
        theta = theta if far else climb(problem, theta).theta
        stalled = mode_at(problem, theta)._replace(converged=False, stalled=True)
        ascent = climbing.Ascent(stalled, stalled)
        monkeypatch.setattr(climbing, "annealed", lambda *_: ascent)
        found = refine(problem, stalled)
        assert len(problem.coarse_to_fine()) == 2
        assert found.converged is far
        assert (found.value - stalled.value > 10.0) == far

    @pytest.mark.parametrize("form", [identity(M), ones(M)], ids=["identity", "ones"])
    def test_learn_fixed(self, data, form):
        problem = pose(data, form, tol=1e-6, max_iter=1000, **SMALL)
        mode = learn_fixed(problem)
        assert mode.n_samples == 36
        assert is_stationary(problem, mode.theta)

    def test_learn_ranks(self):
        data = draw(FACTOR @ FACTOR.T, per_task=30)
        problem = pose(data, coarse=36, coarse_per_task=2)
        assert len(problem.coarse_to_fine()) == 2
        [modes] = learn_ranks([problem], RANKS)
        values = [mode.value for mode in modes]
        assert (np.diff(values) >= 0.0).all()
        for form, mode in zip(RANKS, modes, strict=True):
            value = problem.with_form(form).likelihood().value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)
        theta = np.concatenate([TRUTH, FACTOR.ravel(), [np.log(NOISE)]])
        assert values[1] > problem.with_form(RANKS[1]).likelihood().value(theta)
