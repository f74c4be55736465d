"""Measurements that were repeated at the same inputs."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skmtgp import average_repeats

X = [[1.0, 0], [2.0, 1], [1.0, 0], [1.0, 1], [2.0, 1]]
Y = [1.0, 2.0, 3.0, 4.0, 7.0]


def test_means_counts_and_variances():
    few, means, counts, variances = average_repeats(X, Y)
    np.testing.assert_array_equal(few, [[1, 0], [2, 1], [1, 1]])
    np.testing.assert_array_equal(means, [2.0, 4.5, 4.0])
    np.testing.assert_array_equal(counts, [2, 2, 1])
    np.testing.assert_array_equal(variances, [1.0, 6.25, 0.0])


@settings(max_examples=30, deadline=None)
@given(
    codes=st.lists(st.integers(0, 4), min_size=1, max_size=30),
    offset=st.sampled_from([0.0, 1e3, 1e9]),
)
def test_sums_of_all_rows_are_kept(codes, offset):
    codes = np.array(codes)
    y = offset + np.random.default_rng(len(codes)).standard_normal((len(codes), 2))
    few, means, counts, variances = average_repeats(np.column_stack([codes] * 2), y)
    assert len(np.unique(few[:, 0])) == len(few) == len(set(codes.tolist()))
    assert counts.sum() == len(codes)
    np.testing.assert_allclose(counts @ means, y.sum(axis=0), rtol=1e-12)
    mean = y.mean(axis=0)
    total = counts @ (variances + np.square(means - mean))
    np.testing.assert_allclose(total, np.square(y - mean).sum(axis=0), rtol=1e-6)
    assert (variances[counts == 1] == 0.0).all()


def test_frames_stay_frames():
    frame = pd.DataFrame(X, columns=["x", "task"], index=list("abcde"))
    frame["task"] = pd.Categorical(frame["task"].map({0.0: "old", 1.0: "new"}))
    few, means, _, variances = average_repeats(
        frame, pd.Series(Y, frame.index, name="z")
    )
    assert few.index.tolist() == means.index.tolist() == ["a", "b", "d"]
    assert (means.name, few["task"].tolist()) == ("z", ["old", "new", "new"])
    assert few.dtypes.equals(frame.dtypes)
    table = pd.DataFrame({"u": Y, "v": Y})
    assert average_repeats(frame, table)[1].columns.tolist() == ["u", "v"]
    np.testing.assert_array_equal(variances, [1.0, 6.25, 0.0])


def test_frames_of_polars():
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame({"x": [1.0, 1.0, 2.0], "task": ["a", "a", "b"]})
    few, means, *_ = average_repeats(frame, polars.Series([1.0, 3.0, 5.0]))
    assert few.to_dict("list") == {"x": [1.0, 2.0], "task": ["a", "b"]}
    np.testing.assert_array_equal(means, [2.0, 5.0])


@pytest.mark.parametrize(
    ("X", "y", "match"),
    [
        (X, Y[:3], r"y has shape \(3,\), but X has 5 rows"),
        (X, np.ones((5, 1, 1)), "dim 3"),
        (X, [1.0, 2.0, np.nan, 4.0, 5.0], "y contains NaN.*in row 2"),
        (X, ["a", "b", "c", "d", "e"], "y must be numbers"),
        ([1.0, 2.0], [1.0, 2.0], r"X has shape \(2,\): give a table"),
        (np.ones((2, 2, 2)), [1.0, 2.0], r"X has shape \(2, 2, 2\)"),
        (np.ones((0, 2)), [], r"X has shape \(0, 2\)"),
        (pd.DataFrame({"x": [], "task": []}), [], r"X has shape \(0, 2\)"),
    ],
)
def test_what_cannot_be_averaged(X, y, match):
    with pytest.raises(ValueError, match=match):
        average_repeats(X, y)


def test_dask_rows_are_not_collected():
    array = pytest.importorskip("dask.array")
    with pytest.raises(TypeError, match=r"X is a collection of Dask's.* compute\(\)"):
        average_repeats(array.ones((3, 2)), np.ones(3))
