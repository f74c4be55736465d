r"""The trend of the prior: columns whose coefficients have a flat prior.

.. math:: y_i = h(x_i)^T \beta_{(m_i)} + f^{m_i}(x_i) + \epsilon_i

with one set of coefficients for all tasks, or one a task. They are integrated out, so
that theta has none of them.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import qr

from skmtgp._numerics.linalg import RESOLVED

INDEPENDENT = 1e-10  # of its length: what is left of a column beside the others


@dataclass(frozen=True)
class Trend:
    """Columns of a trend in the units in which an output is learned.

    Attributes
    ----------
    columns : callable
        h(x) of rows of inputs, of shape (n_samples, n_trend).
    n_tasks : int
        Number of tasks.
    per_task : bool
        Whether each task has coefficients of its own.
    centre : ndarray of shape (1, n_trend) or (n_tasks, n_trend)
        What the columns are taken off, as the targets are off their mean.
    scale : ndarray of shape (1,) or (n_tasks,)
        What the targets are divided by: coefficients are in units of y.
    slopes : ndarray of shape (n_sets, n_trend)
        Coefficients by least squares, n_sets = 1 or n_tasks. The targets that are
        learned are without them, which changes no likelihood.
    """

    columns: Any
    n_tasks: int
    per_task: bool
    centre: np.ndarray
    scale: np.ndarray
    slopes: np.ndarray

    @property
    def n_coefficients(self):
        """How many are integrated out."""
        return self.slopes.size

    def rows(self, X, tasks):
        """The trend's columns, of shape (n_samples, n_coefficients).

        Tasks that were never seen come after the others; they have none of their own.
        """
        H = self.own_rows(X, tasks)
        if not self.per_task:
            return H
        found = np.zeros((len(X), self.n_tasks, H.shape[1]))
        found[np.arange(len(X)), tasks] = H
        return found.reshape(len(X), -1)

    def rows_of(self, task, X):
        """The columns that rows of a task have a part in, (n_samples, n_trend)."""
        return self.own_rows(X, np.full(len(X), task))

    def own_rows(self, X, tasks):
        """The columns that each row's task has a part in, (n_samples, n_trend)."""
        H, centre = self.columns(X), _of_rows(self.centre, tasks)
        near = np.abs(H - centre) <= RESOLVED * np.abs(centre)
        return np.where(near, 0.0, H - centre) / _of_rows(self.scale[:, None], tasks)

    def basis(self, X, tasks):
        """An orthonormal basis of the columns at some rows."""
        return self.basis_of(self.own_rows(X, tasks), tasks)

    def basis_of(self, H, tasks):
        """The same from the columns of rows, see `own_rows`."""
        return TaskBases(H, tasks, self.n_tasks) if self.per_task else Basis(H)

    def log_jacobian(self, X, tasks):
        """What the trend changes in the Jacobian of targets in units of y."""
        here = self.basis(X, tasks).log_volume()
        of_y = replace(self, scale=np.ones(1)).basis(X, tasks).log_volume()
        return of_y - here

    def fitted(self, X, tasks):
        """What least squares explain of the targets, (n_samples,)."""
        return self.times(X, tasks, self.slopes)

    def times(self, X, tasks, coefficients):
        """The columns of rows times coefficients, of shape (n_sets, n_trend)."""
        H = self.own_rows(X, tasks)
        if not self.per_task:
            return H @ coefficients[0]
        return np.einsum("ij,ij->i", H, coefficients[tasks])

    def with_task(self, position, centre, scale, slopes):
        """The same with one more task; what is None all tasks have in common."""

        def put(of, new):
            return of if new is None else np.insert(of, position, new, axis=0)

        return replace(
            self,
            n_tasks=self.n_tasks + 1,
            centre=put(self.centre, centre),
            scale=put(self.scale, scale),
            slopes=put(self.slopes, slopes),
        )


def _of_rows(of_tasks, tasks):
    return of_tasks if len(of_tasks) == 1 else of_tasks[tasks]


