"""Sparse inference where the rows are: a Dask cluster of two workers.

``python benchmarks/dask_rows.py`` makes 1,000,000 rows in 20 partitions on the
workers of a LocalCluster, one thread each, and prints for a bound with its gradient

- seconds by the clock; seconds of the processor, which other work on the machine does
  not add to: of the workers' tasks, and of the client with Dask's scheduler in it;
- bytes: what the client sends and receives, as the sizes of the pickled arguments and
  of the pickled total; what the workers send each other, as they count it themselves,
  which leaves out the features that each worker gets;
- the same evaluation in one process, which makes the rows anew, and how far the value
  and the gradient differ;

then a short fit and the most memory that the client has had. ``--n 20000`` is
quick.
"""

import argparse
import pickle
import resource
import sys
from contextlib import contextmanager
from time import perf_counter, process_time

import dask
import dask.array as da
import numpy as np
from distributed import Client, LocalCluster
from settings import PAPER
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp.inference.gradients import Gradients
from skmtgp.inference.sparse import SparseBound
from skmtgp.inference.sums import sum_features, sum_gradients
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank

N_FEATURES, N_TASKS, RANK, MIB = 6, 5, 2, 2.0**20


def make(n, seed):
    """Rows of a partition: inputs, the task, the target."""
    rng = np.random.default_rng(seed)
    X, tasks = rng.uniform(-2.0, 2.0, (n, N_FEATURES)), rng.integers(0, N_TASKS, n)
    y = np.sin(X[:, 0]) * (1.0 + tasks) + np.cos(X[:, 1] + X[:, 2]) * (tasks - 2.0)
    y += 0.1 * rng.standard_normal(n)
    return np.column_stack([X, tasks, y])


def on_workers(n, n_parts):
    """The rows of all partitions as a Dask array."""
    shape, do = (n // n_parts, N_FEATURES + 2), dask.delayed(make)
    parts = [do(shape[0], seed) for seed in range(n_parts)]
    return da.concatenate([da.from_delayed(part, shape, float) for part in parts])


def bound_of(rows, Z):
    """The bound over rows as `make` gives them, and parameters."""
    X, tasks, y = rows[:, :-2], rows[:, -2].astype(int), rows[:, -1]
    if isinstance(rows, da.Array):
        X, tasks, y = dask.persist(X, tasks, y)
    kernel, form = RBF(np.full(N_FEATURES, 2.0)), low_rank(N_TASKS, RANK)
    rho = form.parameters(np.eye(N_TASKS) + 0.1)
    theta = np.concatenate([kernel.theta, rho, [np.log(0.01)]])
    return SparseBound(Prior(kernel, form), X, tasks, y, Z), theta


def sizes(rows, Z):
    """Bytes of what travels in the two passes, out and back, from a few rows."""
    bound, theta = bound_of(rows, Z)
    features, weights = bound.forward(theta)
    adjoint = Gradients(weights).adjoint()
    forward = bound.over_rows(sum_features, features, N_TASKS)
    backward = bound.over_rows(sum_gradients, features, adjoint)
    out = pickle.dumps([features, N_TASKS]), pickle.dumps([features, adjoint])
    back = pickle.dumps(forward), pickle.dumps(backward)
    return [sum(map(len, of_passes)) for of_passes in (out, back)]


def spent(dask_worker):
    """Seconds of the processor that a worker has spent in tasks."""
    totals = dask_worker.digests_total.items()
    return sum(seconds for key, seconds in totals if "thread-cpu" in key)


def sent(dask_worker):
    """Bytes that a worker has sent to others."""
    return dask_worker.transfer_outgoing_bytes_total


def total(client, function):
    """Over the workers."""
    return sum(client.run(function).values())


def evaluate(client, bound, theta, repeats):
    """The best evaluation: seconds by three clocks and bytes, with its result."""
    found = []
    for _ in range(repeats):
        before = total(client, spent), total(client, sent), process_time()
        begin = perf_counter()
        result = bound.value_and_grad(theta)
        seconds = perf_counter() - begin
        of_client = process_time() - before[2]
        of_workers, moved = total(client, spent), total(client, sent)
        row = seconds, of_workers - before[0], of_client, moved - before[1]
        found.append((row, result))
    return min(found, key=lambda pair: pair[0])


@contextmanager
def counted_passes():
    """A list that gets an entry for each pass over all rows."""
    passes, over_rows = [], SparseBound.over_rows

    def counted(bound, *arguments, **options):
        passes.append(None)
        return over_rows(bound, *arguments, **options)

    SparseBound.over_rows = counted
    yield passes
    SparseBound.over_rows = over_rows


def main():
    """Print the measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=1_000_000)
    parser.add_argument("--m", type=int, default=100, help="inducing inputs")
    parser.add_argument("--parts", type=int, default=20, help="partitions")
    parser.add_argument("--repeats", type=int, default=3, help="evaluations")
    parser.add_argument("--max-iter", type=int, default=2, help="of the fit")
    options = parser.parse_args()
    n, m = options.n, options.m
    print("python benchmarks/dask_rows.py", *sys.argv[1:])
    print(
        f"n = {n}, m = {m}, {N_TASKS} tasks, rank {RANK}, {options.parts} partitions "
        f"of {n // options.parts * 8 * (N_FEATURES + 2) / MIB:.1f} MiB"
    )
    few = make(max(2 * m, 1000), 0)
    Z = few[:m, :-2]
    out, back = sizes(few, Z)
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with cluster, Client(cluster) as client:
        rows = on_workers(n, options.parts)
        bound, theta = bound_of(rows, Z)
        far_row, far = evaluate(client, bound, theta, options.repeats)
        wall, of_workers, of_client, moved = far_row
        print(
            f"two workers: {wall:.2f} s an evaluation; processor: workers "
            f"{of_workers:.2f} s, client {of_client:.2f} s"
        )
        print(
            f"bytes an evaluation (two passes): client sends {out / MIB:.2f} MiB, "
            f"receives {back / MIB:.2f} MiB; workers send each other "
            f"{moved / MIB:.2f} MiB ({8 * N_TASKS * m**2 / MIB:.2f} are M m x m)",
            flush=True,
        )
        del bound
        model = MultiTaskGPRegressor(
            RBF(np.full(N_FEATURES, 2.0)),
            rank=RANK,
            inference="sparse",
            n_inducing=m,
            max_iter=options.max_iter,
            **PAPER,
        )
        begin = perf_counter()
        with counted_passes() as passes:
            model.fit(rows[:, :-1], rows[:, -1])
        print(
            f"fit with max_iter={options.max_iter}: {perf_counter() - begin:.1f} s, "
            f"{len(passes)} passes over all rows; "
            f"bound {model.log_marginal_likelihood_value_ / n:.4f} nats a row, noise "
            f"variance {model.noise_variance_:.4f}"
        )
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        print(f"most memory of the client: {most / MIB:.0f} MiB", flush=True)
    parts = range(options.parts)
    rows = np.concatenate([make(n // options.parts, seed) for seed in parts])
    bound, theta = bound_of(rows, Z)
    begin, begin_cpu = perf_counter(), process_time()
    here = bound.value_and_grad(theta)
    print(
        f"one process: {perf_counter() - begin:.2f} s an evaluation, processor "
        f"{process_time() - begin_cpu:.2f} s"
    )
    value = abs(far[0] / here[0] - 1.0)
    gradient = np.abs(far[1] - here[1]).max() / np.abs(here[1]).max()
    print(f"relative differences: value {value:.1e}, gradient {gradient:.1e}")


if __name__ == "__main__":
    main()
