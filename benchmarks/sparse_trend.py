"""What a trend costs in sparse inference.

``python benchmarks/sparse_trend.py`` prints seconds of one bound with its gradient, and
of the bound alone, with trends of p columns over those without a trend: the fastest of
some turns, on one thread. Trends are of all tasks, or of each.
"""

import argparse
from time import perf_counter

import numpy as np
from sklearn.gaussian_process.kernels import RBF
from threadpoolctl import threadpool_limits

from skmtgp.inference.sparse import SparseBound
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank
from skmtgp.model.trend import Trend

TRENDS = [(0, False), (1, False), (3, False), (8, False), (1, True), (3, True)]
N_FEATURES, RANK = 3, 2


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=20_000)
    parser.add_argument("--m", type=int, default=200)
    parser.add_argument("--tasks", type=int, default=6)
    parser.add_argument("--turns", type=int, default=15)
    arguments = parser.parse_args()
    bounds = [make(arguments, *of) for of in TRENDS]
    with threadpool_limits(1):
        seconds = np.array([turn(bounds) for _ in range(arguments.turns)]).min(axis=0)
    print("columns                  value and gradient      value")
    for (p, own), of in zip(TRENDS, seconds, strict=True):
        name, times = f"{p}{' of each task' if own else ''}", of / seconds[0]
        parts = [f"{a:7.3f} s {b:6.3f}" for a, b in zip(of, times, strict=True)]
        print(f"{name:22}", *parts, sep="   ")


def make(arguments, p, own):
    """A bound of a trend of p columns, over the same data each time."""
    n, n_tasks, rng = arguments.n, arguments.tasks, np.random.default_rng(0)
    X, tasks = rng.uniform(0, 3, (n, N_FEATURES)), rng.integers(0, n_tasks, n)
    y = np.sin(X.sum(axis=1)) * (1 + tasks) + 0.1 * rng.standard_normal(n)
    slopes, trend = np.zeros((n_tasks if own else 1, p)), None
    if p:
        parts = n_tasks, own, np.zeros((1, p)), np.ones(1), slopes
        trend = Trend(lambda X: powers(X, p), *parts)
    kernel, form = RBF([1.5] * N_FEATURES), low_rank(n_tasks, RANK)
    prior = Prior(kernel, form, levels=True, trend=trend)
    return SparseBound(prior, X, tasks, y, X[: arguments.m].copy())


def powers(X, p):
    """The first p columns of X, its squares, and so on."""
    return np.column_stack(
        [X[:, j % N_FEATURES] ** (1 + j // N_FEATURES) for j in range(p)]
    )


def turn(bounds):
    """Seconds of a gradient and of a value of each, one after another."""
    found = []
    for bound in bounds:
        theta, begin = bound.prior.theta(), perf_counter()
        bound.value_and_grad(theta)
        between = perf_counter()
        bound.value(theta)
        found.append([between - begin, perf_counter() - between])
    return found


if __name__ == "__main__":
    main()
