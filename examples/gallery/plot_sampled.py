"""
Intervals of a few rows
=======================

Six rows of each of three tasks do not determine the hyperparameters well. This example
compares the intervals of the most likely hyperparameters with those of an average over
plausible ones.
"""

# %%
# The data
# --------
#
# Three related tasks are drawn from the model. Each has six rows to learn from and a
# hundred rows to predict.

import matplotlib.pyplot as plt
import numpy as np

from skmtgp import MultiTaskGPRegressor
from skmtgp.inspection import CoverageDisplay, color_of

rng = np.random.default_rng(7)
x, task = rng.uniform(0, 8, 318), np.arange(318) % 3
K = np.exp(-0.5 * (x[:, None] - x) ** 2) * np.cos(0.8 * (task[:, None] - task))
f = rng.multivariate_normal(np.zeros(318), K, check_valid="ignore")
y, X = f + 0.2 * rng.standard_normal(318), np.column_stack([x, task])
X_train, y_train, X_test, y_test = X[:18], y[:18], X[18:], y[18:]

# %%
# Two models
# ----------

models = {
    "the mode": MultiTaskGPRegressor(rank=2),
    "sampled": MultiTaskGPRegressor(rank=2, hyperparameters="sampled"),
}
for model in models.values():
    model.fit(X_train, y_train)

# %%
# The first task
# --------------
#
# Lines are predictions, bands are 95 % intervals for new measurements, and small dots
# are new measurements.

grid = np.column_stack([np.linspace(0, 8, 200), np.zeros(200)])
figure, axes = plt.subplots(1, 2, figsize=(9, 3.5), sharey=True, layout="constrained")
seen, new = X_train[:, 1] == 0, X_test[:, 1] == 0
for ax, (name, model) in zip(axes, models.items(), strict=True):
    lower, upper = model.predict_interval(grid, 0.95)
    ax.fill_between(grid[:, 0], lower, upper, color=color_of(model), alpha=0.25, lw=0)
    ax.plot(grid[:, 0], model.predict(grid), color=color_of(model))
    ax.plot(X_test[new, 0], y_test[new], ".", color="0.5", ms=4)
    ax.plot(X_train[seen, 0], y_train[seen], "o", color="black", ms=5)
    ax.set(title=f"Hyperparameters: {name}", xlabel="x")
axes[0].set_ylabel("y of task 0")
plt.show()

# %%
# The bands of the mode, the most likely hyperparameters, miss too many measurements.
# The average over the draws is wider where little is known.
#
# All tasks, and all levels
# -------------------------
#
# On the diagonal, as many measurements lie inside as should.

figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    CoverageDisplay.from_estimator(model, X_test, y_test, ax=ax)
    ax.set_title(f"Hyperparameters: {name}")
plt.show()

# %%
# The page `Intervals <../guide/intervals.html>`_ of the user guide explains how
# sampling works, what it costs, and which alternatives there are.
