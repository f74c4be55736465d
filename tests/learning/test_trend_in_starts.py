"""What learning asks of the data where there is a trend: nothing that the trend is."""

from dataclasses import replace

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning.hidden import _scores
from skmtgp.learning.neighbours import correlated_share
from skmtgp.learning.problem import Mode
from skmtgp.learning.stages import augmented_task_covariance
from skmtgp.model.task_covariance import low_rank
from skmtgp.model.trend import Trend

M, N = 3, 240


def columns(X):
    return np.column_stack([np.ones(len(X)), X])


def problem(steepness):
    """Correlated noise and a function that is hidden, on a slope."""
    rng = np.random.default_rng(0)
    tasks, X = np.repeat(range(M), N // M), rng.uniform(0, 9, (N, 1))
    noise = np.convolve(rng.standard_normal(N + 4), np.ones(5), "valid")
    trend = Trend(columns, M, False, np.zeros((1, 2)), np.ones(1), np.zeros((1, 2)))
    y = np.sin(3.0 * X[:, 0]) * tasks + 0.3 * noise + steepness * (X[:, 0] - 2.0)
    given = building.problem(
        RBF(1.0), low_rank(M, 1), building.data(X, tasks, y, M), noise=0.5
    )
    return replace(given, prior=replace(given.prior, trend=trend))


def mode(given):
    return Mode(given.theta(), 0.0, 0, 0, True, False, 0.0, N)


FOUND = {
    "the first K^rho": lambda given: augmented_task_covariance(
        given.data, given.likelihood().posterior(given.theta())
    ),
    "what is hidden": lambda given: list(_scores(given, mode(given))),
    "neighbours": lambda given: correlated_share(given, mode(given)),
}


@pytest.mark.parametrize("what", FOUND)
def test_a_steep_trend_makes_no_difference(what):
    plain, steep = (FOUND[what](problem(steepness)) for steepness in (0.0, 1e4))
    assert np.any(plain)
    np.testing.assert_allclose(steep, plain, rtol=1e-6, atol=1e-9)


def test_coarse_data_have_rows_for_the_coefficients():
    given = problem(0.0)
    few = given.tuning
    many = replace(few, coarse=10, coarse_per_task=2, refinement=3.0)
    sizes = [len(of.data) for of in replace(given, tuning=many).coarse_to_fine()]
    without = replace(given, prior=replace(given.prior, trend=None), tuning=many)
    assert sizes[0] > len(without.coarse_to_fine()[0].data)
