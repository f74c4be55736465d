"""Time and memory of a compiled predictor of a robot, and of rows that join.

``python benchmarks/predictor.py`` fits six joints of the Puma 560 with 14 loads, a
pipeline for each, at starting values, and prints for the paper's kernel and the
geometric one, at n = 280 and 2800, on one core:

- microseconds of a prediction of one state by six pipelines, and by the predictor that
  is compiled of them for one load: the median, and the 99th percentile (goal: at most
  500 at n = 280 and 2000 at n = 2800);
- its size, as it is pickled, with standard deviations and without;
- milliseconds of ``partial_fit`` of one row of all joints, of one that takes the place
  of another (``max_rows``), of the ``refresh`` that comes after it, and of
  ``partial_fit`` with a predictor that follows.
"""

import argparse
import pickle
from time import perf_counter

import numpy as np
import pandas as pd
from settings import PAPER
from sklearn.base import clone
from threadpoolctl import threadpool_limits

from skmtgp import (
    MultiTaskGPRegressor,
    compile_predictor,
    make_inverse_dynamics_regressor,
    partial_fit,
)
from skmtgp.datasets import load_puma560

LOADS, RANK, TASK = list(range(1, 15)), 5, 3
N_CALLS, N_ROWS = 2000, 5


def fit(kernel, n):
    """A pipeline for each joint, and states that they have not seen."""
    options = {"n_per_load": n // len(LOADS), "loads": LOADS, "return_X_y": True}
    X, y = load_puma560(**options)
    model = MultiTaskGPRegressor(rank=RANK, inference="dense", max_iter=0, **PAPER)
    model = make_inverse_dynamics_regressor(model, kernel=kernel)
    test = load_puma560(subset="interpolation", loads=[TASK], return_X_y=True)
    return [clone(model).fit(X, of_joint) for of_joint in y.T], test


def timed(function, calls):
    """Seconds of each call."""
    seconds = []
    for arguments in calls:
        begin = perf_counter()
        function(*arguments)
        seconds.append(perf_counter() - begin)
    return np.array(seconds)


def join(models, X, y, n_rows=None):
    """Let one row join all joints."""
    for model, of_joint in zip(models, y, strict=True):
        partial_fit(model, X[None], [of_joint], max_rows=n_rows)


def measured(kernel, n):
    """A row of the table."""
    models, (X, y) = fit(kernel, n)
    predictor = compile_predictor(models, task=TASK, follow=False)
    states = [(x,) for x in np.resize(X[:, :-1], (N_CALLS, X.shape[1] - 1))]
    seconds = timed(predictor, states)
    slow = timed(lambda x: [model.predict(x[None]) for model in models], zip(X[:50]))
    deviations = compile_predictor(models, task=TASK, std=True, follow=False)
    rows = list(zip(X, y, strict=True))
    joined = timed(lambda *row: join(models, *row), rows[:N_ROWS])
    more = n + N_ROWS
    timed(lambda *row: join(models, *row, more), rows[N_ROWS : N_ROWS + 2])  # O(n^3)
    moved = timed(lambda *row: join(models, *row, more), rows[-N_ROWS:])
    refreshed = timed(predictor.refresh, [(models,)] * N_ROWS)
    follower = compile_predictor(models, task=TASK)
    followed = timed(lambda *row: join(models, *row), rows[:N_ROWS])
    size = len(pickle.dumps(follower)) / 1e6
    return {
        "kernel": kernel,
        "n": n,
        "pipelines, us": 1e6 * np.median(slow),
        "predictor, us": 1e6 * np.median(seconds),
        "99th, us": 1e6 * np.quantile(seconds, 0.99),
        "std, us": 1e6 * np.median(timed(deviations.std, states[:20])),
        "MB": size,
        "MB with std": len(pickle.dumps(deviations)) / 1e6,
        "a row, ms": 1e3 * np.median(joined),
        "a row for a row, ms": 1e3 * np.median(moved),
        "refresh, ms": 1e3 * np.median(refreshed),
        "a row, followed, ms": 1e3 * np.median(followed),
    }


def main():
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[280, 2800])
    args = parser.parse_args()
    with threadpool_limits(1):
        rows = [
            measured(kernel, n) for kernel in ("paper", "geometric") for n in args.sizes
        ]
    print(pd.DataFrame(rows).set_index(["kernel", "n"]).round(2).T.to_string())


if __name__ == "__main__":
    main()
