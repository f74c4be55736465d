"""Ordinary grouped data: the defaults beside what a user would take instead.

``python benchmarks/grouped.py --output FILE.jsonl`` fits each model to each split of
the 61 sets of grouped_data.py: 60 % of the rows of each group, drawn five times, and
where there is a time all but the last third of each group's. Each fit is a line of the
file, written when it is known; what is there is not run again, except with ``--redo``,
and the last line of a key counts. ``--report FILE.jsonl`` prints the tables.

- ``--params rank=0 shared=true`` are parameters of MultiTaskGPRegressor, which alone is
  run with them; ``--models RankSearchIC`` runs the search of such a model. They are
  reported apart. With ``--report``, they say of which models the table of sets is.
- ``--splits 1`` runs, or reports, the first of the random splits alone.
- "GPR" is scikit-learn's Gaussian process, of standardised inputs, with an RBF that has
  a length-scale for each of them, noise, ``normalize_y=True`` and two restarts.
  "One-hot tasks" have a length-scale for each task as well, or one for all if there are
  more than twelve.
- The log loss is the mean of minus the log density of the test rows, noise included.
- A fit that takes longer than ``--limit`` seconds of the processor has failed, and so
  has one whose predictions are not finite. Failed fits are counted.

Seconds are the processor's, of learning and predicting, with one thread.
"""

import argparse
import json
import time
import warnings
from collections import Counter
from functools import lru_cache
from pathlib import Path

import numpy as np
from grouped_data import LAST, SETS, load, splits_of
from grouped_models import DEFAULT, FITTED, MODELS
from grouped_report import report
from ordinary import parameter
from ordinary_models import limited, settings_of
from scipy.stats import norm
from threadpoolctl import threadpool_limits


def run(name, split, model, arguments):
    """The row of a fit."""
    (X, y, _), splits = cached(name, arguments.splits)
    train, params = splits[split], arguments.params
    row = {"set": name, "split": split, "model": model, "settings": settings_of(params)}
    row |= {"n": len(y), "groups": X["task"].nunique(), "inputs": X.shape[1] - 1}
    row |= {"n_test": int((~train).sum()), "deviation": float(np.std(y))}
    begin = time.process_time()
    with threadpool_limits(1), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with limited(arguments.limit):
                found = MODELS[model](params, X[train], y[train], X[~train])
            seconds = time.process_time() - begin
            row |= scores(y[~train], *found)
        except Exception as error:  # the others go on, and it is counted
            seconds = time.process_time() - begin
            row["failed"] = f"{type(error).__name__}: {error}"[:300]
    names = (warning.category.__name__ for warning in caught)
    return row | {"seconds": round(seconds, 3), "warnings": dict(Counter(names))}


def scores(y, mean, std, chose):
    """Errors of the predictions, and what was chosen."""
    row = {"rmse": float(np.sqrt(np.mean((y - mean) ** 2))), "chose": chose}
    if std is not None:
        row["log_loss"] = float(-norm.logpdf(y, mean, std).mean())
        held = np.abs(y - mean) <= norm.ppf(0.975) * std
        row["coverage"] = float(held.mean())
    if not np.isfinite([value for key, value in row.items() if key != "chose"]).all():
        raise ValueError("predictions are not finite")
    return row


@lru_cache
def cached(name, n):
    """A set and its splits, kept for all models."""
    grouped = load(name)
    return grouped, splits_of(grouped, n)


KEY = "set", "split", "model", "settings"


def read(path):
    """Rows of a file by their keys; the last of a key counts."""
    lines = path.read_text().splitlines() if path.exists() else []
    rows = map(json.loads, lines)
    return {tuple(row[k] for k in KEY): row for row in rows}


def names_of(n):
    """Splits in the order in which they are run, of which n are random."""
    names = [f"random{seed}" for seed in range(n)]
    return [*names[:1], LAST, *names[1:]]


def jobs_of(arguments):
    """Fits that are asked for: all sets once, then the next split."""
    for split in names_of(arguments.splits):
        for name in arguments.sets:
            if split != LAST or SETS[name].time is not None:
                for model in arguments.models:
                    yield name, split, model


def work(arguments):
    """Run what is missing, each row to the file when it is known."""
    settings = settings_of(arguments.params)
    rows = {} if arguments.redo else read(arguments.output)
    for job in jobs_of(arguments):
        if (*job, settings) in rows:
            continue
        row = run(*job, arguments)
        with arguments.output.open("a") as file:
            file.write(json.dumps(row) + "\n")
        told = row.get("failed", f"rmse {row.get('rmse', np.nan):.4g}")
        said = f"{', '.join(job)} ({settings}): {told}, {row['seconds']:.1f} s"
        print(said, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    files = parser.add_mutually_exclusive_group(required=True)
    files.add_argument("--output", type=Path, help="to which rows are appended")
    files.add_argument("--report", type=Path, help="of which the tables are printed")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--splits", type=int, default=5, help="random ones of a set")
    parser.add_argument("--models", nargs="+", choices=MODELS)
    parser.add_argument("--params", nargs="+", type=parameter, default=[])
    parser.add_argument("--limit", type=float, default=120.0, help="seconds of a fit")
    parser.add_argument("--redo", action="store_true", help="also what is there")
    arguments = parser.parse_args()
    arguments.params = dict(arguments.params)
    if arguments.models is None:
        arguments.models = [DEFAULT] if arguments.params else list(MODELS)
    if arguments.params and not set(arguments.models) <= set(FITTED):
        parser.error(f"--params are of {' and '.join(FITTED)}")
    if arguments.report is None:
        work(arguments)
    else:
        rows = read(arguments.report).values()
        names = names_of(arguments.splits)
        rows = [row for row in rows if row["split"] in names]
        rows = [row for row in rows if row["set"] in arguments.sets]
        if not rows:
            parser.error(f"no fits in {arguments.report}")
        report(rows, settings_of(arguments.params))


if __name__ == "__main__":
    main()
