"""
Are the intervals right?
========================

A 90 % interval should contain 90 % of the targets of each task. Two displays show
whether it does. Where tasks have different noise, a noise variance for each task helps.
"""

# %%
# Three instruments
# -----------------
# They measure related functions. The second instrument has four times the noise of the
# first, and the third has ten times the noise of the first.
import numpy as np

rng = np.random.default_rng(0)
names = np.array(["fine", "medium", "coarse"])
noise = np.array([0.05, 0.2, 0.5])


def measure(n_each):
    """Samples of every instrument."""
    task = np.repeat([0, 1, 2], n_each)
    x = rng.uniform(0, 6, len(task))
    f = np.sin(x) + np.array([0.0, 0.3, -0.3])[task] * np.cos(2 * x)
    y = f + noise[task] * rng.standard_normal(len(task))
    return np.column_stack([x.astype(object), names[task]]), y


X, y = measure(40)
X_test, y_test = measure(300)

# %%
# One noise for all, and one for each
# -----------------------------------
# The default, ``noise="auto"``, would decide by the data.
from skmtgp import MultiTaskGPRegressor
from skmtgp.metrics import coverage

models = {
    kind: MultiTaskGPRegressor(rank=2, noise=kind).fit(X, y)
    for kind in ("shared", "per_task")
}
by_default = MultiTaskGPRegressor(rank=2).fit(X, y)
print(f"the default takes noise={by_default.noise_!r}")
for kind, model in models.items():
    mean, std = model.predict(X_test, return_std=True, include_noise=True)
    deviation = np.broadcast_to(np.sqrt(model.noise_variance_), 3)
    for task, sigma in zip(model.tasks_, deviation, strict=True):
        rows = X_test[:, 1] == task
        share = coverage(y_test[rows], mean[rows], std[rows], level=0.9)
        print(f"{kind:8}  {task:6}  noise {sigma:.2f}  inside 90 %: {share:.2f}")

# %%
# With one noise variance for all, the intervals of two instruments are too wide and
# those of the coarse one too narrow. The mean of the three at 90 % hides this. With one
# noise variance for each, all curves come near the diagonal. The intervals of the fine
# instrument are still a little too narrow, because 40 samples determine its noise only
# roughly. The grey lines are the instruments, and the blue line is their mean.
import matplotlib.pyplot as plt

from skmtgp.inspection import CoverageDisplay, TaskResidualsDisplay

figure, axes = plt.subplots(1, 2, figsize=(9, 4.6), layout="constrained")
for ax, (kind, model) in zip(axes, models.items(), strict=True):
    CoverageDisplay.from_estimator(model, X_test, y_test, ax=ax)
    ax.set_title(f'noise="{kind}"')

# %%
# The residuals show which instrument is which. Divided by their predictive standard
# deviation, 95 % of them should lie between the dashed lines, for each instrument.
figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
for ax, (kind, model) in zip(axes, models.items(), strict=True):
    TaskResidualsDisplay.from_estimator(
        model, X_test, y_test, kind="standardized", ax=ax
    )
    ax.set_title(f'noise="{kind}"')
