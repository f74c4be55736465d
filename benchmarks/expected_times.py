"""What fits of everyday sizes take: the table of the user guide's page on speed.

Functions of three inputs that tasks mix, with noise. Run from the repository's root:
``python benchmarks/expected_times.py | tee benchmarks/results/expected_times.txt``.
"""

import argparse
import time
import warnings

import numpy as np
from joblib import cpu_count

from skmtgp import MultiTaskGPRegressor, RankSearchIC

GP = MultiTaskGPRegressor
CASES = [  # rows, tasks, whether complete, what, model
    (100, 5, False, "`MultiTaskGPRegressor()`", GP()),
    (300, 10, False, "the same", GP()),
    (1000, 10, False, "the same", GP()),
    (1000, 10, False, "`rank=2`", GP(rank=2)),
    (300, 10, False, "`RankSearchIC()`", RankSearchIC()),
    (100, 5, False, '`hyperparameters="sampled"`', GP(hyperparameters="sampled")),
    (2000, 10, True, "all tasks at the same inputs", GP()),
    (
        10_000,
        10,
        False,
        '`inference="sparse"`, 200 inducing inputs',
        GP(rank=2, inference="sparse", n_inducing=200),
    ),
]


def draw(n, n_tasks, complete, seed=0):
    """Rows of tasks that mix two functions, the task last, and targets."""
    rng = np.random.default_rng(seed)
    task = np.arange(n) % n_tasks
    inputs = rng.uniform(-2.0, 2.0, (n, 3))
    if complete:
        inputs = inputs[np.arange(n) // n_tasks]
    functions = np.column_stack(
        [np.sin(2.0 * inputs[:, 0]) + inputs[:, 1], np.cos(inputs[:, 1] * inputs[:, 2])]
    )
    weights = rng.standard_normal((n_tasks, 2))
    y = (weights[task] * functions).sum(axis=1) + 0.1 * rng.standard_normal(n)
    return np.column_stack([inputs, task]), y


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--most-rows", type=int, default=10_000)
    arguments = parser.parse_args()
    print(f"{cpu_count()} cores.\n")
    print("| rows | tasks | fit | seconds |")
    print("|---|---|---|---|")
    for n, n_tasks, complete, what, model in CASES:
        if n > arguments.most_rows:
            continue
        X, y = draw(n, n_tasks, complete)
        begin = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(X, y)
        seconds = time.perf_counter() - begin
        told = f"{seconds:.0f}" if seconds >= 10.0 else f"{seconds:.1f}"
        print(f"| {n:,} | {n_tasks} | {what} | {told} |", flush=True)


if __name__ == "__main__":
    main()
