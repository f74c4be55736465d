"""Quantiles of mixtures, against distribution functions."""

import numpy as np
import pytest
from scipy.stats import norm

from skmtgp._numerics.mixtures import quantiles

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
