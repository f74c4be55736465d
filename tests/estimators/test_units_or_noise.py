"""Tasks that differ in noise: whether they differ in units, too."""

import numpy as np
import pytest

from skmtgp import MultiTaskGPRegressor
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.reading import read

N_TASKS, N_ROWS = 10, 20


def noisy(f, tasks, rng):
    """Targets with a noise variance of each task, the deviations around 0.2."""
    noise = 0.2 * np.exp(rng.standard_normal(N_TASKS))
    return f + noise[tasks] * rng.standard_normal(len(f))


def one_function_in_other_ranges(seed):
    """All tasks have the same function; their inputs hardly overlap."""
    rng, tasks = np.random.default_rng(seed), np.repeat(np.arange(N_TASKS), N_ROWS)
    start = rng.uniform(0.0, 5.0, N_TASKS)
    x = start[tasks] + 3.0 * rng.uniform(size=len(tasks))
    y = noisy(np.sin(x) + np.cos(2.2 * x), tasks, rng)
    return np.column_stack([x, tasks]), y


def much_alike(seed):
    """A function of all tasks, and a little of another one."""
    rng, tasks = np.random.default_rng(seed), np.repeat(np.arange(N_TASKS), N_ROWS)
    F = np.column_stack([np.ones(N_TASKS), 0.3 * rng.standard_normal(N_TASKS)])[tasks]
    x = rng.uniform(0.0, 8.0, len(tasks))
    K = F @ F.T * np.exp(-0.5 * np.subtract.outer(x, x) ** 2)
    f = np.linalg.cholesky(K + 1e-9 * np.eye(len(x))) @ rng.standard_normal(len(x))
    return np.column_stack([x, tasks]), noisy(f, tasks, rng)


@pytest.mark.parametrize(
    "data",
    [
        one_function_in_other_ranges(0),
        one_function_in_other_ranges(1),
        much_alike(7),
        much_alike(45),
    ],
)
def test_tasks_with_the_same_units_keep_them(data):
    """Functions as large in shared units speak for these, as in units of each."""
    model = MultiTaskGPRegressor()
    found = decide(model, read(model, *data))
    assert not found.units.per_task
    assert found.noise == "per_task"
