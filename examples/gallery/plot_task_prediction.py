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
# They are simulated: a table with a row for each measurement, and a column that says
# where it was made. `truth` is known, as it never is in practice.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from skmtgp import MultiTaskGPRegressor, SingleTaskGP
from skmtgp.datasets import make_sites
from skmtgp.inspection import TaskPredictionDisplay

X, y, truth = make_sites(return_truth=True)
sites = X["site"].unique().tolist()
X.groupby("site", sort=False).size()

# %%
# One model of all sites
# ----------------------
#
# `task_feature` names the column of the sites; all else is default. The model learns
# how the sites are related from the data alone.

together = MultiTaskGPRegressor(task_feature="site").fit(X, y)
shown = {"truth": truth, "tasks": sites, "n_cols": 5}
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

rows = [(site, hour) for site in sites for hour in np.arange(0, 24, 0.5)]
day = pd.DataFrame(rows, columns=["site", "hour"])
errors = {
    name: ((model.predict(day) - truth(day)) ** 2).groupby(day["site"]).mean() ** 0.5
    for name, model in {"together": together, "alone": alone}.items()
}
pd.DataFrame(errors).loc[sites].round(2)
