import re
from dataclasses import replace

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
    pose,
)
from samples import Listener

from skmtgp import MultiTaskGPRegressor
from skmtgp.learning import ranks
from skmtgp.learning.problem import Budget, Mode
from skmtgp.learning.ranks import learn_ranks, wary
from skmtgp.learning.stages import first_stage, full_rank_start, perturbed, second_stage
from skmtgp.model.task_covariance import identity, low_rank, ones


@pytest.fixture(scope="module")
def problems(data):
    other = draw(FACTOR @ FACTOR.T, seed=1)
    return [pose(data), pose(other, log_noise=-2.0, n_noise=M)]


@pytest.fixture(scope="module")
def learned(problems):
    return learn_ranks(problems, RANKS)


@pytest.fixture(scope="module")
def short(problems):
    """Of a few iterations."""
    return [replace(of, budget=replace(of.budget, max_iter=5)) for of in problems]


@pytest.fixture(scope="module")
def learned_shortly(short):
    return learn_ranks(short, RANKS[:2])


class TestLearnRanks:
    def test_no_worse_than_the_truth(self, problems, learned):
        for problem, modes in zip(problems, learned, strict=True):
            noise = np.full(problem.prior.n_noise, np.log(NOISE))
            theta = np.concatenate([TRUTH, FACTOR.ravel(), noise])
            truth = problem.with_form(RANKS[1]).likelihood().value(theta)
            assert modes[1].value > truth

    def test_values_do_not_fall_with_the_rank(self, learned):
        for modes in learned:
            assert (np.diff([mode.value for mode in modes]) >= 0.0).all()

    def test_values_are_those_of_the_parameters(self, problems, learned):
        for problem, modes in zip(problems, learned, strict=True):
            for form, mode in zip(RANKS, modes, strict=True):
                value = problem.with_form(form).likelihood().value(mode.theta)
                np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_outputs_are_learned_separately(self, short, learned_shortly):
        alone = learn_ranks(short[1:], RANKS[:2])
        self.assert_same(alone, learned_shortly[1:])

    @pytest.mark.long
    @pytest.mark.parametrize("n_jobs", [1, 2])
    def test_processes_do_not_matter(self, short, learned_shortly, n_jobs):
        found = learn_ranks(short, RANKS[:2], n_jobs=n_jobs)
        self.assert_same(found, learned_shortly)

    def assert_same(self, one, other):
        for modes, others in zip(one, other, strict=True):
            for a, b in zip(modes, others, strict=True):
                assert a.value == b.value
                np.testing.assert_array_equal(a.theta, b.theta)
                assert a[2:5] == b[2:5]

    def test_starts(self, data, monkeypatch):
        followed = []

        def follow(jobs, **options):
            followed.extend(jobs)
            return second_stage(jobs, **options)

        monkeypatch.setattr(ranks, "second_stage", follow)
        problem = pose(data, max_iter=3)
        learn_ranks([problem], RANKS[:2], seeds=(5, 6))
        plain = [first_stage(problem.with_form(form(M))) for form in (identity, ones)]
        full = full_rank_start(problem, plain[0])
        expected = [*plain, full, perturbed(plain[0], 6)]
        [(problems, starts)] = followed
        assert [of.prior.task_covariance for of in problems] == RANKS[:2]
        for start, other in zip(starts, expected, strict=True):
            np.testing.assert_array_equal(start.kernel_theta, other.kernel_theta)
            np.testing.assert_array_equal(start.K_rho, other.K_rho)

    @pytest.mark.parametrize("n_jobs", [1, pytest.param(2, marks=pytest.mark.long)])
    def test_report(self, problems, n_jobs):
        problems = [
            replace(problem, budget=Budget(1, 1e-3), name=f"output {j} of 2")
            for j, problem in enumerate(problems, start=1)
        ]
        listener = Listener()
        learn_ranks(problems, RANKS, n_jobs=n_jobs, progress=listener)
        pattern = (
            r"output (\d) of 2, rank (\d): "
            r"log likelihood -?\d+\.\d(, .*) \(\d+ iterations, 36 rows\)"
        )
        assert listener.lines[0] is None  # the first of two starts
        lines = [line for line in listener.lines if line]
        found = [re.fullmatch(pattern, line).groups() for line in lines]
        best = ", best of 2 starts"
        assert found[:6] == [(j, r, best) for j in "12" for r in "123"]
        # of what a second climb did not better, nothing is said again
        assert {stage for *_, stage in found[6:]} <= {", climbed again from more noise"}
        assert listener.stages == [("starts", 12), ("learning", 6)]

    def test_report_of_all_rows(self):
        data, few = draw(FACTOR @ FACTOR.T, per_task=30), {"coarse": 36}
        problem = pose(data, max_iter=1, coarse_per_task=2, **few)
        listener = Listener()
        learn_ranks([problem], RANKS[:1], progress=listener)
        lines = [line for line in listener.lines if line]
        stages = [re.search(r", (.*) \(", line)[1] for line in lines]
        assert stages[0] == "best of 2 starts"
        assert stages[-1] == "learned on from all rows"

    def test_report_of_each_climb(self, data, told):
        problem = pose(data, max_iter=12, name="torque", verbose=2, report_every=5)
        learn_ranks([problem], RANKS[1:2])
        lines = told()
        pattern = (
            r"torque, (rank 2|tasks apart|all tasks alike): "
            r"iteration (\d+), log likelihood -?\d+\.\d, "
            r"noise \d\.\de[+-]\d\d of the variance \(\d+ evaluations of 36 rows\)"
            r"(; done, no more to gain|; done, given up|; done, at the limit of .*|)"
        )
        found = [re.fullmatch(pattern, line) for line in lines]
        assert all(found)
        groups = [match.groups() for match in found]
        assert ("rank 2", "5", "") in groups
        assert ("rank 2", "12", "; done, given up") in groups
        assert groups[0][0] == "tasks apart"

    def test_quiet(self, data, told):
        learn_ranks([pose(data, max_iter=1)], [low_rank(M, 1)])
        assert told() == []

    def test_one_task(self):
        data = draw(np.ones((1, 1)), M=1, per_task=20)
        problem = pose(data, low_rank(1, 1))
        [[mode]] = learn_ranks([problem], [low_rank(1, 1)])
        truth = np.r_[TRUTH, 1.0, np.log(NOISE)]
        assert mode.value > problem.likelihood().value(truth)


