"""What predictions of one row are made of."""

import numpy as np
import pytest

from skmtgp._estimators.compiled import _collapsed


@pytest.mark.parametrize("n", [0, 1, 30])
def test_equal_inputs_are_kept_once_and_in_order(n):
    """Those without a weight for any task are left out."""
    rng = np.random.default_rng(0)
    inputs = rng.integers(-1, 2, size=(n, 3)).astype(float)
    B = rng.normal(size=(n, 2))
    B[::4] = 0.0
    found, sums = _collapsed(inputs, B)
    matter = B.any(axis=1)
    np.testing.assert_array_equal(found, np.unique(inputs[matter], axis=0))
    for row, of_row in zip(found, sums, strict=True):
        same = matter & (inputs == row).all(axis=1)
        np.testing.assert_allclose(of_row, B[same].sum(axis=0), rtol=1e-12)
    assert len(sums) == len(found)
