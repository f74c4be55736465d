"""Coverage of the model's own intervals and of MAPIE's, where the model is wrong.

``python benchmarks/conformal.py`` needs ``pip install mapie``. Three sites follow two
functions. "normal" is the model's own noise; "heavy tails" has Student's t of two
degrees of freedom, "steps" functions that jump, which a squared exponential cannot
follow. Their rows are exchangeable. In "later" the last site is asked for where it was
never seen, so that they are not. CV+ is MAPIE's CrossConformalRegressor, of five folds
that have rows of every site. Shares of 95 % intervals that hold new observations, and
their width, over the draws.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from mapie.regression import CrossConformalRegressor
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.model_selection import TaskStratifiedKFold

SITE, NOISE, N_TEST = {"task_feature": "site"}, 0.2, 900
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


def covered(n_rows, job):
    """Coverage and width of each way, of one draw."""
    case, seed = job
    rng = np.random.default_rng([CASES.index(case), seed])
    X, y = draw(case, n_rows, rng)
    X_test, y_test = draw(case, N_TEST, rng, later=True)
    model = MultiTaskGPRegressor(rank=2, **SITE)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own = model.fit(X, y).predict_interval(X_test, 0.95)
        conformal = CrossConformalRegressor(
            MultiTaskGPRegressor(rank=2, **SITE),
            confidence_level=0.95,
            method="plus",
            cv=TaskStratifiedKFold(5, **SITE),
        )
        intervals = conformal.fit_conformalize(X, y).predict_interval(X_test)[1]
    rows = []
    for way, (lower, upper) in (("model", own), ("CV+", intervals[..., 0].T)):
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
