r"""The inverse covariance of data that are complete but for some missing cells.

A cell is an input of a task. With P = K^{-1} of the full grid, as
:class:`~skmtgp.inference.eigen.KroneckerEigen` has it, and m the q cells without a row,

.. math:: K_{oo}^{-1} = P_{oo} - P_{om} P_{mm}^{-1} P_{mo}, \quad
    \log |K_{oo}| = \log |K| + \log |P_{mm}|,

and :math:`P_{mm}^{-1}` is the covariance of what is missing given the rows. With
:math:`P_{mm} = C C^T` and :math:`V = P_{\cdot m} C^{-T}` the inverse, with zeros at m,
is :math:`P - V V^T`: V takes a few products with q x N matrices for each task, and no
matrix is larger than that, N x N or q x q.

Targets are completed by their means given the rows, where :math:`y^T P y` is smallest:
an error of what is filled in changes it in second order only.
"""

from functools import cached_property

import numpy as np
from sklearn.utils import gen_batches

from skmtgp._numerics.linalg import Cholesky
from skmtgp.inference.eigen import Along, KroneckerEigen

MOST = 2**18  # elements held at a time, or as many as K^x has


class GappyEigen(KroneckerEigen):
    """K^{-1} of the samples there are, and its kin; zero where a cell is missing.

    Parameters
    ----------
    K_x, K_rho, noise, observed, level
        See KroneckerEigen.
    cells : tuple of (ndarray of shape (q,), ndarray of shape (q,))
        The input and the observed task of each missing cell.

    Attributes
    ----------
    along : Along
        The missing cells.
    told : ndarray of shape (q, n_observed)
        Of each missing cell in the means of the levels, given all cells.
    cholesky : Cholesky
        Of P_mm.

    Raises
    ------
    NotPositiveDefiniteError
        If K or P_mm cannot be decomposed.
    """

    def __init__(self, K_x, K_rho, noise, observed, level, cells):
        super().__init__(K_x, K_rho, noise, observed, level)
        inputs, tasks = self.cells = cells
        self.along = Along(self.U[inputs], self.W.T, tasks)
        left = self._left(self.along)
        self.told = -left @ self.levels.covariance if self.levels else None
        self.cholesky = Cholesky(np.asfortranarray(self._weights(self.along, left)))

    def hidden(self, along, left):
        """See KroneckerEigen."""
        return self.cholesky.half_solve(self._weights(along, left))

    def hidden_levels(self):
        """See KroneckerEigen."""
        return self.cholesky.half_solve(self.told)

    def completed(self, rotated):
        """Coefficients of Y with the means of missing cells, given the others.

        The second step is one of refinement: without noise the first lacks digits.
        """
        for _ in range(2):
            rotated = rotated - self.rotate(self._excess(rotated))
        return rotated

    def _excess(self, rotated):
        """What is at missing cells above their means given the others, else 0."""
        solved = self.rotate_back(self.alpha(super().half(rotated)))
        cells = (..., *self.cells)
        given = solved[cells]
        excess, flat = np.zeros_like(solved), given.reshape(-1, given.shape[-1])
        excess[cells] = self.cholesky.solve(flat.T).T.reshape(given.shape)
        return excess

    def half(self, rotated):
        """R^T y with K^{-1} = R R^T, whatever y is at missing cells."""
        return super().half(self.completed(rotated))

    def log_det(self):
        """Log-determinant of K."""
        return super().log_det() + self.cholesky.log_det()

    def inverse_diagonal(self):
        """Diagonal of K^{-1}, of shape (n_inputs, n_observed)."""
        diagonal = super().inverse_diagonal()
        for m in range(len(self.S)):
            of_task = Along(self.U, self.W.T, np.full(len(self.L), m))
            V = self.hidden(of_task, self._left(of_task))
            diagonal[:, m] -= np.square(V).sum(axis=0)
        return diagonal

    def log_det_by_K_x(self):
        """Of log|K| by K^x, see KroneckerEigen."""
        scaled, Q, d = super().log_det_by_K_x()
        B = np.zeros((len(self.L),) * 2)
        for t in np.flatnonzero(self.S):
            V = self._solved(slice(None), slice(t, t + 1))[..., 0] * np.sqrt(self.S[t])
            B += V.T @ V
        return scaled - self.U @ B, Q, d

    def log_det_by_K_rho(self):
        """Of log|K| by K^rho, of shape (n_observed, n_observed)."""
        return super().log_det_by_K_rho() - self.W @ self._grams[0] @ self.W.T

    def log_det_by_noise(self):
        """Of log|K| by the noise variances, of shape (n_observed,)."""
        of_noise = np.einsum("mj,mj->m", self.W @ self._grams[1], self.W)
        return super().log_det_by_noise() - of_noise

    def log_det_by_level(self):
        """Of log|K| by the levels' variance."""
        if not self.levels:
            return 0.0
        taken = np.square(self.hidden_levels() / self.levels.variance).sum()
        return super().log_det_by_level() - taken

    def _left(self, along):
        """How cells depend on the levels, beside the rest: see `hidden`."""
        if not self.levels:
            return None
        return -self.levels.told(along.of_x, along.columns[:, along.tasks])

    def _weights(self, along, left):
        """Of the missing cells in means given all cells, (q, n_vectors)."""
        weights = self.products(along, self.along).T
        return weights + self.told @ left.T if self.levels else weights

    def _solved(self, inputs, tasks):
        """V along some of the eigenvectors, of shape (q, n_inputs, n_tasks)."""
        _, of_tasks = self.cells
        W = self.W[:, tasks]
        columns = self.along.of_x[:, inputs, None] * W[of_tasks][:, None]
        if self.levels:
            columns -= self.levels.h[inputs, None] * (self.told @ W)[:, None]
        columns /= self.values[inputs, tasks]
        flat = columns.reshape(len(columns), -1)
        return self.cholesky.half_solve(flat).reshape(columns.shape)

    @cached_property
    def _grams(self):
        """sum_v v^T diag(w) v along the tasks' eigenvectors, with w = L and w = 1."""
        n, (q, n_tasks) = len(self.L), (len(self.along.of_x), len(self.S))
        size = max(1, max(MOST, n * n) // (q * n_tasks))
        of_L, of_one = np.zeros((2, n_tasks, n_tasks))
        for inputs in gen_batches(n, size):
            V = self._solved(inputs, slice(None))
            flat = V.reshape(-1, n_tasks)
            of_one += flat.T @ flat
            of_L += (V * self.L[inputs, None]).reshape(flat.shape).T @ flat
        return of_L, of_one
