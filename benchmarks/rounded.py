"""Rounded targets, and a constant task: what the least noise variance gains.

``python benchmarks/rounded.py`` draws ten sets of rows of each kind, fits
``MultiTaskGPRegressor()`` and others, and prints

- "error": the root mean squared error of the function, over its deviation;
- "held": the share of 95 % intervals that hold a new (rounded) target;
- "loss": the median over the draws of the mean of minus the log density of new targets,
  whose unit is the deviation of the functions.

Tasks are weighted sums of two draws of a Gaussian process with length-scale 1.5 on
[0, 8]. They are rounded to steps of so many deviations ("bounds given" is a fit with
bounds of the noise variance, which are then the only ones). Or one of them is constant:
then the other tasks are scored, "own noise" is a fit with a noise variance for each
task, and "left out" one without the rows of the constant task.
"""

import argparse
import warnings

import numpy as np
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor

GIVEN = {"noise_variance_bounds": (1e-10, 1e4)}
SIZES = ((4, 20), (3, 12))  # tasks, and rows of each
STEPS, NOISES, N_TEST = (0.1, 0.5, 1.0), (0.01, 0.1), 200


def draw(n_tasks, n_rows, noise, seed):
    """Rows with the task last, functions and targets; the first ones are to learn."""
    rng, n = np.random.default_rng(seed), n_tasks * n_rows
    x, task = rng.uniform(0.0, 8.0, n + N_TEST), np.arange(n + N_TEST) % n_tasks
    K = np.exp(-0.5 * np.square((x[:, None] - x) / 1.5)) + 1e-9 * np.eye(len(x))
    functions = np.linalg.cholesky(K) @ rng.standard_normal((len(x), 2))
    f = (functions * rng.standard_normal((n_tasks, 2))[task]).sum(axis=1)
    f /= f.std()
    return np.column_stack([x, task]), f, f + noise * rng.standard_normal(len(x)), n


def scores(model, X, y, X_test, f_test, y_test):
    """Error, share held, and loss."""
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X, y)
    mean, std = model.predict(X_test, return_std=True, include_noise=True)
    away = (y_test - mean) / std
    error = np.sqrt(np.mean(np.square(mean - f_test))) / f_test.std()
    loss = np.mean(0.5 * away**2 + np.log(std) + 0.5 * np.log(2.0 * np.pi))
    return error, np.mean(np.abs(away) < 1.96), loss


def rounded(sizes, noise, step, seed):
    """Scores of each model on rounded targets."""
    X, f, y, n = draw(*sizes, noise, seed)
    y = np.round(y / step) * step
    rows = X[:n], y[:n], X[n:], f[n:], y[n:]
    return {
        "default": scores(MultiTaskGPRegressor(), *rows),
        "bounds given": scores(MultiTaskGPRegressor(**GIVEN), *rows),
    }


def constant(sizes, noise, seed):
    """Scores of each model where the last task is constant, of the others."""
    X, f, y, n = draw(*sizes, noise, seed)
    last = X[:, -1] == sizes[0] - 1
    y[last], others = 1.0, np.flatnonzero(~last)
    learned, test = others[others < n], others[others >= n]
    new = X[test], f[test], y[test]
    return {
        "default": scores(MultiTaskGPRegressor(), X[:n], y[:n], *new),
        "own noise": scores(MultiTaskGPRegressor(noise="per_task"), X[:n], y[:n], *new),
        "left out": scores(MultiTaskGPRegressor(), X[learned], y[learned], *new),
    }


def report(name, found):
    """A line for each model."""
    for model in found[0]:
        error, held, loss = np.array([of[model] for of in found]).T
        print(
            f"{name:46}{model:14}{error.mean():8.3f}{held.mean():8.3f}"
            f"{np.median(loss):10.2f}",
            flush=True,
        )


def main():
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=10)
    seeds = range(parser.parse_args().draws)
    print(f"{'data':46}{'model':14}{'error':>8}{'held':>8}{'loss':>10}")
    for sizes in SIZES:
        for noise in NOISES:
            name = f"{sizes[0]} tasks of {sizes[1]} rows, noise {noise}"
            for step in STEPS:
                found = [rounded(sizes, noise, step, seed) for seed in seeds]
                report(f"{name}, step {step}", found)
            report(f"{name}, one constant", [constant(sizes, noise, k) for k in seeds])


if __name__ == "__main__":
    main()
