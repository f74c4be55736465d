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
# between two places, against their distance in km. They are those of logarithms. The
# fit did not use the dots.
from skmtgp.inspection import VariogramDisplay

model = models["cokriging"]
VariogramDisplay.from_estimator(model, tasks=METALS, max_distance=2.5)

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
