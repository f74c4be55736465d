"""What is known of the noise of each row."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from skmtgp._data.data import Data
from skmtgp._data.known import Known, followed_by, read_known, weighed_rows
from skmtgp.exceptions import InsufficientMemoryError

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
    known = read_known([[1.0, 2.0], [3.0, 4.0]], [1, 5], [0.0, 0.5], (2, 2))
    np.testing.assert_array_equal(known.part([1]).variance, [[3.0, 4.0]])
    np.testing.assert_array_equal(known.output(1).variance, [2.0, 4.0])
    longer = followed_by(known, None, (2, 2), (1, 2))
    assert longer.variance.tolist() == [[1.0, 2.0], [3.0, 4.0], [0.0, 0.0]]
    assert longer.counts.tolist() == [1.0, 5.0, 1.0]
    later = followed_by(None, known, (1, 2), (2, 2))
    assert later.variance.tolist() == [[0.0, 0.0], [1.0, 2.0], [3.0, 4.0]]
    assert later.spread.tolist() == [[0.0, 0.0], [0.0, 0.0], [0.5, 0.5]]
    assert followed_by(None, None, (1, 2), (2, 2)) is None
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
        ({"alpha": "much"}, "alpha='much' must be real numbers"),
        ({"alpha": [1j, 1, 1]}, r"alpha=\[1j, 1, 1\] must be real numbers"),
        ({"alpha": ["many"] * 90}, r"'many', 'many', \.\.\.\] must be real numbers"),
        ({"alpha": [0.1, pd.NA, 0.2]}, "of which none is missing"),
        (
            {"sample_weight": [1, 0, 1]},
            "sample_weight has 0, but .* or zero weight",
        ),
        ({"sample_weight": [1, 2]}, "sample_weight has shape"),
        ({"repeat_variance": 0.1}, "repeat_variance needs sample_weight"),
        ({"sample_weight": 2, "repeat_variance": np.inf}, "repeat_variance has inf"),
        (
            {"sample_weight": [2, 1, 2], "repeat_variance": 0.3},
            "repeat_variance has 0.3 in a row of sample_weight 1: one measurement",
        ),
    ],
)
def test_what_cannot_be_known(given, match):
    names = "alpha", "sample_weight", "repeat_variance"
    with pytest.raises(ValueError, match=match):
        read_known(*(given.get(name) for name in names), (3, 1))


def weighed(weights, *, alpha=None, repeats=True):
    X, y = np.arange(6.0).reshape(3, 2), np.arange(3.0)
    return weighed_rows(X, y, (alpha, weights, None), repeats=repeats)


@pytest.mark.parametrize(
    "weights",
    [2, 2.0, [2, 2, 2], [[2.0]] * 3, np.full(3, 2, object), pd.Series([2, 2, 2])],
    ids=repr,
)
def test_rows_are_repeated_in_whatever_form_weights_come(weights):
    _, y, given = weighed(weights)
    assert y.tolist() == [0, 0, 1, 1, 2, 2]
    assert given == (None, None, None)


@pytest.mark.parametrize(
    "weights", [-1, [1, np.nan, 1], [1, np.inf, 1], 0, [1, 2], "a", [1j, 1, 1]]
)
def test_weights_that_are_none_are_left_to_reading(weights):
    X, y, given = weighed(weights)
    assert len(X) == len(y) == 3
    assert given[1] is weights
    with pytest.raises(ValueError, match="sample_weight"):
        read_known(*given, (3, 1))


def test_more_repeats_than_memory_holds():
    with pytest.raises(
        InsufficientMemoryError, match=r"as 3e\+200 rows that are repea"
    ):
        weighed(1e200)
    assert len(weighed(1e200, repeats=False)[0]) == 3


def test_a_series_in_another_order_is_refused():
    frame = pd.DataFrame({"x": [1.0, 2.0, 3.0], "task": list("aab")}, index=[5, 3, 4])
    y, alpha = frame["x"], pd.Series([0.1, 0.2, 0.3], index=[5, 3, 4])
    ours = alpha, None, None
    assert weighed_rows(frame, y, ours, repeats=False)[2][0] is alpha
    for other in (alpha.sort_index(), alpha.to_frame().sort_index()):
        theirs = other, None, None
        with pytest.raises(
            ValueError, match=r"alpha has the labels .*with 3, .*with 5"
        ):
            weighed_rows(frame, y, theirs, repeats=False)
        # scaled features have often another index, and positions count
        array = frame.to_numpy()
        assert weighed_rows(array, y.to_numpy(), theirs, repeats=False)[0] is array
    numbered = alpha.reset_index(drop=True)
    assert weighed_rows(frame, y, (numbered, None, None), repeats=False)[1] is y
    scaled = frame.set_axis([0, 1, 2])
    assert weighed_rows(scaled, y, ours, repeats=False)[0] is scaled


def test_a_series_in_the_order_of_y_alone_is_refused():
    """Those of X count where labels are not unique, and X and y cannot be compared."""
    frame = pd.DataFrame({"x": [1.0, 2.0, 3.0], "task": list("aab")}, index=[5, 5, 3])
    y = pd.Series([1.0, 2.0, 3.0], index=[3, 5, 5])
    of_X, of_y = (pd.Series(0.1, index=of.index) for of in (frame, y))
    with pytest.raises(ValueError, match=r"alpha has the labels .*with 3, .*with 5"):
        weighed_rows(frame, y, (of_y, None, None), repeats=False)
    assert weighed_rows(frame, y, (of_X, None, None), repeats=False)[1] is y


def test_y_in_another_order_is_refused_before_rows_are_left_out():
    frame = pd.DataFrame({"x": [1.0, 2.0, 3.0], "task": list("aab")}, index=[5, 3, 4])
    y = frame["x"].sort_index()
    alpha, weights = pd.Series(0.1, index=y.index), np.array([1, 0, 1])
    for given in (None, weights, None), (alpha, None, None):
        with pytest.raises(ValueError, match="y has the index labels of X"):
            weighed_rows(frame, y, given, repeats=True)
