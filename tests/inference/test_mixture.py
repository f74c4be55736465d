"""Mixtures of posteriors, against draws from their parts."""

import building
import numpy as np
import pytest
from scipy.stats import norm
from sklearn.gaussian_process.kernels import RBF

from skmtgp.inference.mixture import Mixture
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.task_covariance import low_rank

FORM = low_rank(3, 1, shared=True)


@pytest.fixture(scope="module")
def mixture():
    rng = np.random.default_rng(0)
    X, tasks = rng.uniform(0.0, 6.0, (18, 1)), np.repeat(np.arange(3), 6)
    y = np.sin(X[:, 0]) + tasks
    likelihood = building.dense(RBF(1.0), FORM, X, tasks, y, levels=True)
    hyperprior = Hyperprior(likelihood.prior)
    return Mixture(likelihood, [hyperprior.draw(rng, 0.3) for _ in range(5)])


Z, OF_Z = np.linspace(0.0, 7.0, 4)[:, None], np.array([0, 1, 2, 1])


def moments(means, covariances):
    """Of an equal mixture: of the second moments less the square of the mean."""
    mean = np.mean(means, axis=0)
    seconds = [C + np.outer(m, m) for m, C in zip(means, covariances, strict=True)]
    return mean, np.mean(seconds, axis=0) - np.outer(mean, mean)


def test_moments_of_f(mixture):
    parts = mixture.parts
    means = [part.mean(Z, OF_Z) for part in parts]
    mean, C = moments(means, [part.covariance(Z, OF_Z) for part in parts])
    np.testing.assert_allclose(mixture.mean(Z, OF_Z), mean)
    np.testing.assert_allclose(mixture.covariance(Z, OF_Z), C, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(mixture.variance(Z, OF_Z), np.diagonal(C), rtol=1e-8)


@pytest.mark.parametrize("include_noise", [False, True])
def test_leave_one_out(mixture, include_noise):
    found = [part.leave_one_out(include_noise) for part in mixture.parts]
    residuals, variances = map(np.array, zip(*found, strict=True))
    of_y = [part.leave_one_out(include_noise=True)[1] for part in mixture.parts]
    weights = 1.0 / norm.pdf(residuals, scale=np.sqrt(of_y))
    weights = np.minimum(weights, np.sqrt(len(of_y)) * weights.mean(axis=0))
    weights /= weights.sum(axis=0)
    residual, variance = mixture.leave_one_out(include_noise)
    np.testing.assert_allclose(residual, (weights * residuals).sum(axis=0))
    second = (weights * (variances + residuals**2)).sum(axis=0)
    np.testing.assert_allclose(variance, second - residual**2, rtol=1e-8)


def test_levels(mixture):
    levels = np.array([part.levels for part in mixture.parts])
    np.testing.assert_allclose(mixture.levels, levels.mean(axis=0))
    least = np.mean([part.level_variances() for part in mixture.parts], axis=0)
    assert (mixture.level_variances() > least).all()


def test_tasks_without_data(mixture):
    unseen = np.full(len(Z), 3)
    larger = mixture.with_unseen(1)
    expected = np.mean(
        [part.with_unseen(1).mean(Z, unseen) for part in mixture.parts], axis=0
    )
    np.testing.assert_allclose(larger.mean(Z, unseen), expected)
    known = mixture.variance(Z, OF_Z)
    np.testing.assert_allclose(larger.variance(Z, OF_Z), known)
    assert (larger.variance(Z, unseen) > 0.0).all()


def test_one_part_is_that_part(mixture):
    part = mixture.parts[0]
    alone = Mixture.__new__(Mixture)
    alone.parts = [part]
    np.testing.assert_allclose(alone.variance(Z, OF_Z), part.variance(Z, OF_Z))
    np.testing.assert_allclose(alone.covariance(Z, OF_Z), part.covariance(Z, OF_Z))
