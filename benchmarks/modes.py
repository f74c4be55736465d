"""Learn as the paper has it, and print how far the modes are below the best known.

``python benchmarks/modes.py search`` looks for the best mode of each joint and rank
from many starts and appends what it found to ``benchmarks/results/best_modes.csv``.
``python benchmarks/modes.py`` learns a RankSearchIC of all joints and a fit of rank 4
for each, and prints what is missing. ``python benchmarks/modes.py orders`` fits rank 4
to the same rows in other orders, which changes rounding alone. The data: 20 samples of
each of 14 loads of the Puma 560, the paper's kernel, no levels.
"""

import argparse
import csv
import time
from datetime import date
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
from settings import PAPER
from threadpoolctl import threadpool_limits

from skmtgp import (
    MultiTaskGPRegressor,
    RankSearchIC,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import load_puma560

RANKS = (2, 4, 5, 6, 8, 10)
RESULTS = Path(__file__).parent / "results"
COLUMNS = ["date", "skmtgp", "random_state", "starts", "joint", "rank", "likelihood"]


def load(n_per_load):
    """Joint states with the load, and torques of the six joints."""
    return load_puma560(loads=range(1, 15), n_per_load=n_per_load, return_X_y=True)


def fit(model, X, y):
    """The fitted estimator and the seconds that it took."""
    begin = time.perf_counter()
    model = make_inverse_dynamics_regressor(model).fit(X, y)
    return model[-1], time.perf_counter() - begin


def by_joint(search):
    """Log marginal likelihoods of a search, of shape (n_ranks, n_joints), scaled."""
    columns = [name for name in search.results_ if name.startswith("output")]
    model, values = search.best_estimator_, [search.results_[c] for c in columns]
    n = len(model.X_train_)
    return np.transpose(values) + n * np.log(model.y_scale_)


def search(arguments):
    """Learn from many starts, and append the likelihoods to the file."""
    X, y = load(20)
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "best_modes.csv"
    for seed in range(arguments.first, arguments.first + arguments.rounds):
        model = MultiTaskGPRegressor(
            n_restarts_optimizer=arguments.starts, random_state=seed, **PAPER
        )
        model, seconds = fit(RankSearchIC(model, ranks=RANKS, n_jobs=2), X, y)
        is_new = not path.exists()
        with path.open("a", newline="") as file:
            writer = csv.writer(file)
            if is_new:
                writer.writerow(COLUMNS)
            for rank, values in zip(RANKS, by_joint(model), strict=True):
                for joint, value in enumerate(values, 1):
                    writer.writerow(
                        [
                            date.today(),
                            version("skmtgp"),
                            seed,
                            2 + arguments.starts,
                            joint,
                            rank,
                            f"{value:.2f}",
                        ]
                    )
        print(f"random_state {seed}: {seconds:.0f} s", flush=True)
    print_best(best_known())


def best_known():
    """The highest likelihoods of the file, ranks by joints."""
    table = pd.read_csv(RESULTS / "best_modes.csv")
    return table.pivot_table(
        index="rank", columns="joint", values="likelihood", aggfunc="max"
    )


def print_best(best):
    """Print them."""
    print("\nBest known log marginal likelihood, nats (targets of unit variance)")
    print(best.to_string(float_format="{:.1f}".format))


def check(arguments):
    """Learn, and print what is missing."""
    X, y = load(20)
    best, model = best_known(), MultiTaskGPRegressor(**PAPER)
    print_best(best)
    model, seconds = fit(RankSearchIC(model, ranks=RANKS, n_jobs=2), X, y)
    found = pd.DataFrame(by_joint(model), best.index, best.columns)
    print(f"\nRankSearchIC, two processes: {seconds:.0f} s; nats below the best known")
    print((best - found).to_string(float_format="{:.1f}".format))
    print(f"Smallest gain from a rank to the next: {found.diff().min().min():.2f}")
    print("\nRank 4 alone, one core: joint, seconds, nats below the best known")
    with threadpool_limits(1):
        for joint in best.columns:
            model, seconds = fit(
                MultiTaskGPRegressor(rank=4, **PAPER), X, y[:, joint - 1]
            )
            value = model.log_marginal_likelihood_value_
            value += len(X) * np.log(model.y_scale_)
            below = best.loc[4, joint] - value
            print(f"{joint} {seconds:6.1f} {below:6.1f}", flush=True)


def orders(arguments):
    """Learn rank 4 alone from the rows in several orders; print what is missing."""
    X, y = load(20)
    best = best_known()
    print("Rank 4 alone, by the order of the rows: nats below the best known, sorted")
    for joint in best.columns:
        below = []
        for seed in range(arguments.orders):
            order = np.random.default_rng(seed).permutation(len(X))
            model = MultiTaskGPRegressor(rank=4, **PAPER)
            model, _ = fit(model, X[order], y[order, joint - 1])
            value = model.log_marginal_likelihood_value_
            below.append(best.loc[4, joint] - value - len(X) * np.log(model.y_scale_))
        print(joint, *(f"{nats:6.1f}" for nats in sorted(below)), flush=True)


def main():
    """Search, check, or learn in other orders."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.set_defaults(run=check)
    commands = parser.add_subparsers()
    command = commands.add_parser("search")
    command.add_argument("--rounds", type=int, default=4)
    command.add_argument("--first", type=int, default=0, help="first random_state")
    command.add_argument("--starts", type=int, default=4, help="additional ones")
    command.set_defaults(run=search)
    command = commands.add_parser("orders")
    command.set_defaults(run=orders)
    command.add_argument("--orders", type=int, default=6)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
