import re
import time
import tracemalloc
from dataclasses import replace
from itertools import pairwise

import building
import numpy as np
import pytest
import textbook
from samples import Listener
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from skmtgp import MultiTaskGPRegressor
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.kernels import ARDLinear
from skmtgp.learning import climbing, nesting, problem, ranks, stages
from skmtgp.learning.climbing import annealed, climb, refine, shake
from skmtgp.learning.nesting import descend, nest
from skmtgp.learning.problem import Mode, best_of
from skmtgp.learning.ranks import learn_ranks
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

M = 3
FACTOR = np.array([[1.0, 0.0], [0.6, 0.8], [-0.5, 0.9]])
KERNEL = ARDLinear([1.0, 1.0], 1.0, (1e-6, 1e3)) + ConstantKernel(1.0) * RBF([1.0, 1.0])
TRUTH = np.log([0.5, 0.8, 0.1, 1.5, 0.7, 2.0])  # theta^x of what is drawn
NOISE = 0.01


def draw(K_rho, seed=0, per_task=12, kernel=None, M=M):
    """Data of the model itself."""
    rng = np.random.default_rng(seed)
    tasks = np.repeat(np.arange(M), per_task)
    X = rng.uniform(-2.0, 2.0, (len(tasks), 2))
    X[-5:] = X[:5]  # tasks that share inputs
    kernel = kernel or KERNEL.clone_with_theta(TRUTH)
    C = np.linalg.cholesky(textbook.covariance(kernel, K_rho, NOISE, X, tasks))
    return building.data(X, tasks, C @ rng.standard_normal(len(X)), M)


def configure(**changes):
    return building.settings(**{"kernel": KERNEL} | changes)


@pytest.fixture(scope="module")
def data():
    return draw(FACTOR @ FACTOR.T)


def start_of(settings, form, seed=0):
    rho = 0.5 * np.random.default_rng(seed).standard_normal(form.n_parameters)
    return np.concatenate([settings.kernel.theta, rho, settings.log_noise])


def is_stationary(data, settings, form, theta):
    """Whether no step within the bounds gains much, by the Fisher information."""
    likelihood = settings.likelihood(data, form)
    gradient = likelihood.value_and_grad(theta)[1]
    lower, upper = settings.bounds(form)
    free = (lower < theta) & (theta < upper)
    information = likelihood.fisher_information(theta)[np.ix_(free, free)]
    information += 1e-6 * np.eye(free.sum())
    return 0.5 * gradient[free] @ np.linalg.solve(information, gradient[free]) < 0.05


FORMS = [identity(M), ones(M), low_rank(M, 1), low_rank(M, 2, True), low_rank(M, M)]
every_form = pytest.mark.parametrize(
    "form", FORMS, ids=["identity", "ones", "rank 1", "rank 2, diagonal", "full rank"]
)


class TestSettings:
    @pytest.mark.parametrize("n_noise", [1, M])
    @every_form
    def test_bounds_are_in_the_order_of_theta(self, form, n_noise):
        settings = configure(scale=2.0, log_noise=np.zeros(n_noise))
        lower, upper = settings.bounds(form)
        expected = [
            KERNEL.bounds,
            form.bounds(2.0),
            [settings.log_noise_bounds] * n_noise,
        ]
        np.testing.assert_array_equal(np.c_[lower, upper], np.concatenate(expected))

    def test_bounds_of_a_kernel_without_hyperparameters(self):
        settings = configure(kernel=RBF(length_scale_bounds="fixed"))
        assert settings.bounds(ones(M)).shape == (2, 1)

    def test_likelihood(self, data):
        likelihood = configure(log_noise=np.zeros(M)).likelihood(data, low_rank(M, 1))
        theta = np.concatenate([KERNEL.theta, np.ones(3), np.log([0.1, 0.2, 0.3])])
        K = textbook.covariance(
            KERNEL, np.ones((3, 3)), [0.1, 0.2, 0.3], data.X, data.tasks
        )
        expected = textbook.log_marginal_likelihood(K, data.y)
        np.testing.assert_allclose(likelihood.value(theta), expected, rtol=1e-11)

    @pytest.mark.parametrize("noise", [0.1, 1e-5, 1e-8])
    def test_noise_is_not_held_above_its_start(self, noise):
        settings = configure(log_noise=np.log([noise, 1.0]))
        expected = np.log(min(noise, 1e-5))
        assert settings.log_held == pytest.approx(expected, rel=1e-12)

    @pytest.mark.parametrize("n_noise", [1, M])
    def test_noise_and_diagonal_are_held_together(self, n_noise):
        settings = configure(log_noise=np.full(n_noise, np.log(0.1)))
        form = low_rank(M, 2, diagonal=True)
        theta = np.full(KERNEL.n_dims + form.n_parameters + n_noise, -30.0)
        theta[-1] = -1.0
        raised = settings.with_noise(theta, form)
        n_tail = M + n_noise
        np.testing.assert_array_equal(raised[:-n_tail], theta[:-n_tail])
        np.testing.assert_allclose(raised[-n_tail:-1], np.log(1e-5))
        assert raised[-1] == -1.0
        assert (theta[:-1] == -30.0).all()


