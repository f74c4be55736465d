"""The observations of one output, of which parts can be taken."""

from dataclasses import dataclass, replace

import numpy as np

from skmtgp._data.known import Known
from skmtgp._data.subsets import draw_rows


@dataclass(frozen=True)
class Data:
    """The observations of one output.

    Attributes
    ----------
    X : ndarray of shape (n_samples, n_features)
        Inputs, sorted by task. For sparse inference they may be in any order, on disk
        or, as `tasks` and `y`, in a Dask array.
    tasks : ndarray of shape (n_samples,)
        Tasks, 0 to n_tasks - 1.
    y : ndarray of shape (n_samples,)
        Targets.
    n_tasks : int
        Number of tasks M.
    design : ndarray of shape (n_inputs, n_tasks), default=None
        The row of each input and task, -1 where it is missing, where most are observed,
        once each, and this is made use of: parts of the data are so then, too.
    Z : ndarray of shape (n_inducing, n_features), default=None
        Inducing inputs, for a bound on the likelihood.
    Q : ndarray of shape (n_tasks, n_rows), default=None
        What is known of the tasks, see :class:`~skmtgp._data.descriptors.Descriptors`.
    known : Known, default=None
        What is known of the noise of each row.
    """

    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray
    n_tasks: int
    design: np.ndarray | None = None
    Z: np.ndarray | None = None
    Q: np.ndarray | None = None
    known: Known | None = None

    def __len__(self):
        return len(self.y)

    @property
    def n_told(self):
        """How many rows a factor of K^rho has: one for each task, or descriptor."""
        return self.n_tasks if self.Q is None else self.Q.shape[1]

    @property
    def n_inputs(self):
        """Number of rows, of complete data of inputs."""
        return len(self.y) if self.design is None else len(self.design)

    def thinned(self, size):
        """About `size` of the rows, of each task its share and at least one.

        Of complete data it is as many inputs. What is left is drawn at random, but less
        is always part of more.
        """
        if self.design is None:
            return self._part(self._rows(size))
        order = np.random.default_rng(0).permutation(len(self.design))
        there = self.design[order] >= 0
        kept = np.arange(len(order)) < size
        kept[there.argmax(axis=0)] = True  # an input of each task, always the same
        design = self.design[order[kept]]
        there = there[kept]
        rows = np.sort(design[there])
        design[there] = np.searchsorted(rows, design[there])
        return replace(self._part(rows), design=design)

    def of_tasks(self, kept):
        """The rows of some tasks, of which `kept` is a mask; all tasks count."""
        return self._part(np.flatnonzero(kept[self.tasks]))

    def drawn(self, size):
        """`size` of the rows, of each task its share, or a few of some tasks.

        They are as many whatever their order, and wherever they lie. They come into
        memory. Less is not part of more.
        """
        return self._part(draw_rows(self.tasks, self.n_tasks, size))

    @property
    def counts(self):
        """How many measurements each row stands for."""
        return np.ones(len(self.y)) if self.known is None else self.known.counts

    @property
    def n_measured(self):
        """How many measurements the rows stand for."""
        return len(self) if self.known is None else self.known.counts.sum()

    @property
    def deviation(self):
        """Of the targets of all measurements about their mean."""
        if self.known is None:
            return float(self.y.std())
        mean = np.average(self.y, weights=self.counts)
        squares = np.square(self.y - mean) + self.known.spread
        return float(np.sqrt(np.average(squares, weights=self.counts)))

    @property
    def size(self):
        """Root mean square of the targets of all measurements."""
        if self.known is None:
            return float(np.sqrt(np.square(self.y).mean()))
        squares = np.square(self.y) + self.known.spread
        return float(np.sqrt(np.average(squares, weights=self.counts)))

    def some(self, rows):
        """X, tasks, y and what is known of some rows, in this order, in memory."""
        X, tasks, y = (np.asarray(of[rows]) for of in (self.X, self.tasks, self.y))
        return X, tasks, y, self.known and self.known.part(rows)

    def _part(self, rows):
        rows = np.sort(rows)
        tasks = np.asarray(self.tasks[rows])
        order = np.argsort(tasks, kind="stable")
        X, y = (np.asarray(of[rows], dtype=np.float64) for of in (self.X, self.y))
        parts = {"X": X[order], "tasks": tasks[order], "y": y[order], "design": None}
        return replace(self, **parts, known=self.known and self.known.part(rows[order]))

    def _rows(self, n_samples):
        n = len(self.tasks)
        order = np.random.default_rng(0).permutation(n)
        order = order[np.argsort(self.tasks[order], kind="stable")]
        of_task = np.unique(self.tasks, return_counts=True)[1]
        place = np.arange(n) - np.repeat(np.cumsum(of_task) - of_task, of_task)
        share = -(-of_task * n_samples // n)
        return order[place < np.repeat(share, of_task)]
