"""
A robot arm under six loads
===========================

The torques that move a robot arm depend on the load in its hand. We have only 20
samples of each load. Does it help to learn the loads together?
"""

# %%
# Six loads, from 0.2 kg to 2.8 kg
# --------------------------------
# Half of the samples of a load are from a trajectory common to all loads, half from its
# own trajectory. The target is the torque of joint 3. The test set has all 16
# trajectories: each load is predicted on paths that it never followed, but some other
# load did.
from skmtgp.datasets import load_puma560

JOINT = 2  # counted from 0
loads = [1, 3, 5, 8, 11, 14]
X, tau = load_puma560(n_per_load=20, loads=loads, return_X_y=True)
X_test, tau_test = load_puma560(subset="extrapolation", loads=loads, return_X_y=True)
print(f"{len(X)} samples to learn from, {len(X_test)} to be predicted")

# %%
# Four models
# -----------
# All models have the paper's kernel. All but the first also have the paper's settings:
# one mean, one unit and one noise variance for all loads. They differ in what the loads
# share: nothing, the kernel, everything, or as much as the data show. A torque is
# linear in the mass of a load and its three first moments. With the torque of the arm
# itself this makes rank 5.
import pandas as pd

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)
from skmtgp.metrics import normalized_mean_squared_error

paper = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
models = {
    "each load alone": SingleTaskGP(),
    "a shared kernel": IndependentGP(**paper),
    "one function": PooledGP(noise="shared"),
    "multi-task, rank 5": MultiTaskGPRegressor(rank=5, **paper),
}


def errors(model):
    """Errors of each load, nMSE, on the paths of the test set."""
    regressor = make_inverse_dynamics_regressor(model).fit(X, tau[:, JOINT])
    predicted = regressor.predict(X_test)
    return {
        load: normalized_mean_squared_error(
            tau_test[X_test[:, -1] == load, JOINT], predicted[X_test[:, -1] == load]
        )
        for load in loads
    }


table = pd.DataFrame({name: errors(model) for name, model in models.items()})
print(table.T.to_string(float_format="{:.1e}".format))

# %%
# Errors of each load
# -------------------
# The errors are mean squared errors divided by the variance of the torques. A shared
# kernel helps little, and treating all loads as one does not help at all. The
# multi-task model learns from the other loads how the arm moves on paths that are new
# to a load. Its errors are tens to a thousand times smaller.
import matplotlib.pyplot as plt

from skmtgp.inspection import color_of

figure, ax = plt.subplots(figsize=(6.4, 4.6), layout="constrained")
for (name, column), marker in zip(table.items(), "ovsD", strict=True):
    style = {"color": color_of(models[name]), "marker": marker, "ms": 9}
    ax.plot(range(len(loads)), column, lw=1.5, label=name, **style)
ax.set(yscale="log", xlabel="load", ylabel="nMSE on paths new to the load")
ax.set_xticks(range(len(loads)), loads)
ax.grid(axis="y", alpha=0.3)
figure.legend(loc="outside upper center", ncols=2, frameon=False, fontsize=12)

gain = table.drop(columns="multi-task, rank 5").min(axis=1)
gain /= table["multi-task, rank 5"]
print(f"the best other model's nMSE over that of rank 5: {gain.min():.0f} to ", end="")
print(f"{gain.max():.0f}")
