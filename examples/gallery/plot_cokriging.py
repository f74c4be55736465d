"""
Cokriging: a map of one metal with the help of two others
=========================================================

Cadmium in the soil is expensive to measure, zinc and nickel are cheap. There are 60
measurements of cadmium and 180 of each of the other two. Kriging makes a map from the
60 measurements alone. Cokriging makes it from all 420. The metals are tasks of one
model.

The survey is simulated, so the true map is known. The :doc:`tutorial
</tutorials/cokriging>` takes the same steps more slowly, in the words of geostatistics.
"""

# %%
# The survey
# ----------
# Two sources put metals into this soil. The rock changes over kilometres, and spills
# change over a few hundred metres. We turn the survey into one row for each
# measurement. The column "task" names the metal.
import pandas as pd

from skmtgp import stack_tasks
from skmtgp.datasets import make_soil

METALS = ["cadmium", "nickel", "zinc"]
survey, truth = make_soil(random_state=2, return_truth=True)
X, y = stack_tasks(survey, METALS)
pd.concat([X, y], axis=1).groupby("task").head(2).round(2)

# %%
# Kriging and cokriging
# ---------------------
# Both work on logarithms (``target_transform``) with exponential covariances,
# ``Matern(nu=0.5)``. Kriging of cadmium alone is a ``SingleTaskGP``. Cokriging is a
# linear model of coregionalisation with two structures, one for each scale. The
# length-scales are only starting values, because everything is learned by maximum
# likelihood.
import numpy as np
from sklearn.gaussian_process.kernels import Matern

from skmtgp import MultiTaskGPRegressor, SingleTaskGP

of_cadmium = X["task"] == "cadmium"
logarithms = {"target_transform": (np.log, np.exp), "task_feature": "task"}
structures = [Matern(1.5, nu=0.5), Matern(0.3, nu=0.5)]
models = {
    "kriging": SingleTaskGP(Matern(1.0, nu=0.5), **logarithms).fit(
        X[of_cadmium], y[of_cadmium]
    ),
    "cokriging": MultiTaskGPRegressor(structures, rank=1, **logarithms).fit(X, y),
}

# %%
# The maps
# --------
# White dots are measurements of cadmium.
import matplotlib.pyplot as plt

places = truth[["east", "north"]].assign(task="cadmium")
maps = {"the truth": truth["cadmium"].to_numpy()}
maps |= {name: model.predict(places) for name, model in models.items()}


def draw(images, label, **limits):
    """One map each, with a common scale."""
    figure, axes = plt.subplots(
        1, len(images), figsize=(3.3 * len(images), 3.2), layout="constrained"
    )
    for ax, (name, values) in zip(axes, images.items(), strict=True):
        image = ax.imshow(
            values.reshape(41, 41), origin="lower", extent=(0, 5, 0, 5), **limits
        )
        ax.plot(survey["east"][:60], survey["north"][:60], ".", color="white", ms=3)
        ax.set(title=name, xlabel="east (km)", xticks=[0, 5], yticks=[0, 5])
    axes[0].set_ylabel("north (km)")
    figure.colorbar(image, ax=axes, label=label)


draw(maps, "cadmium (ppm)", vmin=0.0, vmax=np.quantile(maps["the truth"], 0.99))

# %%
# How uncertain are the maps? The colours show the factor between prediction and truth
# at one standard deviation of the logarithm. Kriging is certain where cadmium was
# measured. Cokriging is also certain where only zinc was measured.
factors = {}
for name, model in models.items():
    lower, upper = model.predict_interval(places, 0.683, include_noise=False)
    factors[name] = np.sqrt(upper / lower)

draw(factors, "uncertain by a factor of", vmin=1.0, vmax=1.7, cmap="magma")

# %%
# The table has the errors over the whole map, and how often 90 % intervals contain the
# truth:
rows = {}
for name, model in models.items():
    lower, upper = model.predict_interval(places, 0.9, include_noise=False)
    rows[name] = {
        "mean absolute error (ppm)": np.abs(maps[name] - maps["the truth"]).mean(),
        "90 % intervals hold": np.mean(
            (lower <= maps["the truth"]) & (maps["the truth"] <= upper)
        ),
    }
pd.DataFrame(rows).T.round(2)

# %%
# Variograms
# ----------
# The model implies a variogram for each metal and a cross-variogram for each pair of
# metals. Dots are the experimental variograms: half the mean product of differences
# between two places, against their distance. The fit did not use the dots.
model = models["cokriging"]
logs, between = np.log(survey[METALS]).to_numpy(), np.triu_indices(180, 1)
positions = survey[["east", "north"]].to_numpy()
apart = np.linalg.norm(positions[:, None] - positions, axis=2)[between]
bins = np.linspace(0.0, 2.5, 11)  # km
lags = np.linspace(0.0, 2.5, 100)[:, None]
at = [kernel(np.zeros((1, 1)), lags)[0] for kernel in model.kernel_]
noise = np.diag(np.broadcast_to(model.noise_variance_, len(METALS)))


def experimental(a, b):
    """The cross-variogram of two metals, by distance."""
    first, second = (np.subtract.outer(of, of)[between] for of in logs.T[[a, b]])
    frame = pd.DataFrame({"distance": apart, "variogram": 0.5 * first * second})
    return frame.groupby(pd.cut(frame["distance"], bins), observed=True).mean()


def modelled(a, b):
    """The same by the model, of the same logarithms."""
    pairs = zip(model.task_covariance_, at, strict=True)
    return sum(K[a, b] * (1.0 - k) for K, k in pairs) + noise[a, b]


figure, axes = plt.subplots(3, 3, figsize=(8, 6.4), sharex=True, layout="constrained")
for a, b in np.ndindex(3, 3):
    ax = axes[a, b]
    if b > a:
        ax.set_axis_off()
        continue
    ax.plot("distance", "variogram", "o", ms=4, data=experimental(a, b))
    ax.plot(lags, modelled(a, b))
    ax.axhline(0.0, color="gray", lw=0.5)
    ax.set_title(METALS[a] if a == b else f"{METALS[a]} and {METALS[b]}")
for ax in axes[-1]:
    ax.set_xlabel("distance (km)")
for ax in axes[:, 0]:
    ax.set_ylabel("variogram")

# %%
# The two structures relate the metals in different ways. The table has their sills,
# with the length of each structure in km. All three metals take part in the long
# structure, and nickel hardly takes part in the short one.
names = [f"{kernel.length_scale:.1f} km" for kernel in model.kernel_]
sills = {
    name: pd.DataFrame(K, METALS, METALS)
    for name, K in zip(names, model.task_covariance_, strict=True)
}
pd.concat(sills).round(2)
