"""The default on functions that mostly no kernel draws, of few and of many tasks.

``python benchmarks/formulas.py --draws 60 --output FILE.jsonl`` draws problems and fits
``MultiTaskGPRegressor()``, the same with the true rank, and the simpler models to each.
Each fit is a line of the file, written when it is known; what is there is not run
again. ``--report`` prints what files have, one table each.

A problem has 3 to 100 tasks of 5 to 40 rows, at most 700 in all, and one to five inputs
on [-2, 2], each of which matters with probability 0.7. Tasks mix one to three functions
with normal weights, beside levels. The functions are

- waves: sines of a sum of the inputs;
- sums of waves, one of each input;
- products of waves;
- polynomials of degree two;
- steps: tanh of four times a sum of the inputs;
- draws from a squared exponential with a length-scale of each input.

Noise has a deviation of 0.02 to 0.6 times that of the functions. "error" is the root
mean squared error over the deviation of the functions, levels aside. "/truth" is the
geometric mean of the default's over that of the true rank, "/best" over the best of the
three simpler models, and "worse" is the share of problems with a ratio above 1.1.
"coverage" is that of 95 % intervals of new measurements, "untold" the same where no
NarrowIntervalsWarning came, "s" the processor's seconds of a fit of the default.
"""

import argparse
import json
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp.exceptions import NarrowIntervalsWarning

N_TEST, MOST_ROWS = 1500, 700
TASKS, ROWS = (3, 5, 8, 15, 30, 60, 100), (5, 8, 12, 20, 40)
NOISE, LEVELS = (0.02, 0.1, 0.3, 0.6), (0.0, 1.0, 5.0)
FEATURES = 300  # random ones, whose sum is nearly a draw from a squared exponential
SIMPLER = {"IndependentGP": IndependentGP, "PooledGP": PooledGP, "single": SingleTaskGP}


def waves(rng, uses, k):
    slopes, phases = rng.standard_normal((k, len(uses))) * uses, rng.uniform(0, 6, k)
    return lambda x: np.sin(x @ slopes.T + phases)


def sums(rng, uses, k):
    each = _waves_of_each(rng, uses, k)
    return lambda x: (uses * np.sin(each(x))).sum(axis=2)


def products(rng, uses, k):
    each = _waves_of_each(rng, uses, k)
    return lambda x: np.where(uses, np.cos(each(x) / 2.0), 1.0).prod(axis=2)


def _waves_of_each(rng, uses, k):
    speeds = rng.uniform(1.0, 3.0, (k, len(uses)))
    phases = rng.uniform(0.0, 6.0, (k, len(uses)))
    return lambda x: speeds * x[:, None] + phases


def polynomials(rng, uses, k):
    slopes = rng.standard_normal((k, len(uses)))
    bends = rng.standard_normal((k, len(uses), len(uses)))

    def functions(x):
        x = x * uses
        return x @ slopes.T + 0.5 * np.einsum("nd,kde,ne->nk", x, bends, x)

    return functions


def steps(rng, uses, k):
    slopes, places = rng.standard_normal((k, len(uses))) * uses, rng.uniform(-1, 1, k)
    return lambda x: np.tanh(4.0 * (x @ slopes.T - places))


def draws(rng, uses, k):
    lengths = np.where(uses, rng.uniform(0.5, 2.0, len(uses)), np.inf)
    slopes = rng.standard_normal((k, FEATURES, len(uses))) / lengths
    phases = rng.uniform(0.0, 2.0 * np.pi, (k, FEATURES))
    weights = rng.standard_normal((k, FEATURES)) * np.sqrt(2.0 / FEATURES)
    of = list(zip(slopes, phases, weights, strict=True))
    return lambda x: np.stack([np.cos(x @ a.T + b) @ w for a, b, w in of], axis=1)


KINDS = waves, sums, products, polynomials, steps, draws


