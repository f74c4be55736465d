"""Likelihoods that fill K^x, and contract its gradient, tile by tile."""

import contextlib
from abc import abstractmethod
from functools import cached_property
from itertools import pairwise
from math import ceil, sqrt

import numpy as np

from skmtgp._numerics.parallel import map_threads
from skmtgp.inference.likelihood import Likelihood
from skmtgp.model._nodes import allocate

# Side of a square of as many pairs as a tile of few rows has. Products of more pairs
# and some 25 features take a little longer: OpenBLAS has another way for small ones
TILE = 200
# It is a fifth of more rows, since threads wait for each other between numpy's calls:
# of small tiles two of them are no faster than one. Tiles twice as long leave the cache
PARTS, LONGEST = 5, 1.4
WIDE = 4  # such sides: the columns of a tile, at most


def side_of(n):
    """Side of a square of as many pairs as a tile of a triangle of n rows has."""
    return min(max(TILE, n // PARTS), int(LONGEST * TILE))


def edges_of(n):
    """Where strips of the triangle's rows begin, and n.

    Down the triangle rows become shorter, and strips of as many pairs higher. Strips
    that end at the last column waste less beyond the diagonal than squares do.
    """
    side = side_of(n)
    lengths = [0.0, float(side)]  # of rows of the strips, from the last one up
    while (below := lengths[-1]) < n:
        pairs = side**2 * ceil(below / (WIDE * side))
        lengths.append(0.5 * (below + sqrt(below**2 + 4.0 * pairs)))
    lengths = np.array(lengths[::-1])
    return np.unique(np.rint(n - lengths * (n / lengths[0])).astype(int)).tolist()


def blocks_of(n):
    """Rows and columns of each tile of the triangle: strips in as many parts as needed.

    The first part of a strip begins at the diagonal.
    """
    blocks, wide = [], WIDE * side_of(n)
    for a, b in pairwise(edges_of(n)):
        edges = np.linspace(a, n, ceil((n - a) / wide) + 1).astype(int)
        parts = pairwise(edges.tolist())
        blocks += [(slice(a, b), slice(*part)) for part in parts]
    return blocks


class TiledLikelihood(Likelihood):
    """A likelihood whose K^x is filled in tiles, those of one triangle.

    Parameters
    ----------
    prior, X, tasks, y
        See Likelihood.
    inputs : ndarray of shape (n_inputs, n_features)
        The inputs that K^x is between.

    Attributes
    ----------
    blocks : list of (slice, slice)
        Rows and columns of each tile.
    """

    def __init__(self, prior, X, tasks, y, inputs, known=None):
        super().__init__(prior, X, tasks, y, known)
        self.inputs, self.blocks, self._spare = inputs, blocks_of(len(inputs)), []

    def __getstate__(self):
        made_again = {"_below", "_parts", "_whole", "stacked"}
        kept = {name: of for name, of in vars(self).items() if name not in made_again}
        return kept | {"_spare": []}

    @cached_property
    def _below(self):
        """Which pairs are below the diagonal, of the highest tile."""
        return np.tri(
            max(of.stop - of.start for of, _ in self.blocks), k=-1, dtype=bool
        )

    @abstractmethod
    def _differentiate(self, theta):
        """The value and its gradients.

        They are those by theta of k^x, K^rho, and the variances of levels and noise.
        """

    def _evaluate_with_grad(self, theta):
        """The value and its gradient; NotPositiveDefiniteError where K fails."""
        value, *gradients = self._differentiate(theta)
        return value, self.prior.gradient(theta, *gradients)

    def task_gradient(self, theta):
        """Derivative of the value with respect to K^rho, (n_tasks, n_tasks)."""
        return self._differentiate(theta)[2]

    def release(self):
        """Give back the memory that is kept for the next evaluation."""
        self._spare.clear()

    @contextlib.contextmanager
    def _workspace(self):
        """The memory of an evaluation before, or new memory where there is none."""
        try:
            workspace = self._spare.pop()
        except IndexError:  # none, or another thread has taken the last
            workspace = Workspace(self.blocks)
        try:
            yield workspace
        finally:
            self._spare.append(workspace)

    def _bind(self, theta):
        """k^x and K^rho at theta, the levels' variance and the noise variances."""
        values = self.prior.values(theta)
        bound = self.prior.node.bind(values.kernel, self.inputs)
        return bound, self.prior.K_rho_at(theta), values.level, values.noise

    def _fill_tiles(self, bound, put, memory=None):
        """Call ``put(K_x, rows, cols)`` for each tile; return (K_x, tape) of each.

        `memory` has Arrays for each tile; without it nothing is kept.
        """

        def fill(rows, cols, arrays):
            new = iter(arrays).__next__ if arrays else allocate
            K_x, tape = bound.block(rows, cols, new)
            put(K_x, rows, cols)
            return (K_x, tape) if arrays else None

        memory = memory or [None] * len(self.blocks)
        jobs = [
            (*block, arrays) for block, arrays in zip(self.blocks, memory, strict=True)
        ]
        return map_threads(fill, jobs)

    def _map_tiles(self, function, kept):
        """``function(rows, cols, K_x, tape)`` of each tile."""
        jobs = [(*block, *of) for block, of in zip(self.blocks, kept, strict=True)]
        return map_threads(function, jobs)

    def _clear_below(self, tile, rows, cols):
        """Leave of a tile what is in the upper triangle."""
        if rows.start == cols.start:
            tile[:, : len(tile)][self._below[: len(tile), : len(tile)]] = 0.0


def diagonal_of(tile):
    """The diagonal of a tile that begins there, or of a matrix; can be written to."""
    return np.einsum("ii->i", tile[:, : len(tile)])


class TasksOfSide:
    """Which tasks the rows, or the columns, of a tile have.

    Parameters
    ----------
    tasks : ndarray of shape (n_rows,)
        Of each of them, ascending.

    Attributes
    ----------
    tasks, starts : ndarray of shape (n_present,)
        Those that are there, and the first row of each.
    ranges : dict
        Where the rows of each of them are.
    span : slice
        All tasks from the first to the last of them.
    places : ndarray of shape (n_rows,)
        The task of each row, counted from the first.
    """

    def __init__(self, tasks):
        self.tasks, self.starts = np.unique(tasks, return_index=True)
        stops = [*self.starts[1:].tolist(), len(tasks)]
        of_each = map(slice, self.starts.tolist(), stops)
        self.ranges = dict(zip(self.tasks.tolist(), of_each, strict=True))
        self.span, self.places = slice(tasks[0], tasks[-1] + 1), tasks - tasks[0]


class Workspace:
    """The memory of an evaluation, for the next one: fresh memory takes time.

    Parameters
    ----------
    blocks : list of (slice, slice)
        Rows and columns of each tile, the last tile at the last row.

    Attributes
    ----------
    K : ndarray of shape (n_inputs, n_inputs)
        Place for the covariance.
    tiles : list of Arrays
        Places for what the gradient needs of each tile.
    """

    def __init__(self, blocks):
        # glibc keeps what was freed, up to twice the largest array so far. Without this
        # one, the inverse of K fetches its memory anew each time: 5 % at n = 1400
        np.empty((blocks[-1][0].stop,) * 2)
        self.K = np.empty((blocks[-1][0].stop,) * 2)
        self.tiles = [Arrays((a.stop - a.start, b.stop - b.start)) for a, b in blocks]


class Arrays:
    """Arrays of one shape without end, the same ones in each iteration."""

    def __init__(self, shape):
        self.shape, self.made = shape, []

    def __iter__(self):
        yield from self.made
        while True:
            self.made.append(np.empty(self.shape))
            yield self.made[-1]
