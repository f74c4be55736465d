"""Time and memory of one sparse bound and its gradient as the rows grow.

``python benchmarks/sparse_bound.py`` prints a table for the paper's kernel, 14 tasks
and rank 4: seconds of the processor on one thread, the best of a few, and the most
memory over that of the data (n x m doubles are given beside it). Both should grow as
n^1 and n^0: with n = 100,000 the rows are most of the work. ``--million`` adds
n = 1,000,000 (at m = 100 half a minute and 200 MB of data). The floor is what no way
to the gradient does without, see `floor`; it is timed in turns with the rest.
"""

import argparse
import tracemalloc
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from skmtgp.inference.sparse import SparseBound
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import LowRank

N_TASKS, RANK, MIB = 14, 4, 2.0**20


def make(n, m, seed=0):
    """A bound over random data, and parameters at which to evaluate it."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, 24))
    np.sign(X[:, :6], out=X[:, 18:])
    kernel, form = inverse_dynamics_kernel(6), LowRank(N_TASKS, RANK)
    tasks, y = np.arange(n) % N_TASKS, rng.standard_normal(n)
    bound = SparseBound(Prior(kernel, form), X, tasks, y, X[:m].copy())
    F = rng.standard_normal(form.n_parameters)
    return bound, np.concatenate([kernel.theta, F, [np.log(1e-2)]])


def floor(bound, theta):
    """Seconds of the steps of n m^2, each taken once, and of the kernel's values.

    Features are whitened, L^{-1} k^x(Z, X), because Gram matrices of k^x(Z, X) would
    square the condition number of K_ZZ. The value needs a triangular solve and the Gram
    matrix of one triangle; the gradient needs products of the features with matrices
    that the Gram matrices give. So a second pass must multiply, and either keep n x m
    features or, as the package does, compute them again.
    """
    features, _ = bound.forward(theta)
    m, out = len(bound.Z), None
    S, C = np.zeros((m, m)), np.random.default_rng(0).standard_normal((m, m))
    begin = process_time()
    for X, _, _ in bound.blocks():
        phi = features.tile(X).phi
        S += phi @ phi.T
        out = np.matmul(C, phi, out=out if np.shape(out) == phi.shape else None)
    return process_time() - begin


def measure(n, m, repeats):
    """Best seconds: a value, a value with its gradient, the floor; and peak bytes."""
    bound, theta = make(n, m)
    tracemalloc.start()
    bound.value_and_grad(theta)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    rows = [
        (
            seconds(bound.value, theta),
            seconds(bound.value_and_grad, theta),
            floor(bound, theta),
        )
        for _ in range(repeats)
    ]
    return *np.min(rows, axis=0), peak


def seconds(function, *arguments):
    """Seconds of the processor of one call."""
    begin = process_time()
    function(*arguments)
    return process_time() - begin


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--m", type=int, nargs="+", default=[50, 100, 200, 400])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--million", action="store_true", help="n = 1,000,000 too")
    arguments = parser.parse_args()
    sizes = [*arguments.n, *([1_000_000] if arguments.million else [])]
    print(
        "   m         n   value s  value+grad s  floor s  ratio  time ~ n^     MiB"
        "   n x m MiB"
    )
    with threadpool_limits(1):
        for m in arguments.m:
            before = None
            for n in sizes:
                a, b, c, peak = measure(n, m, arguments.repeats)
                power = np.nan
                if before:
                    power = np.log(b / before[1]) / np.log(n / before[0])
                print(
                    f"{m:4d} {n:9d} {a:9.3f} {b:13.3f} {c:8.3f} {b / c:6.2f} "
                    f"{power:10.2f} {peak / MIB:7.1f} {8.0 * n * m / MIB:11.1f}",
                    flush=True,
                )
                before = n, b


if __name__ == "__main__":
    main()
