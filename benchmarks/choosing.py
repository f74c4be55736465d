"""Criteria that choose among the candidates of RankSearchIC, side by side.

``python benchmarks/choosing.py`` draws problems of eight tasks of 5, 10 and 20 rows
(true rank 1 and 2) and of three tasks of 10 and 20 rows (true rank 3), by
ordinary_data.py; ``--classes`` takes classes of it instead, and ``--plain 10 20`` draws
of intervals.py, without levels, of so many rows a task. All candidates are fitted once.
Each criterion then chooses: how often the true rank, and how well what it has chosen
predicts. "density" is the log density of new observations a row, less that of
the best candidate in hindsight; the rows of a table are medians over the draws.

"laplace" is the evidence by Laplace's method, see skmtgp/learning/evidence.py. "auto",
the default, asks it and BIC, see :func:`skmtgp.learning.weighing.preferred`. At the
end each criterion is compared with BIC, draw by draw: the mean difference of the
density, with losses above five counted as five, and its interval by the bootstrap.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from zlib import crc32

import numpy as np
import pandas as pd
from intervals import NOISE, draw_with_factor
from ordinary_data import BASE, CLASSES, Problem, Truth, draw, problem, split
from ordinary_models import is_right
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from skmtgp import RankSearchIC

SETTINGS = {
    f"{M} tasks of {rows}, rank {rank}": {"n_tasks": M, "rows": rows, "rank": rank}
    for M, sizes, ranks in [(8, (5, 10, 20), (1, 2)), (3, (10, 20), (3,))]
    for rank in ranks
    for rows in sizes
}
PLAIN = {
    f"plain, 8 tasks of {rows}, rank {rank}": (8, rows, rank)
    for rows in (10, 20, 50)
    for rank in (1, 2, 3)
}
SAME, MOST = 0.01, 5.0  # nats a row: no difference, and the largest that counts
CRITERIA = "bic", "aic", "hqc", "loo", "laplace", "auto"


def problem_of(name, seed):
    """A draw of a setting, or of a class of the suite."""
    if name in CLASSES:
        return problem(name, seed)
    if name in PLAIN:
        return plain(*PLAIN[name], seed)
    rng = np.random.default_rng([crc32(name.encode()), seed])
    settings = {**BASE, **SETTINGS[name], "n_inputs": int(rng.integers(1, 3))}
    return draw(rng, **settings)


def plain(n_tasks, n_rows, rank, seed):
    """A draw of intervals.py."""
    X, y, X_test, _, f, F = draw_with_factor(n_tasks, n_rows, rank, seed)
    nothing = np.zeros(n_tasks)
    truth = Truth(F, np.ones((rank, 1)), nothing, nothing, nothing + NOISE)
    return Problem(X, y, X_test, f, truth, rank)


def leave_out(model, y):
    """-2 log density of each row given the others, summed."""
    mean, std = model.loo_predict(include_noise=True)
    return -2.0 * norm.logpdf(y, mean, std).sum()


def measured(job):
    """A frame of the candidates of a problem: criteria, and how they predict."""
    name, seed = job
    drawn = problem_of(name, seed)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = RankSearchIC(criterion="laplace", keep_estimators=True)
        search.fit(drawn.X, drawn.y)
        table = search.results_.assign(setting=name, seed=seed)
        table["loo"] = [leave_out(model, drawn.y) for model in search.estimators_]
        found = [predicted(model, drawn) for model in search.estimators_]
        best = RankSearchIC().fit(drawn.X, drawn.y).best_model_
    table["density"], table["error"] = zip(*found, strict=True)
    assert best in table["model"].to_numpy()
    table["auto"] = (table["model"] != best).astype(int)
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


def compare(table):
    """Print what each criterion gains on BIC, draw by draw."""
    density = {name: choices(table, name)["density"] for name in CRITERIA}
    rng, rows = np.random.default_rng(0), {}
    for name in CRITERIA[1:]:
        gain = (density[name] - density["bic"]).to_numpy()
        cut = density[name].clip(lower=-MOST) - density["bic"].clip(lower=-MOST)
        drawn = cut.to_numpy()[rng.integers(0, len(cut), (10_000, len(cut)))]
        low, high = np.quantile(drawn.mean(axis=1), [0.025, 0.975])
        rows[name] = {
            "gain": cut.mean(),
            "from": low,
            "to": high,
            "better": int((gain > SAME).sum()),
            "worse": int((gain < -SAME).sum()),
            "draws": len(gain),
        }
    print("\nLog density of new rows, gain on BIC, losses above 5 counted as 5\n")
    print(pd.DataFrame.from_dict(rows, orient="index").to_string(float_format="%.3f"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=None)
    parser.add_argument(
        "--plain", nargs="+", type=int, choices=(10, 20, 50), default=()
    )
    parser.add_argument("--seeds", type=int, default=40, help="draws of each")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--output", help="a table of all candidates, csv")
    arguments = parser.parse_args()
    names = [name for name, of in PLAIN.items() if of[1] in arguments.plain]
    names = names + (arguments.classes or []) or list(SETTINGS)
    jobs = [(name, seed) for name in names for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        table = pd.concat(list(pool.map(measured, jobs)), ignore_index=True)
    if arguments.output:
        table.to_csv(arguments.output, index=False)
    report(table)
    compare(table)


if __name__ == "__main__":
    main()
