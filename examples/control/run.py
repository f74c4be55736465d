"""A robot arm picks up an unknown load and stays on its path.

``python examples/control/run.py`` learns the inverse dynamics of a simulated Puma 560
under 14 loads, in 160 states each, with the loads' inertial parameters as descriptors.
Then the arm follows the paper's paths at 1 kHz. Halfway, the light load in its hand
becomes one of 3 kg, which the model has never seen. The controllers differ in the
torques that they send ahead; a soft spring corrects what is left.

For each controller it prints root mean square errors of the joints' positions (the norm
over six joints, in mrad): before the pick-up, in the 0.2 s after it, from 0.2 to 1 s
after it, and later. It also prints the computing time for a period of 1 ms, on one
core. The figure has the errors of one path. It needs Pinocchio and matplotlib.
"""

import argparse
import gc
import json
import pickle
import time
from functools import cache, partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
from controllers import (
    Controller,
    Exact,
    Joining,
    LeastSquares,
    Nearest,
    Regression,
    RigidBodies,
    Switching,
    Tracking,
    Weighted,
)
from plant import CONTROL, Puma, Reference, torques, training_states

from skmtgp import IndependentGP, MultiTaskGPRegressor, compile_predictor
from skmtgp import make_inverse_dynamics_regressor as make_model
from skmtgp.datasets import load_puma560, puma560_urdf
from skmtgp.inspection import COLORS, color_of
from skmtgp.robot import RigidBodyRegressor

OUTPUT = Path(__file__).parents[1] / "output"
PHASES = {"before": (-9e9, 0.0), "0.2 s": (0.0, 0.2), "to 1 s": (0.2, 1.0)}
PHASES["later"] = 1.0, 9e9
N_STATES, N_SHAKEN = 160, 100  # that models learn from; of these of shaken motions
FIRST, SECOND = 0, 14  # positions of the loads: c1 of 0.2 kg, c15 of 3 kg


# The colour of the model that a controller has; of the multi-task one the best way to
# use it has it, and what is compared with that, the others.
LOOKS = {
    "PD alone": COLORS[6],
    "rigid bodies, empty hand": color_of(RigidBodyRegressor(None)),
    "mGP, the nearest known load": COLORS[3],
    "mGP, MMST": COLORS[5],
    "mGP, MOSAIC": COLORS[5],
    "mGP, partial_fit": COLORS[0],
    "GP of each load, regression": color_of(IndependentGP()),
    "rigid bodies, least squares": color_of(RigidBodyRegressor(None)),
    "mGP, tracked load": color_of(MultiTaskGPRegressor()),
    "true equations, told the load": "black",
}
STYLES = {"mGP, MOSAIC": "--"}  # it lies upon MMST
STYLES["rigid bodies, empty hand"] = ":"


def rows_of(loads, n_shaken):
    """The same states under each load, and their torques."""
    states = training_states(N_STATES - n_shaken, n_shaken, np.random.default_rng(0))
    labels = np.repeat(np.arange(1.0, len(loads) + 1), len(states))
    described = np.repeat(loads, len(states), axis=0)
    X = np.column_stack([np.tile(states, (len(loads), 1)), described, labels])
    return X, np.vstack([torques(states, load) for load in loads])


def learn(loads, make, n_shaken):
    """A model of each joint, of all loads."""
    X, y = rows_of(loads, n_shaken)
    return {f"tau{j + 1}": make(X, y[:, j]) for j in range(6)}


def least_squares(loads, n_shaken=N_SHAKEN):
    """Links and friction by least squares, from the same rows."""
    X, y = rows_of(loads, n_shaken)
    robot = pin.buildModelFromXML(puma560_urdf())
    descriptors = pd.DataFrame(loads, index=np.unique(X[:, -1]))
    regressor = RigidBodyRegressor(robot).fit(np.delete(X, range(18, 28), axis=1), y)
    return LeastSquares(regressor, robot, descriptors)


