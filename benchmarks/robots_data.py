"""Robots to learn: training rows and test sets of each case and draw."""

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from skmtgp.datasets import (
    fetch_kinova_gen3,
    make_puma560,
    prepare_trajectory,
    puma560_urdf,
)

ROUGH = {"stribeck": 0.5, "load_friction": 0.05}
SLOWEST = 0.005  # rad/s; slower than this in all joints a robot stands still


class Case(NamedTuple):
    """What a model learns from, and what it is tested on."""

    urdf: str
    X: np.ndarray
    Y: np.ndarray
    tests: dict  # name: (X, Y)
    friction: tuple = ("viscous", "asymmetric", "rotor")  # what models are given
    prior: str = (
        "evidence"  # "nominal" where the URDF has masses, and not the true ones
    )


# --- the simulated Puma 560 ---------------------------------------------------------

PER_TRAJECTORY, PER_LOAD, PER_TEST, LOADS = 400, 20, 300, 14
OWN = [
    *("p1s1", "p4s1", "p3s2", "p3s3", "p2s4", "p2s1", "p1s2"),
    *("p4s2", "p4s3", "p3s4", "p3s1", "p2s2", "p1s3", "p1s4"),
]
COMMON = "p2s3"  # as in the paper, each load has this trajectory and one of its own


def puma(draw, **options):
    """14 loads, 20 samples of each, on two trajectories; test: these, and all 16."""
    made = make_puma560(n_samples=PER_TRAJECTORY, random_state=draw, **options)
    rng, load = np.random.default_rng(draw), made.data[:, -1]
    parts = {"train": [], "interpolation": [], "extrapolation": []}
    for m, own in enumerate(OWN[:LOADS], start=1):
        here = load == m
        known = here & np.isin(made.trajectory, [COMMON, own])
        rows = rng.permutation(np.flatnonzero(known))
        parts["train"].append(rows[:PER_LOAD])
        parts["interpolation"].append(rows[PER_LOAD : PER_LOAD + PER_TEST])
        others = rng.permutation(np.flatnonzero(here & ~known))
        parts["extrapolation"].append(others[:PER_TEST])
    rows = {name: np.concatenate(found) for name, found in parts.items()}
    sets = {name: (made.data[i], made.target[i]) for name, i in rows.items()}
    return Case(puma560_urdf(), *sets.pop("train"), sets)


# --- a UR10e ------------------------------------------------------------------------

# Denavit-Hartenberg parameters that Universal Robots publishes: a, d (m), alpha (rad)
A = 0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0
D = 0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655
ALPHA = np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0
# N m/A: desired torques over desired currents of the recordings at rest, p1 to p5
GAINS = np.array([11.98, 11.98, 9.84, 10.77, 10.77, 10.77])
EMPTY, LOADED, HEAVY = 0, 2805, 2600  # grams, as its publishers say
RECORDINGS = {
    "ur-20_01_31-unload": EMPTY,
    "ur-20_01_31-load": LOADED,
    "ur-19_12_23_free": EMPTY,
    "ur-20_01_13-load_2600": HEAVY,
}
CUTOFF, BLOCK, N_BLOCKS = 10.0, 2.0, 4  # Hz, seconds, of which one is held out


def ur10e_urdf():
    """Its joints; links of any mass, which least squares does not need."""
    body = (
        '<inertial><origin xyz="0 0 0.1"/><mass value="1"/><inertia ixx="0.1" ixy="0" '
        'ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
    )
    limit = '<limit lower="-7" upper="7" effort="400" velocity="9"/>'
    parts = ['<robot name="ur10e"><link name="link0"/>']
    steps = [(0.0, 0.0, 0.0), *zip(A, D, ALPHA, strict=True)]
    for j, (a, d, alpha) in enumerate(steps[:6]):
        parts += [
            f'<link name="link{j + 1}">{body}</link>',
            f'<joint name="joint{j + 1}" type="revolute"><parent link="link{j}"/>',
            f'<child link="link{j + 1}"/><axis xyz="0 0 1"/>{limit}',
            f'<origin xyz="{a} 0 {d}" rpy="{alpha} 0 0"/></joint>',
        ]
    return "".join([*parts, "</robot>"])


