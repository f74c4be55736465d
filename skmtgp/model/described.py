r"""The covariance K^rho between tasks that are described by numbers.

Each task m has a row q_m of its descriptors, such as a load's mass and first moments.
Its row of the factor is linear in them, F = Q B, so that

.. math:: K^\rho = Q B B^T Q^T

So the descriptors of a task without data determine its row. This follows Bonilla,
Agakov and Williams (2007), who have a kernel between descriptors. Here it is linear, of
rank r.
"""

from functools import cached_property

import numpy as np

from skmtgp._numerics.parallel import limit_threads
from skmtgp.model.task_covariance import (
    enlarged,
    leading_columns,
    leading_eigenvectors,
    low_rank,
    lower_trapezoid,
)


class Described:
    """K^rho = F F^T with F = Q B, where Q is known and B is learned.

    Parameters
    ----------
    Q : ndarray of shape (n_tasks, n_rows)
        Descriptors of the tasks, see :class:`~skmtgp._data.descriptors.Descriptors`.
    rank : int
        Rank r of B B^T, 0 to n_rows.

    Attributes
    ----------
    n_parameters : int
        The n_rows r numbers of B, row by row.
    n_free : int
        n_rows r - r (r - 1) / 2, because rotations of B do not count.
    """

    n_kappa = n_own = 0
    shared = False
    unit = 1.0  # Frobenius norm of B for a variance of 1: Q^T Q is n_tasks I

    def __init__(self, Q, rank):
        self.Q, self.rank = Q, rank
        self.n_tasks, self.n_rows = Q.shape
        self.n_parameters = self.n_rows * rank
        self.n_free = self.n_parameters - rank * (rank - 1) // 2

    def __str__(self):
        return f"descriptors of rank {self.rank}"

    @property
    def factor_shape(self):
        """Shape of B, the factor that is learned."""
        return self.n_rows, self.rank

    @cached_property
    def _inverse(self):
        """From columns of the tasks to the nearest ones of B."""
        return np.linalg.pinv(self.Q)

    def with_rank(self, rank):
        """The same form of another rank."""
        return Described(self.Q, rank)

    def coefficients(self, parameters):
        """B, of shape (n_rows, rank)."""
        return parameters.reshape(self.n_rows, self.rank)

    def columns(self, parameters):
        """F, of shape (n_tasks, rank)."""
        return self.Q @ self.coefficients(parameters)

    def bounds(self, scale):
        """Bounds of the parameters, see `LowRank.bounds`."""
        return low_rank(self.n_rows, self.rank).bounds(scale)

    def matrix(self, parameters):
        """K^rho, of shape (n_tasks, n_tasks)."""
        F = self.columns(parameters)
        return F @ F.T

    def factor(self, parameters):
        """F rotated to a lower trapezoid, of shape (n_tasks, rank)."""
        F = self.columns(parameters)
        square = np.zeros((max(F.shape), F.shape[1]))  # tasks may be fewer than columns
        square[: len(F)] = F
        return lower_trapezoid(square)[: len(F)]

    def unseen(self, parameters, described=None):
        """Tasks without data, from what is known of them: see WithShared.unseen."""
        return described @ self.coefficients(parameters), 0.0

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from the symmetric D = dL / dK^rho."""
        return 2.0 * (self.Q.T @ (D @ self.columns(parameters))).ravel()

    def latent(self, parameters):
        """F, of shape (n_tasks, rank), and kappa, which is zero."""
        return self.columns(parameters), np.zeros(self.n_tasks)

    def pull_back_latent(self, parameters, d_F, d_kappa):
        """Gradient of the parameters, from those of F and kappa."""
        return (self.Q.T @ d_F[:, : self.rank]).ravel()

    def derivatives(self, parameters):
        """Derivatives of K^rho: a matrix for each number of B."""
        F = self.columns(parameters)
        for q in self.Q.T:
            for f in F.T:
                half = np.multiply.outer(q, f)
                yield half + half.T

    def parameters(self, K, truncation="eigen"):
        """Parameters of a matrix of this rank near K, see `LowRank.parameters`."""
        leading = leading_columns if truncation == "cholesky" else leading_eigenvectors
        return leading(self._inverse @ K @ self._inverse.T, self.rank).ravel()

    def directions(self, D):
        """Columns to add to F, the best ones last, from D = dL / dK^rho."""
        with limit_threads(len(D)):
            vectors = np.linalg.eigh(self.Q.T @ D @ self.Q)[1]
        return self.Q @ vectors / np.sqrt(self.n_tasks)

    def grown(self, parameters, columns):
        """Parameters of the model of a higher rank: F with these columns added."""
        more = self._inverse @ columns
        return np.hstack([self.coefficients(parameters), more]).ravel()

    def bordered(self, parameters, row, own, position):
        """The model of one more task, of which nothing is learned.

        Parameters
        ----------
        parameters : ndarray of shape (n_parameters,)
            Those of the tasks so far.
        row : ndarray of shape (n_rows,)
            What is known of it.
        own : None
            It has nothing that the descriptors do not tell.
        position : int
            Where it goes among the tasks.

        Returns
        -------
        form : Described
            Of one more task.
        parameters : ndarray of shape (n_parameters,)
            The same.
        """
        Q = np.insert(self.Q, position, row, axis=0)
        return Described(Q, self.rank), parameters


def describes(form):
    """Whether a form of K^rho, perhaps inside of others, is made of descriptors."""
    while hasattr(form, "form"):
        form = form.form
    return isinstance(form, Described)


def task_covariance(n_tasks, rank, Q=None, *, diagonal=False, shared=False):
    """K^rho of the given rank, by the tasks' descriptors if there are any.

    Parameters
    ----------
    n_tasks, rank : int
        Number of tasks, and the rank.
    Q : ndarray of shape (n_tasks, n_rows), default=None
        What is known of the tasks.
    diagonal, shared
        See :func:`~skmtgp.model.task_covariance.low_rank`.
    """
    if Q is None:
        return low_rank(n_tasks, rank, diagonal, shared)
    return enlarged(Described(Q, rank), diagonal, shared)
