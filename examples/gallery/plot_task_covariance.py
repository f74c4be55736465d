"""
Reading the task covariance
===========================

A model has learned the torques of a robot arm under ten loads. It was told nothing
about the loads. What does its task covariance say about them?
"""

# %%
# Ten loads
# ---------
# There are 15 samples of each load, the target is the torque of joint 2, and the rank
# is 5. The loads go from 0.2 kg (load 1) to 2.8 kg (load 14). As in the paper they have
# one mean, one unit and one noise variance. So only the task covariance tells them
# apart.
import pandas as pd

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import load_puma560

loads = [1, 2, 4, 5, 7, 8, 10, 11, 13, 14]
robot = load_puma560(n_per_load=15, loads=loads)
paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
model = make_inverse_dynamics_regressor(MultiTaskGPRegressor(rank=5, **paper))
model.fit(pd.DataFrame(robot.data, columns=robot.feature_names), robot.target[:, 1])

# %%
# All loads are alike, at first sight
# -----------------------------------
# Most of a torque moves the arm itself, whatever it carries. So all correlations are
# near 1. The right plot has the covariance of the loads' deviations from their average,
# which tells more: the light loads are alike, and so are the heavy ones.
import matplotlib.pyplot as plt

from skmtgp.inspection import TaskCovarianceDisplay

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
display = TaskCovarianceDisplay.from_estimator(model, kind="correlation", ax=left)
display.plot(deviations=True, ax=right)
for ax in (left, right):
    ax.set(xlabel="load", ylabel="load")

# %%
# What the deviations follow
# --------------------------
# The model knew which row belongs to which load, but no mass. The leading eigenvector
# of the covariance of deviations is the direction in which the loads differ most.
import numpy as np

K = model[-1].task_covariance_
centre = np.eye(len(K)) - 1 / len(K)
values, vectors = np.linalg.eigh(centre @ K @ centre)
mass = robot.loads.loc[[f"c{n}" for n in loads], "mass"]
print(f"share of the leading eigenvector: {values[-1] / values.sum():.2f}")
print(
    f"its correlation with the mass: {abs(np.corrcoef(vectors[:, -1], mass)[0, 1]):.3f}"
)
