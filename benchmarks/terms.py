"""Models of several terms K^rho_q x k_q: what they cost, and what they gain.

- "cost": one likelihood with its gradient, of Q terms over that of one. Goal: at most
  1.3 + 0.3 Q by dense inference; and the same of the sparse bound, which has Q times as
  many features.
- "drawn": tasks that share a slow function and a fast one, drawn from the model: errors
  of f over that of the true parameters. Goal: two terms at most 1.1 where one term has
  1.5.
- "jura": metals in the soil (Goovaerts 1997), logarithms, each standardised; the file
  jura/jura.csv of the folder ``--data``. Log likelihood, BIC, mean absolute error of
  cadmium at the 100 validation sites in ppm, seconds. Goal: three terms of rank 1 have
  -935 and 0.384 (one term of full rank: -974 and 0.405) in 60 s on one core.
"""

import argparse
import warnings
from pathlib import Path
from time import perf_counter

import levels_data
import numpy as np
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.sparse import SparseBound
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank

N_TASKS, NOISE = 3, 0.3
MODELS = {  # number of kernels, and ranks
    "1 term, full rank": (1, 3),
    "2 terms, full rank": (2, 3),
    "3 terms, full rank": (3, 3),
    "2 terms, rank 1": (2, 1),
    "3 terms, rank 1": (3, 1),
}


def cost(arguments):
    """Seconds of one likelihood and gradient, the fastest of several, in turns."""
    rng = np.random.default_rng(0)
    for n, times in ((300, 300), (1000, 30)):
        X, tasks = rng.standard_normal((n, 3)), np.sort(rng.integers(0, N_TASKS, n))
        y = rng.standard_normal(n)
        of_terms = [DenseLikelihood(_prior(k), X, tasks, y) for k in range(1, 5)]
        for k, (seconds, times_one) in enumerate(_timed(of_terms, times), start=1):
            print(
                f"n = {n}, {k} terms: {1e3 * seconds:6.1f} ms, {times_one:.2f} times "
                f"one (goal {1.3 + 0.3 * k:.1f})"
            )
    for n, m, times in ((2000, 100, 20), (20_000, 100, 5), (20_000, 300, 3)):
        X, tasks = rng.standard_normal((n, 3)), rng.integers(0, N_TASKS, n)
        rows = X, tasks, rng.standard_normal(n), X[:m].copy()
        of_terms = [SparseBound(_prior(k), *rows) for k in range(1, 4)]
        for k, (seconds, times_one) in enumerate(_timed(of_terms, times), start=1):
            print(
                f"n = {n}, {m} inducing inputs, {k} terms: {1e3 * seconds:6.1f} ms, "
                f"{times_one:.2f} times one"
            )


def _prior(n_terms):
    """Of terms of rank 2."""
    term = RBF([1.0] * 3), low_rank(N_TASKS, 2)
    return Prior(*term, levels=True).with_terms([term] * n_terms)


def _timed(likelihoods, times):
    """Seconds of a gradient of each, and the same over that of the first."""
    seconds = np.empty((times, len(likelihoods)))
    for row in seconds:
        for k, likelihood in enumerate(likelihoods):
            theta, begin = likelihood.prior.theta(), perf_counter()
            likelihood.value_and_grad(theta)
            row[k] = perf_counter() - begin
    fastest = seconds.min(axis=0)
    return zip(fastest, fastest / fastest[0], strict=True)


def drawn(arguments):
    """Errors of f, over that of the true parameters."""
    table = []
    for seed in range(arguments.draws):
        X, y, new, f, by_truth = _draw(seed)
        options = {"task_levels": False, "normalize_y": False, "noise": "shared"}
        two = MultiTaskGPRegressor([None, None], rank=1, **options).fit(X, y)
        one = MultiTaskGPRegressor(rank=N_TASKS, **options).fit(X, y)
        found = [by_truth, two.predict(new), one.predict(new)]
        errors = [np.square(mean - f).mean() for mean in found]
        table.append([*errors, _bic(two), _bic(one)])
        of_truth, of_two, of_one = errors
        print(
            f"draw {seed}: two terms {of_two / of_truth:.2f} times the error of the "
            f"truth, one term {of_one / of_truth:.2f}; BIC {_bic(two):.1f}, "
            f"{_bic(one):.1f}"
        )
    of_truth, of_two, of_one = np.mean(table, axis=0)[:3]
    print(f"in all: {of_two / of_truth:.2f}, {of_one / of_truth:.2f}")


def _draw(seed):
    """Rows, targets, where to predict, f there, and its mean by the true parameters."""
    rng = np.random.default_rng(seed)
    n, n_new = N_TASKS * 200, 150
    x = rng.uniform(0.0, 10.0, n)
    x = np.append(x, np.repeat(np.linspace(0.1, 9.9, n_new), N_TASKS))[:, None]
    tasks = np.append(np.arange(n), np.arange(N_TASKS * n_new)) % N_TASKS
    K = 0.0
    for size, length_scale in ((1.0, 2.5), (0.7, 0.3)):
        F = size * rng.standard_normal(N_TASKS)
        K = K + np.outer(F, F)[np.ix_(tasks, tasks)] * RBF(length_scale)(x)
    root = np.linalg.cholesky(K + 1e-8 * np.eye(len(K)))
    f = root @ rng.standard_normal(len(K))
    y = f[:n] + NOISE * rng.standard_normal(n)
    by_truth = K[n:, :n] @ np.linalg.solve(K[:n, :n] + NOISE**2 * np.eye(n), y)
    X = np.column_stack([x, tasks])
    return X[:n], y, X[n:], f[n:], by_truth


def jura(arguments):
    """Cadmium at 100 sites, from logarithms."""
    if arguments.data is None:
        print("left out: --data FOLDER, with jura/jura.csv, is not given")
        return
    X, y, new, truth = levels_data.jura(arguments.data, logarithms=True)
    of_tasks = y.groupby(X["task"])
    z = (y - of_tasks.transform("mean")) / of_tasks.transform("std", ddof=0)
    mean, deviation = of_tasks.mean()["Cd"], of_tasks.std(ddof=0)["Cd"]
    options = {"task_levels": False, "normalize_y": False, "noise": "per_task"}
    for name, (n_terms, rank) in MODELS.items():
        model = MultiTaskGPRegressor(
            [None] * n_terms, rank=rank, task_feature="task", **options
        )
        begin = perf_counter()
        model.fit(X, z)
        seconds = perf_counter() - begin
        found = np.exp(mean + deviation * model.predict(new))
        print(
            f"{name:18s}: log likelihood {model.log_marginal_likelihood_value_:7.1f}, "
            f"BIC {_bic(model):6.1f}, error {np.abs(found - truth).mean():.4f}, "
            f"{seconds:5.1f} s, {model.n_evaluations_} evaluations"
        )


def _bic(model):
    deviance = -2.0 * model.log_marginal_likelihood_value_
    return deviance + model.n_hyperparameters_ * np.log(len(model.y_train_))


SECTIONS = {part.__name__: part for part in (cost, drawn, jura)}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="folder with jura/jura.csv")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=[*SECTIONS])
    parser.add_argument("--draws", type=int, default=10)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    for name in arguments.only:
        print(f"\n{name}")
        SECTIONS[name](arguments)
