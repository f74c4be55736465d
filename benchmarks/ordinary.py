"""A suite of drawn problems with a known truth: what the learner finds of each.

``python benchmarks/ordinary.py --output FILE.jsonl`` fits ``MultiTaskGPRegressor()``
("default"), ``RankSearchIC()`` ("search") and the baselines to some draws of each class
of ordinary_data.py, looks for the best modes of what the first two chose ("best"), and
prints the report of ordinary_report.py. Each fit is a line of the file, written when it
is known; what is there is not run again. ``--report`` prints what files have.

- "best" is dear. It maximises the objective of the model that a fit chose (rank,
  units, noise) from 20 random restarts, and by L-BFGS from the truth's own parameters.
  The objective is the log likelihood and, where each task has its own noise, the log
  density by which their variances are alike. The best known is the highest objective of
  the same model in all files, those of ``--also`` too.
- ``--params rank=2 noise=shared`` are parameters of MultiTaskGPRegressor, alone and in
  the search; ``rank=truth`` gives each problem its own. They are reported apart.
- A fit that takes longer than ``--limit`` seconds of the processor has failed. Failed
  fits are counted and named.

Seconds are the processor's, of one thread.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

import numpy as np
from ordinary_data import CLASSES
from ordinary_models import baselines_of, run, settings_of
from ordinary_report import report

FITTED = "default", "search"
PARTS = *FITTED, "baselines", "best"


class Results:
    """Rows of a file, one for each problem, model and settings; the last one counts.

    Parameters
    ----------
    path : Path or None
        To which rows are appended. None keeps them in memory alone.
    also : sequence of Path
        Files of other versions. Their baselines and best modes count as if they were in
        the file, their fits for the best known likelihoods alone.
    """

    def __init__(self, path, also=()):
        self.path, self.rows = path, {}
        for of in also:
            for row in _read(of):
                if row["model"] in FITTED:
                    row["model"] += f" of {of}"
                self.rows[self.key(row)] = row
        if path is not None and path.exists():
            self.rows |= {self.key(row): row for row in _read(path)}

    @staticmethod
    def key(row):
        """What identifies a row."""
        return row["problem"], row["model"], row["settings"]

    def append(self, row):
        """Add a row, to the file at once."""
        self.rows[self.key(row)] = row
        if self.path is not None:
            with self.path.open("a") as file:
                file.write(json.dumps(row) + "\n")


def _read(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def problems_of(arguments):
    """Names of problems; the first seed of all classes comes first."""
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    return [f"{name}/{seed}" for seed in seeds for name in arguments.classes]


def fits_of(name, arguments):
    """Models that are fitted to a problem, and their parameters."""
    of_tasks = [model for model in FITTED if model in arguments.only]
    yield from ((model, arguments.params) for model in of_tasks)
    if "baselines" in arguments.only:
        yield from ((model, {}) for model in baselines_of(name.split("/")[0]))


def best_of(name, results, arguments):
    """What the fits to a problem have chosen, of which the best is to be known."""
    for model in FITTED:
        row = results.rows.get((name, model, settings_of(arguments.params)), {})
        if "config" in row and row["n"] <= arguments.most_rows:
            yield "best", {**row["config"], "restarts": arguments.restarts}


def missing(jobs, results, redo):
    """Jobs whose rows are not there, once each."""
    found = {}
    for name, model, params in jobs:
        key = name, model, settings_of(params)
        if redo or key not in results.rows:
            found[key] = name, model, params
    return list(found.values())


def work(jobs, results, arguments):
    """Run jobs, each row to the file when it is known."""
    options = {key: getattr(arguments, key) for key in ("limit", "memory", "restarts")}
    jobs = [(*job, options) for job in jobs]
    if arguments.jobs == 1:
        for job in jobs:
            keep(run(job), results)
        return
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for done in as_completed([pool.submit(run, job) for job in jobs]):
            keep(done.result(), results)


def keep(row, results):
    """Store a row, and say so."""
    results.append(row)
    value = row.get("objective", row.get("lml"))
    told = row.get("failed", f"{value or np.nan:.2f} nats")
    name = f"{row['problem']} {row['model']} ({row['settings']})"
    print(f"{name}: {told}, {row['seconds']:.1f} s", flush=True)


def parameter(text):
    """A parameter's name and value."""
    name, value = text.split("=", 1)
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=list(CLASSES))
    parser.add_argument("--seeds", type=int, default=13, help="draws of each class")
    parser.add_argument("--first", type=int, default=0, help="first of them")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--params", nargs="+", type=parameter, default=[])
    parser.add_argument("--restarts", type=int, default=20)
    parser.add_argument(
        "--most-rows", type=int, default=1000, help="of which the best is looked for"
    )
    parser.add_argument("--limit", type=float, default=300.0, help="seconds of a fit")
    parser.add_argument("--memory", type=float, default=6.0, help="GiB of a fit")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--output", type=Path, help="to which rows are appended")
    parser.add_argument("--also", type=Path, nargs="+", default=[], help="more to read")
    parser.add_argument("--redo", action="store_true", help="also what is there")
    parser.add_argument("--report", action="store_true", help="run nothing")
    arguments = parser.parse_args()
    arguments.params = dict(arguments.params)
    results = Results(arguments.output, arguments.also)
    names = problems_of(arguments)
    if not arguments.report:
        fits = [(name, *of) for name in names for of in fits_of(name, arguments)]
        work(missing(fits, results, arguments.redo), results, arguments)
        if "best" in arguments.only:
            of = partial(best_of, results=results, arguments=arguments)
            modes = [(name, *found) for name in names for found in of(name)]
            work(missing(modes, results, arguments.redo), results, arguments)
    place = {name: k for k, name in enumerate(names)}
    rows = [row for row in results.rows.values() if row["problem"] in place]
    rows.sort(key=lambda row: place[row["problem"]])
    report(rows, settings_of(arguments.params))


if __name__ == "__main__":
    main()
