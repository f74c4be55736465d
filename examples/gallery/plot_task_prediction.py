"""
A few rows of a task
====================

Five sites measure the same thing, each with a level and a scale of its own. One has 30
measurements, another only four. In a model of all sites, those with many measurements
help those with few. A model of each site has only its own measurements.
"""

# %%
# The data
# --------
#
# The data are simulated. The table has a row for each measurement, and a column that
# names the site. `truth` is known here; in practice it never is.

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
# `task_feature` names the column of the sites. All other parameters have their
# defaults. From the data alone the model learns how the sites are related.

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
# These are the root mean squared errors of the predictions over the whole day:

rows = [(site, hour) for site in sites for hour in np.arange(0, 24, 0.5)]
day = pd.DataFrame(rows, columns=["site", "hour"])
errors = {
    name: ((model.predict(day) - truth(day)) ** 2).groupby(day["site"]).mean() ** 0.5
    for name, model in {"together": together, "alone": alone}.items()
}
pd.DataFrame(errors).loc[sites].round(2)
