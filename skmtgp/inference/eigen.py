r"""The inverse covariance of complete data, by the eigen-decompositions of its factors.

Where all M tasks are observed at the same N inputs, once each, the covariance of eq. 6
is

.. math:: K = K^\rho \otimes K^x + D \otimes I, \quad
    D = \mathrm{diag}(\sigma_1^2, \ldots, \sigma_M^2)

for targets Y of shape (N, M) stacked column by column. With
:math:`K^x = U L U^T`, :math:`D^{-1/2} K^\rho D^{-1/2} = V S V^T` and
:math:`W = D^{-1/2} V`

.. math:: K^{-1} = (W \otimes U)\, \mathrm{diag}(L_i S_j + 1)^{-1} (W \otimes U)^T.

Levels add :math:`v\, I \otimes 1 1^T`, of rank M. With :math:`h = U^T 1` and
:math:`u_{ij} = h_i / \sqrt{L_i S_j + 1}` they are, relative to that root of K,
:math:`v B B^T` with :math:`B_{(ij) m} = u_{ij} W_{mj}`, whose singular values are those
of an M x M matrix: levels cost no more than that, and a few vectors of N M numbers.

The eigenvalues of a factor are off by its norm's rounding, whatever their size. Those
that may be nothing else are taken to be zero: nothing is ever added to the diagonal,
and K^rho keeps its rank, without which the likelihood of data without noise would be
too rough to be climbed. What is left costs the likelihood |K| / sigma^2 of its digits,
as a Cholesky decomposition does. At the modes of noise-free torques its value is three
times rougher, and its gradient ten times smoother, than that of
:class:`~skmtgp.inference.dense.DenseLikelihood`.
"""

from typing import NamedTuple

import numpy as np

from skmtgp._numerics.linalg import eigh_semidefinite, svd
from skmtgp.exceptions import NotPositiveDefiniteError


class Along(NamedTuple):
    """Vectors over all cells that are Kronecker products, along the eigenvectors.

    Attributes
    ----------
    of_x : ndarray of shape (n_vectors, n_inputs)
        Their parts over the inputs, times U.
    columns : ndarray of shape (n_observed, n_tasks)
        W^T times parts over the tasks.
    tasks : ndarray of shape (n_vectors,)
        Which of these each has.
    """

    of_x: np.ndarray
    columns: np.ndarray
    tasks: np.ndarray


