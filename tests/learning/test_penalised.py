"""Densities of the hyperparameters beside the likelihood."""

from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from scipy.stats import norm, t
from sklearn.gaussian_process.kernels import RBF

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP
from skmtgp.learning.penalised import LITTLE, AlikeNoise, Penalised, SomeNoise
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


def test_little_noise_by_the_book():
    """The tail of Student's t; above a variance that is not little it is flat."""
    prior = likelihood().prior
    density, little = SomeNoise(prior), np.log(LITTLE * prior.scale**2)
    for below in (0.0, 0.5, 3.0, 15.0):
        theta = np.where(prior.of_noise, little - below, THETA)
        theta[-1] = little + 2.0
        expected = (M - 1) * (t.logpdf(below, 4) - t.logpdf(0.0, 4))
        assert density.log_density(theta)[0] == pytest.approx(expected, rel=1e-12)


def test_gradient_of_little_noise():
    penalised = Penalised(likelihood(), SomeNoise(likelihood().prior))
    theta = THETA - np.where(np.arange(len(THETA)) > len(THETA) - M, 9.0, -0.5)
    value, gradient = penalised.value_and_grad(theta)
    assert value == pytest.approx(penalised.value(theta), rel=1e-12)
    assert value < likelihood().value(theta) - 5.0
    density = penalised.of_theta
    numerical = textbook.derivative(lambda t: density.log_density(t)[0], theta)
    found = gradient - likelihood().value_and_grad(theta)[1]
    np.testing.assert_allclose(found, numerical, rtol=1e-5, atol=1e-6)
    expected = likelihood().fisher_information(theta)
    np.testing.assert_array_equal(penalised.fisher_information(theta), expected)


def test_where_learning_starts_is_not_little():
    prior = replace(likelihood().prior, log_noise=np.log(1e-6))
    theta = np.where(prior.of_noise, np.log(1e-6), THETA)
    assert SomeNoise(prior).log_density(theta)[0] == 0.0
    assert SomeNoise(prior).log_density(theta - prior.of_noise)[0] < 0.0


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


def smooth(n, noise, seed=0):
    """Related functions of three tasks, X and y."""
    rng = np.random.default_rng(seed)
    task, x = np.arange(n) % 3, rng.uniform(0.0, 6.0, n)
    y = (1.0 + task) * np.sin(x) + task * np.cos(0.7 * x)
    return np.column_stack([x, task]), y + noise * rng.standard_normal(n)


def test_many_rows_tell_that_there_is_none():
    model = MultiTaskGPRegressor(rank=2, kernel="rbf", noise="shared")
    model.set_params(normalize_y="shared").fit(*smooth(90, 0.0))
    assert model.noise_variance_ < 1e-8 * model.y_scale_**2
    value = model.log_marginal_likelihood(model.theta_)
    assert model.log_marginal_likelihood_value_ == pytest.approx(value)


def test_known_noise_may_be_all_there_is():
    rng = np.random.default_rng(0)
    X, y = smooth(60, 0.0)
    y = y + 0.3 * rng.standard_normal(60)
    model = MultiTaskGPRegressor(rank=2, kernel="rbf", noise="shared")
    learned = model.fit(X, y, alpha=0.5**2)  # more than there is
    assert learned.noise_variance_ < 1e-6


def test_whose_noise_is_alike():
    """Not that of the paper's learning, nor of one function, which leaves misfits."""
    for model, is_alike in [
        (MultiTaskGPRegressor(), True),
        (MultiTaskGPRegressor(learning="staged"), False),
        (IndependentGP(), True),
        (PooledGP(), False),
    ]:
        assert model._has_noise_priors() == is_alike
