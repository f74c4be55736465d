"""Which load is it? The Puma 560, all six joints.

``python benchmarks/descriptors.py --save models.pkl``, then ``python
benchmarks/identification.py models.pkl --repetitions 400 --loads 200`` draws samples of
load 15, 3 kg, which the models have not seen, and estimates its ten inertial
parameters, from torques with 1 % of noise and without: median error of the mass, and
how many parameters are within two deviations. Those that are told have a deviation of
less than half of what is known before. Of those that are measured the samples alone say
as much: if the prior does not know how the parameters of loads go together. Then the
same of 200 loads that are drawn as those of the models were, one estimate of each. The
error by least squares is that on the true equations of motion. It needs Pinocchio, and
so do the loads that are drawn. Last a stream of known loads at 20 Hz, switched every
0.5 s. First, how exact the models are. ``--seed 1`` draws other loads.

Without noise the error of an estimate is that of the models, and one load has much the
same whatever is drawn. So give several files, of models from other samples
(``descriptors.py --draw 1``): they take turns.
"""

import argparse
import pickle
import time
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from descriptors import KNOWN, N_INERTIAL, UNSEEN, all_rows

from skmtgp import TaskIdentifier
from skmtgp.datasets import load_puma560
from skmtgp.datasets._loads import INERTIAL, MASS_RANGE, draw_loads
from skmtgp.datasets._robot import link_torques
from skmtgp.identification import _population

N_SAMPLES = 1, 2, 4, 8, 16
NOISES = 0.01, 0.0  # shares of the torques' deviation
GOAL = {4: 8.0, 16: 3.0}  # grams
PER_SECOND = 20


def known_loads():
    """Inertial parameters of load 15, (10,), and of those of the models, (14, 10)."""
    loads = load_puma560(n_per_load=1).loads.iloc[:, -N_INERTIAL:].to_numpy(float)
    return loads[-1], loads[:-1]


def states_and_slopes():
    """Rows and torques of load 15, and d torque / d parameters, (n_rows, 6, 10)."""
    X, torque = all_rows(UNSEEN)
    truth, _ = known_loads()
    states = [np.ascontiguousarray(of) for of in np.split(X[:, :18], 3, axis=1)]
    steps = 1e-4 * np.diag(np.maximum(np.abs(truth), 1e-2))
    with_load = link_torques(*states, truth)
    slopes = [
        (link_torques(*states, truth + step) - with_load) / step.sum() for step in steps
    ]
    return X, torque, np.stack(slopes, axis=2)


def drawn_loads(n, seed=0):
    """Loads that are drawn as those of the data, of masses over the same range."""
    masses = np.linspace(*MASS_RANGE, n)
    return draw_loads(masses, np.random.RandomState(seed))[INERTIAL].to_numpy(float)


def relative_errors(models, loads, data):
    """Of predictions of unseen loads, relative to the targets of the fits."""
    (X, torque, slopes), (load_15, _) = data, known_loads()
    squares = np.empty((len(loads), len(models)))
    for row, load in zip(squares, loads, strict=True):
        X_of_load = X.copy()
        X_of_load[:, -1 - N_INERTIAL :] = [*load, 0]  # a label that is new
        y = torque + slopes @ (load - load_15)
        means = [model.predict(X_of_load) for model in models.values()]
        row[:] = np.square(np.transpose(means) - y).mean(axis=0)
    deviations = [model[-1].y_train_.std() for model in models.values()]
    return np.sqrt(squares.mean(axis=0)) / deviations


def estimates(draws, noise, n, loads, data):
    """Errors of the parameters and their covariances, one of n samples for each load.

    Torques are linear in a load's parameters. The models of all draws take turns.
    """
    (X, torque, slopes), (load_15, _) = data, known_loads()
    deviation, rng = noise * torque.std(axis=0), np.random.default_rng(0)
    identifiers = [
        TaskIdentifier(list(models.values()), noise=deviation) for models in draws
    ]
    errors, covariances = [], []
    for load, identifier in zip(loads, cycle(identifiers)):
        rows = rng.choice(len(X), n, replace=False)
        y = torque[rows] + slopes[rows] @ (load - load_15)
        y = y + deviation * rng.standard_normal(y.shape)
        mean, covariance = identifier.estimate(X[rows], y)
        errors.append(mean.to_numpy() - load)
        covariances.append(covariance.to_numpy())
    return np.array(errors), np.array(covariances)


