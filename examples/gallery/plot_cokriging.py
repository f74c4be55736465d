"""
Cokriging: a map of one metal with the help of two others
=========================================================

Cadmium in the soil is dear to measure, zinc and nickel are cheap. There are 60
measurements of cadmium and 180 of the other two. Kriging makes a map from the 60 alone;
cokriging makes it from all 420. The metals are tasks of one model.

The survey is simulated, so that the true map is known. The
:doc:`tutorial </tutorials/cokriging>` goes through the same steps more slowly, in a
geostatistician's words.
"""

# %%
# The survey
# ----------
# Two things put metals into this soil: the rock, which changes over kilometres, and
# what people spilled, which changes over some hundred metres. The column "task" will
# name the metal, with one row for each measurement.
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
# Both work on logarithms (``target_transform``) with exponential covariances, which are
# ``Matern(nu=0.5)``. Kriging of cadmium alone is a ``SingleTaskGP``. Cokriging is a
# linear model of coregionalisation with two structures, one of each scale. The lengths
# are starts: everything is learned by maximum likelihood.
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
# How uncertain the maps are: by what factor the truth may be off, up or down, at one
# standard deviation of the logarithm. Kriging is sure where cadmium was measured;
# cokriging is also sure where zinc was.
factors = {}
for name, model in models.items():
    lower, upper = model.predict_interval(places, 0.683, include_noise=False)
    factors[name] = np.sqrt(upper / lower)

draw(factors, "uncertain by a factor of", vmin=1.0, vmax=1.7, cmap="magma")

# %%
# Errors over the whole map, and how often 90 % intervals hold the truth:
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
# The model implies a variogram for each metal and a cross-variogram for each pair. Dots
# are the experimental ones: half the mean product of differences between two places, by
# their distance. Nothing was fitted to the dots. Here they are those of logarithms, by
# distance in km.
from skmtgp.inspection import VariogramDisplay

model = models["cokriging"]
VariogramDisplay.from_estimator(model, tasks=METALS, max_distance=2.5)

# %%
# Two structures relate the metals in two ways. Their sills, by the length in km of each
# structure: all three metals have a part in the long one, nickel has next to none in
# the short one.
names = [f"{kernel.length_scale:.1f} km" for kernel in model.kernel_]
sills = {
    name: pd.DataFrame(K, METALS, METALS)
    for name, K in zip(names, model.task_covariance_, strict=True)
}
pd.concat(sills).round(2)
