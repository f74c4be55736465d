"""Rows that are drawn from those of many tasks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from skmtgp._data.subsets import FEW, draw_rows, shares_of


@pytest.mark.parametrize(
    ("counts", "size", "most"),
    [
        ([100] * 1000, 1100, FEW),  # it was 2000 rows
        ([10] * 8000, 1100, FEW),  # 8000
        ([100] * 270, 1100, 5),
        ([1] * 500 + [10_000], 1100, 600),
        ([1, 2, 97], 10, 8),
        ([700, 298, 2], 100, 69),
    ],
)
def test_as_many_rows_as_are_wanted(counts, size, most):
    counts = np.array(counts)
    tasks = np.repeat(np.arange(len(counts)), counts)
    rows = draw_rows(tasks, len(counts), size)
    assert len(rows) == size
    assert (np.diff(rows) > 0).all()
    assert_array_equal(
        np.bincount(tasks[rows], minlength=len(counts)), shares_of(counts, size)
    )
    assert shares_of(counts, size).max() == most


@given(st.lists(st.integers(1, 30), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_shares(counts, part):
    counts = np.array(counts)
    size = max(1, round(part * counts.sum()))
    shares = shares_of(counts, size)
    assert shares.sum() == size
    assert (shares >= 0).all()
    assert (shares <= counts).all()
    if np.minimum(counts, FEW).sum() <= size:  # one of each, and in proportion
        assert shares.min() >= 1
        rate = (size - len(counts)) / max(1, (counts - 1).sum())
        assert (np.abs(shares - 1 - rate * (counts - 1)) < 1.0).all()
    else:  # four of each of some; one may have fewer
        whole = shares == np.minimum(counts, FEW)
        assert ((shares > 0) & ~whole).sum() <= 1


def test_equal_tasks_have_equal_shares_as_far_as_that_goes():
    shares = shares_of(np.full(100, 50), 430)
    assert_array_equal(np.unique(shares, return_counts=True), [[4, 5], [70, 30]])
    more = np.flatnonzero(shares == 5)
    assert more.max() - more.min() > 50  # by chance, not the first ones


def test_always_the_same_wherever_the_rows_lie():
    """Tasks that get more are the same in another order of the rows."""
    rng = np.random.default_rng(1)
    tasks = rng.integers(0, 50, 1000)
    for size in (60, 500):
        found = draw_rows(tasks, 50, size)
        assert_array_equal(draw_rows(tasks.copy(), 50, size), found)
        shuffled = tasks[rng.permutation(1000)]
        again = draw_rows(shuffled, 50, size)
        assert_array_equal(
            np.bincount(shuffled[again], minlength=50),
            np.bincount(tasks[found], minlength=50),
        )
