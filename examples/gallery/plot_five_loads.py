"""
A path that a load has not followed
===================================

A robot arm has carried five loads along a few paths. Which torque does it need on the
others? This draws the pictures of the tutorial :doc:`/tutorials/robot`, which goes more
slowly.
"""

# %%
# Five loads
# ----------
# 20 samples of each, and the torque of joint 2. The test set has all 16 trajectories;
# each load has been seen on two of them.
from skmtgp.datasets import load_puma560

loads = range(1, 6)
robot = load_puma560(n_per_load=20, loads=loads, as_frame=True)
test = load_puma560(subset="extrapolation", loads=loads, as_frame=True)
X, tau = robot.data, robot.target["tau2"]

# %%
# Two models
# ----------
# Both share the kernel of the paper among the loads. The second also learns how the
# loads are related, with a rank that BIC chooses. Both have the paper's settings: one
# mean, one unit and one noise variance for all loads.
from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    make_inverse_dynamics_regressor,
)

paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
search = RankSearchIC(MultiTaskGPRegressor(**paper), ranks=(2, 4, 5))
models = {
    "iGP": make_inverse_dynamics_regressor(IndependentGP(**paper)),
    "mGP-BIC": make_inverse_dynamics_regressor(search),
}
for model in models.values():
    model.fit(X, tau)

# %%
# Which rank
# ----------
# The criterion falls by hundreds from rank 2 to rank 4. A fifth function adds
# nothing to the likelihood, and one parameter more.
import matplotlib.pyplot as plt

from skmtgp.inspection import RankSelectionDisplay

_, ax = plt.subplots(figsize=(5, 3.5), layout="constrained")
display = RankSelectionDisplay.from_estimator(models["mGP-BIC"][-1], ax=ax)

# %%
# Errors of each load
# -------------------
# Torques less their predictions, on the paths of the test set.
from skmtgp.inspection import TaskResidualsDisplay

figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    TaskResidualsDisplay.from_estimator(model, test.data, test.target["tau2"], ax=ax)
    ax.set(ylabel="error of the torque, N m", title=name)

# %%
# How the loads are related
# -------------------------
# The arm itself is in all torques, and all correlations are near 1. Less the average of
# the loads they show what the loads do: the light ones, c1 to c3, differ from it in one
# direction, the heavier ones in the other.
from skmtgp.inspection import TaskCovarianceDisplay

_, ax = plt.subplots(figsize=(6, 4), layout="constrained")
display = TaskCovarianceDisplay.from_estimator(
    models["mGP-BIC"], kind="correlation", deviations=True, ax=ax
)
