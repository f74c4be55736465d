"""The prior of the targets."""

import pickle
from dataclasses import replace

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.model.described import task_covariance
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import FixedTaskCovariance, low_rank

Q = np.array([[1.0, -1.0, 0.3], [1.0, 0.2, -1.3], [1.0, 0.8, 1.0]])


class Counting(RBF):
    """A kernel that counts how often it is asked for its parameters."""

    asked = 0

    @property
    def hyperparameters(self):
        Counting.asked += 1
        return super().hyperparameters


def test_theta_is_split_without_asking_the_kernel():
    # scikit-learn inspects a kernel anew each time: longer than a small likelihood
    prior = Prior(Counting([1.0, 2.0]), low_rank(3, 2), n_noise=3, levels=True)
    theta = prior.theta()
    values, asked = prior.values(theta), Counting.asked
    again = prior.values(theta)
    assert Counting.asked == asked
    np.testing.assert_array_equal(np.concatenate(values[:2]), theta[:-4])
    np.testing.assert_allclose(again.noise, np.exp(theta[-3:]))
    np.testing.assert_allclose(again.level, np.exp(theta[-4]))


@pytest.mark.parametrize("levels", [False, True])
def test_covariance_by_the_book(levels):
    kernel, form = RBF([1.0, 2.0]), low_rank(3, 2)
    prior = Prior(kernel, form, levels=levels)
    rng = np.random.default_rng(0)
    X, tasks = rng.normal(size=(7, 2)), np.array([0, 0, 1, 1, 1, 2, 2])
    F = rng.normal(size=(3, 2))
    theta = prior.theta(kernel=np.log([0.5, 1.5]), K_rho=F @ F.T)
    level = np.exp(theta[-2]) if levels else 0.0
    K_x, K_rho = RBF([0.5, 1.5])(X), F @ F.T
    expected = [
        [K_rho[m, k] * K_x[i, j] + level * (m == k) for j, k in enumerate(tasks)]
        for i, m in enumerate(tasks)
    ]
    np.testing.assert_allclose(prior.covariance(theta, X, tasks), expected, rtol=1e-12)


def test_levels_that_vanish():
    with_levels = Prior(RBF([1.0, 2.0]), low_rank(3, 2), n_noise=3, levels=True)
    bare = replace(with_levels, levels=False)
    theta = bare.theta(K_rho=np.eye(3))
    assert not bare.levels_vanish(theta)
    least = with_levels.with_least_levels(theta)
    np.testing.assert_array_equal(with_levels.less_levels(least), theta)
    assert with_levels.levels_vanish(least)
    values = with_levels.values(least)
    np.testing.assert_allclose(values.level, with_levels.least_level)
    expected = bare.values(theta)._replace(level=values.level)
    for part, same in zip(values, expected, strict=True):
        np.testing.assert_array_equal(part, same)
    larger = least.copy()
    larger[-4] = larger[-3:].min() + 0.1
    assert not with_levels.levels_vanish(larger)


class OneNumber(FixedTaskCovariance):
    """K^rho = a I, whose rank is that of K^rho; its parameter log a is no factor."""

    n_parameters = n_free = 1

    def __init__(self):
        super().__init__(np.eye(3))
        self.rank = 3

    def bounds(self, scale):
        return np.log([[1e-6, 1e6]])

    def parameters(self, K, truncation="eigen"):
        return np.zeros(1)


def test_parameters_of_a_form_without_a_factor_are_none():
    model = Prior(RBF(), OneNumber(), n_noise=3, levels=True)
    assert not model.of_factor.any()
    assert model.of_noise.sum() == 3


def test_the_kernel_at_theta_is_made_once():
    prior = Prior(RBF([1.0, 2.0]), low_rank(3, 1))
    theta = prior.theta()
    kernel = prior.kernel_at(theta)
    assert prior.kernel_at(theta.copy()) is kernel
    other = prior.kernel_at(theta + 0.1)
    np.testing.assert_allclose(other.theta, kernel.theta + 0.1)
    np.testing.assert_array_equal(prior.kernel_at(theta).theta, kernel.theta)


def test_a_prior_of_one_more_task_knows_the_kernel():
    prior = Prior(RBF([1.0, 2.0]), low_rank(3, 1))
    theta = prior.theta()
    node, kernel = prior.node, prior.kernel_at(theta)
    more, theta = prior.bordered(theta, [np.ones(1)], [None], 1)
    assert more.kernel_at(theta) is kernel
    assert more.node is node
    assert pickle.dumps(more) == pickle.dumps(replace(more))  # without either


def test_the_users_kernel_is_another():
    prior = Prior(RBF([1.0, 2.0]), low_rank(3, 1))
    theta = prior.theta()
    found = prior.in_units(theta, np.ones(1)).kernel
    assert found == prior.kernel_at(theta)
    assert found is not prior.kernel_at(theta)


@pytest.mark.parametrize(
    ("low", "high"),
    [
        (low_rank(3, 1), low_rank(3, 3)),
        (low_rank(3, 0, shared=True), low_rank(3, 2)),
        (low_rank(3, 0, shared=True), low_rank(3, 2, shared=True)),
        (low_rank(3, 1, shared=True), low_rank(3, 2, shared=True)),
        (low_rank(3, 1, diagonal=True), low_rank(3, 2, diagonal=True)),
        (low_rank(3, 0, True, shared=True), low_rank(3, 2, True)),
        (low_rank(3, 0, "equal", shared=True), low_rank(3, 2, "equal")),
        (task_covariance(3, 1, Q), task_covariance(3, 2, Q)),
    ],
    ids=str,
)
def test_theta_of_a_lower_rank(low, high):
    low = building.prior(RBF([1.0, 2.0]), low, levels=True)
    high = building.prior(RBF([1.0, 2.0]), high, levels=True)
    theta = Hyperprior(low).draw(np.random.default_rng(0))
    wide = high.widened(theta, low)
    np.testing.assert_allclose(high.K_rho_at(wide), low.K_rho_at(theta), rtol=1e-12)
    np.testing.assert_array_equal(wide[:2], theta[:2])
    np.testing.assert_array_equal(wide[-2:], theta[-2:])