@pytest.mark.parametrize("fine", [False, True])
def test_a_diagonal_does_not_cost_likelihood(data, fine, monkeypatch):
    """Even if no climb of the model with a diagonal finds anything."""

    def lost(way):
        def follow(data, settings, form, theta, **options):
            budget = replace(settings, max_iter=0) if form.n_kappa else settings
            return way(data, budget, form, theta, **options)

        return follow

    for module in (stages, climbing, nesting):
        monkeypatch.setattr(module, "climb", lost(climb))
    if fine:
        monkeypatch.setattr(problem, "COARSE", 18)
        monkeypatch.setattr(problem, "COARSE_PER_TASK", 2)
    pairs = [(data, configure(max_iter=50))]
    [without] = learn_ranks(pairs, RANKS)
    forms = [low_rank(M, r, diagonal=True) for r in (1, 2, 3)]
    [modes] = learn_ranks(pairs, forms)
    for form, mode, simpler in zip(forms, modes, without, strict=True):
        assert mode.value > simpler.value - 1e-7
        found = pairs[0][1].likelihood(data, form).value(mode.theta)
        np.testing.assert_allclose(mode.value, found, rtol=1e-12)
        assert mode.n_evaluations > simpler.n_evaluations
        assert mode.n_samples == 36


def test_a_diagonal_that_matters_is_found_where_noise_is_tiny():
    rng = np.random.default_rng(3)
    tasks, X = np.repeat(np.arange(M), 12), rng.uniform(-2.0, 2.0, (36, 2))
    own = np.sin(4.0 * X[:, 0]) * np.array([0.0, 0.0, 0.05])[tasks]
    y = np.cos(X[:, 0]) * np.array([1.0, -0.5, 0.7])[tasks] + own
    data, settings = building.data(X, tasks, y - y.mean(), M), configure(tol=1e-2)
    found = {}
    for diagonal in (False, True):
        form = low_rank(M, 1, diagonal)
        [[mode]] = learn_ranks([(data, settings)], [form])
        found[diagonal] = mode.value
    assert found[True] > found[False] + 5.0


