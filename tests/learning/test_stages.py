import tracemalloc
from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from drawn import (
    FACTOR,
    KERNEL,
    NOISE,
    TRUTH,
    M,
    draw,
    is_stationary,
    pose,
    start_of,
)
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from skmtgp.learning import stages
from skmtgp.learning.climbing import Ascent, annealed, climb, shake
from skmtgp.learning.stages import (
    Start,
    augmented_task_covariance,
    first_stage,
    full_rank_start,
    learn_fixed,
    perturbed,
    second_stage,
)
from skmtgp.model.task_covariance import identity, low_rank, ones


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("form", [identity(M), ones(M)], ids=["identity", "ones"])
@pytest.mark.parametrize("n_noise", [1, M])
def test_learn_fixed_is_no_worse_than_the_truth(form, seed, n_noise):
    data = draw(form.matrix(np.empty(0)), seed)
    problem = pose(data, form, n_noise=n_noise)
    mode = learn_fixed(problem)
    truth = np.r_[TRUTH, np.full(n_noise, np.log(NOISE))]
    assert mode.value >= problem.likelihood().value(truth)
    assert is_stationary(problem, mode.theta)


def literal_augmented_task_covariance(data, kernel, K_rho, noise):
    """Section 3.2, word by word."""
    X_hat = []  # "distinct x-configurations observed over all M contexts"
    for x in data.X.tolist():
        if x not in X_hat:
            X_hat.append(x)
    N, M = len(X_hat), data.n_tasks
    T_aug = np.empty((N, M))
    for i, x in enumerate(X_hat):
        for m in range(M):
            observed = data.y[(x == data.X).all(axis=1) & (data.tasks == m)]
            T_aug[i, m] = (
                np.mean(observed)
                if len(observed)
                else textbook.posterior(
                    kernel, K_rho, noise, data.X, data.tasks, data.y, [x], [m]
                )[0].item()
            )
    eta_squared = np.trace(T_aug.T @ T_aug) / (M * N)
    K_x = kernel(np.array(X_hat))
    return T_aug.T @ np.linalg.inv(K_x + eta_squared * np.eye(N)) @ T_aug / N


class TestAugmentedTaskCovariance:
    def posterior(self, data, form, kernel=KERNEL):
        likelihood = building.dense(kernel, form, data.X, data.tasks, data.y)
        return likelihood.posterior(np.r_[kernel.theta, np.log(0.1)])

    @pytest.mark.parametrize("form", [identity(M), ones(M)], ids=["identity", "ones"])
    @pytest.mark.parametrize("kernel", [KERNEL, RBF() + WhiteKernel(0.2)], ids=repr)
    @pytest.mark.parametrize("rows", ["shared", "all shared", "distinct", "repeated"])
    def test_section_3_2(self, data, form, kernel, rows):
        X = data.X.copy()
        if rows == "all shared":
            X = np.tile(X[:12], (3, 1))
        elif rows == "distinct":
            X += np.linspace(0.0, 0.1, len(X))[:, None]
        elif rows == "repeated":  # several observations of a task at one x
            X[1] = X[0]
        data = replace(data, X=X)
        actual = augmented_task_covariance(data, self.posterior(data, form, kernel))
        K_rho = form.matrix(np.empty(0))
        expected = literal_augmented_task_covariance(data, kernel, K_rho, 0.1)
        np.testing.assert_allclose(actual, expected, rtol=1e-9)

    def test_trace_where_the_kernel_vanishes(self, data):
        # "so that tr(K_aug^rho) = M if K_1^x were the zero matrix"
        kernel = ConstantKernel(1e-14) * RBF()
        posterior = self.posterior(data, ones(M), kernel)
        trace = np.trace(augmented_task_covariance(data, posterior))
        np.testing.assert_allclose(trace, M, rtol=1e-10)

    def test_rank_is_not_that_of_the_initial_choice(self, data):
        K_rho = augmented_task_covariance(data, self.posterior(data, ones(M)))
        values = np.linalg.eigvalsh(K_rho)
        assert values[0] > 0.01 * values[-1]

    def test_memory(self):
        """Few matrices between inputs and tasks, of which there may be as many."""
        n, rng = 400, np.random.default_rng(0)
        data = building.data(rng.uniform(size=(n, 2)), np.arange(n), np.ones(n), n)
        posterior = self.posterior(data, identity(n), RBF())
        tracemalloc.start()
        augmented_task_covariance(data, posterior)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 4.5 * 8 * n**2

    def test_does_not_change_the_data(self, data):
        y = data.y.copy()
        augmented_task_covariance(data, self.posterior(data, ones(M)))
        np.testing.assert_array_equal(data.y, y)