@pytest.mark.parametrize(
    ("rank", "size", "levels"),
    [
        pytest.param(3, 2.0, False, marks=pytest.mark.long),
        (2, 2.0, True),
        pytest.param(6, 1.0, False, marks=pytest.mark.long),
    ],
)
# a function as large as the levels leaves few digits to learn the rest by
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning")
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
def test_what_varies_little_is_not_noise(rank, size, levels):
    """A sine is small beside the levels of the tasks, and large beside the noise."""
    rng = np.random.default_rng(0)
    task, x = np.repeat(np.arange(6), 40), rng.uniform(0.0, 6.0, 240)
    amplitudes = np.array([1.0, 0.9, 1.1, 1.2, 0.8, 1.0])
    y = size * np.array([10, 35, 22, 80, 55, 41])[task] + amplitudes[task] * np.sin(x)
    X, y = np.column_stack([x, task]), y + 0.05 * rng.standard_normal(240)
    test = np.arange(240) % 4 == 0
    model = MultiTaskGPRegressor(
        rank=rank, task_levels=levels, normalize_y="shared", noise="shared"
    )
    model.fit(X[~test], y[~test])
    error = model.predict(X[test]) - y[test]
    assert np.sqrt(np.square(error).mean()) < 0.1


class TestStartsWithoutLevels:
    def test_of_tasks_whose_levels_may_vanish(self, data):
        problem = pose(data, levels=True)
        [[*plain, bare]] = ranks.make_starts([problem], None, bare=True)
        assert len(plain) == 2
        assert bare.log_level == problem.prior.log_level_bounds[0]
        assert problem.prior.log_level_at(bare.theta(problem)) == bare.log_level
        without = replace(problem, prior=problem.prior.without_levels)
        np.testing.assert_array_equal(bare.K_rho, first_stage(without).K_rho)

    @pytest.mark.parametrize("changes", [{}, {"levels": True, "least_level": 1.0}])
    def test_no_others(self, data, changes):
        [starts] = ranks.make_starts([pose(data, **changes)], None, bare=True)
        assert len(starts) == 2

    def test_constants_that_functions_explain(self):
        """From the starts with levels alone it ends 2.7 nats lower."""
        rng = np.random.default_rng(6)
        x, tasks = rng.uniform(0.0, 6.0, 80), np.repeat(np.arange(8), 10)
        K = np.exp(-(np.subtract.outer(x, x) ** 2) / 8.0) + 1e-9 * np.eye(80)
        f = np.linalg.cholesky(K) @ rng.standard_normal(80)
        y = 2.0 * rng.standard_normal(8)[tasks] * f + 0.1 * rng.standard_normal(80)
        model = MultiTaskGPRegressor(normalize_y="shared", noise="shared", rank=2)
        X = np.column_stack([x, tasks])
        with_levels = model.fit(X, y).log_marginal_likelihood_value_
        without = model.set_params(task_levels=False).fit(X, y)
        assert with_levels > without.log_marginal_likelihood_value_ - 0.1


