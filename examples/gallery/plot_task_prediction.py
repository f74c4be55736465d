"""
A few rows of a task
====================

Five sites measure the same thing, each on a level and a scale of its own. One has 30
measurements, another four. A model of all of them borrows from the many for the few; a
model of each site has its own alone.
"""

# %%
# The data
# --------
#
# In practice they are a table with a row for each measurement and a column that says
# where it was made.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from skmtgp import MultiTaskGPRegressor, SingleTaskGP
from skmtgp.inspection import TaskPredictionDisplay

LEVEL = {"north": 2.0, "east": 0.0, "south": -1.0, "west": 1.0, "hill": 4.0}
SCALE = {"north": 1.0, "east": 1.5, "south": 0.6, "west": -0.8, "hill": 2.0}
ROWS = {"north": 30, "east": 20, "south": 12, "west": 7, "hill": 4}


def truth(X):
    """What a measurement without error would be."""
    level, scale = X["site"].map(LEVEL), X["site"].map(SCALE)
    return level + scale * np.sin(X["hour"] / 24 * 2 * np.pi)


rng = np.random.default_rng(5)
X = pd.DataFrame({"site": np.repeat(list(ROWS), list(ROWS.values()))})
X["hour"] = rng.uniform(0, 24, len(X))
y = truth(X) + 0.15 * rng.standard_normal(len(X))

# %%
# One model of all sites
# ----------------------
#
# `task_feature` names the column of the sites; all else is default. The rank, 1, says
# that all sites have one curve in common, each by a factor of its own.

together = MultiTaskGPRegressor(rank=1, task_feature="site").fit(X, y)
shown = {"truth": truth, "tasks": list(ROWS), "n_cols": 5}
TaskPredictionDisplay.from_estimator(together, X, y, **shown)
plt.show()

# %%
# A model of each site
# --------------------

alone = SingleTaskGP(task_feature="site").fit(X, y)
TaskPredictionDisplay.from_estimator(alone, X, y, **shown)
plt.show()

# %%
# How much the few rows gain
# --------------------------
#
# Root mean squared errors of what is predicted, over the whole day:

rows = [(site, hour) for site in ROWS for hour in np.arange(0, 24, 0.5)]
day = pd.DataFrame(rows, columns=["site", "hour"])
errors = {
    name: ((model.predict(day) - truth(day)) ** 2).groupby(day["site"]).mean() ** 0.5
    for name, model in {"together": together, "alone": alone}.items()
}
pd.DataFrame(errors).loc[list(ROWS)].round(2)
