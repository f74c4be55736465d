"""The data of levels_and_units.py: drawn, or read from a folder.

Each function gives a Draw; its docstring says what is free and was chosen so that the
settings of the paper fare as badly as they do on such data. Tasks are numbers from 0 in
the last column of X, so that levels and units are arrays by task.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
from sklearn.gaussian_process.kernels import RBF

JITTER = 1e-8  # of the covariance of a smooth function, to draw from it
METALS = ["Cd", "Ni", "Zn"]
FREQUENCY = 1.0  # of the sites' sines
N_JURA = 259  # rows where all metals are known; Ni and Zn are at 100 more


class Draw(NamedTuple):
    """Noisy training rows, and the function where it is to be predicted.

    Attributes
    ----------
    X, y : ndarray of shape (n_samples, n_features), (n_samples,)
        Training rows, with the task in the last column.
    X_test, f_test : ndarray of shape (n_test, n_features), (n_test,)
        Inputs to predict, and the function there without noise.
    levels : ndarray of shape (n_tasks,), default=None
        The true ones.
    """

    X: np.ndarray
    y: np.ndarray
    X_test: np.ndarray
    f_test: np.ndarray
    levels: np.ndarray | None = None

    @property
    def tasks(self):
        """Task of each training row."""
        return self.X[:, -1].astype(int)

    @property
    def tasks_test(self):
        """Task of each row to predict."""
        return self.X_test[:, -1].astype(int)


def smooth(x, length_scale, n_functions, rng):
    """Functions drawn at the rows of x from a squared exponential, in columns."""
    K = RBF(length_scale)(x) + JITTER * np.eye(len(x))
    return np.linalg.cholesky(K) @ rng.standard_normal((len(x), n_functions))


def sites(seed=0, *, times=1.0, units=False):
    """Six sites, 50 rows each: levels from -5 to 40, signals of deviation 1.5.

    Free: a sine of each of two features on [0, 6], with phases of the sites a sixth of
    a period apart, so that the signals are of rank 2; noise of 0.3. `times` multiplies
    the levels, `units` measures each site in a unit of its own, 1 to 1000.
    """
    rng = np.random.default_rng(1000 + seed)
    x, site = rng.uniform(0.0, 6.0, (300, 2)), np.repeat(np.arange(6), 50)
    phase = rng.permutation(6) * np.pi / 3.0
    f = np.sin(FREQUENCY * x + phase[site, None]).sum(axis=1)
    signal = f * 1.5 / f.std() + 0.3 * rng.standard_normal(300)
    levels = np.linspace(-5.0, 40.0, 6)
    unit = np.logspace(0.0, 3.0, 6)[rng.permutation(6)] if units else np.ones(6)
    X = np.column_stack([x, site])
    return X, unit[site] * (times * levels[site] + signal)


def short_tasks(seed):
    """Twelve tasks of eight rows, levels of deviation 4, functions of deviation 1.

    Free: each task's function is a combination of two smooth ones (length-scale 0.8 on
    [0, 6]), rows are one in each eighth of the range, noise is 0.05.
    """
    rng = np.random.default_rng(seed)
    task, test = np.repeat(np.arange(12), 8), np.repeat(np.arange(12), 50)
    eighth = np.tile(np.arange(8), 12)
    x = 6.0 * (eighth + rng.uniform(0.0, 1.0, 96)) / 8.0
    x = np.concatenate([x, np.tile(np.linspace(0.0, 6.0, 50), 12)])
    t = np.concatenate([task, test])
    levels = 4.0 * rng.standard_normal(12)
    weights = rng.standard_normal((12, 2)) / np.sqrt(2.0)
    f = levels[t] + np.sum(smooth(x[:, None], 0.8, 2, rng) * weights[t], axis=1)
    X, y = np.column_stack([x, t]), f[:96] + 0.05 * rng.standard_normal(96)
    return Draw(X[:96], y, X[96:], f[96:], levels)


def jura(folder, *, logarithms=False):
    """Jura's metals melted from wide to long, and what Cd is at the last 100 rows."""
    table = pd.read_csv(folder / "jura" / "jura.csv")[["X", "Y", *METALS]]
    truth = table["Cd"][N_JURA:].to_numpy(copy=True)
    new = table.loc[N_JURA:, ["X", "Y"]].assign(task="Cd")
    table.loc[N_JURA:, "Cd"] = np.nan
    if logarithms:
        table[METALS] = np.log(table[METALS])
    rows = table.melt(["X", "Y"], var_name="task").dropna()
    return rows[["X", "Y", "task"]], rows["value"], new, truth


def sensors(seed, unit=1.0):
    """A precise sensor with 300 rows and one with 30, of 100 times the noise variance.

    Free: both see a sine, the second a slower cosine, too; the noise has deviations of
    0.1 and 1. The second measures in another `unit`.
    """
    rng = np.random.default_rng(seed)
    task, test = np.repeat([0, 1], [300, 30]), np.repeat([0, 1], 100)
    x = rng.uniform(0.0, 6.0, 330)
    x_test = np.tile(np.linspace(0.0, 6.0, 100), 2)

    def f(x, task):
        other = unit * (np.sin(x) + 0.3 * np.cos(0.5 * x))
        return np.where(task == 0, np.sin(x), other)

    y = f(x, task) + np.where(task == 0, 0.1, unit) * rng.standard_normal(330)
    X, X_test = np.column_stack([x, task]), np.column_stack([x_test, test])
    return Draw(X, y, X_test, f(x_test, test))


def schools(seed):
    """139 schools of five pupils: a level of each, one function of 27 inputs.

    Free: the function is drawn, length-scale 4, deviation 1, inputs are normal; levels
    have a deviation of 0.2, noise of 0.8. Ten more pupils of each are predicted.
    """
    rng = np.random.default_rng(seed)
    task = np.tile(np.repeat(np.arange(139), 5), 3)
    n, x = 695, rng.standard_normal((3 * 695, 27))
    g = smooth(x, 4.0, 1, rng)[:, 0]
    levels = 0.2 * rng.standard_normal(139)
    f = levels[task] + (g - g.mean()) / g.std()
    X, y = np.column_stack([x, task]), f[:n] + 0.8 * rng.standard_normal(n)
    return Draw(X[:n], y, X[n:], f[n:], levels)


def confounded(seed, *, season=False, own_levels=False):
    """Six tasks seen in different ranges of x, predicted over all of it.

    Free: 20 rows each, noise 0.2. All tasks are the same function, but for levels of
    deviation 1 if `own_levels`. It is a steep trend with a ripple, of which each task
    sees a window of 4 of [0, 12], shifted by 1.6 from one to the next; or, if `season`,
    a year's wave, of which four tasks see all months and two see summer alone.
    """
    rng = np.random.default_rng(seed)
    task, test = np.repeat(np.arange(6), 20), np.repeat(np.arange(6), 60)
    start = np.array([0, 0, 0, 0, 4, 4]) if season else 1.6 * np.arange(6)
    width = np.array([12, 12, 12, 12, 4, 4]) if season else np.full(6, 4.0)
    x = start[task] + width[task] * rng.uniform(0.0, 1.0, 120)
    x_test = np.tile(np.linspace(0.0, 12.0, 60), 6)
    levels = rng.standard_normal(6) * own_levels

    def f(x, task):
        wave = -3.0 * np.cos(2.0 * np.pi * x / 12.0)
        return levels[task] + (wave if season else x + np.sin(x))

    y = f(x, task) + 0.2 * rng.standard_normal(120)
    X, X_test = np.column_stack([x, task]), np.column_stack([x_test, test])
    return Draw(X, y, X_test, f(x_test, test), levels)
