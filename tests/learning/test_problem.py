import numpy as np
import pytest
import textbook
from drawn import KERNEL, M, configure, every_form
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning.problem import Mode, best_of
from skmtgp.model.task_covariance import low_rank, ones


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
