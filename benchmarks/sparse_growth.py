"""Time and memory of one sparse bound and its gradient, from 10,000 rows to 960,000.

``python benchmarks/sparse_growth.py`` takes rows of `fetch_puma560` at random, at last
all of its 15 loads' 64,000 samples, with the paper's kernel, rank 4 and inducing inputs
chosen greedily from the smallest part. It writes ``results/sparse_growth.csv`` and a
plot, ``docs/images/sparse-growth.png``, with the exponents of n, and goes on where an
interrupted run of it ended; ``--fresh`` starts again. Seconds are the processor's on
one thread, the best of three or more; memory is the most that is taken over that of the
data. ``--short`` takes seconds and has files of its own.
"""

from functools import cache, partial

import matplotlib.pyplot as plt
import numpy as np
from growing import collect, cost, run, save
from matplotlib.ticker import NullFormatter

from skmtgp.datasets import fetch_puma560
from skmtgp.inference.inducing import greedy_variance
from skmtgp.inference.sparse import SparseBound
from skmtgp.inspection import COLORS
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import LowRank
from skmtgp.preprocessing import InverseDynamicsFeatures

N_TASKS, RANK, JOINT, MIB = 15, 4, 4, 2.0**20
SIZES, INDUCING = [10_000, 30_000, 100_000, 300_000, 960_000], [100, 500]
SHORT = [1_000, 2_000, 4_000], [20, 50]


class Rows:
    """All samples of the Puma 560 in random order.

    Attributes
    ----------
    u : ndarray of shape (960000, 24)
        Features without the load.
    tasks, y : ndarray of shape (960000,)
        Tasks 0 to 14, and the scaled torque.
    """

    def __init__(self):
        parts = [
            fetch_puma560(subset=subset, return_X_y=True)
            for subset in ("train", "extrapolation")
        ]
        X, torque = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.random.default_rng(0).permutation(len(X))
        table = InverseDynamicsFeatures(6).fit_transform(X[order])
        self.u, self.tasks = table[:, :-1], table[:, -1].astype(int) - 1
        y = torque[order, JOINT - 1]
        self.y = (y - y.mean()) / y.std()

    def first(self, n):
        """The first n of them, sorted by task."""
        order = np.argsort(self.tasks[:n], kind="stable")
        return tuple(part[:n][order] for part in (self.u, self.tasks, self.y))


@cache
def all_rows():
    """They are read once, if at all."""
    return Rows()


@cache
def inducing_inputs(m, few):
    """Some of the first few."""
    return greedy_variance(inverse_dynamics_kernel(6), all_rows().u[:few], m)


def measure(m, n, few):
    """Best seconds of the processor and peak bytes of one evaluation."""
    kernel, form = inverse_dynamics_kernel(6), LowRank(N_TASKS, RANK)
    F = np.random.default_rng(0).standard_normal(form.n_parameters)
    theta = np.concatenate([kernel.theta, F, [np.log(1e-2)]])
    data = all_rows().first(n)
    bound = SparseBound(Prior(kernel, form), *data, inducing_inputs(m, few))
    return cost(lambda: bound.value_and_grad(theta))


def exponent(x, y):
    """Slope of log y against log x."""
    return np.polyfit(np.log(x), np.log(y), 1)[0]


def draw(found, sizes, inducing, path):
    """Two panels, time and memory, with their exponents."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.0), layout="constrained")
    for m, color in zip(inducing, COLORS, strict=False):
        costs = np.array([found[m, n] for n in sizes]) / [1.0, MIB]
        for axis, y in zip(axes, costs.T, strict=True):
            power = f"{round(exponent(sizes, y), 2) + 0.0:.2f}"
            print(f"m = {m}: {'time' if axis is axes[0] else 'memory'} ~ n^{power}")
            axis.loglog(sizes, y, "o-", color=color, label=f"m = {m}, $n^{{{power}}}$")
    for axis, label in zip(axes, ("seconds", "MiB over the data"), strict=True):
        axis.set(xlabel="n", ylabel=label)
        axis.set_xticks(sizes, [f"{n:,}" for n in sizes])
        axis.minorticks_off()
        axis.tick_params(axis="x", labelsize=7)
        axis.grid(which="major", alpha=0.3)
        axis.legend(loc="upper left", frameon=False)
    low, high = axes[1].get_ylim()
    axes[1].set_ylim(low / 3.0, high * 10.0)  # so that flat looks flat
    axes[1].yaxis.set_minor_formatter(NullFormatter())
    figure.suptitle("One sparse bound and gradient, on one thread")
    save(figure, path)


def collect_and_draw(short, table, image):
    """Measure what is missing, and draw."""
    sizes, inducing = SHORT if short else (SIZES, INDUCING)
    keys = [(m, n) for m in inducing for n in sizes]
    found = collect(table, ["m", "n"], keys, partial(measure, few=sizes[0]))
    draw(found, sizes, inducing, image)


if __name__ == "__main__":
    run(__doc__, "sparse_growth.csv", "sparse-growth.png", collect_and_draw)
