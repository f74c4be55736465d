"""
Torque along a trajectory, with its band
========================================

A robot arm has to follow a path that it never followed with the load in its hand. Which
torque will joint 2 need, and how certain is the prediction? Other loads have followed
the path. Does that help?
"""

# %%
# Six loads
# ---------
# There are 15 samples of each load, from its own trajectory and from one common to all
# loads, p2s3. Load 3 has not followed the common one yet. The torque sensor has an
# error of 1 N m.
import numpy as np

from skmtgp.datasets import load_puma560

JOINT, LOAD, NOISE = 1, 3, 1.0  # joint 2, counted from 0; N m
rng = np.random.default_rng(0)
loads = [1, 3, 5, 7, 9, 12]
robot = load_puma560(loads=loads)
load_of_row = robot.data[:, -1]
allowed = (load_of_row != LOAD) | (robot.trajectory != "p2s3")
known = np.concatenate(
    [np.flatnonzero(allowed & (load_of_row == load))[:15] for load in loads]
)
X = robot.data[known]
y = robot.target[known, JOINT] + NOISE * rng.standard_normal(len(known))

# %%
# Two models
# ----------
# :class:`~skmtgp.IndependentGP` shares the kernel among the loads.
# :class:`~skmtgp.MultiTaskGPRegressor` also learns how the loads are related. As in the
# paper, the loads have one mean, one unit and one noise variance.
from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    make_inverse_dynamics_regressor,
)

paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
regressors = {
    "independent": IndependentGP(**paper),
    "multi-task, rank 2": MultiTaskGPRegressor(rank=2, **paper),
}
models = {
    name: make_inverse_dynamics_regressor(regressor)
    for name, regressor in regressors.items()
}
for model in models.values():
    model.fit(X, y)

# %%
# Load 3 on the path that is new to it
# ------------------------------------
# The rows are in random order and have no time. But the path is a figure of eight: the
# base swings to and fro once, so its angle and velocity give the phase.
new = load_puma560(subset="interpolation", loads=[LOAD])
on_path = new.trajectory == "p2s3"
X_path, clean = new.data[on_path], new.target[on_path, JOINT]
measured = clean + NOISE * rng.standard_normal(len(clean))
angle, velocity = X_path[:, 0], X_path[:, 6]
swing = angle - (angle.max() + angle.min()) / 2
phase = np.arctan2(swing / swing.max(), velocity / velocity.max())

# %%
# The band contains a new measurement with probability 0.95. The torque jumps where the
# velocity of the joint changes its sign: that is friction.
import matplotlib.pyplot as plt

from skmtgp.inspection import TrajectoryDisplay

figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    TrajectoryDisplay.from_estimator(model, X_path, measured, time=phase, ax=ax)
    ax.set(xlabel="phase along the path, rad", ylabel="torque of joint 2, N m")
    ax.set_title(name, pad=28)

# %%
# The multi-task model has smaller errors and a narrower band, which contains nearly as
# many measurements as it should. Its standard deviation is about that of the sensor.
# The other loads have determined the rest.
from skmtgp.metrics import coverage

for name, model in models.items():
    mean, std = model.predict(X_path, return_std=True, include_noise=True)
    error = np.sqrt(np.mean((mean - clean) ** 2))
    inside = coverage(measured, mean, std, level=0.95)
    print(
        f"{name}: error {error:.2f} N m, standard deviation {std.mean():.2f} N m, "
        f"{inside:.0%} inside the band"
    )
