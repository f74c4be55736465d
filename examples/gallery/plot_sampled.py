"""
Intervals of a few rows
=======================

A Gaussian process is sure of itself where its hyperparameters are right. Six rows of
each of three tasks do not tell them. This example compares the intervals of their
likeliest values with those of an average over what they may be.
"""

# %%
# The data
# --------
#
# Three related tasks, drawn from the model: six rows of each to learn from, and a
# hundred to be predicted.

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
# Lines are predictions, bands are intervals of 95 % for new measurements, and small
# dots are these.

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
# The mode's bands miss half of the measurements. The average over the draws says where
# it does not know.
#
# All tasks, and all levels
# -------------------------
#
# On the diagonal as many measurements lie inside as should.

figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    CoverageDisplay.from_estimator(model, X_test, y_test, ax=ax)
    ax.set_title(f"Hyperparameters: {name}")
plt.show()

# %%
# How it works, what it costs, and what else there is, says the guide's page on
# `intervals <../guide/intervals.html>`_.
