"""Criteria that choose among the candidates of RankSearchIC, side by side.

``python benchmarks/choosing.py`` draws problems of eight tasks of 5, 10 and 20 rows
(true rank 1 and 2) and of three tasks of 10 and 20 rows (true rank 3), by
ordinary_data.py; ``--classes`` takes classes of it instead. All candidates are fitted
once. Each criterion then chooses: how often the true rank, and how well what it has
chosen predicts. "density" is the log density of new observations a row, less that of
the best candidate in hindsight; the rows of a table are medians over the draws.

"laplace" is the evidence by Laplace's method, see skmtgp/learning/evidence.py.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from zlib import crc32

import numpy as np
import pandas as pd
from ordinary_data import BASE, CLASSES, draw, problem, split
from ordinary_models import is_right
from threadpoolctl import threadpool_limits

from skmtgp import RankSearchIC
from skmtgp._estimators.fitted import evidence_of

SETTINGS = {
    f"{M} tasks of {rows}, rank {rank}": {"n_tasks": M, "rows": rows, "rank": rank}
    for M, sizes, ranks in [(8, (5, 10, 20), (1, 2)), (3, (10, 20), (3,))]
    for rank in ranks
    for rows in sizes
}
CRITERIA = "bic", "aic", "hqc", "loo", "laplace"


def problem_of(name, seed):
    """A draw of a setting, or of a class of the suite."""
    if name in CLASSES:
        return problem(name, seed)
    rng = np.random.default_rng([crc32(name.encode()), seed])
    settings = {**BASE, **SETTINGS[name], "n_inputs": int(rng.integers(1, 3))}
    return draw(rng, **settings)


def evidence(model):
    """The log evidence of a fitted model, in units of y."""
    return sum(map(evidence_of, getattr(model, "estimators_", [model])))


def measured(job):
    """A frame of the candidates of a problem: criteria, and how they predict."""
    name, seed = job
    drawn = problem_of(name, seed)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = RankSearchIC(criterion="loo", keep_estimators=True)
        search.fit(drawn.X, drawn.y)
        table = search.results_.assign(setting=name, seed=seed)
        table["laplace"] = [-2.0 * evidence(model) for model in search.estimators_]
        found = [predicted(model, drawn) for model in search.estimators_]
    table["density"], table["error"] = zip(*found, strict=True)
    table["right"] = [is_right(of, drawn) for of in table["model"]]
    return table


def predicted(model, drawn):
    """Log density of new observations a row, and the error of f over its size."""
    mean, std = model.predict(drawn.X_test, return_std=True, include_noise=True)
    tasks, f = split(drawn.X_test)[1], drawn.f_test
    squares = np.square(f - mean)
    expected = squares + np.square(drawn.truth.noise[tasks])
    density = -0.5 * (expected / std**2 + np.log(2.0 * np.pi * std**2))
    size = drawn.truth.size(drawn.X.shape[1] - 1)[tasks]
    return float(density.mean()), float((squares / size).mean())


def choices(table, criterion):
    """What a criterion has chosen of each problem, over the best in hindsight."""
    groups = table.groupby(["setting", "seed"], sort=False)
    chosen = table.loc[groups[criterion].idxmin()].set_index(["setting", "seed"])
    chosen["density"] -= groups["density"].max()
    chosen["error"] /= groups["error"].min()
    return chosen.reset_index()


def report(table):
    """Print a table for each measure: settings by criteria."""
    found = {name: choices(table, name) for name in CRITERIA}
    for title, column, how in [
        ("True model chosen, %", "right", lambda of: 100.0 * of.astype(float).mean()),
        (
            "Log density of new rows less the best candidate's, median",
            "density",
            "median",
        ),
        ("The same, mean", "density", "mean"),
        ("Error over the best candidate's, median", "error", "median"),
    ]:
        by = {
            name: of.groupby("setting", sort=False)[column].agg(how)
            for name, of in found.items()
        }
        print(f"\n{title}\n")
        frame = pd.DataFrame(by)
        frame.loc["ALL"] = {name: of[column].agg(how) for name, of in found.items()}
        print(frame.to_string(float_format="{:.3g}".format))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=None)
    parser.add_argument("--seeds", type=int, default=40, help="draws of each")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--output", help="a table of all candidates, csv")
    arguments = parser.parse_args()
    names = arguments.classes or list(SETTINGS)
    jobs = [(name, seed) for name in names for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        table = pd.concat(list(pool.map(measured, jobs)), ignore_index=True)
    if arguments.output:
        table.to_csv(arguments.output, index=False)
    report(table)


if __name__ == "__main__":
    main()
