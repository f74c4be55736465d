"""Time and memory of one likelihood with its gradient by each of the engines.

``python benchmarks/engines.py`` takes complete random data of 14 tasks, so that all of
them can be used, the paper's kernel, rank 4, and for sparse inference 100 and 500 of
the inputs as inducing inputs. It writes ``results/engines.csv`` and the plot of the
user guide, ``docs/images/engines.png``, and goes on where an interrupted run of it
ended; ``--fresh`` starts again. Seconds are the processor's on one thread, the best of
three; memory is the most that is taken over that of the data. ``--short`` takes seconds
and has files of its own.
"""

import argparse
import csv
import tracemalloc
from pathlib import Path
from time import process_time

import matplotlib.pyplot as plt
import numpy as np
from kronecker import make_problem
from threadpoolctl import threadpool_limits

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.sparse import SparseBound

HERE = Path(__file__).parent
N_TASKS, REPEATS, MIB = 14, 3, 2.0**20
ENGINES = {  # inputs of a task, inducing inputs, color
    "dense": ([20, 50, 100, 200, 400], None, "#D55E00"),
    "kronecker": ([20, 100, 200, 500, 1000, 2000], None, "#009E73"),
    "sparse, m = 100": ([20, 100, 500, 2000, 10_000], 100, "#56B4E9"),
    "sparse, m = 500": ([100, 500, 2000, 10_000], 500, "#0072B2"),
}
MOST_SHORT = 100  # inputs of a task
FIELDS = ["engine", "n", "seconds", "bytes"]


def make(engine, n_inputs):
    """A likelihood, and where to evaluate it."""
    problem, theta = make_problem(n_inputs, N_TASKS)
    n_inducing = ENGINES[engine][1]
    if n_inducing is not None:
        X = problem[2]
        return SparseBound(*problem, X[np.arange(n_inducing) % len(X)]), theta
    kinds = {"dense": DenseLikelihood, "kronecker": KroneckerLikelihood}
    return kinds[engine](*problem), theta


def measure(engine, n_inputs):
    """Best seconds of the processor and peak bytes of one evaluation."""
    likelihood, theta = make(engine, n_inputs)
    tracemalloc.start()
    likelihood.value_and_grad(theta)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    times = []
    for _ in range(REPEATS):
        begin = process_time()
        likelihood.value_and_grad(theta)
        times.append(process_time() - begin)
    return min(times), peak


def collect(most, path):
    """Rows of the results file, measured where they are missing."""
    found = {}
    if path.exists():
        with path.open() as file:
            found = {(r["engine"], int(r["n"])): r for r in csv.DictReader(file)}
    for engine, (sizes, *_) in ENGINES.items():
        for n_inputs in [size for size in sizes if size <= most]:
            n = N_TASKS * n_inputs
            if (engine, n) in found:
                continue
            values = engine, n, *measure(engine, n_inputs)
            found[engine, n] = dict(zip(FIELDS, values, strict=True))
            write(found.values(), path)
            print(f"{engine:15s} n {n:7d} {values[2]:9.3f} s {values[3]:12d} bytes")
    return found.values()


def write(rows, path):
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        writer.writeheader()
        writer.writerows(rows)


def draw(rows, path):
    """Two panels, time and memory."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.3), layout="constrained")
    for engine, (*_, color) in ENGINES.items():
        of = sorted((int(r["n"]), r) for r in rows if r["engine"] == engine)
        n = [size for size, _ in of]
        style = {"color": color, "label": engine}
        axes[0].loglog(n, [float(r["seconds"]) for _, r in of], "o-", **style)
        axes[1].loglog(n, [float(r["bytes"]) / MIB for _, r in of], "o-", **style)
    for axis, label in zip(axes, ("seconds", "MiB over the data"), strict=True):
        axis.set(xlabel="samples n of 14 tasks", ylabel=label)
        axis.grid(which="major", alpha=0.3)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4
    )
    figure.suptitle("One likelihood and gradient, on one thread")
    figure.savefig(path, dpi=150)


def main():
    """Measure what is missing, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--fresh", action="store_true")
    arguments = parser.parse_args()
    results = HERE / (".short" if arguments.short else "results")
    table = results / "engines.csv"
    image = HERE.parent / "docs" / "images" / "engines.png"
    if arguments.short:
        image = table.with_suffix(".png")
    if arguments.fresh:
        table.unlink(missing_ok=True)
    with threadpool_limits(1):
        rows = collect(MOST_SHORT if arguments.short else np.inf, table)
    draw(list(rows), image)


if __name__ == "__main__":
    main()