@lru_cache
def recording(folder, name):
    """States with the load, torques and seconds, of rows that move."""
    raw = pd.read_csv(Path(folder) / "ur10e" / f"{name}.csv.gz", header=None)
    raw = raw.to_numpy(float)
    time, q, qd, current = raw[:, 0], raw[:, 1:7], raw[:, 7:13], raw[:, 13:19]
    made = prepare_trajectory(time - time[0], q, current * GAINS, qd, cutoff=CUTOFF)
    time, values = made["time"].to_numpy(), made.drop(columns="time").to_numpy()
    X = np.column_stack([values[:, :18], np.full(len(values), RECORDINGS[name])])
    moves = (np.abs(X[:, 6:12]) > SLOWEST).any(axis=1)
    return X[moves], values[moves, 18:], time[moves]


def blocks(time, draw):
    """Whether a row is in a block of time that is held out."""
    return (time // BLOCK).astype(int) % N_BLOCKS == draw % N_BLOCKS


def together(parts):
    """Rows of some sets."""
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


def two_loads(draw, folder):
    """100 samples of each of two loads; test: blocks, another trajectory (empty)."""
    rng, train, held = np.random.default_rng(draw), [], []
    for name in list(RECORDINGS)[:2]:
        X, Y, time = recording(folder, name)
        out = blocks(time, draw)
        rows = rng.choice(np.flatnonzero(~out), 100, replace=False)
        train.append((X[rows], Y[rows]))
        held.append((X[out], Y[out]))
    X, Y, _ = recording(folder, "ur-19_12_23_free")
    tests = {"blocks of time": together(held), "other trajectory": (X, Y)}
    return Case(ur10e_urdf(), *together(train), tests)


def third_load(draw, folder):
    """The same, and 10 samples of a third load on another trajectory: its blocks."""
    known = two_loads(draw, folder)
    X, Y, time = recording(folder, "ur-20_01_13-load_2600")
    out = blocks(time, draw) | blocks(time, draw + 2)
    rng = np.random.default_rng(draw)
    rows = rng.choice(np.flatnonzero(~out), 10, replace=False)
    train = together([(known.X, known.Y), (X[rows], Y[rows])])
    return Case(known.urdf, *train, {"new load": (X[out], Y[out])})


# --- a Kinova Gen3 ------------------------------------------------------------------

KINOVA_BLOCK = 0.4  # seconds


def kinova(draw, data_home, known):
    """150 samples of some recordings; test: blocks of these, and another recording."""
    made = fetch_kinova_gen3(data_home=data_home, rate=250.0)
    X, Y, of = made.data, made.target, made.recording
    here = np.isin(of, known)
    out = (made.time // KINOVA_BLOCK).astype(int) % N_BLOCKS == draw % N_BLOCKS
    rng = np.random.default_rng(draw)
    rows = rng.choice(np.flatnonzero(here & ~out), 150, replace=False)
    tests = {"blocks of time": (X[here & out], Y[here & out])}
    other = {"run": "same motion again", "quadratic": "other trajectory"}[known[-1]]
    name = {"run": "repeated", "quadratic": "run"}[known[-1]]
    tests[other] = X[of == name], Y[of == name]
    return Case(made.urdf, X[rows], Y[rows], tests, ("viscous", "coulomb"), "nominal")


def cases(data, data_home):
    """What can be made of a draw, by name."""
    found = {
        "puma": lambda draw: puma(draw),
        "puma-stribeck": lambda draw: puma(draw, **ROUGH),
        "kinova": lambda draw: kinova(draw, data_home, ["quadratic", "run"]),
        "kinova-one": lambda draw: kinova(draw, data_home, ["quadratic"]),
    }
    if data is not None:
        found["ur10e"] = lambda draw: two_loads(draw, data)
        found["ur10e-third"] = lambda draw: third_load(draw, data)
    return found
