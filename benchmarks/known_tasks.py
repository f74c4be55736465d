"""Which payload does a drone carry: known ones, and others, by models with noise.

``python benchmarks/known_tasks.py`` draws accelerations by drag of a drone with five
payloads, along 12 s each, with noise, and learns a model of three outputs. Then a
TaskIdentifier is asked of flights of 5 s, with each of these payloads and with another
one. "floor" is its parameter. "right" is the share of flights with known payloads whose
payload is named, "None" that of other flights that are said to be of none of them,
"surely wrong" the share of all that are wrong with a probability above 0.95, and "log
probability" that of the truth, averaged.
"""

import argparse
import warnings

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, TaskIdentifier

PAYLOADS = {  # linear drag and quadratic drag
    "empty": (0.20, 0.020),
    "cam": (0.26, 0.035),
    "box": (0.34, 0.060),
    "tank": (0.42, 0.040),
    "lidar": (0.30, 0.050),
}
NOISE, FLIGHTS, FLOORS = 0.25, 6, (1e-4, "auto", 0.1)
STATE = ["vx", "vy", "vz"]


def flight(drags, rng, seconds, step):
    """Velocities along a smooth trajectory, and noisy accelerations by drag."""
    t, (linear, quadratic) = np.arange(0.0, seconds, step), drags

    def velocity(size):
        f, p = rng.uniform(0.1, 0.7, 4), rng.uniform(0.0, 6.28, 4)
        return size * np.sin(6.28 * f * t[:, None] + p).sum(axis=1) / np.sqrt(2.0)

    x, y, z = map(velocity, (2.5, 2.0, 0.7))
    speed = np.hypot(x, y)
    of_x = -linear * x - quadratic * speed * x
    of_y = -1.2 * linear * y - quadratic * speed * y
    f = np.column_stack([of_x, of_y, -2.0 * linear * z])
    noise = NOISE * rng.standard_normal(f.shape)
    return pd.DataFrame(np.column_stack([x, y, z]), columns=STATE), f + noise


def learned(rng):
    """A model of the known payloads."""
    flights = [flight(of, rng, 12.0, 0.1) for of in PAYLOADS.values()]
    names = np.repeat(list(PAYLOADS), len(flights[0][0]))
    X = pd.concat([X for X, _ in flights], ignore_index=True).assign(load=names)
    return MultiTaskGPRegressor(task_feature="load").fit(
        X, np.vstack([Y for _, Y in flights])
    )


def asked(model, tests):
    """For each floor and test: the truth, whether it is known, and its probability."""
    for floor in FLOORS:
        identifier = TaskIdentifier(model, floor=floor)
        for name, X, Y in tests:
            found = identifier.predict_proba(X, Y)
            told = identifier.classes_[found.argmax()]
            truth = found[identifier.classes_.tolist().index(name)]
            yield {
                "floor": str(floor),
                "known": name is not None,
                "right": told == name,
                "surely wrong": told != name and found.max() > 0.95,
                "log probability": np.log(max(truth, 1e-12)),
            }


def main():
    """Draw, learn, ask and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=7)
    rows = []
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in range(parser.parse_args().draws):
            rng = np.random.default_rng(seed)
            model = learned(rng)
            other = rng.uniform(0.15, 0.45), rng.uniform(0.02, 0.07)
            drags = PAYLOADS | {None: other}
            tests = [
                (name, *flight(of, rng, 5.0, 0.02))
                for name, of in drags.items()
                for _ in range(FLIGHTS)
            ]
            rows += asked(model, tests)
    table = pd.DataFrame(rows)
    of_floors = table.groupby("floor", sort=False)
    right = table.groupby(["floor", "known"], sort=False)["right"].mean().unstack()
    found = of_floors[["surely wrong", "log probability"]].mean()
    found = found.assign(right=right[True], none=right[False])
    names = {"none": "None"}
    print(found[["right", "none", *found.columns[:2]]].rename(columns=names).round(2))


if __name__ == "__main__":
    main()
