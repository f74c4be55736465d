"""Kernels that are not computed again while their part of theta stays the same."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared

from skmtgp.kernels import Columns
from skmtgp.model import compile_kernel
from skmtgp.model.remembered import remembered

PERIODIC = Columns(ExpSineSquared(1.0, 2.0), [0])
KERNELS = [PERIODIC, PERIODIC * Columns(RBF(2.0), [1]), 2.0 * PERIODIC**2 + RBF()]


@pytest.mark.parametrize("kernel", KERNELS, ids=str)
def test_values_are_the_same(kernel):
    rng, theta = np.random.default_rng(0), kernel.theta
    node = remembered(compile_kernel(kernel))
    tile = slice(0, 5), slice(0, 8)
    for X in rng.uniform(size=(2, 8, 2)):
        for step in np.vstack([np.zeros(len(theta)), np.eye(len(theta))] * 2):
            for _ in range(2):
                K, _ = node.bind(theta + step, X).block(*tile)
                expected, _ = compile_kernel(kernel).bind(theta + step, X).block(*tile)
                np.testing.assert_array_equal(np.triu(K), np.triu(expected))


def test_only_what_has_changed_is_computed(monkeypatch):
    kernel = PERIODIC * Columns(ExpSineSquared(), [1])
    calls, values = [], ExpSineSquared.__call__
    monkeypatch.setattr(
        ExpSineSquared, "__call__", lambda *of: calls.append(of) or values(*of)
    )
    node, X = remembered(compile_kernel(kernel)), np.ones((4, 2))
    for theta in kernel.theta + np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]):
        node.bind(theta, X).block(slice(0, 4), slice(0, 4))
    assert len(calls) == 3
