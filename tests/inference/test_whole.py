"""Few rows, whose K is one tile: the same as in tiles."""

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.inference import dense
from skmtgp.model.task_covariance import low_rank


@pytest.mark.parametrize("n_noise", [1, 5])
@pytest.mark.parametrize("levels", [False, True])
def test_as_in_tiles(levels, n_noise, monkeypatch):
    rng = np.random.default_rng(0)
    tasks = np.repeat([0, 1, 3, 4], [9, 1, 12, 8])  # one has no row
    data = rng.standard_normal((30, 2)), tasks, rng.standard_normal(30)
    results = []
    for most in 0, 5:
        monkeypatch.setattr(dense, "MOST_TASKS", most)
        model = building.prior(RBF([1.0, 1.0]), low_rank(5, 2), n_noise, levels)
        likelihood = dense.DenseLikelihood(model, *data)
        assert (likelihood._whole is None) == (most < 5)
        theta = np.random.default_rng(1).standard_normal(model.n_theta)
        value, gradient = likelihood.value_and_grad(theta)
        np.testing.assert_allclose(likelihood.value(theta), value, rtol=1e-12)
        results.append([value, *gradient, *likelihood.task_gradient(theta).ravel()])
    np.testing.assert_allclose(*results, rtol=1e-9, atol=1e-9)
