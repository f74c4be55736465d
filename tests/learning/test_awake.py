"""Modes without functions, from which none can grow: they begin again small."""

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, DotProduct

from skmtgp import MultiTaskGPRegressor
from skmtgp.learning.climbing import climb
from skmtgp.learning.hidden import awaken
from skmtgp.learning.problem import Mode
from skmtgp.learning.tuning import TUNING
from skmtgp.model.task_covariance import low_rank

M = 3
SHARED = low_rank(M, 0, shared=True)


def pose(y, n_features=2, **changes):
    """Rows of three tasks with one function."""
    rng = np.random.default_rng(1)
    X = rng.uniform(-2.0, 2.0, (len(y), n_features))
    tasks = np.sort(np.arange(len(y)) % M)
    data = building.data(X, tasks, y(X) if callable(y) else y, M)
    kernel = RBF(np.full(n_features, 2.0), (1e-2, 1e3))
    given = {"scale": np.sqrt(np.square(data.y).mean()), "noise": 1e-2, "tol": 1e-2}
    return building.problem(kernel, SHARED, data, **given | changes)


class Waves:
    """A wave of each input in much noise."""

    def __init__(self, size, n=150):
        self.size, self.n = size, n

    def __len__(self):
        return self.n

    def __call__(self, X):
        rng = np.random.default_rng(2)
        f = np.sin(2.0 * X[:, 0]) + np.cos(2.0 * X[:, 1])
        return self.size * f + rng.standard_normal(len(X))


def asleep(problem):
    """All is noise but for next to nothing."""
    noise = np.log(np.square(problem.data.y).mean())
    theta = problem.theta(K_rho=np.full((M, M), 1e-9), log_noise=noise)
    value = problem.likelihood().value(theta)
    return Mode(theta, value, 1, 5, True, False, 1.0, len(problem.data))


def test_functions_begin_again_where_a_climb_finds_none():
    problem = pose(Waves(1.0))
    mode = asleep(problem)
    gradient = problem.likelihood().value_and_grad(mode.theta)[1]
    assert abs(gradient[problem.prior.of_length_scales]).max() < 1e-6
    found = awaken(problem, mode)
    assert found.value > mode.value + 20.0
    assert problem.likelihood().value(found.theta) == pytest.approx(found.value)
    assert found.n_evaluations > mode.n_evaluations
    usual = climb(problem, problem.theta())
    assert found.value >= usual.value - problem.budget.tol


@pytest.mark.parametrize("n_features", [1, 2, 4])
@pytest.mark.parametrize("seed", range(4))
def test_pure_noise_stays_noise(seed, n_features):
    y = np.random.default_rng(seed).standard_normal(90)
    problem = pose(y, n_features)
    mode = asleep(problem)
    found = awaken(problem, mode)
    assert found.theta is mode.theta
    assert found.value == mode.value
    assert found.n_evaluations > mode.n_evaluations  # it was tried
    assert found.rivals == ()


def test_functions_that_are_there_are_left_alone():
    problem = pose(Waves(1.0))
    theta = problem.theta(K_rho=np.ones((M, M)), log_noise=0.0)
    mode = asleep(problem)._replace(theta=theta)
    assert awaken(problem, mode) is mode


def test_without_iterations_nothing_begins():
    problem = pose(Waves(1.0), max_iter=0)
    mode = asleep(problem)
    assert awaken(problem, mode) is mode


def test_functions_begin_at_the_size_that_tuning_says():
    problem, begun = pose(Waves(1.0)), []
    mode = asleep(problem)

    def climbed(problem, theta, known):
        begun.append(theta)
        return mode

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skmtgp.learning.hidden.climb", climbed)
        awaken(problem, mode)
    prior, noise = problem.prior, np.square(problem.data.y).mean()
    for theta, step in zip(begun, TUNING.awake_at, strict=True):
        np.testing.assert_allclose(prior.K_rho_at(theta), TUNING.awake * noise)
        left = prior.values(theta).noise
        np.testing.assert_allclose(left, (1.0 - TUNING.awake) * noise)
        scales = np.exp(theta[prior.of_length_scales])
        np.testing.assert_allclose(scales, 2.0 * np.exp(step))


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.NarrowIntervalsWarning")
@pytest.mark.parametrize("rank", [None, 1])
def test_a_kernel_that_is_zero_at_all_rows_leaves_the_levels(rank):
    rng = np.random.default_rng(0)
    X, y = np.column_stack([np.zeros(40), np.arange(40) % 4]), rng.standard_normal(40)
    model = MultiTaskGPRegressor(rank=rank, kernel=DotProduct(0.0, "fixed")).fit(X, y)
    assert np.abs(model.predict(X[:4])).max() < 1.0
