"""Time and memory of one likelihood with its gradient by each of the engines.

``python benchmarks/engines.py`` takes complete random data of 14 tasks, so that all of
them can be used, the paper's kernel, rank 4, and for sparse inference 100 and 500 of
the inputs as inducing inputs. It writes ``results/engines.csv`` and the plot of the
user guide, ``docs/images/engines.png``, and goes on where an interrupted run of it
ended; ``--fresh`` starts again. Seconds are the processor's on one thread, the best of
three or more; memory is the most that is taken over that of the data. ``--short`` takes
seconds and has files of its own.
"""

import matplotlib.pyplot as plt
import numpy as np
from growing import collect, cost, run, save
from kronecker import make_problem

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.sparse import SparseBound
from skmtgp.inspection import COLORS

N_TASKS, MIB = 14, 2.0**20
ENGINES = {  # inputs of a task, inducing inputs, color
    "dense": ([20, 50, 100, 200, 400], None, COLORS[1]),
    "kronecker": ([20, 100, 200, 500, 1000, 2000], None, COLORS[2]),
    "sparse, m = 100": ([20, 100, 500, 2000, 10_000], 100, COLORS[4]),
    "sparse, m = 500": ([100, 500, 2000, 10_000], 500, COLORS[0]),
}
MOST_SHORT = 100  # inputs of a task


def make(engine, n_inputs):
    """A likelihood, and where to evaluate it."""
    problem, theta = make_problem(n_inputs, N_TASKS)
    n_inducing = ENGINES[engine][1]
    if n_inducing is not None:
        X = problem[1]
        return SparseBound(*problem, X[np.arange(n_inducing) % len(X)]), theta
    kinds = {"dense": DenseLikelihood, "kronecker": KroneckerLikelihood}
    return kinds[engine](*problem), theta


def measure(engine, n):
    """Best seconds of the processor and peak bytes of one evaluation."""
    likelihood, theta = make(engine, n // N_TASKS)
    return cost(lambda: likelihood.value_and_grad(theta))


def draw(found, path):
    """Two panels, time and memory."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.3), layout="constrained")
    for engine, (*_, color) in ENGINES.items():
        n = [size for name, size in found if name == engine]
        costs = np.array([found[engine, size] for size in n]) / [1.0, MIB]
        for axis, y in zip(axes, costs.T, strict=True):
            axis.loglog(n, y, "o-", color=color, label=engine)
    for axis, label in zip(axes, ("seconds", "MiB over the data"), strict=True):
        axis.set(xlabel="samples n of 14 tasks", ylabel=label)
        axis.grid(which="major", alpha=0.3)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4
    )
    figure.suptitle("One likelihood and gradient, on one thread")
    save(figure, path)


def collect_and_draw(short, table, image):
    """Measure what is missing, and draw."""
    keys = [
        (engine, N_TASKS * size)
        for engine, (sizes, *_) in ENGINES.items()
        for size in sizes
        if not short or size <= MOST_SHORT
    ]
    draw(collect(table, ["engine", "n"], keys, measure), image)


if __name__ == "__main__":
    run(__doc__, "engines.csv", "engines.png", collect_and_draw)
