"""Whether tasks were measured at inputs that overlap."""

import numpy as np
import pytest

from skmtgp._data.overlap import share_overlapping

TASKS = np.repeat([0, 1, 2], 4)


@pytest.mark.parametrize(
    ("begins", "expected"),
    [([0, 0, 0], 1.0), ([0, 4, 8], 0.0), ([0, 2, 9], 4 / 12), ([0, 3, 6], 4 / 12)],
    ids=["same", "apart", "two of three", "ends alone"],
)
def test_rows_in_the_range_of_another_task(begins, expected):
    x = np.arange(12) % 4 + np.repeat(begins, 4)
    assert share_overlapping(x[:, None], TASKS) == pytest.approx(expected)
    order = np.random.default_rng(0).permutation(12)
    shuffled = share_overlapping(-3.0 * x[order, None], TASKS[order])
    assert shuffled == pytest.approx(expected)


def test_the_input_with_the_least_counts():
    x = np.arange(12) % 4
    X = np.column_stack([x, x + 4 * TASKS, x])
    assert share_overlapping(X, TASKS) == 0.0


def test_all_rows_overlap_without_inputs_and_none_of_one_task():
    assert share_overlapping(np.empty((12, 0)), TASKS) == 1.0
    assert share_overlapping(np.arange(4.0)[:, None], np.zeros(4, dtype=int)) == 0.0
