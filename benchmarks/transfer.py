"""Whether TransferDisplay finds an unrelated task among related ones.

Problems are drawn at random: tasks that are mixtures of one or two functions, drawn
from a Gaussian process on an interval of length 6, or on a square or cube, with
length-scale 1 times the square root of the number of inputs, each with a level, and
noise of a fifth of the deviation of the functions. One task more is another function,
drawn alike. RankSearchIC learns all of them. Printed are, for each number of
rows of a task and each rank of the related tasks, how many of the unrelated tasks, and
how many of the related ones, are "not related" by the frame's `related`, "harmed" or
"helped" by its verdict, or either of the first two.

``python benchmarks/transfer.py --draws 40 --rows 20 --ranks 1``
"""

import argparse
import time
import warnings

import matplotlib.pyplot
import numpy as np
import pandas as pd
from sklearn.gaussian_process.kernels import RBF
from threadpoolctl import threadpool_limits

from skmtgp import RankSearchIC
from skmtgp.inspection import TransferDisplay

NOISE, LENGTH = 0.2, 6.0


def functions(x, n, rng):
    """Draws of n functions at x."""
    K = RBF(np.sqrt(x.shape[1]))(x) + 1e-9 * np.eye(len(x))
    return np.linalg.cholesky(K) @ rng.standard_normal((len(x), n))


def draw(seed, n_tasks, rows, rank, inputs):
    """X and y of related tasks and of one that is not: the last."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(n_tasks), rows)
    x = rng.uniform(0.0, LENGTH, (len(task), inputs))
    weights = rng.normal(size=(n_tasks, rank))
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    weights *= rng.uniform(0.7, 1.4, (n_tasks, 1))
    y = np.einsum("nr,nr->n", functions(x, rank, rng), weights[task])
    last = task == n_tasks - 1
    y[last] = functions(x[last], 1, rng)[:, 0]
    y += rng.normal(size=n_tasks)[task] + NOISE * rng.standard_normal(len(y))
    return np.column_stack([x, task]), y


def transfer(seed, **design):
    """The frame of one draw, with the seconds that learning and comparing took."""
    begin = time.perf_counter()
    search = RankSearchIC().fit(*draw(seed, **design))
    learned = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = TransferDisplay.from_estimator(search).transfer
    matplotlib.pyplot.close("all")
    seconds = {"learning": learned - begin, "comparing": time.perf_counter() - learned}
    return table.assign(seed=seed, rank=search.best_rank_, **seconds)


def rates(table):
    """Shares of tasks, of those that are related and of the one that is not."""
    flags = {
        "not related": ~table["related"],
        "harmed": table["verdict"] == "harmed",
        "either": ~table["related"] | (table["verdict"] == "harmed"),
        "helped": table["verdict"] == "helped",
    }
    odd = table.index == table.index.max()
    return {
        f"{name}, {kind}": 100.0 * flag[rows].mean()
        for name, flag in flags.items()
        for kind, rows in (("unrelated", odd), ("related", ~odd))
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first draw")
    parser.add_argument("--tasks", type=int, default=8)
    parser.add_argument("--rows", type=int, nargs="+", default=[12, 20, 40])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--inputs", type=int, default=1)
    parser.add_argument("--csv", help="where to write the frames of all draws")
    arguments = parser.parse_args()
    matplotlib.use("Agg")
    warnings.simplefilter("ignore")
    kept = []
    for rank in arguments.ranks:
        for rows in arguments.rows:
            design = {"n_tasks": arguments.tasks, "rows": rows, "rank": rank}
            design["inputs"] = arguments.inputs
            seeds = range(arguments.first, arguments.first + arguments.draws)
            with threadpool_limits(1):
                table = pd.concat([transfer(seed, **design) for seed in seeds])
            kept.append(table.assign(design=str(design)))
            chosen = table.groupby("seed")["rank"].first().value_counts().to_dict()
            seconds = table.groupby("seed")[["learning", "comparing"]].first().median()
            print(f"\n{design}, {len(seeds)} draws, ranks chosen {chosen}")
            print(f"seconds: {seconds.round(1).to_dict()}")
            for name, share in rates(table).items():
                print(f"{name:24} {share:5.1f} %", flush=True)
            if arguments.csv:
                pd.concat(kept).to_csv(arguments.csv)


if __name__ == "__main__":
    main()
