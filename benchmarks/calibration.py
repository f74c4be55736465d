"""Simulation-based calibration of the draws of hyperparameters.

``python benchmarks/calibration.py`` draws hyperparameters from their weak priors, data
from the model with them, and then hyperparameters from the posterior of those data. If
these are drawn rightly, the true ones have uniform ranks among them (Talts et al.,
2018). A table has the shares of ranks in each fifth for each quantity that rotations of
the factor do not change, and the p-value of Pearson's test of uniformity; the smallest
of so many is as often below 5 % as their number says.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.stats import chisquare
from sklearn.gaussian_process.kernels import RBF
from threadpoolctl import threadpool_limits

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.learning.sampling import quantities, sample_hyperparameters
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank

N_TASKS, N_BINS = 3, 5


def names_of(features):
    """The quantities of `quantities`, with so many length-scales."""
    pairs = combinations(range(N_TASKS), 2)
    return [
        *(f"log length-scale {d}" for d in range(features)),
        "log level variance",
        "log noise variance",
        *(f"log deviation of task {m}" for m in range(N_TASKS)),
        *(f"correlation of tasks {a}, {b}" for a, b in pairs),
    ]


def share_below(n_rows, rank, features, n_draws, seed):
    """Share of the draws that lie below the true quantities, of one data set."""
    rng = np.random.default_rng(seed)
    prior = Prior(RBF(np.ones(features)), low_rank(N_TASKS, rank), levels=True)
    theta = Hyperprior(prior).draw(rng)
    tasks = np.repeat(np.arange(N_TASKS), n_rows)
    X = rng.uniform(0.0, 6.0, (len(tasks), features))
    K = prior.covariance(theta, X, tasks)
    K.flat[:: len(K) + 1] += prior.values(theta).noise[0]
    values, vectors = np.linalg.eigh(K)
    y = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(K)))
    likelihood = DenseLikelihood(prior, X, tasks, y)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = [(likelihood, Hyperprior(prior).draw(rng, 0.1))]
        drawn = sample_hyperparameters(start, n_draws=n_draws, seed=[seed])
    true = quantities(prior, theta)
    found = np.array([quantities(prior, draw) for draw in drawn.theta])
    # a tie, as of correlations of rank 1, falls on either side
    below = (found < true) + 0.5 * (np.abs(found - true) < 1e-9)
    return below.mean(axis=0)


def main():
    """Run it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200, help="data sets")
    parser.add_argument("--rows", type=int, default=6, help="of each task")
    parser.add_argument("--rank", type=int, default=1, help="of the task covariance")
    parser.add_argument("--features", type=int, default=1, help="with a length-scale")
    parser.add_argument("--n-draws", type=int, default=40, help="of each posterior")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    of = partial(share_below, args.rows, args.rank, args.features, args.n_draws)
    with ProcessPoolExecutor(args.jobs) as pool:
        shares = np.array(list(pool.map(of, range(args.seeds))))
    rows = {}
    for name, of_quantity in zip(names_of(args.features), shares.T, strict=True):
        if "correlation" in name and args.rank == 1:  # 1 or -1
            continue
        counts, _ = np.histogram(of_quantity, N_BINS, (0.0, 1.0))
        rows[name] = [*(counts / len(shares)), chisquare(counts).pvalue]
    fifths = [f"fifth {k + 1}" for k in range(N_BINS)]
    table = pd.DataFrame(rows, index=[*fifths, "p"]).T
    print(
        f"{len(shares)} data sets of {N_TASKS} tasks of {args.rows} rows, "
        f"{args.features} feature(s), rank {args.rank}"
    )
    print(table.round(3).to_string())


if __name__ == "__main__":
    main()
