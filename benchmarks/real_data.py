"""Real data: skmtgp's defaults beside what a user would take instead.

``python benchmarks/real_data.py --data FOLDER`` learns each set of real_data_sets.py by
each model of real_data_models.py, and appends what it measures to
``results/real_data.jsonl``, one line a fit, which is not done again unless ``--redo``
says so. ``--report`` prints the tables alone. A set whose data are not here is left
out, and so is a package that has no environment (``make bench-envs``); a fit that fails
is kept as such.

The error is the set's usual one: MAE, or nMSE over the variance of the training
targets; of each task, averaged, where tasks have units of their own. MSLL is the mean
standardised log loss in nats, of rounded targets that of their cells, and coverage that
of 95 % intervals of y. Seconds are the processor's, of learning and predicting all
outputs of a draw, with one thread. All are means over outputs and draws. The defaults
are held against each other model, on the fits that both have, and the strongest is
shown: errors at most 2 % more, log loss at most 0.02 nats more, no more time than
another package's Gaussian process of all tasks.
"""

import argparse
import sys
import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from real_data_models import GOALS, MODELS, WITH_TASKS, LeftOut
from real_data_sets import FIXED, SETS, Missing, Rows
from scipy.stats import norm
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import threadpool_limits

from skmtgp.exceptions import JitterWarning, PrecisionWarning, UnidentifiedNoiseWarning
from skmtgp.metrics import coverage, mean_standardized_log_loss

PEERS = Path(__file__).parent / "peers"
sys.path.append(str(PEERS))
from results import RESULTS, Table, commit  # noqa: E402

EXPECTED = (
    ConvergenceWarning,
    JitterWarning,
    PrecisionWarning,
    UnidentifiedNoiseWarning,
)
ALLOWED = {  # what counts as the best
    "error": lambda best: 1.02 * best,
    "msll": lambda best: best + 0.02,
    "seconds": lambda best: best,
}
MEASURES = ["error", "msll", "coverage"]


def measure(part, rows, mean, std):
    """Error, log loss and coverage of the predictions of one test set."""
    true, train = rows.y, part.train
    tasks, tasks_train = rows.X["task"].to_numpy(), train.X["task"].to_numpy()
    if not part.own_units:
        tasks, tasks_train = np.zeros(len(true)), np.zeros(len(train.y))
    back = part.back or (lambda y: y)
    found = []
    for task in np.unique(tasks):
        of, known = tasks == task, train.y[tasks_train == task]
        difference = back(true[of]) - back(mean[of])
        nmse = np.mean(difference**2) / known.var()
        predicted = true[of], mean[of], std[of]
        found.append(
            {
                "error": np.abs(difference).mean() if part.measure == "MAE" else nmse,
                "msll": log_loss(*predicted, known, part.step),
                "coverage": coverage(*predicted),
            }
        )
    return {name: float(np.mean([row[name] for row in found])) for name in MEASURES}


def log_loss(true, mean, std, known, step):
    """Standardised, in nats. Of multiples of a step it is that of their cells.

    The density at a value would reward a deviation of zero where values repeat.
    """
    if step is None:
        return mean_standardized_log_loss(true, mean, std, y_train=known)

    def mean_log(mean, std):
        away = np.abs(true - mean)  # of both tails the one that has digits
        near, far = ((side * step / 2.0 - away) / std for side in (1.0, -1.0))
        less = norm.logcdf(far) - norm.logcdf(near)
        return (norm.logcdf(near) + np.log1p(-np.exp(less))).mean()

    return mean_log(known.mean(), known.std()) - mean_log(mean, std)


def standardised(part):
    """The part with features of mean zero and deviation one, as all models get it."""
    names = part.train.X.columns.drop("task")
    mean, std = part.train.X[names].mean(), part.train.X[names].std()

    def scale(rows):
        X = (rows.X[names] - mean) / std.where(std > 0.0, 1.0)
        return Rows(X.assign(task=rows.X["task"]), rows.y)

    part.train = scale(part.train)
    part.tests = {name: scale(rows) for name, rows in part.tests.items()}
    return part


def fit(name, part, arguments):
    """What a model's fit to one output gave."""
    inputs = [rows.X for rows in part.tests.values()]
    try:
        learned = MODELS[name](part, inputs, arguments)
        tests = {
            test: measure(part, rows, *found)
            for (test, rows), found in zip(
                part.tests.items(), learned.predictions, strict=True
            )
        }
    except LeftOut:
        raise
    except Exception as error:  # a failure is a result
        return {"error": f"{type(error).__name__}: {error}"[:300]}
    return {"tests": tests, "seconds": learned.seconds, **learned.notes}


