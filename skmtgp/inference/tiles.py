"""Likelihoods that fill K^x, and contract its gradient, tile by tile."""

import contextlib
from abc import abstractmethod
from itertools import pairwise

import numpy as np

from skmtgp._numerics.parallel import map_threads
from skmtgp.inference.likelihood import Likelihood
from skmtgp.model._nodes import allocate

TILE = 240


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
        self.inputs, n = inputs, len(inputs)
        edges = np.linspace(0, n, -(-n // TILE) + 1)
        self.tiles = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        self.blocks = [(a, b) for i, a in enumerate(self.tiles) for b in self.tiles[i:]]
        side = max(tile.stop - tile.start for tile in self.tiles)
        self.upper = np.triu(np.ones((side, side)), 1)
        np.fill_diagonal(self.upper, 0.5)
        self._spare = []

    def __getstate__(self):
        return vars(self) | {"_spare": []}

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

    def _halve(self, G, rows, cols):
        """Leave of a tile what one triangle takes, and half of the diagonal."""
        if rows == cols:
            G *= self.upper[: len(G), : len(G)]


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