@pytest.mark.parametrize("form", [identity(M), ones(M)], ids=["identity", "ones"])
def test_first_stage(data, form):
    problem = pose(data, form)
    start = first_stage(problem)
    mode = climb(problem, start_of(problem), relaxed=True)
    np.testing.assert_array_equal(start.kernel_theta, mode.theta[:6])
    expected = literal_augmented_task_covariance(
        data,
        KERNEL.clone_with_theta(mode.theta[:6]),
        form.matrix(np.empty(0)),
        np.exp(mode.theta[-1]),
    )
    np.testing.assert_allclose(start.K_rho, expected, rtol=1e-7)


def test_second_stage_follows_every_start_and_keeps_the_best(data):
    form = low_rank(M, 2)
    problem = pose(data, form, max_iter=20)
    starts = [
        Start(KERNEL.theta, np.ones((M, M))),
        Start(TRUTH, FACTOR @ FACTOR.T),
        Start(KERNEL.theta + 1.0, np.eye(M)),
    ]
    each = second_stage([([problem], [start]) for start in starts], shakes=3)
    [best] = second_stage([([problem], starts)], shakes=3)
    alone = max(each, key=lambda mode: mode.value)
    # climbs of one mode end within the tolerance, and together some end sooner
    assert best.value == pytest.approx(alone.value, rel=0.0, abs=problem.budget.tol)
    assert best.n_evaluations > alone.n_evaluations  # the other starts' count too
    rho = form.parameters(FACTOR @ FACTOR.T)
    first = np.concatenate([TRUTH, rho, [problem.prior.log_noise]])
    expected = shake(problem, annealed(problem, first).mode, 2)
    np.testing.assert_array_equal(each[1].theta, expected.theta)


@pytest.mark.parametrize("shakes", [0, 1, 3])
def test_second_stage_shakes_the_best_mode(data, monkeypatch, shakes):
    shaken = []

    def count(problem, mode, times):
        shaken.append((mode.value, times))
        return mode

    monkeypatch.setattr(stages, "shake", count)
    problem = pose(data, low_rank(M, 2), max_iter=20)
    starts = [Start(TRUTH, FACTOR @ FACTOR.T), Start(KERNEL.theta, np.eye(M))]
    alone = [annealed(problem, start.theta(problem)).mode for start in starts]
    second_stage([([problem], starts)], shakes=shakes)
    [(value, times)] = shaken
    assert times == shakes
    assert value >= max(mode.value for mode in alone)


@pytest.mark.parametrize("likely", [True, False])
def test_second_stage_ends_no_lower_than_the_first(data, monkeypatch, likely):
    """A climb with the noise held up may lead to a poor mode."""
    problem = pose(data, low_rank(M, 2), max_iter=20)
    noise = np.log([NOISE if likely else 1e3 * NOISE])
    start = Start(TRUTH, FACTOR @ FACTOR.T, log_noise_found=noise)
    at_start = start._replace(log_noise=noise).theta(problem)
    value = problem.likelihood().value(at_start)
    far = start.theta(problem) + np.where(np.arange(len(at_start)) == 0, 5.0, 0.0)

    def poor(problem, theta, known=()):
        budget = replace(problem.budget, max_iter=1)
        mode = climb(replace(problem, budget=budget), far)
        return Ascent(mode, mode)

    monkeypatch.setattr(stages, "annealed", poor)
    ended = poor(problem, None).mode
    [best] = second_stage([([problem], [start])], shakes=0)
    if likely:
        assert ended.value < value - 3.0
        assert best.value >= value
        assert best.n_evaluations > ended.n_evaluations
    else:
        np.testing.assert_array_equal(best.theta, ended.theta)


