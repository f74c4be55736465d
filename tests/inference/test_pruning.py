"""Which rows tell least."""

import numpy as np
import pytest
from samples import draw

from skmtgp import MultiTaskGPRegressor
from skmtgp.inference.pruning import least_informative


@pytest.fixture(scope="module")
def model():
    X, y = draw(per_task=6, n_outputs=2)
    model = MultiTaskGPRegressor(rank=1, inference="dense", max_iter=0)
    return model.set_params(noise="per_task").fit(X, y)


def information(posterior, left):
    """Of each row of some, given the others of them: from two determinants."""
    values = posterior.prior.values(posterior.theta)
    X, tasks = posterior.bound.differences.sets[0][left], posterior.tasks[left]
    K = posterior.prior.covariance(posterior.theta, X, tasks)
    noise = values.noise[tasks]
    told = np.linalg.inv(K + np.diag(noise))
    return -0.5 * np.log(noise * np.diagonal(told))


def test_each_is_the_one_that_tells_least_of_those_left(model):
    posteriors, left, expected = model._posteriors, np.arange(18), []
    for _ in range(8):
        told = sum(information(posterior, left) for posterior in posteriors)
        expected.append(left[np.argmin(told)])
        left = np.delete(left, np.argmin(told))
    found = least_informative(posteriors, 8)
    assert found.tolist() == expected


def test_a_row_of_each_task_stays(model):
    rows = least_informative(model._posteriors, 15)
    left = np.delete(model._posteriors[0].tasks, rows)
    assert left.tolist() == [0, 1, 2]
    assert len(set(rows.tolist())) == 15
