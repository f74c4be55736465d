"""
Where should inducing inputs lie?
=================================

``inference="sparse"`` summarises the samples by a few inducing inputs. By default these
are training inputs, chosen greedily. ``inducing_inputs="k-means"`` uses the means of
clusters instead. ``"optimised"`` moves the greedy ones to increase the bound on the
likelihood, which takes more evaluations. Is that worth it?
"""

# %%
# A slow wave with a fast one on it
# ---------------------------------
# Three sensors measure multiples of this function with noise, 2000 times in all.
import numpy as np

rng = np.random.default_rng(0)


def wave(x):
    """The function behind all sensors."""
    return np.sin(x) + 0.3 * np.sin(4 * x)


def measure(n_samples):
    """Inputs with the sensor in the last column, what it measures, and the truth."""
    x, sensor = rng.uniform(0, 10, n_samples), rng.integers(0, 3, n_samples)
    truth = np.array([1.0, -2.0, 0.5])[sensor] * wave(x)
    y = truth + 0.3 * rng.standard_normal(n_samples)
    return np.column_stack([x, sensor]), y, truth


X, y, _ = measure(2000)
X_test, _, truth = measure(1000)

# %%
# Three ways to choose them
# -------------------------
# All sensors measure multiples of one function, so the rank is 1.
import pandas as pd

from skmtgp import MultiTaskGPRegressor
from skmtgp.metrics import normalized_mean_squared_error

models, rows = {}, []
for n_inducing in (12, 15, 20):
    for choice in ("greedy", "k-means", "optimised"):
        model = MultiTaskGPRegressor(
            rank=1,
            inference="sparse",
            n_inducing=n_inducing,
            inducing_inputs=choice,
        ).fit(X, y)
        models[n_inducing, choice] = model
        rows.append(
            {
                "inducing": n_inducing,
                "which": choice,
                "bound": model.log_marginal_likelihood_value_,
                "nMSE": normalized_mean_squared_error(truth, model.predict(X_test)),
                "evaluations": model.n_evaluations_,
            }
        )
table = pd.DataFrame(rows).set_index(["inducing", "which"])
print(table.round(4).to_string())

# %%
# Twelve of them
# --------------
# With few inducing inputs the choice matters: 12 of them find the fast wave only if
# they are moved. The plots show the first sensor and where the inducing inputs lie.
import matplotlib.pyplot as plt

from skmtgp.inspection import color_of

figure, axes = plt.subplots(1, 3, figsize=(12, 4), sharey=True, layout="constrained")
x = np.linspace(0, 10, 400)
for ax, choice in zip(axes, ("greedy", "k-means", "optimised"), strict=True):
    model = models[12, choice]
    mean = model.predict(np.column_stack([x, np.zeros(len(x))]))
    ax.plot(x, wave(x), color="0.6", lw=4, label="truth")
    ax.plot(x, mean, color=color_of(model), label="predicted")
    Z = model.inducing_inputs_[:, 0]
    ax.plot(Z, np.full(len(Z), -1.6), "|", ms=12, color="black", label="inducing")
    ax.set(xlabel="x", title=choice)
axes[0].set_ylabel("y of the first sensor")
lines, names = axes[0].get_legend_handles_labels()
figure.legend(lines, names, loc="outside upper center", ncols=3, frameon=False)

# %%
# More of them
# ------------
# With 20 inducing inputs none need be moved, and they predict better than 12 that were
# moved. So try more inducing inputs first, if you can afford them. :ref:`Another
# example <sphx_glr_auto_examples_plot_large_data.py>` shows how many are enough.
errors = table["nMSE"].unstack()
_, ax = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
errors.plot(ax=ax, marker="o", logy=True, xticks=errors.index)
ax.set(xlabel="inducing inputs", ylabel="nMSE")
# sphinx_gallery_thumbnail_number = 2
