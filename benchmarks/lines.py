"""Whether lines and planes are found by default, and curves are not taken for them.

``python benchmarks/lines.py`` draws six kinds of data, with levels and noise:

- "planes": 8 tasks of 10 rows and 3 features, slopes that have nothing in common;
- "alike": the same with slopes around 1.5;
- "varieties": 12 tasks of 4 to 8 rows, lines with slopes around 1;
- "plane and curve": the planes, and a curve of half their size along one feature;
- "curves": 8 tasks of 10 rows and one feature, curves with a trend;
- "returns": 12 tasks of the same 60 rows and 4 features, planes with slopes around 1,
  0.3, 0.2 and -0.1, and noise of 3.3 times their variance, as returns of assets have.

It fits the defaults, the same with kernel="rbf" and "linear", and least squares of each
task. "inside" is the root mean squared error over the deviation of the truth, for new
rows drawn as those were, and "outside" for rows twice as far from the mean. "linear"
counts the fits whose kernel is linear. "seconds" are the processor's of a fit.
"""

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from sklearn.linear_model import LinearRegression
from threadpoolctl import threadpool_limits

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC
from skmtgp.kernels import ARDLinear

NOISE, FAR = 0.4, 2.0


class Kind(NamedTuple):
    """Data of a kind.

    Attributes
    ----------
    f : callable
        The truth as a function of x and the task.
    counts : sequence of int
        Rows of each task.
    d : int
        Features.
    noise : float or ndarray of shape (n_tasks,)
        Its deviation.
    common : bool
        Whether all tasks have the same rows.
    """

    f: Callable
    counts: Sequence
    d: int
    noise: float | np.ndarray = NOISE
    common: bool = False


class EachAlone:
    """Least squares of each task."""

    kernel_ = None

    def fit(self, X, y):
        """Learn."""
        self._models = {}
        for task in np.unique(X[:, -1]):
            own = X[:, -1] == task
            self._models[task] = LinearRegression().fit(X[own, :-1], y[own])
        return self

    def predict(self, X):
        """Predict."""
        found = np.empty(len(X))
        for task, model in self._models.items():
            own = X[:, -1] == task
            found[own] = model.predict(X[own, :-1])
        return found


MODELS = {
    "MultiTaskGPRegressor()": MultiTaskGPRegressor,
    "RankSearchIC()": RankSearchIC,
    "IndependentGP()": IndependentGP,
    'MultiTaskGPRegressor("rbf")': lambda: MultiTaskGPRegressor("rbf"),
    'MultiTaskGPRegressor("linear")': lambda: MultiTaskGPRegressor("linear"),
    "least squares of each task": EachAlone,
}


def planes(rng, around=0.0, n_tasks=8, d=3, deviation=1.0):
    """Planes with slopes that have nothing in common."""
    slopes = around + deviation * rng.standard_normal((n_tasks, d))
    return Kind(*with_levels(rng, slopes), d)


def with_levels(rng, slopes):
    """Planes with levels, and ten rows of each task."""
    levels = rng.standard_normal(len(slopes))
    return lambda x, t: levels[t] + (slopes[t] * x).sum(axis=1), [10] * len(slopes)


def alike(rng):
    """The same."""
    return planes(rng, around=1.5, deviation=0.5)


def varieties(rng):
    """The same."""
    lines = planes(rng, around=1.0, n_tasks=12, d=1, deviation=0.3)
    return lines._replace(counts=rng.integers(4, 9, 12))


def plane_and_curve(rng):
    """The same."""
    plane = planes(rng)
    return plane._replace(f=lambda x, t: plane.f(x, t) + np.sin(2.0 * x[:, 0]))


def curves(rng):
    """The same."""
    lines = planes(rng, around=1.0, d=1, deviation=0.3)
    size, phase = rng.uniform(0.7, 1.5, 8), rng.uniform(0.0, 1.0)
    return lines._replace(
        f=lambda x, t: lines.f(x, t) + size[t] * np.sin(2.0 * x[:, 0] + phase)
    )


def returns(rng, n_tasks=12, signal=0.3):
    """The same."""
    slopes = [1.0, 0.3, 0.2, -0.1] + 0.4 * rng.standard_normal((n_tasks, 4))
    noise = np.sqrt(np.square(slopes).sum(axis=1) / signal)
    f, _ = with_levels(rng, slopes)
    return Kind(f, [60] * n_tasks, 4, noise, common=True)


KINDS = {
    "planes": planes,
    "alike": alike,
    "varieties": varieties,
    "plane and curve": plane_and_curve,
    "curves": curves,
    "returns": returns,
}


def rows_of(kind, seed):
    """Rows of the table, of one data set."""
    rng = np.random.default_rng(seed)
    f, counts, d, noise, common = KINDS[kind](rng)
    task, of_test = (np.repeat(np.arange(len(counts)), n) for n in (counts, 40))
    x, z = (rng.standard_normal((len(of), d)) for of in (task, of_test))
    x = np.tile(x[task == 0], (len(counts), 1)) if common else x
    X, y = np.column_stack([x, task]), f(x, task)
    y += np.broadcast_to(noise, len(counts))[task] * rng.standard_normal(len(y))
    for name, make in MODELS.items():
        begin = time.process_time()
        model = make().fit(X, y)
        row = {"data": kind, "model": name, "seconds": time.process_time() - begin}
        for where, far in (("inside", 1.0), ("outside", FAR)):
            truth = f(far * z, of_test)
            found = model.predict(np.column_stack([far * z, of_test]))
            row[where] = np.sqrt(np.mean((found - truth) ** 2) / truth.var())
        yield row | {"linear": is_linear(model)}


def is_linear(model):
    """Whether its kernel is, beside an amplitude."""
    kernel = getattr(model, "best_estimator_", model).kernel_
    return isinstance(getattr(kernel, "k2", kernel), ARDLinear)


def main():
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=12, help="data sets of each kind")
    seeds = range(parser.parse_args().seeds)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = [row for kind in KINDS for seed in seeds for row in rows_of(kind, seed)]
    cells = pd.DataFrame(rows).groupby(["data", "model"], sort=False)
    table = cells[["inside", "outside"]].median()
    table["linear"], table["seconds"] = cells["linear"].sum(), cells["seconds"].mean()
    print(table.round(3).to_string())
    print(f"\n{len(seeds)} draws of each kind; errors are medians")


if __name__ == "__main__":
    main()
