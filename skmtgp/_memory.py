"""Whether the memory suffices, before it is allocated."""

import contextlib
import math
import os
from pathlib import Path

from skmtgp.exceptions import InsufficientMemoryError

# Between what the covariances are, and how many of them learning takes, by
# benchmarks/memory.py
ROWS = {"dense": "samples", "kronecker": "inputs of each task"}
MATRICES = {"dense": 3, "kronecker": 6}
GIB = 2.0**30


def check_memory(n_rows, n_factors, inference="dense"):
    """Raise an InsufficientMemoryError where the covariances cannot be held.

    Parameters
    ----------
    n_rows : int
        Rows of a covariance.
    n_factors : int
        Covariances whose factors are kept.
    inference : {"dense", "kronecker"}, default="dense"
        Whether the rows are samples, or the inputs that all tasks share.
    """
    _check(
        8.0 * n_rows**2 * max(MATRICES[inference], n_factors),
        f"Exact inference with {n_rows} {ROWS[inference]}",
        "Set inference='sparse', which approximates by inducing inputs, fit fewer "
        "samples, or a SingleTaskGP, whose matrices are of one task each, or a "
        "BayesianLinearRegression, which has none.",
    )


def check_sparse_memory(n_inducing, n_tasks, rank, n_factors):
    """The same of sparse inference.

    Parameters
    ----------
    n_inducing : int
        Number m of inducing inputs.
    n_tasks : int
        Number of tasks M.
    rank : int
        Number r of latent functions.
    n_factors : int
        Posteriors that are kept, of M + r^2 matrices of m x m each; learning takes
        four times that, by benchmarks/sparse_bound.py.
    """
    matrices = (4 + n_factors) * (n_tasks + rank**2)
    _check(
        8.0 * n_inducing**2 * matrices,
        f"Sparse inference with n_inducing={n_inducing}, {n_tasks} tasks and rank "
        f"{rank}",
        "Take fewer inducing inputs, or a lower rank.",
    )


def _check(needed, what, advice):
    available = available_memory()
    if needed > available:
        raise InsufficientMemoryError(
            f"{what} needs about {needed / GIB:.3g} GiB of memory, but "
            f"{available / GIB:.3g} GiB are available. {advice}"
        )


def available_memory():
    """Bytes that can still be allocated; infinite where the system does not tell."""
    with contextlib.suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        line = next(line for line in lines if line.startswith("MemAvailable:"))
        return 1024 * int(line.split()[1])
    with contextlib.suppress(AttributeError, OSError, ValueError):  # not Linux
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return math.inf
