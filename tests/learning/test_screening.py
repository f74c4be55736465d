import building
import numpy as np
import pytest
from drawn import pose
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp.learning.climbing import climb
from skmtgp.learning.screening import (
    as_large,
    criterion,
    screen,
    tells_noise,
    with_kernel,
    with_own_noise,
)
from skmtgp.model.task_covariance import identity, low_rank, ones


def drawn(n_rows, deviations):
    """Tasks that are one function, with noise of these deviations."""
    rng = np.random.default_rng(2)
    tasks = np.repeat(np.arange(len(deviations)), n_rows)
    X = rng.uniform(-2.0, 2.0, (len(tasks), 2))
    noise = np.asarray(deviations)[tasks] * rng.standard_normal(len(tasks))
    return building.data(X, tasks, np.sin(X[:, 0]) + noise, len(deviations))


@pytest.mark.parametrize(
    ("data", "rank", "told"),
    [(drawn(40, [0.5, 0.5, 0.003]), 1, True), (drawn(5, [0.5] * 8), 3, False)],
    ids=["one precise task of many rows", "few rows, which noise follows"],
)
def test_a_climb_ends_where_noise_follows_rows(data, rank, told):
    problem = pose(data, low_rank(data.n_tasks, rank), max_iter=100)
    alike = np.ones((data.n_tasks,) * 2) + 0.1 * np.eye(data.n_tasks)
    mode = climb(problem, problem.theta(K_rho=alike))
    own, to_the_end = with_own_noise(problem, mode)
    _, ended = with_own_noise(problem, mode, least=-np.inf)
    assert tells_noise(own, to_the_end) is tells_noise(own, ended) is told
    assert ended.n_evaluations <= to_the_end.n_evaluations
    assert (ended.n_evaluations == to_the_end.n_evaluations) is told
    if told:  # it has fallen as far
        fall = np.ptp(own.prior.log_noise_at(ended.theta))
        assert fall > -np.log(problem.tuning.vanished)


def test_a_climb_ends_where_noise_cannot_gain_enough():
    data = drawn(40, [0.5, 0.2, 0.1])
    problem = pose(data, low_rank(data.n_tasks, 1), max_iter=100)
    mode = climb(problem, problem.theta(K_rho=0.1 * np.eye(3) + 1.0))
    own, to_the_end = with_own_noise(problem, mode)
    within = criterion(own, to_the_end) - 1.0
    assert with_own_noise(problem, mode, least=within)[1].value == to_the_end.value
    _, ended = with_own_noise(problem, mode, least=within + 1000.0)
    assert ended.n_evaluations < to_the_end.n_evaluations
    assert mode.value < ended.value < to_the_end.value


@pytest.mark.parametrize("n_rows", [5, 40])
def test_a_climb_ends_where_another_kernel_cannot_gain_enough(n_rows):
    data, kernel = drawn(n_rows, [0.1, 0.1, 0.1]), RBF([1.0, 1.0])
    problem = pose(data, low_rank(data.n_tasks, 1), kernel=kernel, max_iter=100)
    mode = climb(problem, problem.theta(K_rho=0.1 * np.eye(3) + 1.0))
    rougher = Matern([1.0, 1.0], nu=1.5)
    _, to_the_end = with_kernel(problem, mode, rougher)
    _, ended = with_kernel(problem, mode, rougher, gain=2.0)
    assert ended.n_evaluations <= to_the_end.n_evaluations
    worth = mode.value + 2.0
    assert (to_the_end.value > worth) is (ended.value > worth)


def test_functions_are_as_large_in_all_tasks():
    data = drawn(12, [0.5, 0.1, 0.02])
    problem, mode = screen(pose(data, low_rank(3, 0, True), max_iter=100))
    sizes = np.diagonal(problem.prior.K_rho_at(mode.theta))
    equal = as_large(problem, mode)
    K_rho = problem.prior.K_rho_at(equal.theta)
    assert sizes.max() > 1.01 * sizes.min()
    np.testing.assert_allclose(K_rho, K_rho[0, 0] * np.eye(3), rtol=1e-12)
    assert equal.value == pytest.approx(problem.likelihood().value(equal.theta))
    assert equal.value <= mode.value
    assert equal.n_evaluations > mode.n_evaluations


@pytest.mark.parametrize(
    "form", [identity(3), identity(3, True), ones(3), low_rank(3, 1, True)]
)
def test_others_have_no_sizes(form):
    problem, mode = screen(pose(drawn(12, [0.5, 0.1, 0.02]), form, max_iter=5))
    assert as_large(problem, mode) is None
