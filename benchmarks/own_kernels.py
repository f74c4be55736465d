"""Whether the model that SeveralKernelsWarning names is better.

``python benchmarks/own_kernels.py --draws 20`` fits the default, and where it warns the
model with the parameters that the warning names, to

- two speeds: four tasks of 25 rows, each with more or less of a slow function and of a
  fast one;
- drifts: six sensors of 25 rows that see the same function, and drift apart;
- panels: 15 countries in 20 years, of which three quarters of the rows are known, with
  levels, slopes in time, three covariates that count and one that does not, and shocks
  of the years that all feel;
- simulations: 25 rows of a cheap one and six of a dear one, without noise, which differ
  by a line;
- the problems of ordinary.py, in every class in turn.

"told" is how many fits warn. "error" is the geometric mean of the root mean squared
error of the model that is named over that of the default, "better" the share of fits in
which it is lower. "coverage" is of 95 % intervals of y, before and after. "seconds" is
the share of the default fit that both questions take.
"""

import argparse
import re
import warnings

import numpy as np
import pandas as pd
from separate import asked, ordinary
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared, Matern
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.exceptions import SeveralKernelsWarning
from skmtgp.kernels import Columns

N_TEST = 60
QUESTIONS = "gain_of_own_kernels", "common_function"
KNOWN = {of.__name__: of for of in (Columns, ExpSineSquared, Matern, RBF)}
END = r"\)\. This|\), with"  # of the parameters that are named


def two_speeds(rng):
    """Training rows, rows to predict with their noise, and their function."""
    a, b = rng.normal(0.0, 1.0, (2, 4))

    def draw(n):
        task, x = np.repeat(np.arange(4), n), rng.uniform(0.0, 12.0, 4 * n)
        f = 3.0 * a[task] * np.sin(x / 4.0) + b[task] * np.cos(3.0 * x)
        return np.column_stack([x, task]), f

    return with_noise(draw, 25, 0.1, rng)


def drifts(rng):
    """The same of sensors."""
    slope, level = rng.normal(0.0, 0.15, 6), rng.normal(20.0, 2.0, 6)
    phase, speed = rng.uniform(0.0, 6.0, 4), rng.uniform(0.3, 1.5, 4)

    def draw(n):
        task, x = np.repeat(np.arange(6), n), rng.uniform(0.0, 20.0, 6 * n)
        f = level[task] + slope[task] * x + np.sin(np.outer(x, speed) + phase).sum(1)
        return np.column_stack([x, task]), f

    return with_noise(draw, 25, 0.2, rng)


def panels(rng):
    """The same of a panel: rows that are left out are to be predicted."""
    n, years = 15, np.arange(20.0)
    x, shock = rng.standard_normal((n, 20, 4)), rng.normal(0.0, 0.5, 20)
    level, slope = rng.normal(0.0, 2.0, n), rng.normal(0.1, 0.05, n)
    f = level[:, None] + np.outer(slope, years) + shock + x @ [0.8, -0.5, 0.3, 0.0]
    y = (f + rng.normal(0.0, 0.4, f.shape)).ravel()
    task, year = np.repeat(np.arange(n), 20), np.tile(years, n)
    X = np.column_stack([year, x.reshape(-1, 4), task])
    new = rng.random(len(y)) < 0.25
    return X[~new], y[~new], X[new], y[new], f.ravel()[new]


def simulations(rng):
    """The same of two simulations; the dear one is to be predicted."""
    a, b, c = rng.uniform(10.0, 14.0), rng.uniform(0.4, 0.6), rng.uniform(5.0, 12.0)

    def dear(x):
        return (6.0 * x - 2.0) ** 2 * np.sin(a * x - 4.0)

    x = np.r_[rng.uniform(0.0, 1.0, 25), (np.arange(6) + rng.uniform(0.0, 1.0, 6)) / 6]
    task = np.repeat([0, 1], [25, 6])
    y = np.where(task == 1, dear(x), b * dear(x) + c * (x - 0.5) - 5.0)
    x_test = np.linspace(0.0, 1.0, N_TEST)
    X_test, f = np.column_stack([x_test, np.ones(N_TEST)]), dear(x_test)
    return np.column_stack([x, task]), y, X_test, f, f


def with_noise(draw, n, noise, rng):
    """Rows with noise, and rows with and without."""
    (X, f), (X_test, f_test) = draw(n), draw(N_TEST)
    y, y_test = (of + noise * rng.standard_normal(len(of)) for of in (f, f_test))
    return X, y, X_test, y_test, f_test


def drawn(draw, n):
    """The data sets of a kind."""
    for seed in range(n):
        yield draw(np.random.default_rng(seed))


def ordinary_rows(n):
    """Problems of all classes in turn, whose coverage is of f."""
    for X, y, X_test, f_test in ordinary(n):
        yield X, y, X_test, f_test, f_test


def advised(caught):
    """The parameters that a warning names; None without one."""
    told = [str(of.message) for of in caught if of.category is SeveralKernelsWarning]
    if not told:
        return None
    named = told[0].split("Try MultiTaskGPRegressor(")[1]
    return eval(f"dict({re.split(END, named)[0]})", KNOWN)


def scores(model, X, y, f):
    """Root mean squared error, and coverage."""
    low, high = model.predict_interval(X, 0.95)
    error = np.sqrt(np.square(model.predict(X) - f).mean())
    return error, np.mean((low <= y) & (y <= high))


def row(X, y, X_test, y_test, f_test):
    """What one data set says."""
    model, caught, share = asked(X, y, *QUESTIONS)
    found = {"told": False, "share": share}
    if (options := advised(caught)) is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            named = MultiTaskGPRegressor(**options).fit(X, y)
        before, after = (scores(of, X_test, y_test, f_test) for of in (model, named))
        found |= {"told": True, "error": after[0] / before[0]}
        found |= {"before": before[1], "after": after[1]}
    return found


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=20)
    n = parser.parse_args().draws
    draws = two_speeds, drifts, panels, simulations
    kinds = {draw.__name__.replace("_", " "): draw for draw in draws}
    sets = {name: drawn(draw, n) for name, draw in kinds.items()}
    lines = []
    with threadpool_limits(1):
        for kind, of_kind in (sets | {"ordinary": ordinary_rows(8 * n)}).items():
            found = pd.DataFrame([row(*of) for of in of_kind])
            line = {"data": kind, "fits": len(found), "told": found["told"].sum()}
            if line["told"]:
                told = found[found["told"]]
                line["error"] = np.exp(np.log(told["error"].astype(float)).mean())
                line["better"] = (told["error"] < 1.0).mean()
                line |= told[["before", "after"]].astype(float).mean()
            lines.append(line | {"seconds": found["share"].mean()})
    print(pd.DataFrame(lines).to_string(index=False, float_format="%.3f"))


if __name__ == "__main__":
    main()
