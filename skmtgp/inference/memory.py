"""How much memory the engines take, and whether there is as much."""

import numpy as np

from skmtgp._numerics.bfgs import MEMORY, MOST_DENSE
from skmtgp._numerics.memory import check_available
from skmtgp._numerics.parallel import SMALL, count_threads
from skmtgp.inference.likelihood import FISHER_ROWS, rows_of_information
from skmtgp.inference.sparse import BLOCK
from skmtgp.inference.tiles import edges_of, side_of
from skmtgp.model._nodes import compile_kernel, count_arrays, count_elements
from skmtgp.model.several import terms_of

WORK = 8  # arrays of a tile that come and go, at most
# Matrices between tasks, with levels: of each climb, with where it starts, and of each
# posterior
OF_CLIMB, OF_POSTERIOR = 17, 8
# Of the weights of each column of the targets, of their products, of a block's rows
OF_COLUMN, OF_PRODUCTS, OF_BLOCK = 12, 3, 5
# Matrices between the rows of the Fisher information, beside three for each parameter
# of k^x and two for each function that tasks share
OF_INFORMATION = 12
ALONE = "a SingleTaskGP, whose matrices are of one task each, or "


class TileMemory:
    """Bytes of the tiles of a kernel, with what their gradients need.

    Parameters
    ----------
    kernel : Kernel or Kernels
        k^x.
    x : ndarray of shape (1, n_features)
        An input.
    node : Node, default=None
        The kernel's fast form, where it is there already.

    Attributes
    ----------
    n_arrays : int
        Arrays of a tile until its gradient is contracted.
    """

    def __init__(self, kernel, x, node=None):
        self.kernel, self.node = kernel, node or compile_kernel(kernel)
        self.n_arrays = count_arrays(kernel, x, self.node)

    def of_triangle(self, n_rows, n_climbs):
        """Bytes of exact inference: one triangle of tiles, and work on some of them.

        Parameters
        ----------
        n_rows : int
            Number of inputs that K^x is between.
        n_climbs : int
            Likelihoods at the same time.

        Returns
        -------
        n_bytes : float
            Of all of them.
        """
        edges = np.array(edges_of(n_rows))
        heights, lengths = np.diff(edges), n_rows - edges[:-1]
        kept = self.n_arrays * float((heights * lengths).sum())
        side = int(heights.max(initial=0))
        work = WORK * min(side_of(n_rows), n_rows) ** 2
        work += count_elements(self.kernel, side, self.node)
        n_threads = 1 if n_rows < SMALL else min(count_threads(), len(heights))
        return 8.0 * (n_climbs * kept + max(n_climbs, n_threads) * work)

    @property
    def n_terms(self):
        """Number of terms whose kernels they are of."""
        return len(terms_of(self.kernel))

    def of_blocks(self, n_inducing, n_rows, n_climbs):
        """Bytes of sparse inference: a tile of the inducing inputs and some rows.

        Parameters
        ----------
        n_inducing : int
            Number of inducing inputs.
        n_rows : int
            Rows that the bound is of.
        n_climbs : int
            Bounds at the same time.

        Returns
        -------
        n_bytes : float
            Of all of them.
        """
        size = min(n_rows, BLOCK)
        arrays = (self.n_arrays + WORK * self.n_terms) * n_inducing * size
        side = min(size, n_inducing)
        return 8.0 * n_climbs * (arrays + count_elements(self.kernel, side, self.node))


def check_memory(demand, tiles, n_rows, *, rows, n_matrices, n_of_tasks=0, why=""):
    """Raise an InsufficientMemoryError where exact covariances cannot be held.

    Parameters
    ----------
    demand : Demand
        What is asked for.
    tiles : TileMemory
        What the kernel takes.
    n_rows : int
        Rows of a covariance.
    rows : str
        What they are.
    n_matrices : float
        How many of them a likelihood takes beside the tiles.
    n_of_tasks : int, default=0
        Matrices between tasks that it takes beside.
    why : str, default=""
        What keeps the data from an engine that takes less.
    """
    of_climbs = _matrices(n_rows, n_matrices * demand.n_climbs)
    of_climbs += tiles.of_triangle(n_rows, demand.n_climbs)
    of_rows = max(of_climbs, _matrices(n_rows, demand.n_kept))
    of_rows = max(of_rows, _of_information(demand, tiles.kernel, demand.n_climbs))
    of_tasks = _of_tasks(demand, demand.n_climbs, demand.n_parameters)
    of_tasks += _matrices(demand.n_tasks, n_of_tasks * demand.n_climbs)
    tasks = f" and {demand.n_tasks} tasks" if of_tasks > of_rows else ""
    check_available(
        of_rows + of_tasks,
        f"Exact inference with {n_rows} {rows}{tasks}{_at_a_time(demand.n_climbs)}",
        f"{why} "
        "Set inference='sparse', which approximates by inducing inputs, "
        f"{'lower n_jobs, ' if demand.n_climbs > 1 else ''}fit fewer samples, or "
        f"{'' if demand.alone else ALONE}a BayesianLinearRegression, which has none.",
    )


