"""Time and memory of one evaluation as n, tasks, hyperparameters and the rank grow.

``python benchmarks/growth.py`` evaluates the likelihood and its gradient on random
data, one quantity growing while the others stay, on one thread. It writes
``results/growth.csv`` and a plot, ``docs/images/growth.png``, with exponents fitted to
the upper half of each range, and goes on where an interrupted run of it ended;
``--fresh`` starts again. ``--short`` takes a minute and has files of its own.
"""

import matplotlib.pyplot as plt
import numpy as np
from growing import collect, cost, run, save
from matplotlib.ticker import NullFormatter
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inspection import COLORS
from skmtgp.kernels import ARDLinear
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import LowRank

AT = {"n": 1400, "tasks": 14, "features": 18, "rank": 4}
RANGES = {
    "n": [280, 560, 840, 1400, 2100, 2800, 4000, 5600],
    "tasks": [2, 4, 8, 14, 28, 56, 100],
    "features": [2, 4, 8, 18, 36, 72, 144],
    "rank": [1, 2, 4, 8, 16, 32, 64],
}
SHORT = {
    "n": [280, 560, 840, 1400],
    "tasks": [2, 14, 100],
    "features": [2, 18, 72],
    "rank": [1, 8, 64],
}
LABELS = {
    "n": "samples n",
    "tasks": "tasks M",
    "features": "kernel hyperparameters",
    "rank": r"rank of $K^\rho$, M = 64",
}
BLUE, ORANGE = COLORS[:2]


def make(n, tasks, features, rank, seed=0):
    """A likelihood over random data with a linear and an ARD kernel, and a theta."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, features))
    task = np.sort(np.arange(n) % tasks)
    rbf = RBF(np.full(features, np.sqrt(8.0 * features)))
    kernel = ARDLinear(np.ones(features)) + ConstantKernel() * rbf
    form = LowRank(tasks, rank)
    y = rng.standard_normal(n)
    likelihood = DenseLikelihood(Prior(kernel, form), X, task, y)
    F = rng.standard_normal(form.n_parameters) / np.sqrt(rank)
    return likelihood, np.concatenate([kernel.theta, F, [np.log(0.1)]])


def setting(grows, value):
    """The problem in which one quantity has this value."""
    at = AT | {grows: value}
    if grows == "rank":
        at["tasks"] = 64
    return at | {"rank": min(at["rank"], at["tasks"])}


def measure(grows, value):
    """Best seconds of the processor and peak bytes of one evaluation."""
    likelihood, theta = make(**setting(grows, value))
    return cost(lambda: likelihood.value_and_grad(theta))


def exponent(x, y):
    """Slope of log y against log x over the upper half of x."""
    upper = slice(len(x) // 2 - (len(x) < 4), None)
    return np.polyfit(np.log(x[upper]), np.log(y[upper]), 1)[0]


def series(found, grows, values):
    """What grows as the plot shows it, seconds and MiB."""
    x = np.array(values, dtype=float)
    costs = np.array([found[grows, value] for value in values]) / [1.0, 2.0**20]
    return 2.0 * x + 2.0 if grows == "features" else x, *costs.T


def draw(found, ranges, path):
    """Four panels, time and memory with their exponents."""
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 7.0), layout="constrained")
    for axis, (grows, values) in zip(axes.flat, ranges.items(), strict=True):
        x, seconds, mebibytes = series(found, grows, values)
        powers = exponent(x, seconds), exponent(x, mebibytes)
        print(f"{LABELS[grows]}: time ~ x^{powers[0]:.2f}, memory ~ x^{powers[1]:.2f}")
        right = axis.twinx()
        time, memory = (f"{round(power, 2) + 0.0:.2f}" for power in powers)
        lines = axis.loglog(x, seconds, "o-", color=BLUE, label=f"time, $x^{{{time}}}$")
        lines += right.loglog(
            x, mebibytes, "s--", color=ORANGE, label=f"memory, $x^{{{memory}}}$"
        )
        axis.set(xlabel=LABELS[grows], ylabel="seconds")
        axis.set_xticks(x, [f"{value:g}" for value in x])
        axis.minorticks_off()
        axis.tick_params(axis="x", labelsize=7)
        right.set_ylabel("MiB")
        for side, y in ((axis, seconds), (right, mebibytes)):
            margin = 2.0 if grows == "n" else 10.0  # so that flat looks flat
            side.set_ylim(y.min() / margin, y.max() * margin)
            side.yaxis.set_minor_formatter(NullFormatter())
        axis.legend(handles=lines, loc="upper left", frameon=False)
        axis.grid(which="major", alpha=0.3)
    figure.suptitle("One likelihood and gradient; exponents of the upper half")
    save(figure, path)


def collect_and_draw(short, table, image):
    """Measure what is missing, and draw."""
    ranges = SHORT if short else RANGES
    keys = [(grows, value) for grows, values in ranges.items() for value in values]
    draw(collect(table, ["grows", "value"], keys, measure), ranges, image)


if __name__ == "__main__":
    run(__doc__, "growth.csv", "growth.png", collect_and_draw)
