"""What a rank that is given does with few rows, with and without expecting noise.

``python benchmarks/given_rank.py --draws 10`` draws tasks from the model, with the
squared exponential of length-scale 1 on [0, 6], noise of deviation 0.2 or none. It fits
their true rank. "rows each" is rows for each hyperparameter. With fewer than three,
`Problem.wary` makes little noise unlikely; "without" it is left out. "error" is the
median, over draws, of the root mean squared error of 20 test rows a task over their
deviation. "density" is the median log density of these rows, "held" the share of them
that 95 % intervals hold.
"""

import argparse
import warnings
from unittest.mock import patch

import numpy as np
import pandas as pd
from sklearn.gaussian_process.kernels import RBF
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.learning.problem import Problem

# tasks, rows of each, rank
SIZES = (8, 4, 2), (20, 4, 2), (8, 5, 2), (8, 6, 2), (8, 8, 3), (20, 6, 2), (20, 5, 1)
N_TEST = 20  # of each task


def draw(n_tasks, n_rows, rank, noise, rng):
    """Rows with the task last and their targets, test rows, targets and functions."""
    task = np.tile(np.arange(n_tasks), n_rows + N_TEST)
    x, n = rng.uniform(0.0, 6.0, len(task)), n_tasks * n_rows
    K = RBF()(x[:, None]) + 1e-9 * np.eye(len(x))
    functions = np.linalg.cholesky(K) @ rng.standard_normal((len(x), rank))
    f = (functions * rng.standard_normal((n_tasks, rank))[task]).sum(axis=1)
    X, y = np.column_stack([x, task]), f + noise * rng.standard_normal(len(f))
    return X[:n], y[:n], X[n:], y[n:], f[n:]


def row(rank, X, y, X_test, y_test, f):
    """What a fit to a draw says."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = MultiTaskGPRegressor(kernel="rbf", rank=rank).fit(X, y)
    left, (low, high) = model.predict(X_test) - f, model.predict_interval(X_test)
    return {
        "each": len(y) / model.n_hyperparameters_,
        "error": np.sqrt(np.square(left).mean()) / f.std(),
        "density": model.log_predictive_density(X_test, y_test).mean(),
        "held": ((low <= y_test) & (y_test <= high)).mean(),
    }


def cell(n_tasks, n_rows, rank, noise, n):
    """A line of the table, of n draws."""
    line = {"noise": noise, "tasks": n_tasks, "rows": n_rows, "rank": rank}
    for name in ("without", "with"):
        wary = Problem.wary if name == "with" else lambda problem, form: problem
        with patch.object(Problem, "wary", wary):
            rngs = map(np.random.default_rng, range(n))
            sets = (draw(n_tasks, n_rows, rank, noise, rng) for rng in rngs)
            found = pd.DataFrame([row(rank, *of) for of in sets])
        line["rows each"] = found["each"].min()
        line[f"error {name}"] = found["error"].median()
        line[f"density {name}"] = found["density"].median()
        line[f"held {name}"] = found["held"].mean()
    return line


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=10)
    n = parser.parse_args().draws
    with threadpool_limits(1):
        lines = [cell(*size, noise, n) for noise in (0.2, 0.0) for size in SIZES]
    print(pd.DataFrame(lines).to_string(index=False, float_format="%.3g"))


if __name__ == "__main__":
    main()
