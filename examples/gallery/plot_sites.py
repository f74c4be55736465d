"""
A site with six measurements
============================

Four sites have measured how a crop grows. A fifth site is new and has six measurements.
Can the other sites help to predict what it has not seen? This example draws the
pictures of the tutorial :doc:`/tutorials/sensors`, which goes more slowly.
"""

# %%
# Five sites
# ----------
# Growth depends on temperature and soil moisture. It has two parts: one needs warmth
# and moisture, the other moisture alone. Each site mixes them in its own amounts.
import numpy as np
import pandas as pd

rng = np.random.default_rng(1)
amounts = {"a": (5, 1), "b": (4, 2), "c": (6, 0.5), "d": (3, 3), "e": (5, 2)}


def growth(site, temperature, moisture):
    """Growth without the error of measurement."""
    warm = np.exp(-(((temperature - 22) / 8) ** 2))
    wet = moisture / (0.2 + moisture)
    a, b = amounts[site]
    return a * warm * wet + b * wet


def measure(site, n):
    """Measurements under conditions drawn at random."""
    frame = pd.DataFrame(
        {
            "site": site,
            "temperature": rng.uniform(5, 35, n),
            "moisture": rng.uniform(0.05, 0.6, n),
        }
    )
    clean = growth(site, frame["temperature"], frame["moisture"])
    return frame.assign(growth=clean + 0.05 * rng.standard_normal(n))


train = [measure(site, 30) for site in "abcd"] + [measure("e", 6)]
train = pd.concat(train, ignore_index=True)
test = pd.concat([measure(site, 200) for site in "abcde"], ignore_index=True)
X, y = train.drop(columns="growth"), train["growth"]
X_test, y_test = test.drop(columns="growth"), test["growth"]

# %%
# Two models
# ----------
# The first model learns each site alone. The second learns all sites together, with a
# rank that the search chooses.
from skmtgp import MultiTaskGPRegressor, RankSearchIC, SingleTaskGP

search = RankSearchIC(MultiTaskGPRegressor(task_feature="site"))
models = {"each site alone": SingleTaskGP(task_feature="site"), "multi-task": search}
for model in models.values():
    model.fit(X, y)
print(f"chosen: rank {search.best_rank_}")

# %%
# The new site
# ------------
# The plots show growth at site e against temperature, at a moisture of 0.4. They have
# the truth, the prediction, and the band that contains a new measurement with
# probability 0.95. The six measurements at site e were made at other moistures. Alone
# they are too few to learn a curve. Together with the other sites they show which
# mixture site e is.
import matplotlib.pyplot as plt

from skmtgp.inspection import TaskPredictionDisplay

shown = {
    "feature": "temperature",
    "at": {"moisture": 0.4},
    "tasks": ["e"],
    "truth": lambda rows: growth("e", rows["temperature"], rows["moisture"]),
}
figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
for ax, (name, model) in zip(axes, models.items(), strict=True):
    TaskPredictionDisplay.from_estimator(model, X, y, ax=[ax], **shown)
    ax.set(title=name, ylabel="growth at site e")
axes[0].legend(frameon=False)

# %%
# How the sites are related
# -------------------------
# All correlations are high, because the crop likes warmth at all sites. Subtract the
# average of the sites, and the correlations show the differences. Warmth matters more
# than on average at sites a and c, and less at site d.
from skmtgp.inspection import TaskCovarianceDisplay

figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
display = TaskCovarianceDisplay.from_estimator(search, kind="correlation", ax=axes[0])
display.plot(kind="correlation", deviations=True, ax=axes[1])

# %%
# Whether the bands are right
# ---------------------------
# The plot shows the share of 200 new measurements of each site inside intervals,
# against the level of the intervals. The bands are too narrow, most of all at site e.
# Six measurements of site e do not determine its hyperparameters well, and one factor
# for the variances of all sites counts that only in part.
from skmtgp.inspection import CoverageDisplay

display = CoverageDisplay.from_estimator(search, X_test, y_test)
