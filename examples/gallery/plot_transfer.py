"""
Which tasks help each other, and which one does not belong
==========================================================

Six pumps of a plant were run at different speeds, and their power was measured. Five
are of the same make, worn to different degrees. The sixth is of another make, but
nobody remembers which one that is. Does each pump gain from learning them together?
"""

# %%
# Six pumps
# ---------
# The target is the power in kilowatts, at 20 settings of speed and valve opening for
# each pump.
import numpy as np
import pandas as pd

rng = np.random.default_rng(3)
size = {"p1": 1.0, "p2": 1.3, "p3": 0.8, "p4": 1.1, "p5": 0.9}


def power(pump, speed, valve):
    """Power without the error of measurement."""
    if pump == "p6":
        return 14 + 5 * np.sin(2.5 * speed - 4 * valve) + 2 * np.cos(6 * valve)
    return 12 + size[pump] * (6 * np.sin(2 * speed) * valve + 4 * speed**2)


def measure(pump, n):
    """Measurements at settings drawn at random."""
    speed, valve = rng.uniform(0.2, 1.8, n), rng.uniform(0.1, 1.0, n)
    watts = power(pump, speed, valve) + 0.4 * rng.standard_normal(n)
    return pd.DataFrame({"pump": pump, "speed": speed, "valve": valve, "power": watts})


data = pd.concat([measure(f"p{i}", 20) for i in range(1, 7)], ignore_index=True)
X, y = data.drop(columns="power"), data["power"]

# %%
# One model
# ---------
# A model of rank 1 assumes that all pumps are multiples of one function.
from skmtgp import MultiTaskGPRegressor

model = MultiTaskGPRegressor(rank=1, task_feature="pump").fit(X, y)
print(model.summary().round(2).to_string())

# %%
# What each pump gains
# --------------------
# Each measurement is predicted twice from the others: by the model, and by a model of
# the same pump alone. The left plot has the gain in log density with its 95 % interval,
# the right plot the errors.
import matplotlib.pyplot as plt

from skmtgp.inspection import TransferDisplay

figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4), layout="constrained")
display = TransferDisplay.from_estimator(model, ax=left)
display.plot(ax=right, kind="error")
columns = ["gain", "gain_std", "verdict", "evidence", "related"]
print(display.transfer[columns].round(2).to_string())

# %%
# Learning together harms pump 6, and it is not related to the others. So we learn it
# alone, and the others without it.
own = X["pump"] != "p6"
others = MultiTaskGPRegressor(rank=1, task_feature="pump").fit(X[own], y[own])
without = TransferDisplay.from_estimator(others).transfer
errors = {"with pump 6": display.transfer["error"], "without": without["error"]}
print(pd.DataFrame(errors).round(2).to_string())

# %%
# Alternatively, the data choose the form of the model. They choose one function that
# all pumps share, and one of each pump's own, so that pump 6 has a function to itself.
# It then neither helps nor harms the others, and it is still not related to them.
from skmtgp import RankSearchIC

search = RankSearchIC(MultiTaskGPRegressor(task_feature="pump")).fit(X, y)
chosen = TransferDisplay.from_estimator(search).transfer
best = search.best_estimator_
print(f"rank {best.rank}, a function of each pump's own: {best.diagonal}")
print(chosen[["error", "verdict", "evidence", "related"]].round(2).to_string())
