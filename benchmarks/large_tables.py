"""Tables of thousands of rows: what the default makes of them.

``python benchmarks/large_tables.py`` draws six tables, and learns from three quarters
of the rows of each: by the default, with ``inference="sparse"`` but for the machines,
and by gradient boosting and ridge regression of scikit-learn. It prints

- "error": the root mean squared error of the function, over its standard deviation
  within tasks;
- "held y" and "held f": the share of 95 % intervals that hold observations and the
  function;
- "seconds": the processor's, of the fit.

Gradient boosting has the task as a category, and stops early. Ridge regression has a
dummy of each task, and standardised features.

- stores: sales of 100 weeks of 130, each of 200 stores with a level, a trend, a season
  of its own size and phase, promotions and prices;
- sites: 100 tasks of 5 to 1500 rows, of three functions, one of which depends on the
  third feature alone;
- clinics: 60 tasks, twelve features of which five matter, a few of them binary;
- turbines: the power of 20 wind turbines, whose noise depends on the wind;
- machines: eight machines that drift apart;
- ovens: 30 ovens with a function in common, and one of each of half its deviation.
"""

import argparse
import time
import warnings

import numpy as np
import pandas as pd
from scipy.special import expit
from sklearn.compose import make_column_transformer
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.linear_model import RidgeCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import OneHotEncoder, StandardScaler
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor

TASK, TESTED = "task", 0.25
SPARSE = {"inference": "sparse", "n_inducing": 150}


def stores(rng, n_tasks=200, n=100, weeks=130):
    """Weeks of stores, in order of time."""
    tables = []
    for task in range(n_tasks):
        week = np.sort(rng.choice(weeks, n, replace=False)).astype(float)
        promo, price = (rng.random(n) < 0.15) * 1.0, rng.standard_normal(n)
        turn, size = 2.0 * np.pi * week / 52.0, rng.lognormal(2.0, 0.4)
        phase = rng.normal(0.0, 0.3)
        f = rng.normal(100.0, 25.0) + rng.normal(0.05, 0.08) * week
        f += size * (np.sin(turn + phase) + 0.3 * np.cos(2.0 * turn + phase))
        f += rng.normal(12.0, 4.0) * promo - 2.0 * price
        columns = {"week": week, "promo": promo, "price": price}
        tables.append(pd.DataFrame(columns | {TASK: f"s{task}", "f": f}))
    return pd.concat(tables, ignore_index=True), 4.0


def sites(rng, n_tasks=100, fewest=5, most=1500):
    """Tasks of very unequal size."""
    counts = np.geomspace(fewest, most, n_tasks).round().astype(int)
    task = np.repeat(range(n_tasks), counts)
    X = rng.uniform(-2.0, 2.0, (len(task), 3))
    a, b, c = X.T
    z = [np.sin(1.5 * a) + 0.5 * b, np.cos(2.0 * b) * a, np.square(c) - 1.3]
    F = rng.normal([2.0, 0.0, 0.0], [0.7, 1.0, 0.6], (n_tasks, 3))
    f = rng.normal(0.0, 5.0, n_tasks)[task] + (F[task] * np.transpose(z)).sum(axis=1)
    table = pd.DataFrame(X, columns=["a", "b", "c"])
    return table.assign(task=np.char.add("s", task.astype(str)), f=f), 0.7


def clinics(rng, n_tasks=60, n=2600):
    """Patients."""
    task = rng.choice(n_tasks, n, p=rng.dirichlet(np.full(n_tasks, 2.0)))
    age, bmi = rng.integers(18, 95, n), rng.normal(27.0, 5.0, n)
    sex, smoker = rng.integers(0, 2, n), (rng.random(n) < 0.25) * 1
    labs = {f"lab{j}": rng.standard_normal(n) for j in range(5)}
    labs |= {f"lab{j}": rng.lognormal(0.0, 0.7, n) for j in (5, 6)}
    columns = {"age": age, "sex": sex, "smoker": smoker, "bmi": bmi}
    columns |= {"stay": rng.poisson(4.0, n)} | labs
    f = 120.0 + rng.normal(0.0, 4.0, n_tasks)[task] + 5.0 * smoker
    f += rng.normal(0.25, 0.08, n_tasks)[task] * (age - 55.0) + 0.6 * (bmi - 27.0)
    f += 3.0 * np.sin(1.5 * labs["lab0"]) + 2.0 * smoker * labs["lab1"]
    names = np.char.add("c", task.astype(str))
    return pd.DataFrame(columns).assign(task=names, f=f), 8.0


def turbines(rng, n_tasks=20, n=5000):
    """Power curves."""
    task, wind = rng.integers(0, n_tasks, n), np.clip(9.0 * rng.weibull(2.1, n), 0, 25)
    density, warm = rng.normal(1.2, 0.05, n), rng.normal(12.0, 8.0, n)
    largest = 2000.0 * rng.normal(1.0, 0.03, n_tasks)
    largest *= np.where(np.arange(n_tasks) % 6 == 0, 0.85, 1.0)
    half = rng.normal(8.5, 0.3, n_tasks)[task]
    share = expit((wind * np.cbrt(density / 1.225) - half) / 1.1)
    noise = 10.0 + 320.0 * share * (1.0 - share)
    columns = {"wind": wind, "density": density, "warm": warm}
    names = np.char.add("t", task.astype(str))
    return pd.DataFrame(columns).assign(task=names, f=largest[task] * share), noise


