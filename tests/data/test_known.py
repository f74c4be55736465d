"""What is known of the noise of each row."""

import numpy as np
import pytest
from scipy.stats import norm

from skmtgp._data.data import Data
from skmtgp._data.known import Known, read_known

rng = np.random.default_rng(0)


def test_repeats_have_the_density_of_all_measurements():
    """Of the mean, and of the measurements about it, together."""
    f, v = 0.7, 0.3 + 0.2
    y = f + np.sqrt(v) * rng.standard_normal(5)
    known = Known(np.array([0.2]), np.array([5.0]), np.array([y.var()]))
    learned = np.array([0.3])
    np.testing.assert_allclose(known.noise(learned), v / 5)
    of_mean = norm.logpdf(y.mean(), f, np.sqrt(v / 5))
    expected = norm.logpdf(y, f, np.sqrt(v)).sum()
    assert of_mean + known.log_density(learned) == pytest.approx(expected, rel=1e-12)


def test_slope_and_information():
    known = Known(rng.uniform(0, 1, 4), np.array([1.0, 2, 3, 7]), rng.uniform(0, 1, 4))
    learned, step = rng.uniform(0.1, 1, 4), 1e-6
    for i, one in enumerate(np.eye(4)):
        up, down = (known.log_density(learned + s * one) for s in (step, -step))
        slope = known.slope(learned)[i]
        assert slope == pytest.approx((up - down) / (2 * step), rel=1e-6, abs=1e-8)
    # with the expected spread, (n - 1) / n v, the slope is zero on average
    expected = (known.counts - 1) / known.counts * (learned + known.variance)
    flat = Known(known.variance, known.counts, expected)
    np.testing.assert_allclose(flat.slope(learned), 0.0, atol=1e-12)
    second = np.array(
        [(flat.slope(learned * np.exp(s)) * learned * np.exp(s)) for s in (1e-5, -1e-5)]
    )
    curvature = (second[0] - second[1]) / 2e-5
    np.testing.assert_allclose(flat.information(learned), -curvature, rtol=1e-4)


def test_parts_and_more_rows():
    known = read_known([[1.0, 2.0], [3.0, 4.0]], [1, 5], 0.5, (2, 2))
    np.testing.assert_array_equal(known.part([1]).variance, [[3.0, 4.0]])
    np.testing.assert_array_equal(known.output(1).variance, [2.0, 4.0])
    longer = known.followed_by(1)
    assert longer.variance.tolist() == [[1.0, 2.0], [3.0, 4.0], [0.0, 0.0]]
    assert longer.counts.tolist() == [1.0, 5.0, 1.0]
    scaled = known.scaled(np.array([[1.0, 2.0]]))
    np.testing.assert_array_equal(scaled.variance, [[1.0, 0.5], [3.0, 1.0]])


def test_moments_are_those_of_all_measurements():
    y, codes = rng.standard_normal(30), np.repeat([0, 1, 2], [5, 10, 15])
    counts = np.bincount(codes).astype(float)
    means = np.bincount(codes, y) / counts
    spread = np.bincount(codes, np.square(y - means[codes])) / counts
    data = Data(np.zeros((3, 1)), np.zeros(3, int), means, 1)
    few = Data(data.X, data.tasks, means, 1, known=Known(np.zeros(3), counts, spread))
    assert few.deviation == pytest.approx(y.std(), rel=1e-12)
    assert few.size == pytest.approx(np.sqrt(np.square(y).mean()), rel=1e-12)
    assert data.deviation == means.std()


def test_nothing_known():
    assert read_known(None, None, None, (3, 1)) is None


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"alpha": -0.5}, "alpha has -0.5, and must be finite numbers of 0 or more"),
        ({"alpha": [0.1, np.nan, 0.1]}, "alpha has nan"),
        ({"alpha": [1.0, 2.0]}, r"alpha has shape \(2,\), but X has 3 samples"),
        ({"alpha": "much"}, "alpha='much' must be numbers"),
        (
            {"sample_weight": [1, 0, 1]},
            "sample_weight has 0, but .* or zero weight",
        ),
        ({"sample_weight": [1, 2]}, "sample_weight has shape"),
        ({"repeat_variance": 0.1}, "repeat_variance needs sample_weight"),
        ({"sample_weight": 2, "repeat_variance": np.inf}, "repeat_variance has inf"),
    ],
)
def test_what_cannot_be_known(given, match):
    names = "alpha", "sample_weight", "repeat_variance"
    with pytest.raises(ValueError, match=match):
        read_known(*(given.get(name) for name in names), (3, 1))
