"""Coverage of the model's intervals and of conformal ones, where the model is wrong.

``python benchmarks/conformal.py`` needs ``pip install mapie``. Three sites follow two
functions. "normal" is the model's own noise; "heavy tails" has Student's t of two
degrees of freedom, "steps" functions that jump, which a squared exponential cannot
follow. Their rows are exchangeable. In "later" the last site is asked for where it was
never seen, so that they are not. "LOO" scales the model's intervals by leave-one-out
errors. CV+ is MAPIE's CrossConformalRegressor, of five folds that have rows of every
site. J+aB is its JackknifeAfterBootstrapRegressor, of 20 subsamples of 0.6 of the rows.
Shares of 95 % intervals that hold new observations, and their width, over the draws.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import chain, product

import numpy as np
import pandas as pd
from mapie.regression import CrossConformalRegressor, JackknifeAfterBootstrapRegressor
from mapie.subsample import Subsample
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.model_selection import TaskStratifiedKFold

SITE, NOISE, N_TEST, LEVEL = {"task_feature": "site"}, 0.2, 900, 0.95
CASES = "normal", "heavy tails", "steps", "later"


def draw(case, n, rng, *, later=False):
    """Rows of three sites, and what was measured."""
    site, x = rng.choice(["a", "b", "c"], n), rng.uniform(0.0, 8.0, n)
    if case == "later":
        x = np.where(site == "c", x / 2.0 + 4.0 * later, x)
    wave = np.sign(np.sin(x)) if case == "steps" else np.sin(x)
    f = np.where(site == "b", -wave, wave) + np.where(site == "c", np.cos(x), 0.0)
    noise = rng.standard_t(2, n) if case == "heavy tails" else rng.standard_normal(n)
    return pd.DataFrame({"x": x, "site": site}), f + NOISE * noise


def by_the_model(X, y, X_test):
    """The model's own intervals, and those that its leave-one-out errors scale."""
    model = MultiTaskGPRegressor(rank=2, **SITE).fit(X, y)
    mean, std = model.loo_predict(include_noise=True)
    rank = np.ceil(LEVEL * (len(y) + 1)) / len(y)
    q = np.quantile(np.abs(y - mean) / std, rank, method="higher")
    mean, std = model.predict(X_test, return_std=True, include_noise=True)
    yield "model", model.predict_interval(X_test, LEVEL)
    yield "LOO", (mean - q * std, mean + q * std)


def by_mapie(X, y, X_test):
    """Intervals of MAPIE."""
    model = MultiTaskGPRegressor(rank=2, **SITE)
    folds = TaskStratifiedKFold(5, **SITE)
    subsamples = Subsample(20, n_samples=0.6, replace=False, random_state=0)
    ways = {
        "CV+": CrossConformalRegressor(model, LEVEL, method="plus", cv=folds),
        "J+aB": JackknifeAfterBootstrapRegressor(model, LEVEL, resampling=subsamples),
    }
    for way, conformal in ways.items():
        _, intervals = conformal.fit_conformalize(X, y).predict_interval(X_test)
        yield way, intervals[..., 0].T


def covered(n_rows, job):
    """Coverage and width of each way, of one draw."""
    case, seed = job
    rng = np.random.default_rng([CASES.index(case), seed])
    X, y = draw(case, n_rows, rng)
    X_test, y_test = draw(case, N_TEST, rng, later=True)
    rows = []
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for way, (lower, upper) in chain(
            by_the_model(X, y, X_test), by_mapie(X, y, X_test)
        ):
            share = np.mean((lower <= y_test) & (y_test <= upper))
            width = np.mean(upper - lower)
            rows.append({"case": case, "way": way, "coverage": share, "width": width})
    return rows


def main():
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="draws of each case")
    parser.add_argument("--rows", type=int, default=120, help="to learn from")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    jobs = list(product(CASES, range(args.seeds)))
    with ProcessPoolExecutor(args.jobs) as pool:
        found = [
            row for of in pool.map(partial(covered, args.rows), jobs) for row in of
        ]
    groups = pd.DataFrame(found).groupby(["case", "way"], sort=False)
    print(groups.mean().round(3).unstack("way").to_string())


if __name__ == "__main__":
    main()
