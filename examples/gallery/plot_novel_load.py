"""
A load that the robot never carried
===================================

A robot arm has carried seven loads, and now picks up an eighth. How many samples of the
new load does it need to predict the torques?

We compare two ways. Either the new load joins the model of the others
(:func:`skmtgp.add_task`), or it is learned alone from the same samples.
"""

# %%
# The seven loads
# ---------------
# There are 20 samples of each load. The target is the torque of joint 2. It is linear
# in four numbers of a load: its mass and its three first moments. Together with the
# torque of the arm itself this makes rank 5. The model is learned once, with the
# paper's settings: one mean, one unit and one noise variance for all loads.
from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import load_puma560

JOINT = 1  # counted from 0
known = [1, 3, 5, 7, 9, 11, 13]
X, tau = load_puma560(n_per_load=20, loads=known, return_X_y=True)
paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
fleet = make_inverse_dynamics_regressor(MultiTaskGPRegressor(rank=5, **paper))
fleet.fit(X, tau[:, JOINT])

# %%
# The new load
# ------------
# Load 15 is the heaviest, 3 kg. Its samples come from two trajectories, and it is
# tested on all 16. Only its row of the factor of the task covariance is learned, five
# numbers. Kernel and noise stay as they are.
from skmtgp import SingleTaskGP, add_task
from skmtgp.metrics import normalized_mean_squared_error

X_new, tau_new = load_puma560(loads=[15], return_X_y=True)
X_test, tau_test = load_puma560(subset="extrapolation", loads=[15], return_X_y=True)


def errors(rows):
    """NMSE of the model that was told these samples of load 15, by name."""
    X, y = X_new[rows], tau_new[rows, JOINT]
    alone = make_inverse_dynamics_regressor(SingleTaskGP()).fit(X, y)
    models = {"joins the others": add_task(fleet, X, y), "alone": alone}
    return {
        name: normalized_mean_squared_error(tau_test[:, JOINT], model.predict(X_test))
        for name, model in models.items()
    }


for name, error in errors(slice(5)).items():
    print(f"from five samples, {name}: nMSE {error:.1e}")

# %%
# More samples, and fewer
# -----------------------
# There are four random draws of each number of samples. A line is their median, and a
# band goes from the best to the worst. Two samples of a load that joins the others are
# worth more than twelve samples of a load learned alone.
import pandas as pd

from skmtgp.inspection import TaskLearningCurveDisplay

rows = [
    {"model": name, "n": n, "draw": draw, "error": error}
    for n in (2, 3, 5, 8, 12)
    for draw in range(4)
    for name, error in errors(slice(20 * draw, 20 * draw + n)).items()
]
table = pd.DataFrame(rows)
medians = table.pivot_table("error", "n", "model", aggfunc="median")
print(medians.to_string(float_format="{:.1e}".format))

display = TaskLearningCurveDisplay.from_results(table, ylabel="nMSE of load 15")
display.ax_.set_xlabel("samples of load 15")