class TestClimb:
    @every_form
    @pytest.mark.parametrize("seed", range(3))
    def test_never_ends_below_its_start(self, data, form, seed):
        settings = configure(max_iter=10)
        theta = start_of(settings, form, seed)
        mode = climb(data, settings, form, theta)
        value = settings.likelihood(data, form).value
        assert mode.value > value(theta)
        np.testing.assert_allclose(mode.value, value(mode.theta), rtol=1e-12)
        lower, upper = settings.bounds(form)
        assert (lower <= mode.theta).all()
        assert (mode.theta <= upper).all()

    @every_form
    def test_ends_at_a_mode(self, data, form):
        settings = configure(tol=1e-6, max_iter=1000)
        mode = climb(data, settings, form, start_of(settings, form))
        assert mode.converged
        assert is_stationary(data, settings, form, mode.theta)
        assert not is_stationary(data, settings, form, start_of(settings, form))

    def test_budget(self, data):
        settings, form = configure(max_iter=3), low_rank(M, 2)
        mode = climb(data, settings, form, start_of(settings, form))
        assert mode.n_iter == 3 < mode.n_evaluations
        assert not mode.converged
        assert mode.seconds > 0.0

    def test_start_beyond_the_bounds(self, data):
        settings, form = configure(max_iter=5), ones(M)
        theta = np.r_[np.full(6, 50.0), 50.0]
        mode = climb(data, settings, form, theta)
        clipped = np.clip(theta, *settings.bounds(form))
        assert mode.value > settings.likelihood(data, form).value(clipped)

    @pytest.mark.parametrize("relaxed", [False, True])
    def test_start_where_the_likelihood_fails(self, data, monkeypatch, relaxed):
        def fail(self, theta):
            return -np.inf, np.full(len(theta), np.nan)

        monkeypatch.setattr(DenseLikelihood, "value_and_grad", fail)
        settings = configure()
        theta = start_of(settings, ones(M))
        mode = climb(data, settings, ones(M), theta, relaxed=relaxed)
        assert mode.value == -np.inf
        assert not mode.converged

    def test_relaxed_climb_climbs_the_penalised_likelihood(self, data, monkeypatch):
        monkeypatch.setattr(climbing, "RELAXED", 0.3)
        settings, form = configure(), identity(M)
        likelihood = settings.likelihood(data, form)

        def penalised(theta):
            away = theta[:6] - KERNEL.theta
            return likelihood.value(theta) - 0.5 * away @ away / 0.3**2

        theta = start_of(settings, form) + 0.5
        mode = climb(data, settings, form, theta, relaxed=True)
        assert penalised(mode.theta) > penalised(theta)
        np.testing.assert_allclose(mode.value, likelihood.value(mode.theta), rtol=1e-12)
        slope = textbook.derivative(penalised, mode.theta)
        assert (
            np.abs(slope).max()
            < 1.0
            < np.abs(textbook.derivative(penalised, theta)).max()
        )

    def test_penalty_holds_the_kernel_alone(self, data, monkeypatch):
        monkeypatch.setattr(climbing, "RELAXED", 1e-5)
        settings, form = configure(), low_rank(M, 2)
        theta = start_of(settings, form)
        mode = climb(data, settings, form, theta, relaxed=True)
        away = np.abs(mode.theta - theta)
        assert away[:6].max() < 1e-6
        assert away[6:-1].min() > 1e-3
        assert away[-1] > 0.1


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("form", [identity(M), ones(M)], ids=["identity", "ones"])
@pytest.mark.parametrize("n_noise", [1, M])
def test_learn_fixed_is_no_worse_than_the_truth(form, seed, n_noise):
    data = draw(form.matrix(np.empty(0)), seed)
    settings = configure(log_noise=np.full(n_noise, np.log(0.1)))
    mode = learn_fixed(data, settings, form)
    truth = np.r_[TRUTH, np.full(n_noise, np.log(NOISE))]
    assert mode.value >= settings.likelihood(data, form).value(truth)
    assert is_stationary(data, settings, form, mode.theta)


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
    settings = configure()
    start = first_stage(data, settings, form)
    theta = start_of(settings, form)
    mode = climb(data, settings, form, theta, relaxed=True)
    np.testing.assert_array_equal(start.kernel_theta, mode.theta[:6])
    expected = literal_augmented_task_covariance(
        data,
        KERNEL.clone_with_theta(mode.theta[:6]),
        form.matrix(np.empty(0)),
        np.exp(mode.theta[-1]),
    )
    np.testing.assert_allclose(start.K_rho, expected, rtol=1e-7)


def test_second_stage_follows_every_start_and_keeps_the_best(data):
    settings, form = configure(max_iter=20), low_rank(M, 2)
    starts = [
        Start(KERNEL.theta, np.ones((M, M))),
        Start(TRUTH, FACTOR @ FACTOR.T),
        Start(KERNEL.theta + 1.0, np.eye(M)),
    ]
    each = second_stage([(data, settings, form, [start]) for start in starts])
    [best] = second_stage([(data, settings, form, starts)])
    alone = max(each, key=lambda mode: mode.value)
    assert best.value == alone.value
    assert best.n_evaluations > alone.n_evaluations  # the other starts' count too
    first = np.concatenate(
        [TRUTH, form.parameters(FACTOR @ FACTOR.T), settings.log_noise]
    )
    expected = annealed(data, settings, form, first)
    expected = shake(data, settings, form, expected, 2)
    np.testing.assert_array_equal(each[1].theta, expected.theta)


