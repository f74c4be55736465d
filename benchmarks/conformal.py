"""Coverage of the model's intervals and of conformal ones, where the model is wrong.

``python benchmarks/conformal.py`` needs ``pip install mapie``. Three sites follow two
functions. "normal" is the model's own noise; "heavy tails" has Student's t of two
degrees of freedom, "steps" functions that jump, which a squared exponential cannot
follow, and "unequal" four times the noise at one site. Their rows are exchangeable. In
"trajectories" only trajectories are, of five rows that share an offset. In "later" the
last site is asked for where it was never seen.

"LOO" is `conformal_interval`, also with ``by_task=True``. The rest is MAPIE's. Split
learns from half of the rows and takes the quantile of the other half, or of each task's
part of it. CV+ is CrossConformalRegressor, of five folds that have rows of every site,
and in "trajectories" whole ones. J+aB is JackknifeAfterBootstrapRegressor, of 20
subsamples of 0.6 of the rows. The table has shares of intervals that hold new
observations, of all sites and of the one where it is lowest on average, their
width and, by the spread of the draws, the standard error of the first. Some draws have
too few rows of a task for a quantile of each.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import chain, product

import numpy as np
import pandas as pd
from mapie.regression import (
    CrossConformalRegressor,
    JackknifeAfterBootstrapRegressor,
    SplitConformalRegressor,
)
from mapie.subsample import Subsample
from sklearn.model_selection import GroupShuffleSplit
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.model_selection import TaskStratifiedGroupKFold, TaskStratifiedKFold

NOISE, N_TEST, LENGTH = 0.2, 900, 5
CASES = "normal", "heavy tails", "steps", "unequal", "trajectories", "later"


def draw(case, n, rng, *, later=False):
    """Rows of three sites as numbers, what was measured, and which rows are alike."""
    number = np.arange(n) // (LENGTH if case == "trajectories" else 1)
    site, x = rng.integers(3, size=n)[number], rng.uniform(0.0, 8.0, n)[number]
    if case == "trajectories":
        x = x + np.arange(n) % LENGTH / 10.0
    if case == "later":
        x = np.where(site == 2, x / 2.0 + 4.0 * later, x)
    wave = np.sign(np.sin(x)) if case == "steps" else np.sin(x)
    f = np.where(site == 1, -wave, wave) + np.where(site == 2, np.cos(x), 0.0)
    noise = rng.standard_t(2, n) if case == "heavy tails" else rng.standard_normal(n)
    if case == "unequal":
        noise = noise * np.where(site == 1, 4.0, 1.0)
    if case == "trajectories":
        noise = rng.standard_normal(n)[number] + 0.2 * noise
    return np.column_stack([x, site]), f + NOISE * noise, number


def by_the_model(X, y, X_test, level):
    """The model's own intervals, and those that its leave-one-out errors scale."""
    model = MultiTaskGPRegressor(rank=2).fit(X, y)
    yield "model", model.predict_interval(X_test, level)
    yield "LOO", model.conformal_interval(X_test, level)
    if np.bincount(X[:, 1].astype(int)).min() + 1 >= 1.0 / (1.0 - level):
        yield "LOO by task", model.conformal_interval(X_test, level, by_task=True)


def by_split(X, y, number, X_test, level):
    """MAPIE's intervals from rows of their own, one quantile of all or of each task."""
    halves = GroupShuffleSplit(1, train_size=0.5, random_state=0)
    learn, rest = next(halves.split(X, y, number))
    model = MultiTaskGPRegressor(rank=2).fit(X[learn], y[learn])
    yield "split", _split(model, X[rest], y[rest], X_test, level)
    tasks = X[rest, 1]
    rows_of = [rest[tasks == site] for site in range(3)]
    if min(map(len, rows_of)) * (1.0 - level) > 1.0 - 1e-9:  # what MAPIE asks for
        ends = np.empty((2, len(X_test)))
        for site, rows in enumerate(rows_of):
            new = X_test[:, 1] == site
            ends[:, new] = _split(model, X[rows], y[rows], X_test[new], level)
        yield "split by task", ends


def _split(model, X, y, X_test, level):
    split = SplitConformalRegressor(model, level).conformalize(X, y)
    return split.predict_interval(X_test)[1][..., 0].T


def by_refits(X, y, number, X_test, level):
    """MAPIE's intervals from errors of models of folds or of subsamples."""
    model = MultiTaskGPRegressor(rank=2)
    folds, known = TaskStratifiedKFold(5), {}
    if number[-1] < len(y) - 1:
        folds, known = TaskStratifiedGroupKFold(5), {"groups": number}
    subsamples = Subsample(20, n_samples=0.6, replace=False, random_state=0)
    conformal = CrossConformalRegressor(model, level, method="plus", cv=folds)
    conformal.fit_conformalize(X, y, **known)
    yield "CV+", conformal.predict_interval(X_test)[1][..., 0].T
    conformal = JackknifeAfterBootstrapRegressor(model, level, resampling=subsamples)
    conformal.fit_conformalize(X, y)
    yield "J+aB", conformal.predict_interval(X_test)[1][..., 0].T


def covered(n_rows, level, job):
    """Coverage and width of each way, of one draw."""
    case, seed = job
    rng = np.random.default_rng([CASES.index(case), seed])
    X, y, number = draw(case, n_rows, rng)
    X_test, y_test, _ = draw(case, N_TEST, rng, later=True)
    rows = []
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for way, (lower, upper) in chain(
            by_the_model(X, y, X_test, level),
            by_split(X, y, number, X_test, level),
            by_refits(X, y, number, X_test, level),
        ):
            held = (lower <= y_test) & (y_test <= upper)
            sites = {site: held[X_test[:, 1] == site].mean() for site in range(3)}
            of = {"held": held.mean(), **sites, "width": np.mean(upper - lower)}
            rows.append({"case": case, "way": way, **of, "draws": 1})
    return rows


def main():
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="draws of each case")
    parser.add_argument("--rows", type=int, default=150, help="to learn from")
    parser.add_argument("--level", type=float, default=0.95, help="of the intervals")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    jobs = list(product(args.cases, range(args.seeds)))
    with ProcessPoolExecutor(args.jobs) as pool:
        found = [
            row
            for of in pool.map(partial(covered, args.rows, args.level), jobs)
            for row in of
        ]
    groups = pd.DataFrame(found).groupby(["case", "way"], sort=False)
    means, sums = groups.mean(), groups["draws"].sum()
    table = means[["held", "width"]].round(3)
    table.insert(1, "error", groups["held"].sem().round(3))
    table.insert(2, "least of a site", means[[0, 1, 2]].min(axis=1).round(3))
    print(table.assign(draws=sums).to_string())


if __name__ == "__main__":
    main()