class KroneckerEigen:
    """K^{-1} and its kin.

    Matrices Y have a row for each input and a column for each observed task; there may
    be a stack of them.

    Parameters
    ----------
    K_x : ndarray of shape (n_inputs, n_inputs), Fortran-ordered
        K^x; overwritten.
    K_rho : ndarray of shape (n_tasks, n_tasks)
        K^rho.
    noise : ndarray of shape (n_tasks,) or (1,)
        Noise variance of each task, or of all.
    observed : ndarray of shape (n_observed,)
        Tasks of which there are data.
    level : float, default=0.0
        Variance v of the tasks' levels.

    Attributes
    ----------
    L, U : ndarray of shape (n_inputs,) and (n_inputs, n_inputs)
        Eigenvalues and -vectors of K^x.
    S, W : ndarray of shape (n_observed,) and (n_observed, n_observed)
        Eigenvalues of K^rho relative to the noise, and D^{-1/2} times its eigenvectors.
    values : ndarray of shape (n_inputs, n_observed)
        L_i S_j + 1, the eigenvalues of K without levels, relative to the noise.
    levels : Levels or None
        What the levels add.

    Raises
    ------
    NotPositiveDefiniteError
        If a factor is not finite or is indefinite, or the noise is not positive.
    """

    def __init__(self, K_x, K_rho, noise, observed, level=0.0):
        noise = np.broadcast_to(noise, len(K_rho))[observed]
        if not ((noise > 0.0) & (noise < np.inf)).all():
            raise NotPositiveDefiniteError(
                f"The noise variances {noise} must be positive and finite."
            )
        self.noise, root = noise, np.sqrt(noise)[:, None]
        relative = K_rho[np.ix_(observed, observed)] / root / root.T
        self.S, V = eigh_semidefinite(np.asfortranarray(relative))
        self.W = V / root
        self.L, self.U = eigh_semidefinite(K_x)
        self.values = np.multiply.outer(self.L, self.S) + 1.0
        self.levels = Levels(self, level) if level else None

    def rotate(self, Y):
        """U^T Y W: coefficients of Y along the eigenvectors."""
        return self.U.T @ Y @ self.W

    def rotate_back(self, Y):
        """U Y W^T."""
        return self.U @ Y @ self.W.T

    def half(self, rotated):
        """R^T y with K^{-1} = R R^T, from the coefficients of y.

        Parameters
        ----------
        rotated : ndarray of shape (..., n_inputs, n_observed)
            Coefficients.

        Returns
        -------
        half : ndarray of the same shape
            Its sum of squares is y^T K^{-1} y.
        """
        half = rotated / np.sqrt(self.values)
        return self.levels.shrink(half) if self.levels else half

    def alpha(self, half):
        """Coefficients of K^{-1} y, of which `half` is the root's."""
        half = self.levels.shrink(half) if self.levels else half
        return half / np.sqrt(self.values)

    def solve(self, Y):
        """K^{-1} Y."""
        return self.rotate_back(self.alpha(self.half(self.rotate(Y))))

    def completed(self, rotated):
        """Coefficients of Y with what is missing of it filled in; nothing is, here."""
        return rotated

    def products(self, left, right):
        """a^T K^{-1} b of vectors, each an Along, without levels."""
        found, inverse = np.empty((len(left.of_x), len(right.of_x))), 1.0 / self.values
        for m in np.unique(left.tasks):
            rows = left.tasks == m
            weights = inverse @ (left.columns[:, m, None] * right.columns)
            weighed = right.of_x * weights.T[right.tasks]
            found[rows] = left.of_x[rows] @ weighed.T
        return found

    def hidden(self, along, left):
        """What the data do not explain for want of missing cells.

        Parameters
        ----------
        along : Along
            Covariances of sums g of functions, or of cells, with the cells.
        left : ndarray of shape (n_vectors, n_observed) or None
            How g depends on the levels once the cells are known; None without levels.

        Returns
        -------
        hidden : ndarray of shape (n_missing, n_vectors)
            Its Gram matrix is to be taken off the explained covariances of g.
        """
        return np.empty((0, len(along.tasks)))

    def hidden_levels(self):
        """The same of the levels, (n_missing, n_observed)."""
        return np.empty((0, len(self.S)))

    def log_det(self):
        """Log-determinant of K."""
        log_det = np.log(self.values).sum() + len(self.L) * np.log(self.noise).sum()
        return log_det + (self.levels.log_det() if self.levels else 0.0)

    def inverse_diagonal(self):
        """Diagonal of K^{-1}, of shape (n_inputs, n_observed)."""
        diagonal = np.square(self.U) @ (1.0 / self.values) @ np.square(self.W).T
        return diagonal - (self.levels.inverse_diagonal() if self.levels else 0.0)

    # derivatives, which make up those of the likelihood

    def log_det_by_K_x(self):
        """Of log|K| by K^x, which is U C U^T - Q diag(d) Q^T: U C, Q and d."""
        scaled = self.U * (self.S / self.values).sum(axis=1)
        if not self.levels:
            return scaled, np.empty((len(self.L), 0)), np.empty(0)
        return scaled, self.levels.Q, self.S * np.diagonal(self.levels.between)

    def log_det_by_K_rho(self):
        """Of log|K| by K^rho, of shape (n_observed, n_observed)."""
        by_K_rho = self.W * (self.L[:, None] / self.values).sum(axis=0) @ self.W.T
        if self.levels:
            by_K_rho -= self.W @ self.levels.overlaps(self.L) @ self.W.T
        return by_K_rho

    def log_det_by_noise(self):
        """Of log|K| by the noise variances, of shape (n_observed,)."""
        of_noise = np.square(self.W) @ (1.0 / self.values).sum(axis=0)
        if self.levels:
            inner = self.levels.overlaps(np.ones_like(self.L))
            of_noise -= np.einsum("mj,mj->m", self.W @ inner, self.W)
        return of_noise

    def log_det_by_level(self):
        """Of log|K| by the levels' variance."""
        return self.levels.log_det_by_variance() if self.levels else 0.0