class TestShake:
    @pytest.fixture
    def mode(self, data):
        """A poor one: almost no noise, and the kernel as it was."""
        settings, form = configure(), low_rank(M, 2)
        theta = np.append(start_of(settings, form)[:-1], -16.0)
        return mode_at(data, settings, form, theta)

    @pytest.mark.parametrize("times", [0, 1, 2])
    def test_never_worse(self, data, mode, times):
        settings, form = configure(tol=1e-6, max_iter=1000), low_rank(M, 2)
        best = shake(data, settings, form, mode, times)
        assert best.value > mode.value + 1.0 or times == 0
        value = settings.likelihood(data, form).value(best.theta)
        np.testing.assert_allclose(best.value, value, rtol=1e-10)
        if times:
            assert is_stationary(data, settings, form, best.theta)
            assert best.seconds > mode.seconds
            assert best.n_iter > mode.n_iter

    def test_each_begins_where_the_last_ended_and_the_best_counts(
        self, data, mode, monkeypatch
    ):
        starts, settings, form = [], configure(), low_rank(M, 2)
        values = iter([-90.0, -50.0, -70.0])

        def jump(data, settings, form, theta):
            starts.append(theta[-1])
            theta = np.append(theta[:-1], -15.0 - len(starts))
            return Mode(theta, next(values), 7, 8, True, False, 1.0, 36)

        monkeypatch.setattr(climbing, "climb", jump)
        best = shake(data, settings, form, mode._replace(value=-80.0), 3)
        assert starts == [np.log(1e-5)] * 3
        assert best.value == -50.0
        assert best.theta[-1] == -17.0
        assert best.n_iter == mode.n_iter + 14
        assert best.seconds == mode.seconds + 3.0
        assert best.n_evaluations == mode.n_evaluations + 24

    def test_noise_of_noisy_data_is_held_down_at_first(self, data, mode, monkeypatch):
        begun, settings, form = [], configure(), low_rank(M, 2)
        values = iter([-99.0, -50.0, -98.0, -60.0])

        def jump(data, settings, form, theta, *, relaxed=False, held=None):
            begun.append((round(np.exp(theta[-1]), 9), relaxed, held))
            theta = np.append(theta[:-1], np.log(0.01 if held else 0.02))
            return Mode(theta, next(values), 7, 8, True, False, 1.0, 36)

        monkeypatch.setattr(climbing, "climb", jump)
        theta = np.append(mode.theta[:-1], np.log(0.1))
        noisy = mode._replace(theta=theta, value=-80.0)
        best = shake(data, settings, form, noisy, 2)
        low, lower = (1e-4, True, "down"), (2e-3, True, "down")
        assert begun == [low, (0.01, False, None), lower, (0.01, False, None)]
        assert best.value == -50.0
        assert best.n_iter == mode.n_iter + 14
        assert best.n_evaluations == mode.n_evaluations + 32

    def test_noise_that_is_held_down_does_not_rise(self, data, mode):
        settings, form = configure(), low_rank(M, 2)
        theta = np.append(mode.theta[:-1], np.log(1e-4))
        low = climb(data, settings, form, theta, held="down")
        assert low.theta[-1] <= np.log(1e-4)
        assert climb(data, settings, form, theta).theta[-1] > np.log(1e-4)

    def test_fixed_noise_is_not_lowered(self, data, mode, monkeypatch):
        monkeypatch.setattr(climbing, "climb", lambda *_, **__: pytest.fail("climbed"))
        noise = np.log(0.1)
        fixed = configure(log_noise=np.array([noise]), log_noise_bounds=(noise, noise))
        noisy = mode._replace(theta=np.append(mode.theta[:-1], noise))
        assert shake(data, fixed, low_rank(M, 2), noisy, 2) == noisy


@pytest.mark.parametrize("shakes", [0, 1, 3])
def test_second_stage_shakes_the_best_mode(data, monkeypatch, shakes):
    shaken = []

    def count(data, settings, form, mode, times):
        shaken.append((mode.value, times))
        return mode

    monkeypatch.setattr(stages, "shake", count)
    settings, form = configure(max_iter=20), low_rank(M, 2)
    starts = [Start(TRUTH, FACTOR @ FACTOR.T), Start(KERNEL.theta, np.eye(M))]
    alone = [
        annealed(data, settings, form, start.theta(settings, form)) for start in starts
    ]
    second_stage([(data, settings, form, starts)], shakes=shakes)
    [(value, times)] = shaken
    assert times == shakes
    assert value >= max(mode.value for mode in alone)


