"""Frequencies at which rows of several tasks repeat."""

import numpy as np
import pytest

from skmtgp._numerics.periodogram import frequencies, without_waves

CYCLES = 23.7
SHAPES = {
    "sine": lambda phase: np.sin(2.0 * np.pi * phase),
    "second harmonic": lambda phase: (
        np.sin(2.0 * np.pi * phase) + 2.0 * np.cos(4.0 * np.pi * phase)
    ),
    "sawtooth": lambda phase: phase % 1.0,
    "pulses": lambda phase: np.exp(-0.5 * ((phase % 1.0 - 0.5) / 0.06) ** 2),
}


def draw(shape, n=60, n_tasks=3, seed=0):
    rng = np.random.default_rng(seed)
    x, tasks = rng.uniform(size=n * n_tasks), np.repeat(np.arange(n_tasks), n)
    phase = CYCLES * x + rng.uniform(0.0, 0.2, n_tasks)[tasks]
    y = 5.0 * tasks + SHAPES[shape](phase) + 0.1 * rng.standard_normal(len(x))
    return x, tasks, y


@pytest.mark.parametrize("shape", SHAPES)
def test_the_frequency_is_among_the_best(shape):
    found = frequencies(*draw(shape), 300.0)
    assert len(found) <= 8
    assert np.abs(found - CYCLES).min() < 0.1


@pytest.mark.parametrize("shape", SHAPES)
def test_no_multiple_is_better(shape):
    found = frequencies(*draw(shape), 300.0, n_best=1)
    np.testing.assert_allclose(found, CYCLES, atol=0.1)


def test_another_period_is_found_not_a_multiple():
    x, tasks, y = draw("sine")
    found = frequencies(x, tasks, y + np.sin(2.0 * np.pi * 61.3 * x), 300.0)
    assert np.abs(found - CYCLES).min() < 0.1
    assert np.abs(found - 61.3).min() < 0.1


def test_without_waves():
    x, tasks, y = draw("second harmonic")
    rest = without_waves(x, tasks, y, np.array([CYCLES]))
    assert np.abs(rest).max() < 0.5
    few = np.arange(3)
    rest = without_waves(few / 2.0, few, few + 1.0, np.array([1.3]))
    np.testing.assert_allclose(rest, 0.0, atol=1e-9)


def test_slow_parts_and_many_small_tasks():
    x, tasks, y = draw("sine")
    found = frequencies(x, tasks, y + 20.0 * x * (tasks + x), 300.0)
    assert np.abs(found - CYCLES).min() < 0.1
    found = frequencies(*draw("sine", n=5, n_tasks=40), 300.0)
    assert np.abs(found - CYCLES).min() < 0.1


def test_order_of_rows_and_units_of_targets():
    x, tasks, y = draw("sawtooth")
    order = np.random.default_rng(1).permutation(len(x))
    expected = frequencies(x, tasks, y, 300.0)
    found = frequencies(x[order], tasks[order], 1e6 * y[order], 300.0)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_nothing_to_find():
    x, tasks, _ = draw("sine")
    assert len(frequencies(x, tasks, 3.0 * tasks, 300.0)) == 0
    assert (frequencies(*draw("sine"), 10.0) < 10.5).all()
    one = np.zeros(1)
    assert len(frequencies(one, one.astype(int), one + 1.0, 2.0)) == 0