def of_gaps(n_missing, n):
    """What missing cells take beside, in matrices of n x n.

    Four of these, and some vectors of n and of n_missing for each cell.
    """
    of_cells = n_missing * (4.0 * n + 1.5 * n_missing) / n**2
    return of_cells + 4.0 * (n_missing > 0)


def check_sparse_memory(demand, tiles, n_inducing, n_exact):
    """The same of sparse inference.

    Parameters
    ----------
    demand : Demand
        What is asked for. Of M tasks that share r latent functions of Q terms it takes
        M Q^2 + r^2 matrices of m x m for each posterior that is kept; learning takes up
        to six times that. Each coefficient of a trend is a column more of the targets:
        M Q m + r m numbers for each posterior, up to twelve times that to learn it, and
        as many as M products with the other columns.
    tiles : TileMemory
        What the kernel takes.
    n_inducing : int
        Number m of inducing inputs.
    n_exact : int
        Rows that are learned from exactly, before.
    """
    n, n_tasks, rank = demand.n_samples, demand.n_tasks, demand.rank
    n_inducing, n_exact = min(n, n_inducing), min(n, n_exact)
    n_climbs, n_exact_climbs = demand.n_climbs, demand.n_exact_climbs
    of_each = n_tasks * tiles.n_terms**2 + rank**2
    matrices = (6 * n_climbs + demand.n_kept) * of_each
    of_bound = _matrices(n_inducing, matrices)
    of_bound += tiles.of_blocks(n_inducing, n, n_climbs)
    of_bound += _of_trend(demand, n_inducing * (n_tasks * tiles.n_terms + rank))
    of_exact = _matrices(n_exact, n_exact_climbs)
    of_exact += tiles.of_triangle(n_exact, n_exact_climbs)
    n_at_once = max(n_climbs, n_exact_climbs)
    of_exact = max(of_exact, _of_information(demand, tiles.kernel, n_at_once))
    of_tasks = _of_tasks(demand, n_at_once, n_tasks * rank)
    check_available(
        of_tasks,
        f"Sparse inference with {n_tasks} tasks{_at_a_time(n_at_once)}",
        "Its matrices between tasks take that, with any number of inducing inputs. "
        f"{'Lower n_jobs, ' if n_at_once > 1 else 'Take '}fewer tasks, such as groups "
        f"of them, {ALONE}a BayesianLinearRegression, which has none.",
    )
    check_available(
        max(of_bound, of_exact) + of_tasks,
        f"Sparse inference with n_inducing={n_inducing}, {n_tasks} tasks and rank "
        f"{rank}{_at_a_time(n_climbs)}",
        "Take fewer inducing inputs, a lower rank, n_exact or n_jobs.",
    )


def _of_trend(demand, n_weights):
    """Bytes of a trend in sparse inference, of as many weights for each column."""
    if not demand.n_coefficients:
        return 0.0
    n_columns, size = 1 + demand.n_coefficients, min(demand.n_samples, BLOCK)
    products = OF_PRODUCTS * demand.n_tasks * n_columns
    of_climb = OF_COLUMN * n_weights + products + OF_BLOCK * size
    of_posterior = n_weights + n_columns
    of_all = demand.n_climbs * of_climb + demand.n_kept * of_posterior
    return 8.0 * n_columns * of_all


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
    check_available(
        8.0 * (4 * n_new**2 + 2 * rank * side * n_new + 3 * side**2),
        f"add_task with {n_new} samples, {n_inducing} inducing inputs and rank {rank}",
        "Give fewer samples of the new task.",
    )


def _matrices(n, how_many):
    """Bytes of matrices of n x n."""
    return 8.0 * n**2 * how_many


def _of_tasks(demand, n_climbs, n_parameters):
    """Bytes of matrices between tasks, and of the steps that limited memory keeps.

    Where a parameter is at a bound there are copies of the steps.
    """
    matrices = max(OF_CLIMB * n_climbs, OF_POSTERIOR * demand.n_kept)
    steps = 4 * MEMORY * n_parameters if n_parameters > MOST_DENSE else 0
    return _matrices(demand.n_tasks, matrices) + 8.0 * steps * n_climbs


def _of_information(demand, kernel, n_climbs):
    """Bytes of the Fisher information with which climbs of many tasks begin."""
    n_rows = rows_of_information(demand.n_samples, demand.n_tasks)
    if n_rows <= FISHER_ROWS:
        return 0.0
    n_matrices = OF_INFORMATION + 3 * kernel.n_dims + 2 * demand.rank
    return _matrices(n_rows, n_matrices * n_climbs)


def _at_a_time(n_climbs):
    return f", {n_climbs} times at once by n_jobs," if n_climbs > 1 else ""