def deviations(covariances):
    """Roots of the diagonals."""
    return np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))


def by_samples_alone(covariances, usual):
    """Deviations with a prior of independent parameters in place of the identifier's.

    In units of `usual`, the deviations of that prior.
    """
    descriptors = SimpleNamespace(table=known_loads()[1])
    _, scale = _population(descriptors, TaskIdentifier(None).widening)
    units = np.outer(usual, usual)
    told = np.linalg.inv(covariances / units) - np.linalg.inv(scale @ scale.T / units)
    values, vectors = np.linalg.eigh(told)  # information, negative by rounding
    spread = 1.0 / (1.0 + np.maximum(values, 0.0))
    return np.sqrt(np.einsum("kij,kj->ki", np.square(vectors), spread))


def shares(errors, covariances):
    """Shares of |z| < 2: of the mass, of what is told, and of what is measured."""
    usual = 2.0 * known_loads()[1].std(axis=0)
    std = deviations(covariances)
    within, told = np.abs(errors) < 2.0 * std, std < 0.5 * usual
    measured = by_samples_alone(covariances, usual) < 0.5
    return within[:, 0].mean(), within[told].mean(), within[measured].mean()


def bound(noise, n, repetitions, data):
    """Median error of the mass in g, by least squares on the equations of motion."""
    X, torque, slopes = data
    slopes = slopes / torque.std(axis=0)[:, None]
    rng, errors = np.random.default_rng(0), []
    for _ in range(repetitions):
        rows = rng.choice(len(X), n, replace=False)
        A = slopes[rows].reshape(-1, N_INERTIAL)
        drawn = noise * rng.standard_normal(len(A))
        errors.append(1e3 * abs(np.linalg.lstsq(A, drawn, rcond=None)[0][0]))
    return np.median(errors)


def measure(draws, noise, n, repetitions, drawn, data):
    """A line of the table."""
    begin = time.perf_counter()
    of_15 = estimates(draws, noise, n, [known_loads()[0]] * repetitions, data)
    seconds = (time.perf_counter() - begin) / repetitions
    of_drawn = estimates(draws, noise, n, drawn, data)
    goal = f"({GOAL[n]:.0f} g)" if n in GOAL and noise else ""
    exact = f"{bound(noise, n, 400, data):6.2f} g" if n > 1 and noise else " " * 8
    found = " ".join(f"{of:5.2f}" for of in (*shares(*of_15), *shares(*of_drawn)))
    error = 1e3 * np.median(np.abs(of_15[0][:, 0]))
    return f"{noise:4.0%} {n:3} {error:6.2f} g {goal:6} {exact}  {found} {seconds:6.2f}"


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
    parser.add_argument("models", nargs="+", help="files, of one draw each")
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--loads", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the loads drawn")
    parser.add_argument("--switches", type=int, default=40)
    parser.add_argument("--samples", type=int, nargs="+", default=N_SAMPLES)
    parser.add_argument("--noises", type=float, nargs="+", default=NOISES)
    arguments = parser.parse_args()
    draws = [pickle.loads(Path(of).read_bytes()) for of in arguments.models]
    data = states_and_slopes()
    drawn = drawn_loads(arguments.loads, arguments.seed)
    print("errors of the models, of drawn loads, relative to the targets of the fits:")
    for models in draws:
        found = relative_errors(models, drawn, data)
        found = np.append(found, np.sqrt(np.square(found).mean()))
        names = [*models, "all"]
        print(*(f"{name} {of:.1e}" for name, of in zip(names, found, strict=True)))
    print(
        "load 15, 3 kg: median error of the mass (goal), by true equations of motion, "
        "|z|<2:\nmass, told, measured; |z|<2 of drawn loads: mass, told, measured; "
        "seconds"
    )
    for noise in arguments.noises:
        for n in arguments.samples:
            line = measure(draws, noise, n, arguments.repetitions, drawn, data)
            print(line, flush=True)
    print("noise  right from the third sample on  within three")
    for noise in arguments.noises:
        after, within = stream(draws[0], noise, arguments.switches)
        print(f"{noise:5.0%} {after:20.3f} {within:20.3f}")


if __name__ == "__main__":
    main()
