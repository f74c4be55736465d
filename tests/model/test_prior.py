"""The prior of the targets."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank


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