def test_best_of():
    modes = [
        Mode(np.zeros(1), value, 3, 4, True, False, 0.5, 9) for value in (1.0, 3.0, 2.0)
    ]
    spent = {"seconds": 1.5, "n_evaluations": 12}
    assert best_of(modes) == modes[1]._replace(**spent)
    modes[1] = modes[1]._replace(stalled=True)
    assert best_of(modes) == modes[1]._replace(**spent)
    assert best_of(modes, doubt=0.5) == modes[1]._replace(**spent)
    assert best_of(modes, doubt=1.5) == modes[2]._replace(**spent)


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


def mode_at(data, settings, form, theta):
    value = settings.likelihood(data, form).value(theta)
    return Mode(theta, value, 7, 8, True, False, 0.5, len(data.y))


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "diagonal"])
def forms(request):
    return [low_rank(M, rank, request.param) for rank in (1, 2, 3)]


@pytest.fixture(scope="module")
def modes(data, forms):
    settings = configure()
    good = climb(data, settings, forms[0], start_of(settings, forms[0]))
    bad = [
        mode_at(data, settings, form, np.r_[start_of(settings, form)[:-1], 5.0])
        for form in forms[1:]
    ]
    assert all(mode.value < good.value for mode in bad)
    return [good, *bad]


class TestNest:
    """The higher ranks' modes are deliberately bad."""

    @pytest.mark.parametrize("max_iter", [0, 1, 200])
    @pytest.mark.parametrize("ranks", [(0, 1, 2), (0, 2)], ids=["steps", "leap"])
    def test_values_do_not_fall(self, data, forms, modes, max_iter, ranks):
        settings = configure(max_iter=max_iter)
        forms, modes = [forms[k] for k in ranks], [modes[k] for k in ranks]
        before = list(modes)
        nested = nest(data, settings, forms, modes)
        assert all(a is b for a, b in zip(modes, before, strict=True))
        assert nested[0] is modes[0]
        assert (np.diff([mode.value for mode in nested]) >= 0.0).all()
        for form, mode in zip(forms, nested, strict=True):
            value = settings.likelihood(data, form).value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_higher_rank_is_learned_from_the_lower_one(self, data, forms, modes):
        settings = configure(tol=1e-6, max_iter=1000)
        nested = nest(data, settings, forms[:2], modes[:2])
        assert nested[1].value > nested[0].value + 1.0
        assert nested[1].seconds > modes[1].seconds
        assert nested[1].n_iter > modes[0].n_iter > 0  # the way to it began there
        assert is_stationary(data, settings, forms[1], nested[1].theta)

    def test_new_columns_are_those_that_the_gradient_asks_for(self, data, forms, modes):
        settings = configure(max_iter=0)  # the start alone
        nested = nest(data, settings, forms[:2], modes[:2])
        assert nested[1].value > nested[0].value + 0.01

    def test_the_lower_mode_is_the_last_resort(self, data, forms, modes, monkeypatch):
        monkeypatch.setattr(nesting, "climb", lambda *args: modes[1])
        nested = nest(data, configure(), forms[:2], modes[:2])
        assert nested[1].value == modes[0].value
        likelihood = configure().likelihood(data, forms[1])
        value = likelihood.value(nested[1].theta)
        np.testing.assert_allclose(value, modes[0].value, rtol=1e-12)

    def test_good_modes_are_kept(self, data, forms, modes):
        rising = [mode._replace(value=float(k)) for k, mode in enumerate(modes)]
        nested = nest(data, configure(), forms, rising)
        assert all(a is b for a, b in zip(nested, rising, strict=True))


