import numpy as np
import pytest
import textbook
from drawn import KERNEL, M, every_form, pose
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning.problem import Mode, best_of
from skmtgp.model.task_covariance import low_rank, ones


class TestProblem:
    @pytest.mark.parametrize("n_noise", [1, M])
    @pytest.mark.parametrize("levels", [False, True])
    @every_form
    def test_bounds_are_in_the_order_of_theta(self, data, form, n_noise, levels):
        prior = pose(data, form, scale=2.0, n_noise=n_noise, levels=levels).prior
        lower, upper = prior.bounds()
        expected = [
            KERNEL.bounds,
            form.bounds(2.0),
            [np.log([4e-12, 4e6])] * levels,
            [prior.log_noise_bounds] * n_noise,
        ]
        expected = np.concatenate([part for part in expected if len(part)])
        np.testing.assert_allclose(np.c_[lower, upper], expected, rtol=1e-15)

    def test_bounds_of_a_kernel_without_hyperparameters(self, data):
        problem = pose(data, ones(M), kernel=RBF(length_scale_bounds="fixed"))
        assert problem.prior.bounds().shape == (2, 1)

    def test_likelihood(self, data):
        likelihood = pose(data, low_rank(M, 1), n_noise=M).likelihood()
        theta = np.concatenate([KERNEL.theta, np.ones(3), np.log([0.1, 0.2, 0.3])])
        K = textbook.covariance(
            KERNEL, np.ones((3, 3)), [0.1, 0.2, 0.3], data.X, data.tasks
        )
        expected = textbook.log_marginal_likelihood(K, data.y)
        np.testing.assert_allclose(likelihood.value(theta), expected, rtol=1e-11)

    @pytest.mark.parametrize("noise", [0.1, 1e-5, 1e-8])
    def test_noise_is_not_held_above_its_start(self, data, noise):
        problem = pose(data, noise=noise, n_noise=M)
        expected = np.log(min(noise, 1e-5))
        assert problem.log_held == pytest.approx(expected, rel=1e-12)

    def test_few_rows_do_not_tell_that_there_is_no_noise(self, data):
        """Half a nat a hyperparameter below two rows for each, none from three on."""
        problem = pose(data, ones(M))
        size = pose(data, low_rank(M, 1)).prior.n_hyperparameters
        assert problem.wary(low_rank(M, 1)).noise_rate == 0.0
        assert problem.noise_rate == 0.0
        for n in range(size, len(data) + 1):
            few = problem.with_data(data._part(np.arange(n)))
            expected = 0.5 * min(size, max(0, 3 * size - n))
            assert few.wary(low_rank(M, 1)).noise_rate == pytest.approx(expected)

    @pytest.mark.parametrize("n_noise", [1, M])
    def test_noise_and_diagonal_are_held_together(self, data, n_noise):
        form = low_rank(M, 2, diagonal=True)
        problem = pose(data, form, n_noise=n_noise)
        theta = np.full(KERNEL.n_dims + form.n_parameters + n_noise, -30.0)
        theta[-1] = -1.0
        raised = problem.with_noise(theta)
        n_tail = M + n_noise
        np.testing.assert_array_equal(raised[:-n_tail], theta[:-n_tail])
        np.testing.assert_allclose(raised[-n_tail:-1], np.log(1e-5))
        assert raised[-1] == -1.0
        assert (theta[:-1] == -30.0).all()

    def test_the_variance_of_levels_is_not_held(self, data):
        form = low_rank(M, 2, diagonal=True)
        problem = pose(data, form, levels=True)
        raised = problem.with_noise(np.full(problem.prior.n_theta, -30.0))
        np.testing.assert_array_equal(raised[:-5], -30.0)
        np.testing.assert_allclose(raised[-5:-2], np.log(1e-5))  # kappa
        np.testing.assert_allclose(raised[-2:], [-30.0, np.log(1e-5)])


def test_best_of():
    modes = [
        Mode(np.zeros(1), value, 3, 4, True, False, 0.5, 9) for value in (1.0, 3.0, 2.0)
    ]
    spent = {"seconds": 1.5, "n_evaluations": 12}
    assert best_of(modes) == modes[1]._replace(**spent, rivals=((0.0, 2.0),))
    modes[1] = modes[1]._replace(stalled=True)
    for doubt, best, others in [(0.0, 1, [2.0]), (0.5, 1, [2.0]), (1.5, 2, [3.0, 1.0])]:
        rivals = tuple((0.0, value) for value in others)
        expected = modes[best]._replace(**spent, rivals=rivals)
        assert best_of(modes, doubt=doubt) == expected
