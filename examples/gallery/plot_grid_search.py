"""
Kernel and rank by grid search
==============================

A data frame names the task in a column of strings, and its features have different
units. Which kernel and which rank predict best? scikit-learn's ``GridSearchCV`` tunes
the whole pipeline.
"""

# %%
# Four sites
# ----------
# The growth of a crop depends on temperature and soil moisture, and differently at each
# site.
import numpy as np
import pandas as pd

rng = np.random.default_rng(0)
frame = pd.DataFrame(
    {
        "site": np.repeat(["east", "north", "south", "west"], 20),
        "temperature": rng.uniform(5, 35, 80),
        "moisture": rng.uniform(0.05, 0.6, 80),
    }
)
wet = frame["moisture"] / (0.2 + frame["moisture"])
warm = np.exp(-(((frame["temperature"] - 22) / 8) ** 2))
a = frame["site"].map({"east": 5.0, "north": 4.0, "south": 6.0, "west": 3.0})
b = frame["site"].map({"east": 1.0, "north": 2.0, "south": 0.5, "west": 3.0})
y = a * warm * wet + b * wet + 0.1 * rng.standard_normal(80)

# %%
# The pipeline
# ------------
# The scaler must not change the column of sites. With ``remainder="passthrough"`` this
# column moves to the end. There ``task_feature=-1``, the default, finds it.
from sklearn.compose import make_column_transformer
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import MultiTaskGPRegressor

scale = make_column_transformer(
    (StandardScaler(), ["temperature", "moisture"]), remainder="passthrough"
)
pipeline = Pipeline([("scale", scale), ("gp", MultiTaskGPRegressor())])

# %%
# The search
# ----------
# The folds contain all sites, and the errors are averaged over the sites. So both need
# the name of the column.
from sklearn.gaussian_process.kernels import RBF, Matern
from sklearn.model_selection import GridSearchCV

from skmtgp.metrics import make_normalized_mse_scorer
from skmtgp.model_selection import TaskStratifiedKFold

kernels = {
    "squared exponential": RBF([1.0, 1.0]),
    "Matern 3/2": Matern([1.0, 1.0], nu=1.5),
    "Matern 1/2": Matern([1.0, 1.0], nu=0.5),
}
grid = GridSearchCV(
    pipeline,
    {"gp__kernel": list(kernels.values()), "gp__rank": [1, 2, 3]},
    cv=TaskStratifiedKFold(4, shuffle=True, random_state=0, task_feature="site"),
    scoring=make_normalized_mse_scorer("site"),
).fit(frame, y)

names = {str(kernel): name for name, kernel in kernels.items()}
results = pd.DataFrame(
    {
        "kernel": [names[str(k)] for k in grid.cv_results_["param_gp__kernel"]],
        "rank": np.asarray(grid.cv_results_["param_gp__rank"], dtype=int),
        "nMSE": -grid.cv_results_["mean_test_score"],
    }
)
table = results.pivot(index="kernel", columns="rank", values="nMSE")
print(table.round(3))

# %%
# The best of them
# ----------------
# ``best_estimator_`` is the pipeline learned from all rows. The rank matters much: the
# data were made of two functions. The kernel matters less.
import matplotlib.pyplot as plt

from skmtgp.inspection import TaskCovarianceDisplay

best = grid.best_estimator_
print(names[str(best.get_params()["gp__kernel"])], "rank", best["gp"].rank_)

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
table.T.plot(ax=left, marker="o", xticks=[1, 2, 3])
left.set(ylabel="nMSE in cross-validation", ylim=(0, None))
TaskCovarianceDisplay.from_estimator(best, kind="correlation", ax=right)
