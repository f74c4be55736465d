"""Tasks that are multiples of one wave, each with its level, and noise."""

import numpy as np


def draw(n_tasks=3, rows=8, *, n_outputs=None, seed=0):
    rng = np.random.default_rng(seed)
    x, task = rng.uniform(0.0, 6.0, n_tasks * rows), np.repeat(np.arange(n_tasks), rows)
    y = np.array([1.0, -2.0, 0.5, 1.5])[task] * np.sin(x) + task
    y = y + 0.2 * rng.standard_normal(len(y))
    X = np.column_stack([x, task])
    return X, y if n_outputs is None else np.column_stack([y, np.cos(x) - y])
