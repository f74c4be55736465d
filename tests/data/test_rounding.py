"""How targets are rounded, told by the targets alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skmtgp._data.rounding import step_of, variance_of_rounding


def rounded(step, n=60, seed=0):
    """Inputs, two tasks and a smooth function of both, rounded to a step."""
    rng = np.random.default_rng(seed)
    x, tasks = rng.uniform(0.0, 6.0, (n, 1)), np.arange(n) % 2
    y = np.round((np.sin(x[:, 0]) + tasks) / step) * step
    return x, tasks, y[:, None]


@given(
    step=st.floats(1e-6, 1e6),
    offset=st.floats(-1e3, 1e3),
    seed=st.integers(0, 1000),
)
def test_multiples_of_a_step_from_anywhere(step, offset, seed):
    wholes = np.random.default_rng(seed).integers(-20, 20, 100)
    wholes[:2] = 3, 4
    assert step_of(step * (wholes + offset)) == pytest.approx(step, rel=1e-6)


def test_decimals_are_not_exact_multiples():
    y = np.array([0.1 + 0.2, 0.3, 0.7, 0.1 * 3, 1.1, 0.9, 0.2, 0.5, 0.6, 0.4, 0.4])
    assert len(np.unique(y)) > len(np.unique(np.round(y, 12)))
    assert step_of(y) == pytest.approx(0.1)


@pytest.mark.parametrize(
    "y",
    [
        np.random.default_rng(0).standard_normal(200),
        np.random.default_rng(0).standard_normal(12),
        np.zeros(30),
        np.arange(9.0),
        np.append(np.arange(30.0), 1e9),
        np.append(np.arange(30.0), 7.3),
    ],
    ids=["normal", "few normal", "equal", "few rows", "a far one", "one between"],
)
def test_no_step(y):
    assert step_of(y) == 0.0


@pytest.mark.parametrize("step", [0.1, 0.5, 1.0])
def test_a_twelfth_of_the_square_of_the_step(step):
    assert variance_of_rounding(*rounded(step)) == pytest.approx(step**2 / 12.0)


@pytest.mark.parametrize("most", [1e2, 1e3])
def test_single_precision_and_far_levels(most):
    wholes = np.random.default_rng(0).integers(0, most, 200)
    wholes[:2] = 3, 4
    single = (0.1 * wholes).astype(np.float32).astype(float)
    assert step_of(single) == pytest.approx(0.1, rel=1e-5)
    assert step_of(1e9 + 0.1 * wholes) == pytest.approx(0.1, rel=1e-5)


def test_integers_of_integers_may_be_exact():
    x = np.tile(np.arange(15.0), 2)[:, None]
    tasks = np.repeat([0, 1], 15)
    y = 2.0 * x + tasks[:, None]
    assert step_of(y[:, 0]) == 1.0
    assert variance_of_rounding(x, tasks, y) == 0.0
    both = np.vstack([x, x]), np.append(tasks, tasks), np.vstack([y, y])
    assert variance_of_rounding(*both) == 0.0  # at the same inputs


def test_rare_events_are_not_noise_alone():
    rng = np.random.default_rng(0)
    y = (np.arange(100) % 50 == 0).astype(float)
    found = variance_of_rounding(
        rng.uniform(size=(100, 1)), np.zeros(100, int), y[:, None]
    )
    assert found == pytest.approx(0.25 * y.var())


def test_each_output_has_its_own():
    x, tasks, y = rounded(0.5)
    Y = np.column_stack([y, np.random.default_rng(0).standard_normal(60)])
    assert variance_of_rounding(x, tasks, Y) == pytest.approx([0.25 / 12.0, 0.0])