class Basis:
    """An orthonormal basis Q of columns T = Q R, whatever their units.

    Parameters
    ----------
    T : ndarray of shape (n_samples, n_columns)
        Columns.

    Attributes
    ----------
    Q : ndarray of shape (n_samples, rank)
        Fortran-ordered.
    dependent : ndarray of int
        Columns that the others make, as pivoting finds them.
    """

    def __init__(self, T):
        length = np.linalg.norm(T, axis=0)
        self.length = np.where(length > 0.0, length, 1.0)
        unit = T / self.length if len(T) else np.zeros((1, T.shape[1]))
        Q, R, order = qr(unit, mode="economic", pivoting=True)
        rank = int((np.abs(np.diagonal(R)) > INDEPENDENT).sum())
        self.Q = np.asfortranarray(Q[: len(T), :rank])
        self.dependent = np.sort(order[rank:])
        self._R = np.empty((rank, T.shape[1]))  # of columns of length 1
        self._R[:, order] = R[:rank]

    @property
    def rank(self):
        """Number of independent columns."""
        return self.Q.shape[1]

    def log_volume(self):
        """Half the log-determinant of T^T T, of the columns that are independent."""
        independent = np.delete(np.arange(len(self.length)), self.dependent)
        R = self._R[:, independent] * self.length[independent]
        return np.linalg.slogdet(R)[1]

    def least_squares(self, Y):
        """Coefficients of the columns, in rows, that explain most of targets."""
        return self.coefficients(self.Q.T @ Y)

    def coefficients(self, of_basis):
        """Those of the columns, from those of the basis, in rows."""
        found = np.linalg.lstsq(self._R, of_basis, rcond=None)[0]
        return (found.T / self.length).T


class TaskBases:
    """A basis of columns that tasks have of their own, one task's after another's.

    Its methods are those of a Basis. What is zero in the rows of other tasks is
    neither kept nor decomposed.

    Parameters
    ----------
    H : ndarray of shape (n_samples, n_trend)
        Columns of each row's task.
    tasks : ndarray of shape (n_samples,)
        Tasks.
    n_tasks : int
        Number of tasks.

    Attributes
    ----------
    bases : list of n_tasks Basis
        Of the rows of each task.
    dependent : ndarray of int
        Columns that the others make, of n_tasks times n_trend.
    """

    def __init__(self, H, tasks, n_tasks):
        order = np.argsort(tasks, kind="stable")
        counts = np.bincount(tasks, minlength=n_tasks)
        self.rows = np.split(order, np.cumsum(counts)[:-1])
        self.bases = [Basis(H[rows]) for rows in self.rows]
        stops = np.cumsum([basis.rank for basis in self.bases])
        self.columns = np.split(np.arange(stops[-1]), stops[:-1])
        of_tasks = H.shape[1] * np.arange(n_tasks)
        pairs = zip(of_tasks, self.bases, strict=True)
        self.dependent = np.concatenate([start + of.dependent for start, of in pairs])

    @property
    def rank(self):
        """Number of independent columns."""
        return sum(basis.rank for basis in self.bases)

    @cached_property
    def Q(self):
        """The basis, of shape (n_samples, rank)."""
        Q = np.zeros((sum(map(len, self.rows)), self.rank), order="F")
        for rows, columns, basis in self._tasks():
            Q[np.ix_(rows, columns)] = basis.Q
        return Q

    def log_volume(self):
        """See Basis."""
        return sum(basis.log_volume() for basis in self.bases)

    def least_squares(self, Y):
        """See Basis."""
        parts = zip(self.rows, self.bases, strict=True)
        return np.concatenate([of.least_squares(Y[rows]) for rows, of in parts])

    def coefficients(self, of_basis):
        """See Basis."""
        found = [of.coefficients(of_basis[at]) for _, at, of in self._tasks()]
        return np.concatenate(found)

    def _tasks(self):
        return zip(self.rows, self.columns, self.bases, strict=True)
