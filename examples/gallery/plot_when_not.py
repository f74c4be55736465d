"""
Where straight lines do better: the sea off Peru
================================================

Not every set of related functions needs a multi-task model. The surface of the Pacific
off Peru and Ecuador is warm in March and cool in September, but no two years are the
same: El Niño years are warmer by several degrees. Suppose that only four months of each
year had been measured. Can we predict the other eight?

Each year is a task, a function of the month. The data are NOAA's monthly means
(ERSST.V3B, region Niño 1+2, degrees Celsius), in the public domain, and come with
statsmodels.
"""

# %%
# Thirty years
# ------------
# We use the years 1981 to 2010, a standard reference period in climatology.
import numpy as np
from statsmodels.datasets import elnino

wide = elnino.load_pandas().data.astype({"YEAR": int}).set_index("YEAR").loc[1981:]
months = list(wide.columns)
wide.columns = range(1, 13)
sea = wide.stack().rename_axis(["year", "month"]).rename("sst").reset_index()
X, y = sea[["year", "month"]], sea["sst"]

# %%
# Four models
# -----------
# The models are: each year alone; years that share a kernel; one function for all
# years; and the multi-task model. It has rank 1 and ``diagonal=True``: each year is a
# multiple of one course that all years share, plus a part of its own.
#
# We draw four months of each year at random, three times, and predict the other eight.
# The numbers are root mean squared errors in degrees.
import pandas as pd

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP

models = {
    "each year alone": SingleTaskGP(task_feature="year"),
    "a shared kernel": IndependentGP(task_feature="year"),
    "one function": PooledGP(task_feature="year"),
    "multi-task": MultiTaskGPRegressor(rank=1, diagonal=True, task_feature="year"),
}


def draw(seed):
    """Rows that were measured, four of each year, and the others."""
    known = sea.groupby("year").sample(4, random_state=seed).index.sort_values()
    return known, sea.index.difference(known)


def rmse(predicted):
    """Root mean squared error of months left out, in degrees."""
    return np.sqrt(np.mean((predicted - y[left_out]) ** 2))


errors = {}
for seed in (2, 1, 0):
    known, left_out = draw(seed)
    errors[f"draw {seed}"] = {
        name: rmse(model.fit(X.loc[known], y[known]).predict(X.loc[left_out]))
        for name, model in models.items()
    }
print(pd.DataFrame(errors).round(2).to_string())

# %%
# The multi-task model has the smallest error of the four in every draw. But a simpler
# method does somewhat better: straight lines between the known months, in degrees above
# or below the average of each month. It can, because the years follow each other and
# make one long record. The multi-task model ignores the order of its tasks. It is made
# for tasks without an order: sites, machines, patients.
normal = sea.loc[known].groupby("month")["sst"].mean()
anomaly = sea["sst"] - sea["month"].map(normal)
between = np.interp(left_out, known, anomaly[known])
filled = between + sea["month"][left_out].map(normal)
print(f"straight lines in time, draw 0: {rmse(filled):.2f}")

# %%
# Two years
# ---------
# The plots have 1985, a cool year, and 1997, an El Niño year. Circles are the four
# months of draw 0. What the years share narrows the band of 1985. No other year could
# tell how 1997 ended: the band is wide there, and January of that year is outside.
import matplotlib.pyplot as plt

from skmtgp.inspection import TrajectoryDisplay

figure, axes = plt.subplots(2, 2, figsize=(9.5, 6.6), sharey=True, layout="constrained")
for row, name in zip(axes, ("a shared kernel", "multi-task"), strict=True):
    for ax, year in zip(row, (1985, 1997), strict=True):
        rows = sea["year"] == year
        TrajectoryDisplay.from_estimator(
            models[name], X[rows], y[rows], time=sea["month"][rows], ax=ax
        )
        seen = sea.loc[known].query("year == @year")
        ax.plot(seen["month"], seen["sst"], "o", ms=9, mfc="none", color="black")
        ax.set_title(f"{year}: {name}", pad=26)
        ax.set(xlabel="", ylabel="°C")
        ax.set_xticks(range(1, 13), [month.title()[0] for month in months])

# %%
# How sure it should be
# ---------------------
# The weakness: 95 % intervals of the multi-task model contain somewhat too few of the
# hidden months. It has many hyperparameters for its samples.
from skmtgp.metrics import coverage

for name in ("a shared kernel", "multi-task"):
    model = models[name]
    mean, std = model.predict(X.loc[left_out], return_std=True, include_noise=True)
    inside = coverage(y[left_out], mean, std, level=0.95)
    print(f"{name}: {model.n_hyperparameters_} hyperparameters, {inside:.0%} inside")
