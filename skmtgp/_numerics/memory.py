"""Whether the memory suffices, before it is allocated."""

import contextlib
import math
import os
from pathlib import Path

from skmtgp._numerics.bfgs import MEMORY, MOST_DENSE
from skmtgp._support.guide import INFERENCE
from skmtgp.exceptions import InsufficientMemoryError

# Between what the covariances are, and how many matrices of them learning takes beside
# the tiles: K, and two for its eigen-decomposition
ROWS = {"dense": "samples", "kronecker": "inputs of each task"}
MATRICES = {"dense": 1, "kronecker": 3}
# Matrices between tasks: of each climb, with where it starts, and of each posterior
OF_CLIMB, OF_POSTERIOR = 12, 4
GIB = 2.0**30
PROC, CGROUP = Path("/proc"), Path("/sys/fs/cgroup")
CONTROLS = [  # of a control group: limit, use, files within that can be let go
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
]


def check_memory(
    n_rows,
    n_factors,
    inference="dense",
    *,
    tiles,
    n_tasks=0,
    n_parameters=0,
    n_climbs=1,
    why="",
    alone=False,
):
    """Raise an InsufficientMemoryError where the covariances cannot be held.

    Parameters
    ----------
    n_rows : int
        Rows of a covariance.
    n_factors : int
        Covariances whose factors are kept.
    inference : {"dense", "kronecker"}, default="dense"
        Whether the rows are samples, or the inputs that all tasks share.
    tiles : TileMemory
        What the kernel takes.
    n_tasks : int, default=0
        Tasks, with matrices between them.
    n_parameters : int, default=0
        Parameters that tasks have.
    n_climbs : int, default=1
        Climbs at the same time.
    why : str, default=""
        What the method was chosen for, if there is something to say about it.
    alone : bool, default=False
        Whether the rows are of one task already.
    """
    fewer_jobs = "lower n_jobs, " if n_climbs > 1 else ""
    single = "" if alone else "a SingleTaskGP, whose matrices are of one task each, or "
    of_climbs = _matrices(n_rows, MATRICES[inference] * n_climbs)
    of_climbs += tiles.of_triangle(n_rows, n_climbs)
    of_rows = max(of_climbs, _matrices(n_rows, n_factors))
    of_tasks = _of_tasks(n_tasks, n_parameters, n_climbs, n_factors)
    tasks = f" and {n_tasks} tasks" if of_tasks > of_rows else ""
    _check(
        of_rows + of_tasks,
        f"Exact inference with {n_rows} {ROWS[inference]}{tasks}{_at_a_time(n_climbs)}",
        f"{why} "
        "Set inference='sparse', which approximates by inducing inputs, "
        f"{fewer_jobs}fit fewer samples, or {single}"
        "a BayesianLinearRegression, which has none.",
    )


def check_sparse_memory(
    n_inducing,
    n_tasks,
    rank,
    n_factors,
    *,
    n_rows,
    tiles,
    n_climbs=1,
    n_exact=0,
    n_exact_climbs=1,
):
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
        Posteriors that are kept, of M + r^2 matrices of m x m each; learning takes up
        to six times that.
    n_rows : int
        Rows, some of which are read at a time.
    tiles : TileMemory
        What the kernel takes.
    n_climbs : int, default=1
        Climbs of the bound at the same time.
    n_exact : int, default=0
        Rows that are learned from exactly, before.
    n_exact_climbs : int, default=1
        Climbs of their likelihood at the same time.
    """
    matrices = (6 * n_climbs + n_factors) * (n_tasks + rank**2)
    of_bound = _matrices(n_inducing, matrices)
    of_bound += tiles.of_blocks(n_inducing, n_rows, n_climbs)
    of_exact = _matrices(n_exact, MATRICES["dense"] * n_exact_climbs)
    of_exact += tiles.of_triangle(n_exact, n_exact_climbs)
    n_climbs, n_parameters = max(n_climbs, n_exact_climbs), n_tasks * rank
    _check(
        max(of_bound, of_exact) + _of_tasks(n_tasks, n_parameters, n_climbs, n_factors),
        f"Sparse inference with n_inducing={n_inducing}, {n_tasks} tasks and rank "
        f"{rank}{_at_a_time(n_climbs)}",
        "Take fewer inducing inputs, a lower rank, n_exact or n_jobs.",
    )


def check_border_memory(n_new, n_inducing, rank):
    """The same for a task that joins a sparse model.

    Parameters
    ----------
    n_new : int
        Its samples.
    n_inducing : int
        Number of inducing inputs.
    rank : int
        Number of latent functions.
    """
    side = rank * min(n_new, n_inducing)
    _check(
        8.0 * (4 * n_new**2 + 2 * rank * side * n_new + 3 * side**2),
        f"add_task with {n_new} samples, {n_inducing} inducing inputs and rank {rank}",
        "Give fewer samples of the new task.",
    )


def _matrices(n, how_many):
    """Bytes of matrices of n x n."""
    return 8.0 * n**2 * how_many


def _of_tasks(n_tasks, n_parameters, n_climbs, n_factors):
    """Bytes of matrices between tasks, and of the steps that limited memory keeps.

    Where a parameter is at a bound there are copies of the steps.
    """
    matrices = max(OF_CLIMB * n_climbs, OF_POSTERIOR * n_factors)
    steps = 4 * MEMORY * n_parameters if n_parameters > MOST_DENSE else 0
    return _matrices(n_tasks, matrices) + 8.0 * steps * n_climbs


def _at_a_time(n_climbs):
    return f", {n_climbs} times at once by n_jobs," if n_climbs > 1 else ""


def _check(needed, what, advice):
    available = available_memory()
    if needed > available:
        raise InsufficientMemoryError(
            f"{what} needs about {needed / GIB:.3g} GiB of memory, but "
            f"{available / GIB:.3g} GiB are available. {advice.strip()} {INFERENCE}"
        )


def available_memory():
    """Bytes that can still be allocated; infinite where the system does not tell.

    The machine's, or what is left to the container if that is less.
    """
    left = (_left(group, *names) for group in _control_groups() for names in CONTROLS)
    return min(_of_the_machine(), *left)


def _control_groups():
    """Folders of the control groups that this process may be in."""
    groups = {CGROUP, CGROUP / "memory"}
    with contextlib.suppress(OSError, ValueError):
        for line in (PROC / "self" / "cgroup").read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers in ("", "memory"):  # version 2, version 1
                group = CGROUP / controllers / path.lstrip("/")
                groups.update([group, *group.parents])
    return groups


def _left(group, limit, used, files):
    """Bytes that a control group leaves; infinite where it has no limit."""
    try:
        most, held = (int((group / name).read_text()) for name in (limit, used))
    except (OSError, ValueError):  # "max"
        return math.inf
    with contextlib.suppress(OSError, ValueError, KeyError):
        lines = (group / "memory.stat").read_text().splitlines()
        held -= int(dict(line.split() for line in lines)[files])
    return max(0, most - held)


def _of_the_machine():
    with contextlib.suppress(OSError, ValueError, StopIteration):
        lines = (PROC / "meminfo").read_text().splitlines()
        line = next(line for line in lines if line.startswith("MemAvailable:"))
        return 1024 * int(line.split()[1])
    with contextlib.suppress(AttributeError, OSError, ValueError):  # not Linux
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return math.inf
