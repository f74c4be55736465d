"""
Reading the task covariance
===========================

A model has learned the torques of a robot arm under ten loads. What does it say about
the loads, and about the joint states that matter?
"""

# %%
# Ten loads
# ---------
# 15 samples of each, the torque of joint 2, rank 5. The loads go from 0.2 kg (load 1)
# to 2.8 kg (load 14).
import pandas as pd

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import load_puma560

loads = [1, 2, 4, 5, 7, 8, 10, 11, 13, 14]
robot = load_puma560(n_per_load=15, loads=loads)
model = make_inverse_dynamics_regressor(MultiTaskGPRegressor(rank=5))
model.fit(pd.DataFrame(robot.data, columns=robot.feature_names), robot.target[:, 1])

# %%
# All loads are alike, at first sight
# -----------------------------------
# Most of a torque is for the arm itself, whatever it carries, so that all correlations
# are near 1. The covariance of the loads' deviations from their average, on the right,
# says more: the light loads go together, and so do the heavy ones.
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
# The model was told which row is of which load, and no mass. The leading eigenvector
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

# %%
# Which joint states matter
# -------------------------
# The kernel is a sum of a linear part and a squared exponential, with a relevance for
# each feature: position q, velocity qd and acceleration qdd of each joint, and the
# signs of the velocities, which friction needs. Compare features within a part, not the
# two parts.
#
# The squared exponential listens to q2 and q3 most, the angles on which gravity acts.
# Dots in a column at the left are at their bound: the kernel does without. The largest
# linear weight is that of q1, on which gravity does not depend. On a few paths the
# joint states go together, and one can stand in for another: relevances tell what a
# model uses, not what causes the torque.
from skmtgp.inspection import KernelRelevanceDisplay

KernelRelevanceDisplay.from_estimator(model)
