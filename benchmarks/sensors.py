"""How often intervals of the tutorial on sensors hold, in other draws of its data.

``python benchmarks/sensors.py`` draws the growth of docs/tutorials/sensors.md by other
seeds: four sites of 30 rows, one of 6. It prints the share of 95 % intervals that hold
new observations, and the mean squared error, by the mode of the hyperparameters and by
draws of them; a row for each seed, and their average. The tutorial's own is seed 1.
"""

import argparse
import warnings

import numpy as np
import pandas as pd
from sklearn.metrics import mean_squared_error
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, RankSearchIC

AMOUNTS = {"a": (5, 1), "b": (4, 2), "c": (6, 0.5), "d": (3, 3), "e": (5, 2)}
ROWS = dict.fromkeys("abcd", 30) | {"e": 6}
TEST_ROWS, NOISE = 200, 0.05


def measure(site, n, rng):
    """Rows of a site, as the tutorial draws them."""
    temperature, moisture = rng.uniform(5, 35, n), rng.uniform(0.05, 0.6, n)
    warm = np.exp(-(((temperature - 22) / 8) ** 2))
    wet = moisture / (0.2 + moisture)
    a, b = AMOUNTS[site]
    growth = a * warm * wet + b * wet + NOISE * rng.standard_normal(n)
    inputs = {"site": site, "temperature": temperature, "moisture": moisture}
    return pd.DataFrame(inputs), pd.Series(growth)


def draw(rows, rng):
    """So many rows of each site."""
    parts = [measure(site, n, rng) for site, n in rows.items()]
    return [pd.concat(of, ignore_index=True) for of in zip(*parts, strict=True)]


def measured(seed):
    """Shares that hold, and errors, of a draw."""
    rng, found = np.random.default_rng(seed), {"seed": seed}
    X, y = draw(ROWS, rng)
    X_test, y_test = draw(dict.fromkeys(AMOUNTS, TEST_ROWS), rng)
    for way in ("mode", "sampled"):
        estimator = MultiTaskGPRegressor(task_feature="site", hyperparameters=way)
        model = RankSearchIC(estimator, ranks=(1, 2, 3)).fit(X, y)
        lower, upper = model.predict_interval(X_test, 0.95)
        held = (np.asarray(lower) <= y_test) & (y_test <= np.asarray(upper))
        found[f"held, {way}"] = held.mean()
        found[f"error, {way}"] = mean_squared_error(y_test, model.predict(X_test))
    return found


def main():
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40)
    arguments = parser.parse_args()
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = [measured(seed) for seed in range(arguments.seeds)]
    table = pd.DataFrame(rows).set_index("seed")
    print(table.round(4).to_string())
    summary = pd.DataFrame({"mean": table.mean(), "standard error": table.sem()})
    print(summary.round(4).to_string())


if __name__ == "__main__":
    main()
