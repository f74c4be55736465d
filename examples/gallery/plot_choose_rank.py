"""
Which rank should the task covariance have?
===========================================

The rank is the number of functions that the tasks share. With too small a rank the
model cannot tell the tasks apart. With too large a rank it has more parameters than the
samples can determine. Here the truth is known, and we compare two ways to find the
rank: information criteria and cross-validation.
"""

# %%
# Eight tasks made of two functions
# ---------------------------------
# Each task is a mixture of the same two functions. It is measured at 15 inputs of its
# own, with little noise.
import numpy as np

rng = np.random.default_rng(0)
n_tasks, n_each = 8, 15
task = np.repeat(np.arange(n_tasks), n_each)
x = rng.uniform(0, 6, n_tasks * n_each)
weights = rng.normal(size=(n_tasks, 2))
shared = np.column_stack([np.sin(x), np.cos(2 * x)])
y = (weights[task] * shared).sum(axis=1) + 0.1 * rng.standard_normal(len(x))
X = np.column_stack([x, task])

# %%
# Information criteria
# --------------------
# :class:`~skmtgp.RankSearchIC` learns all ranks together and keeps the one with the
# lowest BIC. It computes the other criteria, too.
from skmtgp import MultiTaskGPRegressor, RankSearchIC

ranks = [1, 2, 3, 4, 5]
model = MultiTaskGPRegressor()
search = RankSearchIC(model, ranks=ranks, criterion="bic").fit(X, y)
table = search.results_.set_index("rank")
columns = ["log_marginal_likelihood", "n_hyperparameters", "bic", "hqc", "aic"]
print(table[columns].round(1).to_string())

# %%
# Cross-validation
# ----------------
# The rank is an ordinary parameter, so scikit-learn's grid search can choose it. Every
# fold must have samples of every task.
# :class:`~skmtgp.model_selection.TaskStratifiedKFold` takes care of that.
from sklearn.model_selection import GridSearchCV

from skmtgp.metrics import make_normalized_mse_scorer
from skmtgp.model_selection import TaskStratifiedKFold

grid = GridSearchCV(
    model,
    {"rank": ranks},
    cv=TaskStratifiedKFold(5, shuffle=True, random_state=0),
    scoring=make_normalized_mse_scorer(),
).fit(X, y)
errors = -grid.cv_results_["mean_test_score"]
for rank, error in zip(ranks, errors, strict=True):
    print(f"rank {rank}: nMSE {error:.3f} in cross-validation")

# %%
# The two side by side
# --------------------
# All three criteria choose rank 2, which is the truth; BIC does so most clearly. The
# likelihood hardly grows beyond rank 2. Higher ranks predict equally well, so
# cross-validation cannot tell them from rank 2. It took 25 fits to parts of the data,
# the criteria took one search.
import matplotlib.pyplot as plt

from skmtgp.inspection import RankSelectionDisplay

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
RankSelectionDisplay.from_estimator(search, criteria=["bic", "hqc", "aic"], ax=left)
right.plot(ranks, errors, "o-")
right.set(xlabel="rank of the task covariance", xticks=ranks)
right.set(ylabel="nMSE in cross-validation", ylim=(0, None))
