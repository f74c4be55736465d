"""How often intervals hold of a task that was measured in a corner of the inputs.

Six to fourteen tasks of one or two functions are drawn on [0, 6], with 15 or 25 rows
each. The last one has 6 or 12 rows, all below 2. Printed are, of 95 % intervals, the
share of new observations that they hold, and the mean log density of these (the median
of the draws): of the last task above 2, and of the others. "known rows" is the default
without what the rows leave open of F, which `skmtgp.inference.open_rows` counts. "ms"
is the time of a first prediction.

``python benchmarks/corners.py --draws 20``
"""

import argparse
import time
import warnings
from contextlib import nullcontext
from unittest.mock import patch

import numpy as np
from scipy.stats import norm
from sklearn.gaussian_process.kernels import RBF
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor

WIDTH, CORNER, NEW = 6.0, 2.0, 40
MODELS = {"known rows": {}, "default": {}, "laplace": {"hyperparameters": "laplace"}}


def draw(seed):
    """Rows to learn from, new ones of the last task, and new ones of the others."""
    rng = np.random.default_rng(seed)
    n_tasks, rank, noise, n, n_last = (
        rng.choice(of) for of in ([6, 10, 14], [1, 2], [0.05, 0.2], [15, 25], [6, 12])
    )
    x = rng.uniform(0.0, WIDTH, (n_tasks, n + NEW))
    x[-1, :n] = rng.uniform(0.0, CORNER, n)
    x[-1, n:] = rng.uniform(CORNER, WIDTH, NEW)
    K = RBF(1.0)(x.reshape(-1, 1)) + 1e-9 * np.eye(x.size)
    z = np.linalg.cholesky(K) @ rng.standard_normal((x.size, rank))
    F = 0.5 * rng.standard_normal((n_tasks, rank)) + np.eye(rank)[0]
    y = np.einsum("tnr,tr->tn", z.reshape(*x.shape, rank), F)
    y = y + noise * rng.standard_normal(x.shape) + rng.standard_normal((n_tasks, 1))
    X = np.stack([x, np.broadcast_to(np.arange(n_tasks)[:, None], x.shape)], axis=-1)
    kept = np.ones((n_tasks, n), dtype=bool)
    kept[-1, n_last:] = False
    others = X[:-1, n:].reshape(-1, 2), y[:-1, n:].ravel()
    return X[:, :n][kept], y[:, :n][kept], (X[-1, n:], y[-1, n:]), others


def measure(name, X, y, *tests):
    """Held and log density of each test, and seconds."""
    as_known = patch("skmtgp.multitask.with_open_rows", lambda problem, mode, _: mode)
    rows = as_known if name == "known rows" else nullcontext()
    with warnings.catch_warnings(), rows:
        warnings.simplefilter("ignore")
        model = MultiTaskGPRegressor(**MODELS[name]).fit(X, y)
    found = []
    for new, observed in tests:
        begin = time.perf_counter()
        lower, upper = model.predict_interval(new)
        seconds = time.perf_counter() - begin
        held = np.mean((lower <= observed) & (observed <= upper))
        density = norm.logpdf(observed, model.predict(new), (upper - lower) / 3.92)
        found += [held, density.mean()]
    return *found, seconds


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--draws", type=int, default=20)
    draws = [draw(seed) for seed in range(parser.parse_args().draws)]
    print(f"{'':12s}{'corner held':>12s}{'density':>9s}{'others held':>12s}", end="")
    print(f"{'density':>9s}{'ms':>7s}")
    for name in MODELS:
        found = np.array([measure(name, *data) for data in draws])
        corner, others = found[:, 0], found[:, 2]
        print(
            f"{name:12s}{corner.mean():12.3f}{np.median(found[:, 1]):9.2f}"
            f"{others.mean():12.3f}{np.median(found[:, 3]):9.2f}"
            f"{1e3 * np.median(found[:, 4]):7.1f}",
            flush=True,
        )


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
