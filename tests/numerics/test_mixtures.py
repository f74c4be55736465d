"""Quantiles and densities of mixtures, and moments of functions, against known ones."""

import numpy as np
import pytest
from scipy.stats import norm

from skmtgp._numerics.mixtures import log_density, moments, quantiles

RNG = np.random.default_rng(0)
MEANS, DEVIATIONS = (
    3.0 * RNG.standard_normal((5, 4, 2)),
    RNG.uniform(0.01, 2.0, (5, 4, 2)),
)


@pytest.mark.parametrize("p", [0.001, 0.025, 0.5, 0.9, 0.999])
def test_p_of_the_mixture_is_below(p):
    found = quantiles(MEANS, DEVIATIONS, p)
    below = norm.cdf(found, MEANS, DEVIATIONS).mean(axis=0)
    np.testing.assert_allclose(below, p, rtol=1e-10)


def test_one_component():
    found = quantiles(MEANS[:1], DEVIATIONS[:1], 0.975)
    np.testing.assert_array_equal(found, MEANS[0] + DEVIATIONS[0] * norm.ppf(0.975))


def test_equal_components():
    found = quantiles(MEANS[[0] * 3], DEVIATIONS[[0] * 3], 0.3)
    expected = norm.ppf(0.3, MEANS[0], DEVIATIONS[0])
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_certain_components():
    means, zeros = np.array([[0.0], [1.0], [2.0], [3.0]]), np.zeros((4, 1))
    for p, expected in [(0.2, 0.0), (0.4, 1.0), (0.9, 3.0)]:
        assert quantiles(means, zeros, p) == pytest.approx(expected, abs=1e-12)
    assert quantiles(means[:1], zeros[:1], 0.9) == 0.0


def test_densities_are_averaged():
    values = RNG.uniform(-9.0, 9.0, (4, 2))
    expected = np.log(norm.pdf(values, MEANS, DEVIATIONS).mean(axis=0))
    found = log_density(MEANS, DEVIATIONS, values)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    far = log_density(MEANS, DEVIATIONS, values + 1e4)  # where densities underflow
    nearest = norm.logpdf(values + 1e4, MEANS, DEVIATIONS).max(axis=0)
    np.testing.assert_allclose(far, nearest - np.log(5.0), rtol=1e-12)


def test_densities_of_certain_and_of_unknown_values():
    deviations = np.array([[0.0, 0.0, np.inf]])
    found = log_density(np.zeros((1, 3)), deviations, np.array([0.0, 1.0, 0.0]))
    assert found[0] > 700.0
    assert found[1:].tolist() == [-np.inf, -np.inf]


@pytest.mark.parametrize("deviation", [0.1, 1.0, 2.0])
def test_moments_of_logarithmic_normals(deviation):
    mean, variance = moments(np.zeros((1, 1)), np.full((1, 1), deviation), np.exp)
    np.testing.assert_allclose(mean, np.exp(0.5 * deviation**2), rtol=1e-8)
    expected = np.exp(deviation**2) * np.expm1(deviation**2)
    np.testing.assert_allclose(variance, expected, rtol=1e-4)


def test_moments_of_a_mixture():
    mean, variance = moments(MEANS, DEVIATIONS, lambda z: z)
    np.testing.assert_allclose(mean, MEANS.mean(axis=0), rtol=1e-12)
    expected = np.square(DEVIATIONS).mean(axis=0) + MEANS.var(axis=0)
    np.testing.assert_allclose(variance, expected, rtol=1e-12)


def test_moments_through_kinks():
    """The half normal distribution."""
    mean, variance = moments(np.zeros((1, 1)), np.ones((1, 1)), np.abs)
    np.testing.assert_allclose(mean, np.sqrt(2.0 / np.pi), atol=3e-3)
    np.testing.assert_allclose(variance, 1.0 - 2.0 / np.pi, atol=3e-3)


def test_moments_of_certain_values():
    mean, variance = moments(np.zeros((1, 3)), np.zeros((1, 3)), np.exp)
    np.testing.assert_allclose(mean, 1.0)
    np.testing.assert_allclose(variance, 0.0, atol=1e-30)
