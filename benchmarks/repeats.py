"""Repeated rows given once, with their mean, number and variance, beside all rows.

``python benchmarks/repeats.py`` draws data of the shape of the London schools' (139
schools, 15,362 pupils, of whom 4,004 have other inputs than all others of their school)
or of a ``--share`` of them, and prints

- "same": by how much the log likelihood, its gradient, and means and deviations of f
  differ at the same hyperparameters, relative to the largest. Goal: 1e-8.
- "time": seconds of one dense likelihood and gradient of either; of all rows only up to
  ``--most`` of them.

``--share 1`` is the whole shape: 4,004 rows take some seconds, all rows are left out.
"""

import argparse

import numpy as np
from likelihood import seconds
from sklearn.gaussian_process.kernels import RBF
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, average_repeats

N_SCHOOLS, N_ROWS, N_DISTINCT, N_INPUTS = 139, 15_362, 4_004, 27


def draw(share, seed=0):
    """Rows of pupils, of whom many share all inputs, and targets."""
    rng = np.random.default_rng(seed)
    n_tasks, n = round(share * N_SCHOOLS), round(share * N_ROWS)
    n_distinct = round(share * N_DISTINCT)
    tasks = np.append(np.arange(n_tasks), rng.integers(n_tasks, size=n_distinct))
    x = rng.integers(0, 2, (n_distinct, N_INPUTS)).astype(float)
    rows = np.append(np.arange(n_distinct), rng.integers(n_distinct, size=n))[:n]
    X = np.column_stack([x, tasks[:n_distinct]])[rows]
    slopes = 0.3 * rng.standard_normal((n_tasks, N_INPUTS))
    f = (slopes[X[:, -1].astype(int)] * X[:, :-1]).sum(axis=1)
    return X, f + rng.standard_normal(n)


def fitted(X, y, **known):
    """A model at its starting values, which do not depend on the rows."""
    options = {"noise": "shared", "normalize_y": "shared", "max_iter": 0}
    model = MultiTaskGPRegressor(RBF(4.0), rank=1, inference="dense", **options)
    return model.fit(X, y, **known)


def compared(model, other, X):
    """Largest differences of two models at one theta, over the largest number."""
    theta, tasks = model.theta_, np.searchsorted(model.tasks_, X[:, -1])
    values = [
        np.hstack(of.log_marginal_likelihood(theta, True)) for of in (model, other)
    ]
    posteriors = [of._likelihoods[0].posterior(theta) for of in (model, other)]
    means = [of.mean(X[:, :-1], tasks) for of in posteriors]
    deviations = [np.sqrt(of.variance(X[:, :-1], tasks)) for of in posteriors]
    return [
        np.abs(one - two).max() / np.abs(one).max()
        for one, two in (values, means, deviations)
    ]


def main():
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--share", type=float, default=0.1, help="of the schools' shape"
    )
    parser.add_argument("--most", type=int, default=4000, help="rows of all, at most")
    arguments = parser.parse_args()
    X, y = draw(arguments.share)
    few, means, counts, variance = average_repeats(X, y)
    print(f"{len(X)} rows, {len(few)} distinct, {len(np.unique(X[:, -1]))} tasks")
    with threadpool_limits(1):
        model = fitted(few, means, sample_weight=counts, repeat_variance=variance)
        value = [model.log_marginal_likelihood, model.theta_, True]
        print(f"distinct rows: {seconds(*value):.2f} s a likelihood and gradient")
        if len(X) > arguments.most:
            print(f"all rows: left out, there are more than {arguments.most}")
            return
        of_all = fitted(X, y)
        print(f"all rows: {seconds(of_all.log_marginal_likelihood, *value[1:]):.2f} s")
        differences = compared(of_all, model, few[:200])
    names = "likelihood and gradient", "means of f", "deviations of f"
    for name, of in zip(names, differences, strict=True):
        print(f"{name} differ by {of:.1e} (goal 1e-8)")


if __name__ == "__main__":
    main()