def multi_task(X, y, **parameters):
    """A multi-task model of rank 5."""
    model = MultiTaskGPRegressor(
        rank=5, task_levels=False, normalize_y="shared", noise="shared"
    )
    return make_model(model, kernel="geometric", **parameters).fit(X, y)


LEARNED = {
    "described": partial(multi_task, task_descriptors=range(18, 28)),
    "labelled": lambda X, y: multi_task(np.delete(X, range(18, 28), axis=1), y),
    "alone": lambda X, y: make_model(IndependentGP(), kernel="geometric").fit(
        np.delete(X, range(18, 28), axis=1), y
    ),
}


NEEDED = {  # kinds of models that a controller is made of; "described" if not here
    "mGP, partial_fit": {"labelled"},
    "GP of each load, regression": {"described", "alone"},
}


def needed(names):
    """The kinds of models that some controllers, or all, are made of."""
    if not names:
        return list(LEARNED)
    of_each = [NEEDED.get(name, {"described"}) for name in names]
    return [kind for kind in LEARNED if kind in set().union(*of_each)]


def learned(loads, folder, n_shaken=N_SHAKEN, kinds=LEARNED):
    """The models of some kinds, read from a folder if they are there."""
    found = {}
    for name in kinds:
        make = LEARNED[name]
        path = folder / f"{name}.pkl"
        if not path.exists():
            begin, models = time.time(), learn(loads, make, n_shaken)
            print(f"learned {name}: {time.time() - begin:.0f} s", flush=True)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(pickle.dumps(models))
        found[name] = pickle.loads(path.read_bytes())
    return found


def controllers(models, loads, deviations):
    """What is compared, by name; not all kinds of models need be there."""
    compiled = {kind: compile_predictor(of) for kind, of in models.items()}
    described, labelled = map(compiled.get, ("described", "labelled"))
    light, known = loads[FIRST], loads[:SECOND]
    first = next(iter(compiled.values())).tasks[FIRST]
    rigid = cache(lambda: least_squares(loads[:SECOND]))
    regression = cache(lambda: Regression(compiled["alone"], described.descriptors))
    return {
        "PD alone": Controller,
        "rigid bodies, empty hand": RigidBodies,
        "mGP, the nearest known load": lambda: Nearest(described, known, first),
        "mGP, MMST": lambda: Switching(described, deviations, first),
        "mGP, MOSAIC": lambda: Weighted(described, deviations, first),
        "mGP, partial_fit": lambda: Joining(
            labelled, models["labelled"], deviations, first
        ),
        "GP of each load, regression": lambda: Tracking(
            regression(), light, deviations
        ),
        "rigid bodies, least squares": lambda: Tracking(rigid(), light, deviations),
        "mGP, tracked load": lambda: Tracking(described, light, deviations),
        "true equations, told the load": lambda: Exact(light),
    }


def follow(reference, controller, loads, picked_up, **friction):
    """Follow the path: errors of each period, seconds of periods and of jobs."""
    light, heavy = loads[FIRST], loads[SECOND]
    robot = Puma(reference.q[0], reference.qd[0], light, **friction)
    n, jobs = len(reference.q), []
    errors, needed, worked = np.empty((n, 6)), np.empty(n), []
    for k in range(n):
        if k == picked_up:
            robot.carry(heavy)
            controller.picked_up(heavy)
        while jobs and jobs[0][0] <= k:
            controller.install(jobs.pop(0)[1])
        begin = time.thread_time()
        spring = controller.spring(reference.q[k], reference.qd[k], robot)
        torque = controller.torque(reference.ahead[k]) + spring
        needed[k] = time.thread_time() - begin
        q, qd = robot.q, robot.qd
        robot.step(torque)
        middle = 0.5 * (q + robot.q), 0.5 * (qd + robot.qd), CONTROL * (robot.qd - qd)
        begin = time.thread_time()
        job = controller.observe(np.concatenate(middle), torque)
        needed[k] += time.thread_time() - begin
        if job is not None:
            begin = time.thread_time()
            result = job()
            worked.append(time.thread_time() - begin)
            jobs.append((k + int(np.ceil(worked[-1] * CONTROL)), result))
        errors[k] = reference.q[(k + 1) % n] - robot.q
    return errors, needed, worked


