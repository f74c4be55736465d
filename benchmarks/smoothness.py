"""How much likelier a rougher k^x must be to be taken, and what each choice costs.

``python benchmarks/smoothness.py`` draws five kinds of data from functions of known
smoothness, with levels and noise. It fits ``MultiTaskGPRegressor()`` as it is, with two
nats asked for each rougher kernel, and with the kernel of the truth given. "error" is
the root mean squared error of the functions at new inputs over that with the true
kernel. "of f" and "of y" are shares that 95 % intervals hold, of the functions and of
new measurements. "density" is the mean log density of new measurements. "right" is the
share of fits with the true kernel.
"""

import argparse
import warnings
from itertools import product
from unittest.mock import patch

import numpy as np
import pandas as pd
from scipy.stats import norm
from sklearn.gaussian_process.kernels import RBF, Matern
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.learning.tuning import TUNING

TRUTHS = {
    "exponential": lambda scale: Matern(scale, nu=0.5),
    "matern": lambda scale: Matern(scale, nu=1.5),
    "matern52": lambda scale: Matern(scale, nu=2.5),
    "rbf": RBF,
}
# tasks, rows of each, inputs, length-scale in [0, 1], noise
DATA = [
    (4, 40, 2, 0.3, 0.1),
    (4, 40, 2, 0.3, 0.3),
    (6, 20, 1, 0.3, 0.1),
    (6, 48, 3, 0.7, 0.1),
    (8, 10, 1, 0.3, 0.2),
]
N_TEST, RANK, Q = 60, 2, norm.ppf(0.975)
NATS = {"as it is": None, "two nats": 2.0}


def draw(truth, n_tasks, n_each, n_inputs, scale, noise, seed):
    """Rows with the task last, their targets, and new rows with functions and targets.

    Tasks are weighted sums of two draws of a Gaussian process.
    """
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(n_tasks), n_each + N_TEST)
    x = rng.uniform(0.0, 1.0, (len(task), n_inputs))
    K = TRUTHS[truth](scale)(x) + 1e-8 * np.eye(len(x))
    functions = np.linalg.cholesky(K) @ rng.standard_normal((len(x), RANK))
    weights = rng.standard_normal((n_tasks, RANK)) / np.sqrt(RANK)
    f = (functions * weights[task]).sum(axis=1) + 3.0 * task
    X, y = np.column_stack([x, task]), f + noise * rng.standard_normal(len(x))
    new = np.arange(len(x)) % (n_each + N_TEST) >= n_each
    return X[~new], y[~new], X[new], f[new], y[new]


def fits(truth, data, seed):
    """A row for each way to choose the kernel."""
    X, y, *new = draw(truth, *data, seed)
    least = fitted(MultiTaskGPRegressor(truth), X, y)
    for way, nats in {**NATS, "true kernel": None}.items():
        model = least
        if way in NATS:
            asked = {} if nats is None else {"likelier": nats}
            with patch.dict(vars(TUNING), asked):
                model = fitted(MultiTaskGPRegressor(), X, y)
        same = is_same(model.kernel_, least.kernel_)
        yield {"truth": truth, "model": way, **told(model, least, *new), "right": same}


def fitted(model, X, y):
    """The fitted model."""
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return model.fit(X, y)


def is_same(kernel, other):
    """Whether two kernels are as smooth."""
    return getattr(kernel, "nu", None) == getattr(other, "nu", None)


def told(model, least, X, f, y):
    """How well a model predicts."""
    mean, std = model.predict(X, return_std=True)
    lower, upper = model.predict_interval(X, 0.95)
    of_y = (upper - lower) / (2.0 * Q)
    error = np.mean(np.square(mean - f)) / np.mean(np.square(least.predict(X) - f))
    return {
        "error": np.sqrt(error),
        "of f": np.mean(np.abs(f - mean) < Q * std),
        "of y": np.mean((lower < y) & (y < upper)),
        "density": norm.logpdf(y, mean, of_y).mean(),
    }


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=12, help="draws of each")
    seeds = range(parser.parse_args().seeds)
    rows = [row for of in product(TRUTHS, DATA, seeds) for row in fits(*of)]
    table = pd.DataFrame(rows).groupby(["truth", "model"], sort=False).mean()
    print(table.round(3).to_string())
    print(f"\nmeans of {len(seeds)} draws of each of {len(DATA)} kinds of data")


if __name__ == "__main__":
    main()
