"""Data of docs/migrating.md: three tasks, of which the last has few rows."""

import numpy as np

rng = np.random.default_rng(0)
x = rng.uniform(0, 1, (90, 2))  # two features
task = np.repeat([0, 1, 2], [40, 40, 10])
x_new, task_new = rng.uniform(0, 1, (30, 2)), np.repeat([0, 1, 2], 10)


def f(x, task):
    """Two functions, which each task has in other amounts."""
    mix = np.array([[1.0, 0.5], [-1.0, 1.0], [2.0, 0.5]])[task]
    return mix[:, 0] * np.sin(6 * x[:, 0]) + mix[:, 1] * np.cos(5 * x[:, 1])


y = f(x, task) + 0.1 * rng.standard_normal(90)
