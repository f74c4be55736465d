"""Peak memory of a whole fit, in matrices of n x n doubles.

``python benchmarks/memory.py`` fits the paper's kernel with 14 tasks, rank 4 and a few
iterations in a process of its own for each n, and prints how far its peak lies above
what it held with the data and after a tiny fit (goal: at most 4 matrices).
"""

import argparse
import resource
import subprocess
import sys
import warnings

import numpy as np
from settings import PAPER
from sklearn.exceptions import ConvergenceWarning

from skmtgp import MultiTaskGPRegressor
from skmtgp.kernels import inverse_dynamics_kernel

N_TASKS, RANK = 14, 4


def peak():
    """Most bytes that this process has held so far."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def used(n):
    """Bytes that a fit to n samples takes over the data."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((n, 18))
    X = np.column_stack([x, np.sign(x[:, 6:12]), np.arange(n) % N_TASKS])
    y = np.sin(x).sum(axis=1) * (1.0 + X[:, -1])
    kernel = inverse_dynamics_kernel(6)
    model = MultiTaskGPRegressor(kernel, rank=RANK, max_iter=2, **PAPER)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(X[:28], y[:28])  # libraries are loaded, threads started
        before = peak()
        model.fit(X, y)
    return peak() - before


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, nargs="+", default=[2800, 4000])
    parser.add_argument("--here", action="store_true", help="in this process")
    arguments = parser.parse_args()
    if arguments.here:
        print(used(arguments.n[0]))
        return
    print("    n       MiB   n x n doubles")
    for n in arguments.n:
        command = [sys.executable, __file__, "--here", "--n", str(n)]
        found = int(subprocess.run(command, check=True, capture_output=True).stdout)
        print(f"{n:5d} {found / 2**20:9.0f} {found / (8.0 * n * n):15.2f}", flush=True)


if __name__ == "__main__":
    main()
