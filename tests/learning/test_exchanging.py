"""Past deliberately bad modes of data with little noise."""

from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from drawn import FACTOR, M, mode_at, pose
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from skmtgp.learning import exchanging
from skmtgp.learning.climbing import climb
from skmtgp.learning.exchanging import exchange, exchanged, reopen
from skmtgp.model.task_covariance import low_rank

TRUTH = np.log([1.5, 0.7, 30.0, 300.0])  # a constant and three length-scales
NOISE = 1e-9


@pytest.fixture(scope="module")
def problem():
    kernel = ConstantKernel(1.0) * RBF([1.0, 1.0, 1.0])
    rng = np.random.default_rng(3)
    X, tasks = rng.uniform(-2.0, 2.0, (36, 3)), np.repeat(np.arange(M), 12)
    true = kernel.clone_with_theta(TRUTH)
    K = textbook.covariance(true, FACTOR @ FACTOR.T, NOISE, X, tasks)
    y = np.linalg.cholesky(K) @ rng.standard_normal(36)
    bounds = tuple(np.log([1e-10, 10.0]))
    data = building.data(X, tasks, y, M)
    return pose(data, low_rank(M, 2), kernel=kernel, log_noise_bounds=bounds)


def at(problem, kernel, noise=NOISE):
    return mode_at(
        problem,
        problem.theta(kernel=kernel, K_rho=FACTOR @ FACTOR.T, log_noise=np.log(noise)),
    )


class TestExchange:
    def test_finds_the_feature_that_matters(self, problem):
        poor = at(problem, TRUTH[[0, 2, 1, 3]])
        found = exchange(problem, poor)
        truth = climb(problem, at(problem, TRUTH).theta)
        assert poor.value < truth.value - 10.0
        assert found.value > truth.value - 0.5
        assert found.n_evaluations > poor.n_evaluations
        value = problem.likelihood().value(found.theta)
        np.testing.assert_allclose(found.value, value, rtol=1e-8)

    def test_keeps_a_good_mode_for_no_evaluation(self, problem):
        good = climb(problem, at(problem, TRUTH).theta)
        assert exchange(problem, good) is good

    def test_noisy_data_have_their_mode(self, problem, monkeypatch):
        monkeypatch.setattr(exchanging, "exchanged", None)  # is not called
        noisy = at(problem, TRUTH[[0, 2, 1, 3]], noise=0.1)
        assert exchange(problem, noisy) is noisy

    def test_what_stalls_is_taken_if_it_is_much_better_alone(
        self, problem, monkeypatch
    ):
        poor, gains = at(problem, TRUTH[[0, 2, 1, 3]]), []

        def stall(problem, theta):
            gains.append(1)
            return poor._replace(theta=theta, value=poor.value + 0.5, stalled=True)

        monkeypatch.setattr(exchanging, "climb", stall)
        found = exchange(problem, poor)
        assert found.theta is poor.theta
        assert found.n_evaluations > poor.n_evaluations
        assert len(gains) == 1

    def test_ends_after_some(self, problem):
        tuning = replace(problem.tuning, exchanges=0)
        poor = at(problem, TRUTH[[0, 2, 1, 3]])
        assert exchange(replace(problem, tuning=tuning), poor) is poor


class TestExchanged:
    def test_pairs_of_length_scales(self, problem):
        theta = at(problem, TRUTH).theta
        pairs = exchanged(problem, theta)
        assert len(pairs) == 3
        for other in pairs:
            np.testing.assert_array_equal(other[4:], theta[4:])
            assert sum(other != theta) == 2
            assert sorted(other[1:4]) == sorted(theta[1:4])

    def test_the_farthest_from_its_bounds_first_and_no_more_than_allowed(self, problem):
        theta = at(problem, TRUTH).theta
        few = replace(problem, tuning=replace(problem.tuning, most_exchanges=2))
        pairs = exchanged(few, theta)
        assert len(pairs) == 2
        assert all(other[1] != theta[1] for other in pairs)

    def test_none_of_what_is_alike_or_off(self, problem):
        upper = np.log(1e5)
        kernel = np.r_[TRUTH[0], upper - 0.5, upper - 0.2, upper]
        assert exchanged(problem, at(problem, kernel).theta) == []
        alike = at(problem, np.r_[TRUTH[0], 1.0, 1.0, 1.05])
        assert exchanged(problem, alike.theta) == []

    @pytest.mark.parametrize(
        "kernel",
        [RBF(1.0), RBF([1.0, 2.0, 3.0], "fixed"), RBF(2.0) * RBF(3.0), WhiteKernel()],
        ids=str,
    )
    def test_none_where_no_feature_has_its_own(self, problem, kernel):
        other = pose(problem.data, low_rank(M, 2), kernel=kernel)
        assert exchanged(other, other.theta()) == []


class TestReopen:
    def test_finds_what_the_mode_missed(self, problem):
        off = np.log(1e5)
        poor = at(problem, [TRUTH[0], off, TRUTH[1], off], noise=1e-6)
        found = reopen(problem, poor)
        assert found.value > poor.value + 10.0
        assert found.n_evaluations > poor.n_evaluations
        value = problem.likelihood().value(found.theta)
        np.testing.assert_allclose(found.value, value, rtol=1e-8)

    def test_is_never_worse(self, problem):
        good = at(problem, TRUTH)._replace(value=1e6)
        found = reopen(problem, good)
        assert found.value == good.value
        assert found.n_evaluations > good.n_evaluations