def run(table, arguments):
    """Measure what is missing; names of what cannot be measured here, and why."""
    left_out = {}
    for data in arguments.only:
        try:
            for draw in range(1 if data in FIXED else arguments.seeds):
                parts = SETS[data](arguments.data, draw)
                for part, model in product(map(standardised, parts), arguments.models):
                    key = {"data": data, "draw": draw, "output": part.name}
                    key["model"] = model
                    if arguments.redo or not table.select(**key):
                        run_one(table, key, part, arguments, left_out)
        except Missing as missing:
            left_out[data] = str(missing)
    return left_out


def run_one(table, key, part, arguments, left_out):
    """Measure a fit and keep it, or that its package is not here."""
    try:
        found = fit(key["model"], part, arguments)
    except LeftOut as reason:
        left_out[key["model"]] = str(reason)
        return
    n, tasks = len(part.train.y), part.train.X["task"].nunique()
    size = {"n": n, "tasks": tasks, "measure": part.measure}
    row = table.append({**key, **size, **found, "commit": commit()})
    print(line(row), flush=True)


def line(row):
    """A fit in a line."""
    what = f"{row['data']} {row['draw']} {row['output']}: {row['model']}"
    if "error" in row:
        return f"{what}: FAILED, {row['error']}"
    tests = "; ".join(
        f"{name} {' '.join(f'{found[m]:.4g}' for m in MEASURES)}"
        for name, found in row["tests"].items()
    )
    return f"{what}: {tests}, {row['seconds']:.1f} s"


def report(rows, sets):
    """Print the tables, and give the verdicts."""
    verdicts = []
    for data in sets:
        own = [row for row in rows if row["data"] == data]
        done = [row for row in own if "error" not in row]
        if done:
            draws = len({row["draw"] for row in done})
            print(f"\n{data}: n = {done[0]['n']}, {done[0]['tasks']} tasks", end=", ")
            print(f"{draws} draw(s); error: {done[0]['measure']}")
            for test in done[0]["tests"]:
                fits = measured(done, test)
                shown = summary(fits).to_string(float_format="{:.4g}".format)
                print(f"{test}:\n{shown}")
                verdicts += judge(data, test, fits)
        for row in own:
            if "error" in row:
                print(line(row))
    return verdicts


def measured(rows, test):
    """Measures of a test set by model, draw and output."""
    index = ["model", "draw", "output"]
    fits = [
        {**{k: row[k] for k in [*index, "seconds"]}, **row["tests"][test]}
        for row in rows
    ]
    return pd.DataFrame(fits).set_index(index)


def summary(fits):
    """Means over outputs and draws; seconds of all outputs of a draw."""
    by_model = fits.groupby("model")
    seconds = fits["seconds"].groupby(["model", "draw"]).sum().groupby("model").mean()
    table = by_model[MEASURES].mean().assign(seconds=seconds, fits=by_model.size())
    return table.reindex([name for name in MODELS if name in table.index])


def judge(data, test, fits):
    """The defaults against the strongest other model."""
    verdicts = []
    for name, (measure, allowed) in product(GOALS, ALLOWED.items()):
        rivals = WITH_TASKS if measure == "seconds" else MODELS
        pairs = compared(fits[measure].unstack("model"), name, rivals)
        if not pairs:
            continue
        rival = max(pairs, key=lambda r: pairs[r][0] - allowed(pairs[r][1]))
        value, limit = pairs[rival][0], allowed(pairs[rival][1])
        met = "met" if value <= limit else "NOT MET"
        verdicts.append((data, test, name, measure, value, rival, limit, met))
    return verdicts


def compared(wide, name, rivals):
    """Means of a model and of each other, over the fits that both have."""
    pairs = {}
    for rival in wide.columns.intersection(list(rivals)).drop(name, errors="ignore"):
        both = wide[[name, rival]].dropna() if name in wide else ()
        if len(both):
            pairs[rival] = tuple(both.mean())
    return pairs


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder with jura and ur10e")
    parser.add_argument("--only", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--models", nargs="+", choices=MODELS, default=list(MODELS))
    parser.add_argument("--seeds", type=int, default=3, help="draws, where there are")
    parser.add_argument(
        "--budget", type=float, default=300.0, help="seconds of another package's fit"
    )
    parser.add_argument("--envs", type=Path, default=Path(__file__).parent / ".envs")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--redo", action="store_true", help="measure again")
    parser.add_argument("--report", action="store_true", help="print the tables alone")
    arguments = parser.parse_args()
    arguments.envs = arguments.envs.resolve()
    for kind in EXPECTED:
        warnings.simplefilter("ignore", kind)
    table = Table("real_data", arguments.results)
    with threadpool_limits(1):
        left_out = {} if arguments.report else run(table, arguments)
    chosen = [row for row in table.rows.values() if row["model"] in arguments.models]
    verdicts = report(chosen, arguments.only)
    names = ["data", "test", "model", "of", "value", "strongest", "at most", "is"]
    shown = pd.DataFrame(verdicts, columns=names)
    print("\n" + shown.to_string(index=False, float_format="{:.4g}".format))
    for name, reason in left_out.items():
        print(f"left out: {name}, {reason}")


if __name__ == "__main__":
    main()
