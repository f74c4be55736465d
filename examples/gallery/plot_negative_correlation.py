"""
Tasks that are each other's opposite
====================================

Where one task goes up, the other goes down. Can a sample of one help to predict the
other? A multi-task model can: it learns the sign, because an entry of the task
covariance may be negative. Models that share only the kernel cannot express this, nor
can a model that treats both tasks as one function.
"""

# %%
# Two tasks, each seen in one half
# --------------------------------
# The second task is -0.8 times the first. The first is measured on the left, the second
# on the right. Seven inputs in the middle are common to both.
import numpy as np


def truth(x, task):
    """Values of the tasks "up" and "down"."""
    return np.where(task == "up", 1.0, -0.8) * (np.sin(x) + 0.3 * np.sin(2.5 * x))


rng = np.random.default_rng(0)
x = np.concatenate([np.linspace(0, 6.5, 14), np.linspace(3.5, 10, 14)])
task = np.repeat(["up", "down"], 14)
X = np.column_stack([x.astype(object), task])
y = truth(x, task) + 0.03 * rng.standard_normal(28)

# %%
# Three models
# ------------
from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP
from skmtgp.metrics import normalized_mean_squared_error

line = np.linspace(0, 10, 101)
labels = np.repeat(["up", "down"], 101)
X_line = np.column_stack([np.tile(line, 2).astype(object), labels])
y_line = truth(np.tile(line, 2), labels)
models = {
    "multi-task, rank 1": MultiTaskGPRegressor(rank=1),
    "independent": IndependentGP(),
    "pooled": PooledGP(),
}
for name, model in models.items():
    mean = model.fit(X, y).predict(X_line)
    error = normalized_mean_squared_error(y_line, mean, tasks=labels)
    print(f"{name}: nMSE {error:.4f}")

# %%
# What each of them predicts
# --------------------------
# Dots are samples, dashed lines the truth, and bands 95 % intervals. The independent
# tasks know nothing where they have no samples. The pooled model draws one curve
# through both tasks.
import matplotlib.pyplot as plt

from skmtgp.inspection import COLORS

figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), sharey=True, layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    mean, std = model.predict(X_line, return_std=True)
    for label, color in zip(("up", "down"), COLORS, strict=False):
        rows = labels == label
        low, high = mean[rows] - 1.96 * std[rows], mean[rows] + 1.96 * std[rows]
        ax.fill_between(line, low, high, color=color, alpha=0.2, lw=0)
        ax.plot(line, mean[rows], color=color, label=label)
        ax.plot(line, y_line[rows], color=color, ls="--", lw=1)
        ax.plot(x[task == label], y[task == label], "o", color=color, ms=4)
    ax.set(title=name, xlabel="x")
axes[0].set_ylabel("y")
axes[0].legend()

# %%
# The sign that was learned
# -------------------------
# The truth is that "down" is -0.8 times "up".
from skmtgp.inspection import TaskCovarianceDisplay

mgp = models["multi-task, rank 1"]
down, up = mgp.task_factor_[:, 0]
print(f"down over up, as learned: {down / up:.2f}")
_, ax = plt.subplots(figsize=(4.4, 3.4), layout="constrained")
TaskCovarianceDisplay.from_estimator(mgp, ax=ax)
