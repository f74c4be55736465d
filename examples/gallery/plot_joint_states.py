"""
Which joint states matter
=========================

The torque of a joint depends on 18 numbers: the positions, velocities and accelerations
of all joints. Which of them does a model use?
"""

# %%
# Ten loads
# ---------
# There are 15 samples of each load. The target is the torque of joint 2. The features
# are named after the columns of the frame. The model has the paper's settings: one
# mean, one unit and one noise variance for all loads.
import pandas as pd

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import load_puma560

loads = [1, 2, 4, 5, 7, 8, 10, 11, 13, 14]
robot = load_puma560(n_per_load=15, loads=loads)
X, tau = pd.DataFrame(robot.data, columns=robot.feature_names), robot.target[:, 1]
paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
model = make_inverse_dynamics_regressor(MultiTaskGPRegressor(rank=5, **paper))
model.fit(X, tau)

# %%
# The relevance of each
# ---------------------
# The kernel is a sum of a linear part and a squared exponential. Each part has a
# relevance for each feature: position q, velocity qd and acceleration qdd of each
# joint, and the signs of the velocities, which model friction. Compare features within
# a part, but not between the parts. A dot at the left edge marks a feature at its
# bound, which the kernel does not use.
from skmtgp.inspection import KernelRelevanceDisplay

display = KernelRelevanceDisplay.from_estimator(model)

# %%
# The most relevant
# -----------------
# The squared exponential depends most on q2 and q3, the angles on which gravity acts.
# The largest linear weight is that of q1, on which gravity does not depend. On a few
# paths the joint states are correlated, so one of them can replace another. Relevances
# show what a model uses, not what causes the torque.
table = pd.DataFrame(display.relevances.T, display.feature_names, display.parts)
for part, column in table.items():
    print(f"{part}\n{column.nlargest(4).to_string(float_format='{:.2g}'.format)}\n")