def summary(errors, needed, worked, picked_up):
    """A row of the table."""
    square = np.square(errors).sum(axis=1)
    seconds = (np.arange(len(errors)) - picked_up) / CONTROL
    row = {}
    for name, (low, high) in PHASES.items():
        mean = square[(low <= seconds) & (seconds < high)].mean()
        row[f"{name}, mrad"] = 1e3 * np.sqrt(mean)
    row["99 % of periods, ms"] = 1e3 * np.quantile(needed, 0.99)
    row["in time, %"] = 100.0 * np.mean(needed < 1.0 / CONTROL)
    row["longest job, ms"] = 1e3 * max(worked, default=np.nan)
    return row


def draw(curves, picked_up, path):
    """Errors over time, on a logarithmic scale."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(8, 4.2), layout="constrained")
    for name, errors in curves.items():
        size = 1e3 * np.sqrt(np.square(errors).sum(axis=1))
        style = {"lw": 1.4, "color": LOOKS[name], "ls": STYLES.get(name), "label": name}
        ax.semilogy(np.arange(len(size)) / CONTROL, size, **style)
    ax.axvline(picked_up / CONTROL, color="0.5", ls="--", lw=0.8)
    ax.set(xlabel="seconds", ylabel="error of the joints' positions, mrad")
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def median_and_worst(table):
    """Of each controller over the paths."""
    of_paths = table.drop(columns="path").groupby("controller", sort=False)
    worst = of_paths.max()
    worst["in time, %"] = of_paths["in time, %"].min()
    return {"Median over the paths": of_paths.median(), "Worst": worst}


def main():
    """Learn, follow the paths and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, nargs="+", default=[1, 2, 3, 4])
    parser.add_argument("--speeds", type=int, nargs="+", default=[1, 2, 3, 4])
    parser.add_argument("--only", nargs="+", help="names of controllers")
    parser.add_argument("--stribeck", type=float, default=0.0)
    parser.add_argument(
        "--models", type=Path, default=OUTPUT / "control", help="folder of the models"
    )
    parser.add_argument(
        "--shaken", type=int, default=N_SHAKEN, help="states of shaken motions, of 160"
    )
    parser.add_argument("--seed", type=int, default=0, help="of when it picks up")
    parser.add_argument("--output", type=Path, help="file of the rows, JSON lines")
    parser.add_argument("--figure", type=Path, default=OUTPUT / "control.png")
    args = parser.parse_args()
    puma = load_puma560(n_per_load=20, descriptors="inertial")
    loads = puma.loads.iloc[:, -10:].to_numpy(float)
    models = learned(loads[:SECOND], args.models, args.shaken, needed(args.only))
    compared = controllers(models, loads, puma.target.std(axis=0))
    compared = {name: compared[name] for name in args.only or compared}
    rng, rows, curves = np.random.default_rng(args.seed), [], {}
    for path, speed in product(args.paths, args.speeds):
        reference = Reference(path, speed)
        picked_up = int(rng.uniform(0.2, 0.6) * len(reference.q))
        for name, make in compared.items():
            gc.unfreeze()
            gc.collect()
            gc.freeze()  # to look at all that is there by now would take 0.1 s
            told = follow(reference, make(), loads, picked_up, stribeck=args.stribeck)
            where = {"path": f"p{path}s{speed}", "controller": name}
            rows.append(where | summary(*told, picked_up))
            curves[name] = told[0]
            print(json.dumps(rows[-1]), flush=True)
        draw(curves, picked_up, args.figure)
    table = pd.DataFrame(rows)
    if args.output:
        table.to_json(args.output, orient="records", lines=True)
    for title, found in median_and_worst(table).items():
        print(f"\n{title}\n", found.round(3).to_string(), sep="\n")


if __name__ == "__main__":
    main()
