"""The prior of the targets."""

import numpy as np
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