class TestAnotherWay:
    """Of data without noise: of the model without levels, or features come back."""

    @pytest.fixture
    def problem(self):
        rng = np.random.default_rng(0)
        X, tasks = rng.uniform(-2.0, 2.0, (36, 2)), np.repeat(np.arange(M), 12)
        y = np.array([1.0, 2.0, -1.0])[tasks] * np.sin(X[:, 0])
        bounds = tuple(np.log([1e-10, 10.0]))
        return pose(
            building.data(X, tasks, y, M),
            low_rank(M, 1),
            levels=True,
            log_noise_bounds=bounds,
        )

    @staticmethod
    def at(problem, *, level, noise):
        theta = problem.theta()
        theta[-2:] = np.log([level, noise])
        value = problem.likelihood().value(theta)
        return Mode(theta, value, 7, 8, True, False, 0.5, len(problem.data))

    def test_without_levels_where_they_vanish(self, problem, monkeypatch):
        reopen, asked = ranks.reopen, []
        monkeypatch.setattr(
            ranks, "reopen", lambda *of: asked.append(of) or reopen(*of)
        )
        poor = self.at(problem, level=1e-12, noise=1e-9)
        found = ranks._another_way(problem, poor)
        assert found.value > poor.value + 10.0
        assert found.n_evaluations > poor.n_evaluations
        value = problem.likelihood().value(found.theta)
        np.testing.assert_allclose(found.value, value, rtol=1e-8)
        assert problem.prior.levels_vanish(found.theta)
        [(bare, start)] = asked
        assert not bare.prior.levels
        assert start.value == bare.likelihood().value(np.delete(poor.theta, -2))

    def test_features_come_back_where_there_are_levels(self, problem, monkeypatch):
        monkeypatch.setattr(ranks, "reopen", lambda *given: given)
        mode = self.at(problem, level=0.1, noise=1e-9)
        assert ranks._another_way(problem, mode) == (problem, mode)

    def test_noisy_data_have_their_mode(self, problem):
        mode = self.at(problem, level=0.1, noise=0.1)
        assert ranks._another_way(problem, mode) is mode


@pytest.mark.parametrize(
    ("noise", "n_rows", "expects"),
    [(0.0, 36, False), (0.3, 36, True), (0.0, 30, True), (0.3, 30, True)],
)
def test_step_1_tells_that_there_is_no_noise(data, noise, n_rows, expects):
    """Of 2.8 rows a hyperparameter it does, of 2.3 not: those are too few."""
    X, tasks = data.X, data.tasks
    y = np.array([1.0, 0.5, -0.8])[tasks] * np.sin(X[:, 0]) + 0.3 * X[:, 1]
    y += noise * np.random.default_rng(0).standard_normal(len(y))
    rows = np.sort(np.random.default_rng(1).permutation(len(y))[:n_rows])
    drawn = building.data(X[rows], tasks[rows], y[rows], M)
    problem = replace(pose(drawn), log_little=np.log(0.01))
    [found] = wary([problem], RANKS[2:])
    assert bool(found.noise_rate) == expects
    assert found.noise_rate in (0.0, problem.wary(RANKS[2]).noise_rate)
    assert wary([problem], RANKS) == [problem]  # several are compared by evidence
