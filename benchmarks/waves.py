"""Whether fast waves beside slow functions, trends or levels are taken for noise.

``python benchmarks/waves.py`` draws four kinds of data with noise, 4 tasks each:

- "two speeds": a slow wave of each task, and a fast one of another size, in phase;
- "phases": levels, and a fast wave with a phase of each task;
- "trends": the same with slopes instead of levels;
- "days": the load of buildings over ten days: levels, a slow wave, and a daily cycle.

It fits the defaults, and the same with a kernel that begins at a short length-scale.
"error" is the root mean squared error over the deviation of the fast wave, of 60 new
inputs a task; where waves are taken for noise it is about 1. "near a short one" are
fits whose likelihood is at most 3 nats below that from a short length-scale; these may
be of another form. "seconds" are the processor's of a fit.
"""

import argparse
import time
import warnings

import numpy as np
import pandas as pd
from sklearn.gaussian_process.kernels import RBF
from threadpoolctl import threadpool_limits

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC

M = 4
MODELS = MultiTaskGPRegressor, RankSearchIC, IndependentGP


def two_speeds(rng):
    """Slow and fast functions of x and the task, the range of x, rows, noise."""
    slow, fast = 2.0 * rng.standard_normal(M), rng.uniform(0.35, 0.75, M)
    return (
        lambda x, t: slow[t] * np.sin(x / 2.0),
        lambda x, t: fast[t] * np.sin(7.0 * x),
        *(6.0, 40, 0.1),
    )


def phases(rng):
    """The same."""
    level, wave = rng.standard_normal(M), _wave(rng)
    return lambda x, t: level[t], wave, 6.0, 40, 0.2


def trends(rng):
    """The same."""
    slope, wave = rng.standard_normal(M), _wave(rng)
    return lambda x, t: slope[t] * x, wave, 6.0, 40, 0.2


def days(rng):
    """The same."""
    level, size = rng.uniform(20.0, 60.0, M), rng.uniform(4.0, 10.0, M)
    slow, phase = rng.uniform(3.0, 8.0, M), rng.uniform(0.0, 2.0 * np.pi, (2, M))
    return (
        lambda x, t: level[t] + slow[t] * np.sin(2.0 * np.pi * x / 10.0 + phase[0, t]),
        lambda x, t: size[t] * np.sin(2.0 * np.pi * x + 0.3 * phase[1, t]),
        *(10.0, 60, 1.5),
    )


def _wave(rng):
    size, phase = rng.uniform(0.7, 1.5, M), rng.uniform(0.0, 2.0 * np.pi, M)
    return lambda x, t: size[t] * np.sin(6.0 * x + phase[t])


KINDS = {"two speeds": two_speeds, "phases": phases, "trends": trends, "days": days}


def rows_of(kind, seed):
    """Rows of the table, of one data set."""
    rng = np.random.default_rng(seed)
    slow, fast, width, n, noise = KINDS[kind](rng)
    task, of_test = np.repeat(np.arange(M), n), np.repeat(np.arange(M), 60)
    x, z = rng.uniform(0.0, width, len(task)), rng.uniform(0.0, width, len(of_test))
    y = slow(x, task) + fast(x, task) + noise * rng.standard_normal(len(task))
    X, X_test = np.column_stack([x, task]), np.column_stack([z, of_test])
    f_test, deviation = slow(z, of_test) + fast(z, of_test), fast(z, of_test).std()
    short = RBF([width / 20.0], (1e-2, 1e2))
    for cls in MODELS:
        begin = time.process_time()
        model = cls().fit(X, y)
        seconds = time.process_time() - begin
        other = cls(MultiTaskGPRegressor(short)) if cls is RankSearchIC else cls(short)
        values = [_value(of) for of in (model, other.fit(X, y))]
        mean, std = model.predict(X_test, return_std=True)
        yield {
            "data": kind,
            "model": cls.__name__,
            "error": np.sqrt(np.square(mean - f_test).mean()) / deviation,
            "near a short one": values[0] > values[1] - 3.0,
            "coverage of f": (np.abs(mean - f_test) < 1.96 * std).mean(),
            "seconds": seconds,
        }


def _value(model):
    best = getattr(model, "best_estimator_", model)
    return best.log_marginal_likelihood_value_


def main():
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=12, help="data sets of each kind")
    seeds = range(parser.parse_args().seeds)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = [row for kind in KINDS for seed in seeds for row in rows_of(kind, seed)]
    cells = pd.DataFrame(rows).groupby(["data", "model"], sort=False)
    table = cells[["error", "coverage of f", "seconds"]].mean()
    table.insert(1, "largest", cells["error"].max())
    table.insert(2, "near a short one", cells["near a short one"].sum())
    print(table.round(3).to_string())
    print(f"\n{len(seeds)} draws of each kind")


if __name__ == "__main__":
    main()