class Levels:
    """What levels add to a KroneckerEigen.

    Parameters
    ----------
    eigen : KroneckerEigen
        Without them.
    variance : float
        v.

    Attributes
    ----------
    covariance : ndarray of shape (n_observed, n_observed)
        Of the levels given y.
    between : ndarray of shape (n_observed, n_observed)
        W^T `covariance` W.
    Q : ndarray of shape (n_inputs, n_observed)
        U (h_i / (L_i S_j + 1)): what a level is along each eigenvector of the tasks.
    """

    def __init__(self, eigen, variance):
        # no eigen itself: its memory is free with its last reference, without a cycle
        self.variance, self.values, self.W = variance, eigen.values, eigen.W
        self.h = eigen.U.sum(axis=0)
        u = self.h[:, None] / np.sqrt(self.values)
        size = np.linalg.norm(u, axis=0)
        self.unit = u / np.maximum(size, np.finfo(float).tiny)
        # v B^T B = V diag(s^2) V^T
        self.P, s, Vt = svd(np.sqrt(variance) * size[:, None] * self.W.T)
        self.squares = np.square(s)
        self.covariance = variance * (Vt.T / (1.0 + self.squares)) @ Vt
        self.between = self.W.T @ self.covariance @ self.W
        self.Q = eigen.U @ (self.h[:, None] / self.values)

    def shrink(self, half):
        """(I + v B B^T)^{-1/2} times coefficients relative to the root."""
        along = np.einsum("ij,...ij->...j", self.unit, half)
        taken = 1.0 - 1.0 / np.sqrt(1.0 + self.squares)
        along = along @ (self.P * taken) @ self.P.T
        return half - self.unit * along[..., None, :]

    def log_det(self):
        """What they add to log|K|."""
        return np.log1p(self.squares).sum()

    def log_det_by_variance(self):
        """Its derivative by v."""
        return (self.squares / (1.0 + self.squares)).sum() / self.variance

    def means(self, rotated):
        """Means of the levels, from the coefficients of y.

        Those that v times sums of K^{-1} y give would have v / sigma^2 times its error.
        """
        return self.covariance @ (self.W @ (self.h @ (rotated / self.values)))

    def inverse_diagonal(self):
        """What they take off the diagonal of K^{-1}, (n_inputs, n_observed)."""
        taken = np.empty((len(self.Q), len(self.between)))
        for m, w in enumerate(self.W):  # no arrays of n_observed^3 numbers
            told = self.Q * w
            taken[:, m] = np.einsum("ij,ij->i", told @ self.between, told)
        return taken

    def overlaps(self, weights):
        """`between` times sum_i w_i h_i^2 / ((L_i S_j + 1)(L_i S_k + 1)), by j, k."""
        scaled = (weights * np.square(self.h))[:, None] / self.values
        return self.between * (scaled.T @ (1.0 / self.values))

    def told(self, along_x, along_tasks):
        """What means say of unit levels: 1^T K^{-1} cov(y, f(x)) without levels.

        Parameters
        ----------
        along_x : ndarray of shape (n_samples, n_inputs)
            k^x(x, inputs) U.
        along_tasks : ndarray of shape (n_observed, n_samples)
            W^T cov of the tasks' amplitudes.

        Returns
        -------
        told : ndarray of shape (n_samples, n_observed)
            For the level of each observed task.
        """
        along = (along_x * self.h) @ (1.0 / self.values)
        return (along * along_tasks.T) @ self.W.T