def machines(rng, n_tasks=8, n=4000):
    """Days of machines, in order of time."""
    tables = []
    for task in range(n_tasks):
        day = np.sort(rng.uniform(0.0, 365.0, n // n_tasks))
        load, turn = rng.random(len(day)), 2.0 * np.pi * day
        warm = 20.0 + 8.0 * np.sin(turn / 365.0) + 2.0 * rng.standard_normal(len(day))
        f = rng.normal(0.0, 0.01) * day + 0.1 * warm
        f += 0.5 * rng.normal(1.0, 0.3) * np.sin(turn / 120.0 + rng.uniform(0.0, 6.0))
        f += rng.normal(5.0, 1.0) * load**1.5
        columns = {"day": day, "load": load, "warm": warm}
        tables.append(pd.DataFrame(columns | {TASK: f"m{task}", "f": f}))
    return pd.concat(tables, ignore_index=True), 0.3


def ovens(rng, n_tasks=30, n=160):
    """Tasks that deviate from what they have in common, each in its own way."""
    x, task = rng.uniform(0.0, 1.0, (n_tasks * n, 2)), np.repeat(range(n_tasks), n)
    f = waves(rng, x) + 0.5 * rng.standard_normal(n_tasks)[task]
    for m in range(n_tasks):
        f[task == m] += 0.5 * waves(rng, x[task == m])
    table = pd.DataFrame(x, columns=["heat", "damp"])
    return table.assign(task=np.char.add("o", task.astype(str)), f=f), 0.3


def waves(rng, x, n=400):
    """A function of two inputs, nearly a draw of a Gaussian process."""
    turn = x @ (rng.standard_normal((2, n)) / 0.4) + rng.uniform(0.0, 2.0 * np.pi, n)
    return np.cos(turn) @ rng.standard_normal(n) * np.sqrt(2.0 / n)


TABLES = {
    stores: SPARSE,
    sites: SPARSE | {"n_inducing": 100},
    clinics: SPARSE,
    turbines: SPARSE,
    machines: {},
    ovens: SPARSE,
}


def boosted(X, X_new):
    """Gradient boosting, of tables with the task as a category."""
    categories = X[TASK].astype("category").cat.categories
    X, X_new = (
        of.assign(task=pd.Categorical(of[TASK], categories)) for of in (X, X_new)
    )
    model = HistGradientBoostingRegressor(
        max_iter=600,
        learning_rate=0.05,
        max_leaf_nodes=15,
        min_samples_leaf=10,
        early_stopping=True,
        random_state=0,
    )
    return model, X, X_new


def ridge(X, X_new):
    """Ridge regression with a dummy of each task."""
    features = [name for name in X if name != TASK]
    columns = make_column_transformer(
        (StandardScaler(), features), (OneHotEncoder(handle_unknown="ignore"), [TASK])
    )
    return make_pipeline(columns, RidgeCV(np.logspace(-3, 3, 13))), X, X_new


def main():
    """Draw, learn and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = [make.__name__ for make in TABLES]
    parser.add_argument("--tables", nargs="+", choices=names, default=names)
    parser.add_argument("--seeds", type=int, default=1)
    arguments = parser.parse_args()
    titles = f"{'error':>8}{'held y':>8}{'held f':>8}{'seconds':>9}"
    print(f"{'table':10}{'seed':>5}{'rows':>7}  {'model':14}{titles}  chosen")
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for make, options in TABLES.items():
            if make.__name__ in arguments.tables:
                for seed in range(arguments.seeds):
                    compare(make, seed, options)


def compare(make, seed, options):
    """A line for each model."""
    rng = np.random.default_rng(seed)
    table, noise = make(rng)
    y = table["f"] + noise * rng.standard_normal(len(table))
    tested = (rng.random(len(table)) < TESTED) & (table.groupby(TASK).cumcount() >= 2)
    X, f = table.drop(columns="f"), table["f"]
    size = (f - f.groupby(table[TASK]).transform("mean")).std()
    train, test = X[~tested], X[tested]
    ours = MultiTaskGPRegressor(task_feature=TASK, **options)
    models = {"default": (ours, train, test)}
    models |= {"boosted trees": boosted(train, test), "ridge": ridge(train, test)}
    for name, (model, X, X_new) in models.items():
        begin = time.process_time()
        model.fit(X, y[~tested])
        seconds = time.process_time() - begin
        error = np.sqrt(np.mean((model.predict(X_new) - f[tested]) ** 2)) / size
        held, chosen = " " * 16, ""
        if model is ours:
            for of, value in ((True, y[tested]), (False, f[tested])):
                low, high = model.predict_interval(X_new, include_noise=of)
                held += f"{np.mean((low <= value) & (value <= high)):8.2f}"
            held, chosen = held[16:], f"rank {model.rank_}, {model.inference_}"
        line = f"{make.__name__:10}{seed:5}{len(train):7}  {name:14}"
        print(f"{line}{error:8.3f}{held}{seconds:9.1f}  {chosen}".rstrip(), flush=True)


if __name__ == "__main__":
    main()
