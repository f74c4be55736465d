"""
Complete data, and what they save
=================================

Eight stations report at the same times. Data are called complete if every task has the
same inputs, once each. How much faster is learning then? Do the results change?
"""

# %%
# Eight stations
# --------------
# Each is a mixture of the same two functions of time.
import numpy as np
import pandas as pd


def report(n_times):
    """Measurements of all stations at so many times."""
    rng = np.random.default_rng(0)
    hours = np.linspace(0, 48, n_times)
    shared = np.stack([np.sin(hours / 4), np.cos(hours / 9)])
    clean = rng.normal(size=(8, 2)) @ shared
    X = pd.DataFrame(
        {"hour": np.tile(hours, 8), "station": np.repeat(list("abcdefgh"), n_times)}
    )
    return X, clean.ravel() + 0.1 * rng.standard_normal(clean.size)


X, y = report(50)

# %%
# Found automatically
# -------------------
# ``inference="auto"``, the default, notices that the data are complete, whatever the
# order of the rows. The covariance of all samples is then a Kronecker product of two
# small matrices: one of the stations, one of the times. The large matrix is never
# computed. Up to a tenth of the measurements may be missing, such as the first one
# here.
from skmtgp import MultiTaskGPRegressor

model = MultiTaskGPRegressor(rank=2, task_feature="station")
shuffled = np.random.default_rng(0).permutation(len(X))
print("all rows:", model.fit(X.iloc[shuffled], y[shuffled]).inference_)
print("one less:", model.fit(X[1:], y[1:]).inference_)

# %%
# The same model
# --------------
# Both ways are exact. They have the same likelihood to many digits, and nearly the same
# predictions. Predictions can differ as much as the tolerance of learning allows.
from time import perf_counter

from sklearn.base import clone

fits, seconds = {}, {}
for inference in ("dense", "kronecker"):
    begin = perf_counter()
    fits[inference] = clone(model).set_params(inference=inference).fit(X, y)
    seconds[inference] = perf_counter() - begin

dense, kronecker = fits.values()
theta = dense.theta_
relative = kronecker.log_marginal_likelihood(theta) / dense.log_marginal_likelihood()
apart = np.abs(dense.predict(X) - kronecker.predict(X)).max()
print(f"likelihood at the same parameters: {abs(relative - 1):.0e} apart, relatively")
print(f"predictions: {apart:.0e} apart, where y has deviation {y.std():.1f}")
ratio = seconds["dense"] / seconds["kronecker"]
print(f"time to learn, dense over kronecker: {ratio:.1f}")

# %%
# More times
# ----------
# Learning takes a few hundred evaluations of the likelihood and its gradient. In
# general the time of one evaluation grows with the cube of the number of all samples.
# For complete data it grows with the cube of the number of times only.


def time_of_likelihood(inference, X, y):
    """Seconds for one likelihood and its gradient, the best of five."""
    fitted = clone(model).set_params(inference=inference, max_iter=0).fit(X, y)
    seconds = []
    for _ in range(5):
        begin = perf_counter()
        fitted.log_marginal_likelihood(fitted.theta_, eval_gradient=True)
        seconds.append(perf_counter() - begin)
    return min(seconds)


rows = []
for n_times in (25, 50, 100, 200):
    data = report(n_times)
    times = [time_of_likelihood(name, *data) for name in fits]
    rows.append({"samples": 8 * n_times, **dict(zip(fits, times, strict=True))})
table = pd.DataFrame(rows).set_index("samples")
table["dense over kronecker"] = table["dense"] / table["kronecker"]
print(table["dense over kronecker"].round(1).to_string())

# %%
# The left plot has the predictions for three stations, both ways. The right plot has
# the times.
import matplotlib.pyplot as plt

from skmtgp.inspection import COLORS

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
line = pd.DataFrame({"hour": np.linspace(0, 48, 200)})
for station, color in zip("abc", COLORS, strict=False):
    new = line.assign(station=station)
    left.plot(line["hour"], dense.predict(new), color=color, lw=5, alpha=0.3)
    left.plot(line["hour"], kronecker.predict(new), color=color, ls="--", label=station)
    of_station = X["station"] == station
    left.plot(X["hour"][of_station], y[of_station], "o", ms=3, color=color)
left.legend(title="station")
left.set(xlabel="hour", ylabel="y", title="predictions: dense wide, kronecker dashed")
for name, marker in zip(fits, "os", strict=True):
    right.loglog(table.index, 1000 * table[name], marker + "-", label=name)
right.set(xlabel="samples of all stations", ylabel="ms", title="one likelihood")
right.set_xticks(table.index, table.index)
right.minorticks_off()
right.legend()
