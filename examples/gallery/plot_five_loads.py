"""
A path that a load has not followed
===================================

A robot arm has carried five loads along a few paths. Which torque does it need to carry
them along the other paths? This example draws the pictures of the tutorial
:doc:`/tutorials/robot`, which goes more slowly.
"""

# %%
# Five loads
# ----------
# There are 20 samples of each load. The target is the torque of joint 2. The test set
# has all 16 trajectories, and each load has been seen on two of them.
from skmtgp.datasets import load_puma560

loads = range(1, 6)
robot = load_puma560(n_per_load=20, loads=loads, as_frame=True)
test = load_puma560(subset="extrapolation", loads=loads, as_frame=True)
X, tau = robot.data, robot.target["tau2"]

# %%
# Two models
# ----------
# Both models share the paper's kernel among the loads. The second also learns how the
# loads are related, with a rank that BIC chooses. Both have the paper's settings: one
# mean, one unit and one noise variance for all loads.
from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    make_inverse_dynamics_regressor,
)

paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
search = RankSearchIC(MultiTaskGPRegressor(**paper), ranks=(2, 4, 5), criterion="bic")
models = {
    "iGP": make_inverse_dynamics_regressor(IndependentGP(**paper)),
    "mGP-BIC": make_inverse_dynamics_regressor(search),
}
for model in models.values():
    model.fit(X, tau)

# %%
# Which rank
# ----------
# From rank 2 to rank 4, BIC falls by hundreds. A fifth function adds one parameter and
# nothing to the likelihood.
import matplotlib.pyplot as plt

from skmtgp.inspection import RankSelectionDisplay

_, ax = plt.subplots(figsize=(5, 3.5), layout="constrained")
display = RankSelectionDisplay.from_estimator(models["mGP-BIC"][-1], ax=ax)

# %%
# Errors of each load
# -------------------
# These are the torques minus their predictions, on the paths of the test set.
from skmtgp.inspection import TaskResidualsDisplay

figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    TaskResidualsDisplay.from_estimator(model, test.data, test.target["tau2"], ax=ax)
    ax.set(ylabel="error of the torque, N m", title=name)

# %%
# How the loads are related
# -------------------------
# The arm's own weight is in all torques, so all correlations are near 1. Subtract the
# average of the loads, and the correlations show the effect of the loads. The light
# ones, c1 to c3, differ from the average in one direction, the heavier ones in the
# other.
from skmtgp.inspection import TaskCovarianceDisplay

_, ax = plt.subplots(figsize=(6, 4), layout="constrained")
display = TaskCovarianceDisplay.from_estimator(
    models["mGP-BIC"], kind="correlation", deviations=True, ax=ax
)
# sphinx_gallery_thumbnail_number = 3
