"""Whether what tasks have of their own, beside their descriptors, is found.

``python benchmarks/beside_descriptors.py`` draws tasks whose functions are linear in
their descriptors, with functions of their own or without, and fits the default and the
descriptors alone (the rank is given). Of new tasks and of new rows of known ones it
prints medians of the error of f, how many of 100 intervals of 95 % hold f and y (means
over the draws), in how many draws own functions are taken, and the median of seconds.
"""

import argparse
import time

import numpy as np
import pandas as pd

from skmtgp import MultiTaskGPRegressor

N_NEW, NOISE, LEVELS, ROWS_LEFT_OUT = 10, 0.25, 0.15, 10
CASES = {
    "own 0.3": {"own": 0.3},
    "own 0.2": {"own": 0.2},
    "own 0.1": {"own": 0.1},
    "own 0.3, 8 tasks": {"own": 0.3, "n_tasks": 8, "n_rows": 30},
    "none": {},
    "none, 4 descriptors": {"n_descriptors": 4, "n_rows": 15},
    "none, 8 tasks": {"n_tasks": 8, "n_rows": 30},
    "none, 40 tasks": {"n_tasks": 40, "n_rows": 10},
}


def draw(seed, *, own=0.0, n_tasks=18, n_rows=20, n_descriptors=2):
    """Rows to fit, new rows of the same tasks, and rows of new tasks: X, y and f."""
    rng = np.random.default_rng(1000 + seed)
    size, each = n_tasks + N_NEW, n_rows + ROWS_LEFT_OUT
    table = rng.standard_normal((size, n_descriptors))
    D = np.column_stack([np.ones(size), table])
    weights = D @ rng.normal(0.0, 0.4, (n_descriptors + 1, 4))
    weights += rng.normal(0.0, own, (size, 4))
    levels = 0.3 * table.sum(axis=1) + (own > 0.0) * rng.normal(0.0, LEVELS, size)
    task, x = np.repeat(np.arange(size), each), rng.uniform(0.0, 6.0, (size * each, 2))
    waves = np.sin(x[:, 0]), np.cos(x[:, 0]), 0.5 * x[:, 1] - 1.5, np.sin(0.8 * x[:, 1])
    f = np.sum(weights[task] * np.transpose(waves), axis=1) + levels[task]
    y = f + rng.normal(0.0, NOISE, len(f))
    X = np.column_stack([x, table[task], task])
    known, first = task < n_tasks, np.arange(len(task)) % each < n_rows
    parts = known & first, known & ~first, ~known
    return [[of[rows] for of in (X, y, f)] for rows in parts]


def measure(model, X, y, f):
    """Root of the mean squared error of f, and the shares that intervals hold."""
    found = [np.sqrt(np.square(model.predict(X) - f).mean())]
    for target, include_noise in ((f, False), (y, True)):
        lower, upper = model.predict_interval(X, 0.95, include_noise=include_noise)
        found.append(np.mean((lower <= target) & (target <= upper)))
    return found


def fitted(seed, options, **given):
    """What is printed of a fit."""
    rows, known, new = draw(seed, **options)
    p = rows[0].shape[1] - 3
    begin = time.perf_counter()
    model = MultiTaskGPRegressor(task_descriptors=range(2, 2 + p), **given)
    model.fit(*rows[:2])
    seconds = time.perf_counter() - begin
    return [*measure(model, *new), *measure(model, *known), model.diagonal_, seconds]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--draws", type=int, default=8)
    n_draws = parser.parse_args().draws
    print(f"{'':28}  new: error  f   y  known: error  f   y  own  seconds")
    for name, options in CASES.items():
        rank = options.get("n_descriptors", 2) + 1
        for model, given in (("default", {}), ("alone", {"rank": rank})):
            rows = [fitted(seed, options, **given) for seed in range(n_draws)]
            table = pd.DataFrame(rows).replace({"equal": True}).astype(float)
            (error, *_, seconds), mean = table.median(), 100.0 * table.mean()
            print(
                f"{name:20} {model:8} {error:10.3f} {mean[1]:4.0f} {mean[2]:3.0f}"
                f" {table[3].median():13.3f} {mean[4]:4.0f} {mean[5]:3.0f}"
                f" {table[6].sum():4.0f} {seconds:8.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