class TestHigherRanks:
    """Of data without noise they begin where a lower one's climb held up has ended."""

    @pytest.fixture
    def quiet(self):
        rng, tasks = np.random.default_rng(3), np.repeat(np.arange(M), 12)
        X, kernel = rng.uniform(-2.0, 2.0, (36, 2)), KERNEL.clone_with_theta(TRUTH)
        K = textbook.covariance(kernel, FACTOR @ FACTOR.T, 1e-9, X, tasks)
        y = np.linalg.cholesky(K) @ rng.standard_normal(36)
        return building.data(X, tasks, y, M)

    @pytest.fixture
    def problems(self, quiet):
        return [pose(quiet, low_rank(M, rank)) for rank in (2, 3)]

    @pytest.fixture
    def starts(self, quiet):
        return [
            stages.first_stage(pose(quiet, form)) for form in (identity(M), ones(M))
        ]

    def test_values_do_not_fall(self, problems, starts):
        modes = second_stage([(problems, starts)], shakes=0)
        assert not problems[0].is_noisy(modes[0])
        assert (np.diff([mode.value for mode in modes]) >= 0.0).all()
        for problem, mode in zip(problems, modes, strict=True):
            value = problem.likelihood().value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_it_takes_fewer_evaluations_than_each_alone(self, problems, starts):
        modes = second_stage([(problems, starts)], shakes=0)
        alone = second_stage([([of], starts) for of in problems], shakes=0)
        assert modes[0].value == alone[0].value
        for mode, other in zip(modes, alone, strict=True):
            assert mode.value > other.value - 0.5
        spent, others = (sum(of.n_evaluations for of in m) for m in (modes, alone))
        assert spent < others

    def test_those_that_gained_nothing_are_not_shaken(
        self, problems, starts, monkeypatch
    ):
        shaken = []

        def spy(problem, mode, times):
            shaken.append((mode.value, times))
            return mode

        monkeypatch.setattr(stages, "shake", spy)
        second_stage([(problems, starts)], shakes=3)
        values, times = zip(*shaken, strict=True)
        gains = np.diff(values, prepend=-np.inf) > problems[0].tuning.doubt
        assert times == tuple(np.where(gains, 3, 0))
        assert 0 in times

    def test_positions_that_are_reported(self, problems, starts):
        of_starts, of_jobs = {}, {}
        reporters = (lambda: of_starts.__setitem__, lambda: of_jobs.__setitem__)
        jobs = [(problems, [*starts, starts[0]._replace(mode=None)])] * 2
        modes = second_stage(jobs, shakes=0, reporters=reporters)
        assert list(of_jobs.values()) == modes
        for j, mode in enumerate(modes):
            first, others = [j], range(4 + 2 * j, 6 + 2 * j)
            found = [of_starts[i].value for i in (*first, *others)]
            assert max(found) == mode.value
        assert sorted(of_starts) == list(range(12))


def test_perturbed():
    start = Start(KERNEL.theta, FACTOR @ FACTOR.T)
    one, same, other = perturbed(start, 0), perturbed(start, 0), perturbed(start, 1)
    np.testing.assert_array_equal(one.K_rho, same.K_rho)
    np.testing.assert_array_equal(one.kernel_theta, same.kernel_theta)
    assert not np.allclose(one.kernel_theta, other.kernel_theta)
    assert not np.allclose(one.kernel_theta, start.kernel_theta)
    np.testing.assert_array_equal(start.kernel_theta, KERNEL.theta)
    assert np.linalg.matrix_rank(one.K_rho) == 2
    assert np.linalg.eigvalsh(one.K_rho)[0] > -1e-12


def test_full_rank_start(data):
    """Its K_1 is that of a model of full rank, better than the one it begins with."""
    problem, form = pose(data, identity(M)), low_rank(M, M)
    start = first_stage(problem)
    full, likelihood = (
        full_rank_start(problem, start),
        problem.with_form(form).likelihood(),
    )

    def value(K_rho, kernel):
        rho = form.parameters(K_rho)
        noises = [[log_noise] for log_noise in np.linspace(-8.0, 0.0, 17)]
        thetas = [np.concatenate([kernel, rho, noise]) for noise in noises]
        return max(likelihood.value(theta) for theta in thetas)

    assert np.linalg.matrix_rank(full.K_rho) == M
    assert full.mode.n_iter <= 100
    before = value(np.eye(M), start.kernel_theta)
    assert value(full.K_rho, full.kernel_theta) > before + 1.0


def test_a_full_rank_start_takes_no_longer_than_it_may():
    """With many tasks of few rows it climbed for thousands of iterations."""
    rng, n_tasks = np.random.default_rng(0), 12
    tasks, x = np.repeat(np.arange(n_tasks), 4), rng.uniform(0.0, 5.0, (48, 1))
    y = rng.normal(size=n_tasks)[tasks] * np.sin(x[:, 0])
    y += 0.1 * rng.standard_normal(48)
    kernel, form = RBF(), identity(n_tasks)
    problem = building.problem(kernel, form, building.data(x, tasks, y, n_tasks))
    start = full_rank_start(problem, first_stage(problem))
    assert start.mode.n_iter <= problem.tuning.full_rank_steps < problem.budget.max_iter