class TestDescend:
    """The lower ranks' modes are deliberately bad."""

    @pytest.fixture
    def rising(self, data, forms):
        settings = configure()
        good = climb(data, settings, forms[2], start_of(settings, forms[2]))
        bad = [
            mode_at(data, settings, form, np.r_[start_of(settings, form)[:-1], 5.0])
            for form in forms[:2]
        ]
        assert all(mode.value < good.value for mode in bad)
        return [*bad, good]

    def test_lower_ranks_are_learned_from_the_higher_one(self, data, forms, rising):
        settings = configure(tol=1e-6, max_iter=1000)
        before = list(rising)
        better = descend(data, settings, forms, rising)
        assert all(a is b for a, b in zip(rising, before, strict=True))
        assert better[2] is rising[2]
        for form, mode, old in zip(forms[:2], better, rising, strict=False):
            assert mode.value > old.value + 1.0
            assert mode.seconds > old.seconds
            assert is_stationary(data, settings, form, mode.theta)
            value = settings.likelihood(data, form).value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_iterations_are_those_of_the_way(self, data, forms, rising, monkeypatch):
        again = rising[1]._replace(value=1e9, n_iter=7)
        monkeypatch.setattr(nesting, "climb", lambda *args: again)
        lower, highest = descend(data, configure(), forms[1:], rising[1:])
        assert lower.n_iter == highest.n_iter + 7 > 7

    def test_none_is_worse(self, data, forms, rising, monkeypatch):
        worst = rising[0]._replace(value=-1e9)
        monkeypatch.setattr(nesting, "climb", lambda *args: worst)
        better = descend(data, configure(), forms, rising)
        assert [m.value for m in better] == [m.value for m in rising]

    def test_good_modes_are_kept(self, data, forms, rising):
        falling = [mode._replace(value=-float(k)) for k, mode in enumerate(rising)]
        better = descend(data, configure(), forms, falling)
        assert all(a is b for a, b in zip(better, falling, strict=True))


class TestCoarseToFine:
    @pytest.fixture
    def small(self, monkeypatch):
        """The coarsest level has 12 rows."""
        monkeypatch.setattr(problem, "COARSE", 12)
        monkeypatch.setattr(problem, "COARSE_PER_TASK", 2)
        monkeypatch.setattr(problem, "REFINEMENT", 2.0)

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

    @pytest.mark.parametrize("part", ["thinned", "drawn"])
    def test_time_does_not_grow_with_the_tasks_times_the_rows(self, part):
        n, n_tasks = 200_000, 20_000
        tasks = np.arange(n) // (n // n_tasks)
        data = building.data(np.zeros((n, 1)), tasks, np.zeros(n), n_tasks)
        begin = time.process_time()
        some = getattr(data, part)(40_000)
        assert time.process_time() - begin < 2.0  # 10 s, were it so
        np.testing.assert_array_equal(np.bincount(some.tasks), 2)

    @pytest.mark.usefixtures("small")
    def test_levels_are_nested(self, data):
        levels = data.levels()
        assert [len(level.y) for level in levels] == [12, 21, 36]
        assert levels[-1] is data
        for few, more in pairwise(levels):
            assert set(few.y) < set(more.y)

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
    def test_sizes_of_levels(self, n, M, sizes):
        tasks = np.sort(np.arange(n) % M)
        data = building.data(np.zeros((n, 1)), tasks, np.zeros(n), M)
        found = [len(level.y) for level in data.levels()]
        np.testing.assert_allclose(found, sizes, atol=M)
        assert len(found) == len(sizes)

    @pytest.mark.usefixtures("small")
    def test_refine_ends_at_a_mode_of_all_rows(self, data):
        settings, form = configure(tol=1e-6, max_iter=1000), low_rank(M, 2)
        coarse = data.levels()[0]
        first = climb(coarse, settings, form, start_of(settings, form))
        mode = refine(data, settings, form, first)
        assert mode.n_samples == len(data.y)
        assert mode.n_iter > first.n_iter
        assert mode.n_evaluations > first.n_evaluations
        assert mode.seconds > first.seconds
        assert is_stationary(data, settings, form, mode.theta)

    @pytest.mark.usefixtures("small")
    def test_refine_starts_with_noise_that_is_not_too_small(self, data, monkeypatch):
        starts = []
        settings, form = configure(), low_rank(M, 2)
        mode = mode_at(
            data, settings, form, np.r_[start_of(settings, form)[:-1], -22.0]
        )

        def stay(level, settings, form, theta, **options):
            starts.append((len(level.y), theta[-1], *options))
            return mode

        monkeypatch.setattr(climbing, "climb", stay)
        refine(data, settings, form, mode)
        held = np.log(1e-5)
        assert starts == [(21, held, "relaxed", "held"), (21, -22.0), (36, held)]
        assert mode.theta[-1] == -22.0

    @pytest.mark.usefixtures("small")
    @pytest.mark.parametrize("form", [identity(M), ones(M)], ids=["identity", "ones"])
    def test_learn_fixed(self, data, form):
        settings = configure(tol=1e-6, max_iter=1000)
        mode = learn_fixed(data, settings, form)
        assert mode.n_samples == 36
        assert is_stationary(data, settings, form, mode.theta)

    def test_learn_ranks(self, monkeypatch):
        monkeypatch.setattr(problem, "COARSE", 36)
        monkeypatch.setattr(problem, "COARSE_PER_TASK", 2)
        data, settings = draw(FACTOR @ FACTOR.T, per_task=30), configure()
        assert len(data.levels()) == 2
        [modes] = learn_ranks([(data, settings)], RANKS)
        values = [mode.value for mode in modes]
        assert (np.diff(values) >= 0.0).all()
        for form, mode in zip(RANKS, modes, strict=True):
            value = settings.likelihood(data, form).value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)
        theta = np.concatenate([TRUTH, FACTOR.ravel(), [np.log(NOISE)]])
        assert values[1] > settings.likelihood(data, RANKS[1]).value(theta)


