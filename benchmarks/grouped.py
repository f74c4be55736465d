"""Ordinary grouped data: the defaults beside what a user would take instead.

``python benchmarks/grouped.py --output FILE.jsonl`` fits each model to each split of
the 61 sets of grouped_data.py: 60 % of the rows of each group, drawn five times, and
where there is a time all but the last third of each group's. Each fit is a line of the
file, written when it is known; what is there is not run again, except with ``--redo``,
and the last line of a key counts. ``--report FILE.jsonl`` prints the tables.

- ``--params rank=0 shared=true`` are parameters of MultiTaskGPRegressor, which alone is
  run with them; ``--models RankSearchIC`` runs the search of such a model. They are
  reported apart. With ``--report``, they say of which models the table of sets is.
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
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
from grouped_data import LAST, SETS, load, splits_of
from ordinary import parameter
from ordinary_models import limited, settings_of
from scipy.stats import norm
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.linear_model import RidgeCV
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC

DEFAULT, SEARCH = FITTED = "MultiTaskGPRegressor", "RankSearchIC"
AS_SHIPPED = settings_of({})
CHOSEN = "rank", "shared", "diagonal", "noise", "normalize_y"
MANY = 12  # tasks, above which they share a length-scale
PENALTIES = np.logspace(-3, 3, 19)
WORST = 3.0  # which a log loss above counts as
APART, POOR = 1.05, 0.8  # a ratio of errors, and a coverage, that count

# the models: mean, deviation or None, and what was chosen


def ours(make, train, y, test):
    """A model of this package."""
    model = make().fit(train, y)
    mean, std = model.predict(test, return_std=True, include_noise=True)
    return mean, std, chosen_by(model)


def chosen_by(model):
    """What a default chose, as far as the model has it."""
    best = getattr(model, "best_estimator_", model)
    found = {}
    for name in CHOSEN:
        value = getattr(best, f"{name}_", None)
        if value is not None:
            found[name] = value if isinstance(value, str) else str(value)
    if hasattr(model, "best_model_"):
        found["model"] = model.best_model_
    return found


def default(params, *rows):
    """MultiTaskGPRegressor, with its defaults but for these parameters."""
    return ours(partial(MultiTaskGPRegressor, task_feature="task", **params), *rows)


def search(params, *rows):
    """RankSearchIC of the same."""
    estimator = MultiTaskGPRegressor(task_feature="task", **params)
    return ours(partial(RankSearchIC, estimator), *rows)


def independent(_, *rows):
    """IndependentGP, with no parameters."""
    return ours(partial(IndependentGP, task_feature="task"), *rows)


def pooled(_, *rows):
    """PooledGP, with no parameters."""
    return ours(partial(PooledGP, task_feature="task"), *rows)


class SomeRBF(RBF):
    """An RBF of the columns from `first` to before `last`."""

    def __init__(self, length_scale, length_scale_bounds, first=0, last=None):
        super().__init__(length_scale, length_scale_bounds)
        self.first, self.last = first, last

    def __call__(self, X, Y=None, eval_gradient=False):
        """The covariances."""
        of = np.s_[:, self.first : self.last]
        return super().__call__(X[of], None if Y is None else Y[of], eval_gradient)


def gpr(smooth):
    """A Gaussian process of scikit-learn."""
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * smooth + WhiteKernel(0.1, (1e-6, 1e2))
    return GaussianProcessRegressor(
        kernel, normalize_y=True, n_restarts_optimizer=2, random_state=0
    )


def of_each_task(_, train, y, test):
    """One for each task."""
    A, B = scaled(train, test)
    tasks, new = train["task"].to_numpy(), test["task"].to_numpy()
    mean, std = np.zeros((2, len(B)))
    for task in np.unique(new):
        model = gpr(RBF(np.ones(A.shape[1]), (1e-3, 1e4)))
        model.fit(A[tasks == task], y[tasks == task])
        of = new == task
        mean[of], std[of] = model.predict(B[of], return_std=True)
    return mean, std, {}


def of_dummies(_, train, y, test):
    """One whose inputs are also the tasks, one-hot."""
    d, n_tasks = train.shape[1] - 1, train["task"].nunique()
    if n_tasks <= MANY:
        smooth = RBF(np.ones(d + n_tasks), (1e-3, 1e4))
    else:
        smooth = SomeRBF(np.ones(d), (1e-3, 1e4), last=d)
        smooth *= SomeRBF(1.0, (1e-2, 1e4), first=d)
    A, B = map(np.hstack, zip(scaled(train, test), dummies(train, test), strict=True))
    return *gpr(smooth).fit(A, y).predict(B, return_std=True), {}


def ridge(_, train, y, test, *, slopes=False):
    """Ridge regression with a level, or also slopes, of each task."""
    parts = []
    for X, tasks in zip(scaled(train, test), dummies(train, test), strict=True):
        products = X[:, :, None] * tasks[:, None, :] if slopes else X[:, :0]
        parts.append(np.hstack([X, tasks, products.reshape(len(X), -1)]))
    return RidgeCV(PENALTIES).fit(parts[0], y).predict(parts[1]), None, {}


def boosted(_, train, y, test):
    """Trees with the task as a category; groups are small, and so are leaves."""
    names = np.unique(train["task"])
    A, B = (
        np.column_stack([X, np.searchsorted(names, rows["task"])])
        for X, rows in zip(scaled(train, test), (train, test), strict=True)
    )
    model = HistGradientBoostingRegressor(
        min_samples_leaf=5, categorical_features=[A.shape[1] - 1], random_state=0
    )
    return model.fit(A, y).predict(B), None, {}


def scaled(train, test):
    """Standardised inputs."""
    A, B = (rows.drop(columns="task").to_numpy(float) for rows in (train, test))
    scaler = StandardScaler().fit(A)
    return scaler.transform(A), scaler.transform(B)


def dummies(train, test):
    """A column for each task."""
    names = np.unique(train["task"])
    return [
        (rows["task"].to_numpy()[:, None] == names).astype(float)
        for rows in (train, test)
    ]


GPS = {
    DEFAULT: default,
    SEARCH: search,
    "IndependentGP": independent,
    "PooledGP": pooled,
    "GPR, one-hot tasks": of_dummies,
    "GPR of each task": of_each_task,
}
MODELS = GPS | {
    "ridge, dummies": ridge,
    "ridge, slopes": partial(ridge, slopes=True),
    "boosted trees": boosted,
}

# one fit


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


# the file


KEY = "set", "split", "model", "settings"


def read(path):
    """Rows of a file by their keys; the last of a key counts."""
    lines = path.read_text().splitlines() if path.exists() else []
    rows = map(json.loads, lines)
    return {tuple(row[k] for k in KEY): row for row in rows}


def jobs_of(arguments):
    """Fits that are asked for: all sets once, then the next split."""
    names = [f"random{seed}" for seed in range(arguments.splits)]
    for split in [*names[:1], LAST, *names[1:]]:
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


# the report

HEADER = f"""
"ratio" is the geometric mean over sets of the RMSE over that of {DEFAULT}
as shipped, on the splits that both have. "better" and "worse" are the shares of sets in
which it is more than 5 % better or worse. "log loss" is the mean over fits of the log
loss less the log of the deviation of all targets of the set, where one above
{WORST:g} counts as {WORST:g}, so that single disasters do not decide; "median" is the
median of the same. "cover" is the mean coverage of 95 % intervals, "below" the share of
sets in which it is below {POOR:g}. Seconds are of all fits together. Failed fits count
in "fits", "failed" and "seconds" alone.

