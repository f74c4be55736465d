"""
What does the robot carry? A load tracked sample by sample
==========================================================

A robot arm puts down one load and picks up another, and nobody tells it. A model of
other loads finds the mass of the new load, sample by sample, from the torques that its
motors need. It also finds when the load changes.
"""

# %%
# Learn from known loads
# ----------------------
# A simulated Puma 560 moves 14 loads along eight trajectories, in the same 80 states
# each. Ten numbers describe a load: its mass, three first moments and six moments of
# inertia. They are columns of X, the ``task_descriptors``. Torques are linear in them.
# Three of the six joints are enough here, and each has its own model.
from sklearn.base import clone

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import make_puma560

options = {"tool": "moving", "descriptors": "inertial", "as_frame": True}
puma = make_puma560(n_samples=10, speeds=[10.0, 5.0], **options)
known = puma.data["load"] != "c15"  # the heaviest, of 3 kg, stays unknown
inertial, joints = list(puma.data.columns[18:28]), ["tau2", "tau3", "tau5"]

estimator = MultiTaskGPRegressor(
    rank=4,
    task_feature="load",
    task_levels=False,
    normalize_y="shared",
    noise="shared",
    tol=1.0,
)
model = make_inverse_dynamics_regressor(
    estimator, kernel="geometric", task_descriptors=inertial, task_feature="load"
)
models = {
    joint: clone(model).fit(puma.data[known], puma.target.loc[known, joint])
    for joint in joints
}

# %%
# A stream of measurements
# ------------------------
# The arm moves along another trajectory for 7 s. It carries load c3 of 0.6 kg, then the
# unknown c15 of 3 kg, then c8 of 1.6 kg. The measurement error of a torque is 1 % of
# its standard deviation.
import numpy as np
import pandas as pd

test = make_puma560(n_samples=1000, speeds=[7.0], **options)
carried = np.repeat(["c3", "c15", "c8"], [200, 400, 400])
rows = np.flatnonzero(test.trajectory == "p2s1")  # 1000 of each load, one after another
rows = rows.reshape(15, 1000)[[int(load[1:]) - 1 for load in carried], np.arange(1000)]
states = test.data.iloc[rows, :18].to_numpy()
deviations = puma.target[joints].std().to_numpy()
rng = np.random.default_rng(0)
torques = test.target.iloc[rows][joints].to_numpy()
torques = torques + 0.01 * deviations * rng.standard_normal(torques.shape)

# %%
# Track the load
# --------------
# ``compile_predictor`` makes a fast function of the models. ``DescriptorTracker`` uses
# it to solve for the descriptors: each sample gives one linear equation for each joint.
# If no small change of the descriptors explains a sample, the load must be another one.
# The tracker then forgets what it knew.
from skmtgp import DescriptorTracker, compile_predictor

tracker = DescriptorTracker(compile_predictor(models), 0.01 * deviations, start="c3")
found = []
for state, torque in zip(states, torques, strict=True):
    tracker.update(state, torque)
    found.append((tracker.descriptors[0], np.sqrt(tracker.covariance[0, 0])))

path = pd.DataFrame(found, columns=["mass", "std"])
path["truth"] = test.loads.loc[carried, "mass"].to_numpy()
path.iloc[[199, 200, 201, 205, 220, 599, 600, 601, 605, 620, 999]].round(3)

# %%
# One sample is enough to find the mass of a new load within some 30 g. After a second
# of motion it is known within a few grams. Later on the standard deviations are too
# small. They assume that errors are independent from sample to sample, but the errors
# of the model change slowly along a motion.
import matplotlib.pyplot as plt

seconds = np.arange(1000) * 7e-3
figure, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
axes[0].plot(seconds, path["truth"], color="0.6", lw=4, label="what it carries")
axes[0].plot(seconds, path["mass"], label="what it finds")
axes[0].set_ylabel("mass (kg)")
axes[0].legend()
axes[1].semilogy(seconds, 1e3 * np.abs(path["mass"] - path["truth"]), ".", ms=3)
axes[1].semilogy(seconds, 2e3 * path["std"], color="0.4", label="two deviations")
axes[1].set(xlabel="seconds", ylabel="error (g)", ylim=(0.02, 200))
axes[1].legend()
plt.show()