def problem(seed):
    """What it is, training rows, rows to predict, their function and its level."""
    rng = np.random.default_rng(seed)
    kind, n_tasks = KINDS[rng.integers(len(KINDS))], int(rng.choice(TASKS))
    rows = int(np.clip(rng.choice(ROWS), 5, MOST_ROWS // n_tasks))
    d, k = int(rng.integers(1, 6)), min(int(rng.integers(1, 4)), n_tasks - 1)
    noise, size = float(rng.choice(NOISE)), rng.choice(LEVELS)
    uses = rng.random(d) < 0.7
    uses[rng.integers(d)] = True
    functions, weights = kind(rng, uses, k), rng.standard_normal((n_tasks, k))
    task = np.repeat(np.arange(n_tasks), rows)
    new = rng.integers(0, n_tasks, N_TEST)
    x, x_new = (rng.uniform(-2.0, 2.0, (len(of), d)) for of in (task, new))
    f, f_new = (
        (functions(at) * weights[of]).sum(axis=1)
        for at, of in ((x, task), (x_new, new))
    )
    level, scale = size * rng.standard_normal(n_tasks), np.std(f)
    y = f / scale + level[task] + noise * rng.standard_normal(len(task))
    about = {"kind": kind.__name__, "tasks": n_tasks, "rows": rows, "inputs": d}
    about |= {"functions": k, "noise": noise}
    given = np.column_stack([x, task]), y, np.column_stack([x_new, new])
    y_new = f_new / scale + level[new] + noise * rng.standard_normal(N_TEST)
    return about, given, f_new / scale + level[new], level[new], y_new


def fitted(name, seed):
    """One row: what a model makes of a problem."""
    about, (X, y, X_new), f, level, y_new = problem(seed)
    if name in SIMPLER:
        model = SIMPLER[name]()
    else:
        model = MultiTaskGPRegressor(
            rank=about["functions"] if name == "truth" else None
        )
    begin = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, y)
        seconds = time.process_time() - begin
        lower, upper = model.predict_interval(X_new, 0.95)
        error = np.sqrt(np.square(model.predict(X_new) - f).mean())
    return {"seed": seed, "model": name, **about} | {
        "error": float(error / np.std(f - level)),
        "coverage": float(np.mean((lower <= y_new) & (y_new <= upper))),
        "seconds": seconds,
        "told": any(of.category is NarrowIntervalsWarning for of in caught),
    }


def report(rows):
    """The table of a file."""
    table = pd.DataFrame(rows).drop_duplicates(["seed", "model"], keep="last")
    about = table.groupby("seed").first()
    wide = {of: table.pivot_table(of, "seed", "model") for of in ("error", "coverage")}
    seconds = table.pivot_table("seconds", "seed", "model")["default"]
    told = table[table["model"] == "default"].set_index("seed")["told"]
    error = wide["error"]
    others = [name for name in SIMPLER if name in error]
    ratios = pd.DataFrame({"/truth": error["default"] / error.get("truth", np.nan)})
    ratios["/best"] = error["default"] / error[others].min(axis=1)
    ratios = ratios.dropna(axis=1, how="all")
    groups = {
        "3 to 15 tasks": about["tasks"] <= 15,
        "30 tasks": about["tasks"] == 30,
        "60 and 100 tasks": about["tasks"] >= 60,
        **{kind.__name__: about["kind"] == kind.__name__ for kind in KINDS},
        "all": about["tasks"] > 0,
    }
    lines = []
    for name, some in groups.items():
        if not some.any():
            continue
        of = ratios[some]
        line = {
            "problems": name,
            "n": len(of),
            "error": error["default"][some].median(),
        }
        for column in of:
            line[column] = np.exp(np.log(of[column]).mean())
            line["worse " + column] = (of[column] > 1.1).mean()
        line["coverage"] = wide["coverage"]["default"][some].mean()
        quiet = some & ~told.astype(bool)
        line["untold"] = wide["coverage"]["default"][quiet].mean()
        lines.append(
            line | {"s": seconds[some].median(), "s, all": seconds[some].sum()}
        )
    print(pd.DataFrame(lines).to_string(index=False, float_format="%.3g"))


def read(path):
    """Rows of a file that may not be there."""
    return [json.loads(line) for line in path.open()] if path.exists() else []


def main():
    """Run what is not there, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--others", nargs="*", default=["truth", *SIMPLER])
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--report", action="store_true", help="run nothing")
    args = parser.parse_args()
    rows = read(args.output)
    known = {(row["seed"], row["model"]) for row in rows}
    models = ["default", *args.others]
    jobs = [(name, seed) for seed in range(args.draws) for name in models]
    with threadpool_limits(1):
        for name, seed in [] if args.report else jobs:
            if (seed, name) not in known:
                rows.append(fitted(name, seed))
                with args.output.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    report(rows)


if __name__ == "__main__":
    main()
