"""Densities of the hyperparameters beside the likelihood."""

import building
import numpy as np
import pytest
import textbook
from scipy.stats import norm
from sklearn.gaussian_process.kernels import RBF

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP
from skmtgp.learning.penalised import AlikeNoise, Penalised
from skmtgp.model.task_covariance import low_rank

M = 4


def likelihood(seed=0):
    rng, tasks = np.random.default_rng(seed), np.repeat(np.arange(M), 6)
    X = rng.uniform(0.0, 5.0, (len(tasks), 1))
    y = np.sin(X[:, 0]) + 0.2 * rng.standard_normal(len(tasks))
    return building.dense(RBF(), low_rank(M, 1), X, tasks, y, n_noise=M)


THETA = np.r_[0.2, 1.0, 0.8, 1.2, 0.9, np.log([0.01, 0.1, 0.02, 0.5])]


def test_density_by_the_book():
    """Normal around a mean of which nothing is known, which is integrated out."""
    density = AlikeNoise(likelihood().prior, 0.7)
    logs = THETA[-M:]
    means = np.linspace(-60.0, 60.0, 200_001)
    by_mean = norm.logpdf(logs[:, None], means, 0.7).sum(axis=0)
    away = THETA.copy()
    away[-1] += 1.3
    other = norm.logpdf(away[-M:][:, None], means, 0.7).sum(axis=0)
    expected = np.log(np.exp(other).sum()) - np.log(np.exp(by_mean).sum())
    found = density.log_density(away)[0] - density.log_density(THETA)[0]
    assert found == pytest.approx(expected, rel=1e-8)


def test_gradient_and_information():
    penalised = Penalised(likelihood(), AlikeNoise(likelihood().prior, 0.5))
    value, gradient = penalised.value_and_grad(THETA)
    assert value == pytest.approx(penalised.value(THETA), rel=1e-12)
    numerical = textbook.derivative(penalised.value, THETA)
    np.testing.assert_allclose(gradient, numerical, rtol=1e-5, atol=1e-6)
    density = penalised.of_theta
    slopes = [
        textbook.derivative(lambda t, i=i: density.log_density(t)[1][i], THETA)
        for i in range(len(THETA))
    ]
    np.testing.assert_allclose(density.information(), -np.array(slopes), atol=1e-6)
    more = penalised.fisher_information(THETA) - likelihood().fisher_information(THETA)
    np.testing.assert_allclose(more, density.information(), atol=1e-9)


def test_a_common_factor_does_not_matter():
    density = AlikeNoise(likelihood().prior, 0.5)
    more = THETA + np.where(np.arange(len(THETA)) >= len(THETA) - M, 3.0, 0.0)
    assert density.log_density(more)[0] == pytest.approx(density.log_density(THETA)[0])
    same = np.where(np.arange(len(THETA)) >= len(THETA) - M, -2.0, THETA)
    assert density.log_density(same)[0] == 0.0


def sensors(seed):
    """Three tasks of many rows and one of four, equally noisy."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(M), [30, 30, 30, 4])
    x = rng.uniform(0.0, 6.0, len(task))
    y = (1.0 + task) * np.sin(x) + 0.2 * rng.standard_normal(len(task))
    return np.column_stack([x, task]), y


@pytest.mark.parametrize("seed", range(4))
def test_few_rows_are_not_fitted_without_noise(seed):
    X, y = sensors(seed)
    model = MultiTaskGPRegressor(rank=1, kernel="rbf", noise="per_task").fit(X, y)
    deviations = np.sqrt(model.noise_variance_)
    assert (deviations > 0.07).all()
    assert (deviations < 0.4).all()
    value = model.log_marginal_likelihood(model.theta_)
    assert model.log_marginal_likelihood_value_ == pytest.approx(value)


def test_whose_noise_is_alike():
    """Not that of the paper's learning, nor of one function, which leaves misfits."""
    for model, is_alike in [
        (MultiTaskGPRegressor(), True),
        (MultiTaskGPRegressor(learning="staged"), False),
        (IndependentGP(), True),
        (PooledGP(), False),
    ]:
        assert np.isfinite(model._noise_deviation()) == is_alike
