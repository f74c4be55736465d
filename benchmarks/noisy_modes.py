"""Fit noisy data with the defaults, and print how far the modes are below the best.

The best is the best of what the defaults, of the same and of lower rank, and a fit with
``n_restarts_optimizer=4`` find. The data are small, of eight kinds:

- "levels": sites of very different means, beside which a common sine is small;
- "gp": draws from the model, rank 2, with little, some and much noise;
- "trend": the same beside a steep trend that all tasks share;
- "wide": draws of rank 3 for 8 tasks with 12 samples of 4 features each.

Each comes with several seeds and is learned at rank 1, 2, 3 and at full rank. The last
columns are the evaluations of a fit, and of one with more starts.
"""

import argparse
import time
import warnings

import numpy as np
import pandas as pd
from sklearn.exceptions import ConvergenceWarning

from skmtgp import MultiTaskGPRegressor
from skmtgp.exceptions import JitterWarning, PrecisionWarning

LIMITS = 0.5, 5.0, 50.0  # nats
SITES = np.array([10, 35, 22, 80, 55, 41])
AMPLITUDES = np.array([1.0, 0.9, 1.1, 1.2, 0.8, 1.0])


def levels(seed, scale):
    """Six sites, 30 samples each: a level, and a sine with noise of 0.05."""
    rng = np.random.default_rng(seed)
    site, x = np.repeat(np.arange(6), 30), rng.uniform(0.0, 6.0, 180)
    y = scale * SITES[site] + AMPLITUDES[site] * np.sin(x)
    return np.column_stack([x, site]), y + 0.05 * rng.standard_normal(180)


def draw(seed, noise, *, d=2, n_tasks=5, per_task=25, rank=2, trend=0.0):
    """A draw from the model with a squared exponential of random length-scales."""
    rng = np.random.default_rng(100 + seed)
    n, task = n_tasks * per_task, np.repeat(np.arange(n_tasks), per_task)
    X = rng.uniform(-2.0, 2.0, (n, d))
    Z = X / np.exp(rng.uniform(-0.7, 1.0, d))
    K_x = np.exp(-0.5 * np.square(Z[:, None] - Z).sum(axis=-1))
    F = rng.standard_normal((n_tasks, rank))
    K = (F @ F.T)[np.ix_(task, task)] * K_x + 1e-10 * np.eye(n)
    y = np.linalg.cholesky(K) @ rng.standard_normal(n)
    y += noise * rng.standard_normal(n) + trend * X[:, 0]
    return np.column_stack([X, task]), y


KINDS = {
    "levels, 0.1": lambda seed: levels(seed, 0.1),
    "levels, 1": lambda seed: levels(seed, 1.0),
    "levels, 5": lambda seed: levels(seed, 5.0),
    "gp, noise 0.001": lambda seed: draw(seed, 1e-3),
    "gp, noise 0.05": lambda seed: draw(seed, 0.05),
    "gp, noise 0.5": lambda seed: draw(seed, 0.5),
    "trend": lambda seed: draw(seed, 0.1, trend=20.0),
    "wide": lambda seed: draw(seed, 0.05, d=4, n_tasks=8, per_task=12, rank=3),
}


def fits(X, y, **params):
    """Likelihoods at each rank, and the evaluations of all."""
    ranks = (1, 2, 3, len(np.unique(X[:, -1])))
    models = [MultiTaskGPRegressor(rank=rank, **params).fit(X, y) for rank in ranks]
    values = np.array([model.log_marginal_likelihood_value_ for model in models])
    return values, sum(int(np.sum(model.n_evaluations_)) for model in models)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=7, help="of each kind of data")
    seeds = range(parser.parse_args().seeds)
    for kind in (ConvergenceWarning, JitterWarning, PrecisionWarning):
        warnings.simplefilter("ignore", kind)
    begin, rows = time.process_time(), []
    for name, make in KINDS.items():
        found = [fits(*make(seed)) for seed in seeds]
        more = [
            fits(*make(seed), n_restarts_optimizer=4, random_state=0) for seed in seeds
        ]
        default, best = (np.array([values for values, _ in of]) for of in (found, more))
        best = np.maximum.accumulate(np.maximum(best, default), axis=1)
        gap = best - default
        rows.append(
            {
                "data": name,
                "fits": gap.size,
                **{f"> {limit:g} nats": int((gap > limit).sum()) for limit in LIMITS},
                "largest": round(float(gap.max()), 1),
                "evaluations": sum(n for _, n in found) // gap.size,
                "more starts": sum(n for _, n in more) // gap.size,
            }
        )
    table = pd.DataFrame(rows).set_index("data")
    print("Fits that end below the best known likelihood, by how much\n")
    print(table.to_string())
    print(f"\nOf {table['fits'].sum()} fits:", end=" ")
    print(
        ", ".join(f"{table[f'> {limit:g} nats'].sum()} > {limit:g}" for limit in LIMITS)
    )
    print(f"{time.process_time() - begin:.0f} seconds of one core")


if __name__ == "__main__":
    main()
