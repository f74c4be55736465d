"""Models of a robot side by side: least squares on its links, processes, and both.

``python benchmarks/robots.py --data FOLDER --output robots.jsonl`` learns each case and
draw with each model, and keeps a line for each joint and test set: nMSE (within the
load, averaged over loads), the log density of an observation relative to that of a
normal distribution with the mean and variance of the training targets (MSLL, the lower
the better), the share of observations in 95 % intervals, seconds of the fit of all
joints. What is in the file is not run again. ``--report`` prints the tables; "near" is
at how many joints a model is within 10 % of every other one, on the draws of both.

The cases: the Puma 560 with the friction that least squares knows ("puma") and with
friction that is larger where a joint begins to move and under load ("puma-stribeck"); a
Kinova Gen3; and, if `--data` has a folder "ur10e" with its recordings, a UR10e.
"""

import argparse
import json
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from robots_data import cases
from robots_models import MODELS, VARIANTS

from skmtgp.metrics import (
    coverage,
    mean_standardized_log_loss,
    normalized_mean_squared_error,
)

KEYS = ["case", "draw", "model"]
ORDER = "puma", "puma-stribeck", "ur10e", "ur10e-third", "kinova", "kinova-one"
ONE_LOAD, SAME_AS_POOLED = ("kinova", "kinova-one"), ("iGP", "sGP", "mGP paper")
NEAR = 1.1  # times the error of the best model
ROUNDING = 1e-20  # an nMSE below it is exact
UNKNOWN = 1e3  # deviations of the torque, for what least squares knows nothing of


def measure(case, name):
    """A row for each test set and joint."""
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of fits that end for lack of digits, say
        predict = MODELS[name](case)
    seconds = round(time.perf_counter() - begin, 2)
    for test, (X, Y) in case.tests.items():
        mean, std = predict(X)
        for j in range(Y.shape[1]):
            scores = score(Y[:, j], mean[:, j], std[:, j], X[:, -1], case.Y[:, j])
            yield {"test": test, "joint": j + 1, "seconds": seconds, **scores}


def score(y, mean, std, tasks, y_train):
    """Errors, averaged over the loads."""
    std = np.clip(std, 1e-150, UNKNOWN * np.std(y_train))
    return {
        "nmse": float(normalized_mean_squared_error(y, mean, tasks=tasks)),
        "msll": float(
            mean_standardized_log_loss(y, mean, std, y_train=y_train, tasks=tasks)
        ),
        "coverage": float(coverage(y, mean, std, level=0.95, tasks=tasks)),
    }


def read(path):
    """The rows of a file."""
    return pd.read_json(path, lines=True) if path.exists() else pd.DataFrame()


def run(arguments):
    """Measure what the file does not have."""
    known = read(arguments.output)
    done = set(map(tuple, known[KEYS].to_numpy().tolist())) if len(known) else set()
    makers = cases(arguments.data, arguments.data_home)
    for draw in arguments.draws:
        for of in arguments.cases or [name for name in ORDER if name in makers]:
            wanted = [m for m in arguments.models if (of, draw, m) not in done]
            names = [m for m in wanted if of not in ONE_LOAD or m not in SAME_AS_POOLED]
            case = makers[of](draw) if names else None
            for name in names:
                rows = [
                    {"case": of, "draw": draw, "model": name, **row}
                    for row in measure(case, name)
                ]
                with arguments.output.open("a") as file:
                    file.write("".join(json.dumps(row) + "\n" for row in rows))
                print(of, draw, name, rows[0]["seconds"], flush=True)


def report(table, *, markdown=False):
    """Print the tables of each case and test."""
    for of in [name for name in ORDER if name in set(table["case"])]:
        here = table[table["case"] == of]
        for test in here["test"].unique():
            frame = summarise(here[here["test"] == test])
            n = here["draw"].nunique()
            title = f"{of}, {test}: nMSE, geometric means of {n} draw{'s' * (n > 1)}"
            print(f"\n**{title}**\n\n{pipes(frame)}" if markdown else f"\n{title}")
            print("" if markdown else frame.to_string(index_names=False))


def summarise(table):
    """Geometric means over the draws, by model and joint, as text."""
    order = [name for name in MODELS if name in set(table["model"])]
    logs = table.assign(nmse=np.log(np.maximum(table["nmse"], ROUNDING)))
    of_model, joints = logs.groupby("model"), table["joint"].unique()
    errors = np.exp(logs.groupby(["model", "joint"])["nmse"].mean().unstack())
    columns = {
        **{f"joint {j}": errors[j].map("{:.2g}".format) for j in joints},
        "mean": np.exp(of_model["nmse"].mean()).map("{:.2g}".format),
        "near": pd.Series({name: near_the_best(logs, name) for name in order}),
        "msll": of_model["msll"].mean().map("{:.2f}".format),
        "cover": of_model["coverage"].mean().map("{:.2f}".format),
        "seconds": of_model["seconds"].median().map("{:.1f}".format),
        "draws": of_model["draw"].nunique(),
    }
    return pd.DataFrame(columns).loc[order]


def near_the_best(logs, name):
    """At how many joints it is within 10 % of each other model, on common draws."""
    wide = logs.pivot(index=["joint", "draw"], columns="model", values="nmse")
    others = wide.drop(columns=[*VARIANTS, name], errors="ignore")
    behind = others.rsub(wide[name], axis=0).groupby("joint").mean().max(axis=1)
    return int((behind <= np.log(NEAR)).sum())


def pipes(frame):
    """A table in Markdown."""
    heads = ["model", *frame.columns]
    lines = [heads, ["---"] + ["--:"] * (len(heads) - 1)]
    lines += [[name, *map(str, row)] for name, row in frame.T.items()]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main():
    """Measure, or print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add, default = parser.add_argument, Path(__file__).parent / "results/robots.jsonl"
    add("--output", type=Path, default=default, help="the file of the rows")
    add("--report", action="store_true", help="print what is measured")
    add("--markdown", action="store_true", help="the same as tables for the page")
    add("--data", type=Path, help="folder that has a folder ur10e")
    add("--data-home", type=Path, help="scikit-learn's data home, for the Kinova")
    add("--cases", nargs="+", choices=ORDER, help="all that there are data for")
    add("--models", nargs="+", choices=MODELS, default=list(MODELS))
    add("--draws", nargs="+", type=int, default=list(range(5)))
    arguments = parser.parse_args()
    if not (arguments.report or arguments.markdown):
        run(arguments)
    report(read(arguments.output), markdown=arguments.markdown)


if __name__ == "__main__":
    main()
