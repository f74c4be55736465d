"""A load that was never seen, from its inertial parameters: the Puma 560.

``python benchmarks/descriptors.py --joints 2 3 4 6`` learns each joint from 20 samples
of each of the loads 1 to 14, with the ten inertial parameters of the loads as
descriptors, and predicts load 15 on all its trajectories, of which there was no sample:
nMSE, and the share of errors within two deviations. ``--save FILE`` keeps the models,
which `identification.py` reads. ``--draw 1`` learns from the next 20 samples of each
load.
"""

import argparse
import pickle
import time

import numpy as np
import pandas as pd
from settings import PAPER

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import load_puma560

KNOWN, UNSEEN = range(1, 15), [15]
SUBSETS = "train", "interpolation", "extrapolation"
GOAL = {2: 1e-5, 3: 4e-6, 4: 4e-5, 6: 3e-7}  # nMSE
N_INERTIAL = 10


def training_rows(n_per_load, draw=0):
    """Some samples of each load: a draw has none of those of another."""
    X, torque = load_puma560(loads=KNOWN, descriptors="inertial", return_X_y=True)
    place = pd.Series(X[:, -1]).groupby(X[:, -1]).cumcount().to_numpy()
    chosen = place // n_per_load == draw
    return X[chosen], torque[chosen]


def learn(joint, *, kernel, rank, rows):
    """The fitted pipeline of a joint."""
    X, torque = rows
    places = range(-1 - N_INERTIAL, -1)
    model = make_inverse_dynamics_regressor(
        MultiTaskGPRegressor(rank=rank, **PAPER),
        kernel=kernel,
        task_descriptors=places,
    )
    return model.fit(X, torque[:, joint - 1])


def all_rows(loads):
    """Samples of some loads from all trajectories."""
    options = {"loads": loads, "descriptors": "inertial", "return_X_y": True}
    parts = [load_puma560(subset=subset, **options) for subset in SUBSETS]
    return (np.concatenate(of) for of in zip(*parts, strict=True))


def measure(model, joint):
    """NMSE of load 15, and the share of errors within two deviations."""
    X, torque = all_rows(UNSEEN)
    y = torque[:, joint - 1]
    mean, std = model.predict(X, return_std=True)
    nmse = np.square(mean - y).mean() / y.var()
    return nmse, np.mean(np.abs(mean - y) < 2.0 * std)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--joints", type=int, nargs="+", default=[1, 2, 3, 4, 5, 6])
    parser.add_argument("--kernel", default="geometric")
    parser.add_argument("--rank", type=int, default=5)
    parser.add_argument("--n-per-load", type=int, default=20)
    parser.add_argument("--draw", type=int, default=0)
    parser.add_argument("--save")
    arguments = parser.parse_args()
    options = {"kernel": arguments.kernel, "rank": arguments.rank}
    options["rows"] = training_rows(arguments.n_per_load, arguments.draw)
    models = {}
    print("joint   nMSE     goal   |z|<2  log likelihood  seconds")
    for joint in arguments.joints:
        begin = time.perf_counter()
        model = learn(joint, **options)
        seconds = time.perf_counter() - begin
        nmse, share = measure(model, joint)
        value = model[-1].log_marginal_likelihood_value_
        goal = f"{GOAL[joint]:.0e}" if joint in GOAL else "  -  "
        print(f"{joint:5} {nmse:8.1e} {goal} {share:6.2f} {value:12.1f} {seconds:9.0f}")
        models[f"tau{joint}"] = model
    if arguments.save:
        with open(arguments.save, "wb") as file:
            pickle.dump(models, file)


if __name__ == "__main__":
    main()
