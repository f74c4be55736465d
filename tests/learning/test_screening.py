import building
import numpy as np
import pytest
from drawn import pose

from skmtgp.learning.climbing import climb
from skmtgp.learning.screening import tells_noise, with_own_noise
from skmtgp.model.task_covariance import low_rank


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
    _, ended = with_own_noise(problem, mode, to_the_end=False)
    assert tells_noise(own, to_the_end) is tells_noise(own, ended) is told
    assert ended.n_evaluations <= to_the_end.n_evaluations
    assert (ended.n_evaluations == to_the_end.n_evaluations) is told
    if told:  # it has fallen as far
        fall = np.ptp(own.prior.log_noise_at(ended.theta))
        assert fall > -np.log(problem.tuning.vanished)