RANKS = [low_rank(M, 1), low_rank(M, 2), low_rank(M, 3)]


@pytest.fixture(scope="module")
def pairs(data):
    other = draw(FACTOR @ FACTOR.T, seed=1)
    return [(data, configure()), (other, configure(log_noise=np.full(M, -2.0)))]


@pytest.fixture(scope="module")
def learned(pairs):
    return learn_ranks(pairs, RANKS)


class TestLearnRanks:
    def test_no_worse_than_the_truth(self, pairs, learned):
        for (data, settings), modes in zip(pairs, learned, strict=True):
            n_noise = len(settings.log_noise)
            noise = np.full(n_noise, np.log(NOISE))
            theta = np.concatenate([TRUTH, FACTOR.ravel(), noise])
            truth = settings.likelihood(data, RANKS[1]).value(theta)
            assert modes[1].value > truth

    def test_values_do_not_fall_with_the_rank(self, learned):
        for modes in learned:
            assert (np.diff([mode.value for mode in modes]) >= 0.0).all()

    def test_values_are_those_of_the_parameters(self, pairs, learned):
        for (data, settings), modes in zip(pairs, learned, strict=True):
            for form, mode in zip(RANKS, modes, strict=True):
                value = settings.likelihood(data, form).value(mode.theta)
                np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_outputs_are_learned_separately(self, pairs, learned):
        alone = learn_ranks(pairs[1:], RANKS)
        self.assert_same(alone, learned[1:])

    @pytest.mark.parametrize("n_jobs", [1, 2])
    def test_processes_do_not_matter(self, pairs, learned, n_jobs):
        self.assert_same(learn_ranks(pairs, RANKS, n_jobs=n_jobs), learned)

    def assert_same(self, one, other):
        for modes, others in zip(one, other, strict=True):
            for a, b in zip(modes, others, strict=True):
                assert a.value == b.value
                np.testing.assert_array_equal(a.theta, b.theta)
                assert a[2:5] == b[2:5]

    def test_starts(self, data, monkeypatch):
        followed = []

        def follow(jobs, **options):
            followed.extend(starts for *_, starts in jobs)
            return second_stage(jobs, **options)

        monkeypatch.setattr(ranks, "second_stage", follow)
        settings = configure(max_iter=3)
        learn_ranks([(data, settings)], RANKS[:2], seeds=(5, 6))
        plain = [first_stage(data, settings, form) for form in (identity(M), ones(M))]
        full = full_rank_start(data, settings, plain[0])
        expected = [*plain, full, perturbed(plain[0], 6)]
        for starts in followed:
            for start, other in zip(starts, expected, strict=True):
                np.testing.assert_array_equal(start.kernel_theta, other.kernel_theta)
                np.testing.assert_array_equal(start.K_rho, other.K_rho)
        assert len(followed) == 2

    @pytest.mark.parametrize("n_jobs", [1, 2])
    def test_report(self, pairs, n_jobs):
        pairs = [
            (data, replace(settings, max_iter=1, name=f"output {j} of 2"))
            for j, (data, settings) in enumerate(pairs, start=1)
        ]
        listener = Listener()
        learn_ranks(pairs, RANKS, n_jobs=n_jobs, progress=listener)
        pattern = (
            r"output (\d) of 2, rank (\d): "
            r"log marginal likelihood -?\d+\.\d\d \(scaled\) of 36 rows after \d+ "
            r"iterations"
        )
        of_stage = "(, the best of 2 starts|, shaken|, without levels first): log"
        pattern = pattern.replace(": log", of_stage)
        assert listener.lines[0] is None  # the first of two starts
        lines = [line for line in listener.lines if line]
        found = [re.fullmatch(pattern, line).groups() for line in lines]
        stages = ", the best of 2 starts", ", shaken", ", without levels first"
        assert found == [(j, r, stage) for stage in stages for j in "12" for r in "123"]
        assert listener.stages == [("starts", 12), ("learning", 6), ("levels", 6)]

    def test_report_of_all_rows(self, monkeypatch):
        monkeypatch.setattr(problem, "COARSE", 36)
        monkeypatch.setattr(problem, "COARSE_PER_TASK", 2)
        pair = draw(FACTOR @ FACTOR.T, per_task=30), configure(max_iter=1)
        listener = Listener()
        learn_ranks([pair], RANKS[:1], progress=listener)
        lines = [line.split(" log ")[0] for line in listener.lines if line]
        stages = [
            "the best of 2 starts",
            "shaken",
            "without levels first",
            "from all rows",
        ]
        assert [line.split(", ")[-1] for line in lines] == [f"{s}:" for s in stages]

    def test_report_of_each_climb(self, data, capsys, monkeypatch):
        monkeypatch.setattr(climbing, "REPORT_EVERY", 5)
        settings = configure(max_iter=12, name="torque", verbose=2)
        learn_ranks([(data, settings)], RANKS[1:2])
        lines = capsys.readouterr().out.splitlines()
        pattern = (
            r"\[skmtgp\] torque, (rank 2|fixed task covariance), 36 rows, "
            r"iteration (\d+): log marginal likelihood -?\d+\.\d\d, "
            r"noise variance \d\.\de[+-]\d\d of the target's"
            r"(: no more gain|: budget spent|: no digits left|)"
        )
        found = [re.fullmatch(pattern, line) for line in lines]
        assert all(found)
        groups = [match.groups() for match in found]
        assert ("rank 2", "5", "") in groups
        assert ("rank 2", "12", ": budget spent") in groups
        assert groups[0][0] == "fixed task covariance"

    def test_quiet(self, pairs, capsys):
        pairs = [(pairs[0][0], configure(max_iter=1))]
        learn_ranks(pairs, [low_rank(M, 1)])
        assert capsys.readouterr() == ("", "")

    def test_one_task(self):
        data = draw(np.ones((1, 1)), M=1, per_task=20)
        settings, form = configure(), low_rank(1, 1)
        [[mode]] = learn_ranks([(data, settings)], [form])
        truth = np.r_[TRUTH, 1.0, np.log(NOISE)]
        assert mode.value > settings.likelihood(data, form).value(truth)


