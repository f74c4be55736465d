"""What the defaults of MultiTaskGPRegressor gain, and cost, on ordinary problems.

``python benchmarks/defaults.py`` fits the defaults and, one at a time, other choices to
the same draws of each class of ordinary_data.py. Errors are those of a choice over
those of the defaults: the geometric mean over the draws of the ratio of root mean
squares over tasks. Above 1 the defaults are better. Coverage is that of 95 % intervals
of new observations, seconds are the processor's, of all fits together.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pandas as pd
from ordinary_data import CLASSES, HUNDREDS
from ordinary_models import run, settings_of

CHOICES = [
    {},
    {"kernel": "rbf"},
    {"noise": "shared"},
    {"noise": "per_task"},
    {"normalize_y": "shared"},
    {"normalize_y": "per_task"},
    {"task_levels": False},
    {"rank": 1},
    {"rank": 2},
    {"rank": "full"},
    {"diagonal": True},
    {"rank": 1, "diagonal": True},
    {"noise_variance_bounds": (1e-2, 1e3)},
    {"n_restarts_optimizer": 2},
    {"hyperparameters": "map"},
]


def error(row):
    """Root mean square over the tasks, of a row; NaN if the fit failed."""
    return np.sqrt(np.mean(row["errors"])) if "errors" in row else np.nan


def table(rows):
    """One column for each choice, one row for each class, and those of all."""
    frame = pd.DataFrame(
        {
            "problem": row["problem"],
            "choice": row["settings"],
            "error": error(row),
            "coverage": row.get("coverage", np.nan),
            "seconds": row["seconds"],
            "failed": "failed" in row,
        }
        for row in rows
    )
    choices, problems = frame["choice"].unique(), frame["problem"].unique()
    errors = frame.pivot(index="problem", columns="choice", values="error")
    ratios = np.log(errors.loc[problems, choices])
    ratios = ratios.sub(ratios[choices[0]], axis=0)
    of = ratios.index.str.split("/").str[0]
    found = np.exp(ratios.groupby(of, sort=False).mean())
    found.loc["ALL"] = np.exp(ratios.mean())
    of_choice = frame.groupby("choice")
    found.loc["coverage"] = of_choice["coverage"].mean()
    found.loc["seconds"] = of_choice["seconds"].sum()
    found.loc["failed"] = of_choice["failed"].sum()
    return found.T.rename_axis(None, axis=1)


SUMS = ["ALL", "coverage", "seconds", "failed"]


def show(found):
    """Print a table of the choices, and one of the classes."""
    ratios = found.drop(columns=SUMS)
    numbered = found[SUMS].rename(columns={"ALL": "errors"})
    numbered.insert(0, "choice", found.index)
    for name, of in (("least", ratios.idxmin), ("most", ratios.idxmax)):
        where = of(axis=1)
        values = [f"{ratios.at[k, c]:.2f} ({c})" for k, c in where.items()]
        numbered[name] = values
    numbered["failed"] = numbered["failed"].astype(int)
    numbered.index = pd.RangeIndex(len(found))
    print(numbered.to_string(float_format="{:.2f}".format), "\n")
    ratios.index = numbered.index
    print(ratios.T.to_string(float_format="{:.2f}".format))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    classes = [name for name in CLASSES if name not in HUNDREDS]
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=classes)
    parser.add_argument("--seeds", type=int, default=3, help="draws of each class")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds of a fit")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    arguments = parser.parse_args()
    options = {"limit": arguments.limit, "memory": 6.0}
    jobs = [
        (f"{name}/{seed}", "default", choice, options)
        for name in arguments.classes
        for seed in range(arguments.seeds)
        for choice in CHOICES
    ]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        rows = list(pool.map(run, jobs))
    assert rows[0]["settings"] == settings_of({})
    print(f"Errors over the defaults', {arguments.seeds} draws of each class\n")
    show(table(rows))


if __name__ == "__main__":
    main()
