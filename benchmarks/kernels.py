"""Kernels of inverse dynamics side by side: the Puma 560, 20 samples of each load.

``python benchmarks/kernels.py --output kernels.jsonl`` learns each joint with each
kernel and each rank, from 14 loads of three draws, and keeps a line for each: the log
marginal likelihood (targets of unit variance), nMSE on interpolation and extrapolation
sets, the noise variance, seconds of the whole search. "joint" is the geometric kernel
that knows whose torque it learns. What is in the file is not run again. ``--report``
prints the tables: BIC, eq. 8, chooses one rank for all joints of a draw and kernel.
"""

import argparse
import json
import time
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
from settings import PAPER
from sklearn.pipeline import make_pipeline

from skmtgp import (
    MultiTaskGPRegressor,
    RankSearchIC,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import fetch_puma560
from skmtgp.metrics import normalized_mean_squared_error

LOADS, N_PER_LOAD = range(1, 15), 20
KERNELS = "paper", "trigonometric", "geometric", "joint"
RANKS = 2, 4, 5, 6, 8, 10
TEST_SETS = "interpolation", "extrapolation"
KEYS = ["kernel", "draw", "joint"]


@lru_cache(maxsize=3)
def rows(draw, subset, n_per_load):
    """Joint states with the load, and torques of the six joints."""
    options = {"loads": LOADS, "random_state": draw, "return_X_y": True}
    return fetch_puma560(subset=subset, n_per_load=n_per_load, **options)


def measure(kernel, draw, joint, ranks, n_test):
    """A row for each rank."""
    X, torque = rows(draw, "train", N_PER_LOAD)
    begin = time.perf_counter()
    model = MultiTaskGPRegressor(**PAPER)
    search = RankSearchIC(model, ranks=ranks, simpler=False, keep_estimators=True)
    options = {"joint": joint - 1} if kernel == "joint" else {}
    name = "geometric" if kernel == "joint" else kernel
    pipeline = make_inverse_dynamics_regressor(search, kernel=name, **options)
    pipeline.fit(X, torque[:, joint - 1])
    common = {"kernel": kernel, "draw": draw, "joint": joint, "n_test": n_test}
    common["seconds"] = round(time.perf_counter() - begin, 1)
    for model in pipeline[-1].estimators_:
        yield common | describe(model) | errors(pipeline[0], model, draw, joint, n_test)


def describe(model):
    """What was learned."""
    n, scale = len(model.X_train_), float(model.y_scale_)
    likelihood = model.log_marginal_likelihood_value_
    return {
        "rank": int(model.rank_),
        "log_marginal_likelihood": float(likelihood + n * np.log(scale)),
        "n_hyperparameters": int(model.n_hyperparameters_),
        "noise_variance": float(model.noise_variance_ / scale**2),
        "n_evaluations": int(model.n_evaluations_),
    }


def errors(features, model, draw, joint, n_test):
    """NMSE on each test set, averaged over the loads."""
    found, pipeline = {}, make_pipeline(features, model)
    for subset in TEST_SETS:
        X, torque = rows(draw, subset, n_test)
        error = normalized_mean_squared_error(
            torque[:, joint - 1], pipeline.predict(X), tasks=X[:, -1]
        )
        found[f"nmse_{subset}"] = float(error)
    return found


def read(path):
    """The rows of a file."""
    return pd.read_json(path, lines=True) if path.exists() else pd.DataFrame()


def run(arguments):
    """Measure what the file does not have."""
    known = read(arguments.output)
    done = set(map(tuple, known[KEYS].to_numpy().tolist())) if len(known) else set()
    plan = [
        (kernel, draw, joint)
        for draw in arguments.draws
        for kernel in arguments.kernels
        for joint in arguments.joints
        if (kernel, draw, joint) not in done
    ]
    for case in plan:
        measured = list(measure(*case, arguments.ranks, arguments.n_test))
        with arguments.output.open("a") as file:
            file.writelines(json.dumps(row) + "\n" for row in measured)
        print(*case, f"{measured[0]['seconds']:.0f} s", flush=True)


def chosen(of_case):
    """The rows of the rank that BIC, eq. 8, chooses for all joints of a draw."""
    n = 14 * N_PER_LOAD * of_case["joint"].nunique()
    groups = of_case.groupby("rank")
    sums = groups[["log_marginal_likelihood", "n_hyperparameters"]].sum()
    sums = sums[groups["joint"].nunique() == of_case["joint"].nunique()]
    deviance = -2.0 * sums["log_marginal_likelihood"]
    bic = deviance + sums["n_hyperparameters"] * np.log(n)
    return of_case[of_case["rank"] == bic.idxmin()]


def report(table):
    """Print each draw, and the medians over draws."""
    cases = table.groupby(["kernel", "draw"])
    best = pd.concat([chosen(of_case) for _, of_case in cases])
    columns = ["rank", "log_marginal_likelihood", "noise_variance", "seconds"]
    columns += [f"nmse_{subset}" for subset in TEST_SETS]
    nats = {"log_marginal_likelihood": "{:.1f}".format}
    show = partial(
        pd.DataFrame.to_string, float_format="{:.3g}".format, formatters=nats
    )
    order = ["kernel", "joint", "draw"]
    print(show(best.set_index(order).sort_index()[columns]))
    for column in columns[1:2] + columns[3:]:
        medians = best.pivot_table(
            index="kernel", columns="joint", values=column, aggfunc="median"
        )
        print(f"\nMedian over {best['draw'].nunique()} draws by joint: {column}")
        medians = medians.reindex([k for k in KERNELS if k in medians.index])
        digits = "{:.1f}" if column in nats else "{:.2g}"
        print(medians.to_string(float_format=digits.format))


def main():
    """Measure, or print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add, default = parser.add_argument, Path(__file__).parent / "results/kernels.jsonl"
    add("--output", type=Path, default=default, help="the file of the rows")
    add("--report", action="store_true", help="print what is measured")
    add("--kernels", nargs="+", default=KERNELS)
    add("--draws", nargs="+", type=int, default=[0, 1, 2])
    add("--joints", nargs="+", type=int, default=range(1, 7))
    add("--ranks", nargs="+", type=int, default=RANKS)
    add("--n-test", type=int, default=4000, help="rows of each load and test set")
    arguments = parser.parse_args()
    if not arguments.report:
        run(arguments)
    report(read(arguments.output))


if __name__ == "__main__":
    main()