@pytest.mark.parametrize(("rank", "size"), [(3, 2.0), (6, 1.0)])
def test_what_varies_little_is_not_noise(rank, size):
    """A sine is small beside the levels of the tasks, and large beside the noise."""
    rng = np.random.default_rng(0)
    task, x = np.repeat(np.arange(6), 40), rng.uniform(0.0, 6.0, 240)
    amplitudes = np.array([1.0, 0.9, 1.1, 1.2, 0.8, 1.0])
    y = size * np.array([10, 35, 22, 80, 55, 41])[task] + amplitudes[task] * np.sin(x)
    X, y = np.column_stack([x, task]), y + 0.05 * rng.standard_normal(240)
    test = np.arange(240) % 4 == 0
    model = MultiTaskGPRegressor(rank=rank).fit(X[~test], y[~test])
    error = model.predict(X[test]) - y[test]
    assert np.sqrt(np.square(error).mean()) < 0.1


def test_full_rank_start(data):
    """Its K_1 is that of a model of full rank, better than the one it begins with."""
    settings = configure()
    start = first_stage(data, settings, identity(M))
    full, form = full_rank_start(data, settings, start), low_rank(M, M)
    likelihood = settings.likelihood(data, form)

    def value(K_rho, kernel):
        rho = form.parameters(K_rho)
        noises = [[log_noise] for log_noise in np.linspace(-8.0, 0.0, 17)]
        thetas = [np.concatenate([kernel, rho, noise]) for noise in noises]
        return max(likelihood.value(theta) for theta in thetas)

    assert np.linalg.matrix_rank(full.K_rho) == M
    before = value(np.eye(M), start.kernel_theta)
    assert value(full.K_rho, full.kernel_theta) > before + 1.0
