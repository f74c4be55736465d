"""What the tests of borders have in common."""

import numpy as np
import textbook


def check_pairs(border, row):
    """All borders at once are those of one after another, with finite differences."""
    rows = np.stack([row, 0.5 * row - 1.0])
    values, gradients, hessians = border.pairs().evaluate(rows)
    for row, value, slope, hessian in zip(
        rows, values, gradients, hessians, strict=True
    ):
        expected = border.value_and_grad(row)
        np.testing.assert_allclose(value, expected[0], rtol=1e-10)
        np.testing.assert_allclose(slope, expected[1], rtol=1e-8, atol=1e-8)
        curved = textbook.derivative(lambda row: border.value_and_grad(row)[1], row)
        close = {"rtol": 0.0, "atol": 1e-6 * np.abs(curved).max()}
        np.testing.assert_allclose(hessian, curved, **close)