In a table of sets, "rmse" is over that of the best other model, "loss" is the log loss
less that of the best other Gaussian process, each on the splits that both have, and
"chose" is what {DEFAULT} chose most often."""


def report(rows, settings):
    """Print the tables of random splits, and those of the last third.

    Parameters
    ----------
    rows : list of dict
        Of the file.
    settings : str
        Of the two models in the table of sets.
    """
    print(HEADER)
    frame = pd.DataFrame(rows)
    absent = {"failed", "rmse", "log_loss", "coverage", "chose"} - set(frame)
    frame = frame.assign(**dict.fromkeys(absent, np.nan))
    frame["over"] = frame["log_loss"] - np.log(frame["deviation"])
    last = frame["split"] == LAST
    for title, of in (("Random splits", ~last), ("The last third", last)):
        if of.any():
            sets = frame.loc[of, "set"].nunique()
            print(f"\n{title}, {sets} sets\n")
            show(by_model(frame[of]))
            print(f"\n{title}: each set, {settings}\n")
            show(by_set(frame[of], settings))


def show(table):
    """Print a table."""
    print(table.to_string(index=False, na_rep="-", float_format="{:.3f}".format))


def errors_of(frame, other):
    """RMSE of each set, of two frames on the splits that both have."""
    both = [of.set_index(["set", "split"])["rmse"] for of in (frame, other)]
    both = pd.concat(both, axis=1, keys=["one", "other"]).dropna()
    return np.sqrt((both**2).groupby("set", sort=False).mean())


def by_model(frame):
    """A row for each model and its settings."""
    named = (frame["model"] == DEFAULT) & (frame["settings"] == AS_SHIPPED)
    reference, table = frame[named], []
    order = {model: k for k, model in enumerate(MODELS)}
    groups = frame.groupby(["model", "settings"], sort=False)
    for (model, settings), fits in sorted(groups, key=lambda of: order[of[0][0]]):
        errors = errors_of(fits, reference)
        ratios = errors["one"] / errors["other"]
        clipped = fits["over"].clip(upper=WORST)
        cover = fits.groupby("set")["coverage"].mean().dropna()
        row = {"model": model if settings == AS_SHIPPED else f"{model}, {settings}"}
        row |= {"fits": len(fits), "failed": fits["failed"].notna().sum()}
        row["ratio"] = np.exp(np.log(ratios).mean())
        row["better"] = (ratios < 1.0 / APART).mean()
        row["worse"] = (ratios > APART).mean()
        row |= {"log loss": clipped.mean(), "median": clipped.median()}
        row["cover"] = fits["coverage"].mean()
        row["below"] = (cover < POOR).mean() if len(cover) else np.nan
        table.append(row | {"seconds": round(fits["seconds"].sum())})
    return pd.DataFrame(table)


def by_set(frame, settings):
    """A row for each set."""
    return pd.DataFrame(
        described(name, fits, settings)
        for name, fits in frame.groupby("set", sort=False)
    )


def described(name, fits, settings):
    """A set: the two models over the best of the others, by errors and log loss."""
    first = fits.iloc[0]
    row = {"set": name, "n": first["n"], "groups": first["groups"]}
    row |= {"inputs": first["inputs"], "splits": fits["split"].nunique()}
    others = {m: of for m, of in fits.groupby("model") if m not in FITTED}
    of_fitted = fits[fits["settings"] == settings]
    of_two = {model: of_fitted[of_fitted["model"] == model] for model in FITTED}
    for short, model in (("default", DEFAULT), ("search", SEARCH)):
        errors = [errors_of(of_two[model], of) for of in others.values()]
        ratios = [(of["one"] / of["other"]).max() for of in errors]
        row[f"rmse {short}"] = max(ratios, default=np.nan)
    for short, model in (("default", DEFAULT), ("search", SEARCH)):
        losses = [
            paired(of_two[model], of)
            for other, of in others.items()
            if other in GPS and other not in FITTED
        ]
        row[f"loss {short}"] = max(losses, default=np.nan)
    for short, model in (("default", DEFAULT), ("search", SEARCH)):
        row[f"cover {short}"] = of_two[model]["coverage"].mean()
    return row | {"chose": what_it_chose(of_two[DEFAULT])}


def paired(frame, other):
    """Mean log loss less the other's, on the splits that both have."""
    losses = [of.set_index("split")["log_loss"] for of in (frame, other)]
    return (losses[0] - losses[1]).mean()


def what_it_chose(fits):
    """The most frequent choice, and in how many fits if not in all."""
    counts = Counter(map(in_words, fits["chose"].dropna())).most_common()
    if not counts:
        return "-"
    what, times = counts[0]
    return what if len(counts) == 1 else f"{what} ({times} of {len(fits)})"


def in_words(chose):
    """A choice."""
    words = ["shared" if chose["shared"] == "True" else f"rank {chose['rank']}"]
    if chose["diagonal"] != "False":
        words.append(f"diagonal {chose['diagonal']}".replace(" True", ""))
    if chose["noise"] != "shared":
        words.append(f"noise {chose['noise']}")
    if chose["normalize_y"] != "shared":
        words.append(f"units {chose['normalize_y']}")
    return ", ".join(words)


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
        rows = [row for row in rows if row["set"] in arguments.sets]
        if not rows:
            parser.error(f"no fits in {arguments.report}")
        report(rows, settings_of(arguments.params))


if __name__ == "__main__":
    main()
