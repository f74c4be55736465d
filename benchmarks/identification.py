"""Which load is it? The Puma 560, all six joints.

``python benchmarks/descriptors.py --save models.pkl``, then
``python benchmarks/identification.py models.pkl --repetitions 400`` draws samples of
load 15, 3 kg, which the models have not seen, and estimates its ten inertial
parameters, from torques with 1 % of noise and without: median error of the mass, and
how many of the parameters that are told (to less than half of what is known before) are
within two deviations; beside it the error by least squares on the true equations of
motion, which needs Pinocchio. Then a stream of known loads at 20 Hz, switched every
0.5 s.
"""

import argparse
import pickle
import time

import numpy as np
from descriptors import KNOWN, N_INERTIAL, UNSEEN, all_rows

from skmtgp import TaskIdentifier
from skmtgp.datasets import load_puma560
from skmtgp.datasets._robot import link_torques

N_SAMPLES = 1, 2, 4, 8, 16
NOISES = 0.01, 0.0  # shares of the torques' deviation
GOAL = {4: 8.0, 16: 3.0}  # grams
PER_SECOND = 20


def estimates(models, noise, n, repetitions):
    """Errors of the mass in g, z-scores, and whether parameters are told."""
    X, torque = all_rows(UNSEEN)
    loads = load_puma560(n_per_load=1).loads.iloc[:, -N_INERTIAL:].to_numpy(float)
    truth, usual = loads[-1], 2.0 * loads[:-1].std(axis=0)
    deviation, rng = noise * torque.std(axis=0), np.random.default_rng(0)
    identifier = TaskIdentifier(list(models.values()), noise=deviation)
    errors, scores, told = [], [], []
    for _ in range(repetitions):
        rows = rng.choice(len(X), n, replace=False)
        y = torque[rows] + deviation * rng.standard_normal((n, len(deviation)))
        mean, covariance = identifier.estimate(X[rows], y)
        std = np.sqrt(np.diagonal(covariance))
        errors.append(1e3 * abs(mean.iloc[0] - truth[0]))
        scores.append((mean.to_numpy() - truth) / std)
        told.append(std < 0.5 * usual)
    return np.array(errors), np.array(scores), np.array(told)


def bound(noise, n, repetitions):
    """Median error of the mass in g, by least squares on the equations of motion."""
    X, torque = all_rows(UNSEEN)
    truth = load_puma560(n_per_load=1).loads.iloc[-1, -N_INERTIAL:].to_numpy(float)
    states = [np.ascontiguousarray(of) for of in np.split(X[:, :18], 3, axis=1)]
    steps = 1e-4 * np.diag(np.maximum(np.abs(truth), 1e-2))
    with_load = link_torques(*states, truth)
    slopes = [
        (link_torques(*states, truth + step) - with_load) / step.sum() for step in steps
    ]
    slopes = np.stack(slopes, axis=2) / torque.std(axis=0)[:, None]
    rng, errors = np.random.default_rng(0), []
    for _ in range(repetitions):
        rows = rng.choice(len(X), n, replace=False)
        A = slopes[rows].reshape(-1, N_INERTIAL)
        drawn = noise * rng.standard_normal(len(A))
        errors.append(1e3 * abs(np.linalg.lstsq(A, drawn, rcond=None)[0][0]))
    return np.median(errors)


def stream(models, noise, n_switches):
    """Share of samples, from the third after a switch on, with the right load."""
    X, torque = all_rows(KNOWN)
    rng, n = np.random.default_rng(0), PER_SECOND // 2
    loads = [KNOWN[0]]
    while len(loads) < n_switches:
        loads.append(rng.choice([k for k in KNOWN if k != loads[-1]]))
    rows = np.concatenate(
        [rng.choice(np.flatnonzero(X[:, -1] == k), n, replace=False) for k in loads]
    )
    deviation = noise * torque.std(axis=0)
    y = torque[rows] + deviation * rng.standard_normal((len(rows), len(deviation)))
    identifier = TaskIdentifier(list(models.values()), noise=deviation)
    best = identifier.partial_fit(X[rows], y).path_.argmax(axis=1)
    right = identifier.classes_[best].reshape(-1, n) == np.array(loads)[:, None]
    return right[:, 2:].mean(), right[:, :3].any(axis=1).mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("models")
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--switches", type=int, default=40)
    arguments = parser.parse_args()
    with open(arguments.models, "rb") as file:
        models = pickle.load(file)
    print(
        "noise  samples  median error of the mass (goal), by true equations of motion, "
        "|z|<2: mass, told, seconds"
    )
    for noise in NOISES:
        for n in N_SAMPLES:
            begin = time.perf_counter()
            errors, z, told = estimates(models, noise, n, arguments.repetitions)
            seconds = (time.perf_counter() - begin) / arguments.repetitions
            goal = f"({GOAL[n]:.0f} g)" if n in GOAL and noise else ""
            exact = f"{bound(noise, n, 400):6.2f} g" if n > 1 and noise else " " * 8
            mass, all_told = (np.mean(np.abs(of) < 2.0) for of in (z[:, 0], z[told]))
            print(
                f"{noise:5.0%} {n:8} {np.median(errors):15.2f} g {goal:15} "
                f"{exact} {mass:6.2f} {all_told:6.2f} {seconds:14.2f}",
                flush=True,
            )
    print("noise  right from the third sample on  within three")
    for noise in NOISES:
        after, within = stream(models, noise, arguments.switches)
        print(f"{noise:5.0%} {after:20.3f} {within:20.3f}")


if __name__ == "__main__":
    main()
