"""Covariances K^rho between tasks: parameters, matrix, gradient.

A task covariance maps a vector of parameters to the M x M matrix K^rho of eq. 6 and
pulls gradients with respect to the matrix back to the parameters. It knows nothing of
inputs or likelihoods.
"""

import numpy as np

FACTOR_BOUND = 30.0
KAPPA_BOUNDS = (1e-11, 1e4)


class FixedTaskCovariance:
    """A task covariance without parameters.

    Parameters
    ----------
    matrix : ndarray of shape (n_tasks, n_tasks)
        K^rho.
    """

    n_parameters = n_free = 0

    def __init__(self, matrix):
        self._matrix = matrix
        self.n_tasks = len(matrix)

    def bounds(self, scale):
        """Bounds of the parameters: none."""
        return np.empty((0, 2))

    def matrix(self, parameters):
        """K^rho, of shape (n_tasks, n_tasks)."""
        return self._matrix

    def factor(self, parameters):
        """A factor of K^rho, of shape (n_tasks, rank)."""
        values, vectors = np.linalg.eigh(self._matrix)
        kept = values > 1e-12 * values[-1]
        return lower_trapezoid(vectors[:, kept] * np.sqrt(values[kept]))

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from D = dL / dK^rho."""
        return np.empty(0)

    def derivatives(self, parameters):
        """dK^rho / d parameters, of shape (n_parameters, n_tasks, n_tasks)."""
        return np.empty((0, self.n_tasks, self.n_tasks))


def identity(n_tasks):
    """K^rho = I: tasks that are independent given the kernel (iGP)."""
    return FixedTaskCovariance(np.eye(n_tasks))


def ones(n_tasks):
    """K^rho = 1 1^T: tasks that cannot be told apart (pGP)."""
    return FixedTaskCovariance(np.ones((n_tasks, n_tasks)))


class LowRank:
    """K^rho = F F^T (+ diag(kappa)) with F of shape (n_tasks, rank).

    Parameters
    ----------
    n_tasks : int
        Number of tasks M.
    rank : int
        Rank r of F F^T, 1 to M.
    diagonal : bool, default=False
        Whether to add diag(kappa).

    Attributes
    ----------
    n_parameters : int
        M r numbers of F, row by row, and M logarithms of kappa with the diagonal.
    n_free : int
        r (2 M + 1 - r) / 2, the count of an incomplete Cholesky decomposition in
        eq. 8, and M more with the diagonal.

    Notes
    -----
    F is not held to a trapezoid while it is learned. The r (r - 1) / 2 rotations that
    this leaves do not change the likelihood and cost nothing, while a trapezoid singles
    out the first r tasks and has singular points where their block is: learning from
    the same start ends at worse modes.
    """

    def __init__(self, n_tasks, rank, diagonal=False):
        self.n_tasks, self.rank, self.diagonal = n_tasks, rank, diagonal
        self.n_factor = n_tasks * rank
        self.n_parameters = self.n_factor + n_tasks * diagonal
        self.n_free = rank * (2 * n_tasks + 1 - rank) // 2 + n_tasks * diagonal

    def bounds(self, scale):
        """Bounds of the parameters, of shape (n_parameters, 2).

        They are wide, but keep K^rho from growing without end where an amplitude of the
        kernel can shrink with it, at the cost of the digits of small noise variances.

        Parameters
        ----------
        scale : float
            Standard deviation of the targets.
        """
        bounds = np.tile(
            [-FACTOR_BOUND * scale, FACTOR_BOUND * scale], (self.n_parameters, 1)
        )
        bounds[self.n_factor :] = np.log(np.multiply(KAPPA_BOUNDS, scale**2))
        return bounds

    def _split(self, parameters):
        F = parameters[: self.n_factor].reshape(self.n_tasks, self.rank)
        return F, np.exp(parameters[self.n_factor :])

    def matrix(self, parameters):
        """K^rho, of shape (n_tasks, n_tasks)."""
        F, kappa = self._split(parameters)
        K = F @ F.T
        if self.diagonal:
            K[np.diag_indices_from(K)] += kappa
        return K

    def factor(self, parameters):
        """F rotated to a lower trapezoid, of shape (n_tasks, rank)."""
        return lower_trapezoid(self._split(parameters)[0])

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from the symmetric D = dL / dK^rho."""
        F, kappa = self._split(parameters)
        gradient = (2.0 * D @ F).ravel()
        if self.diagonal:
            gradient = np.concatenate([gradient, np.diagonal(D) * kappa])
        return gradient

    def derivatives(self, parameters):
        """dK^rho / d parameters, of shape (n_parameters, n_tasks, n_tasks)."""
        F, kappa = self._split(parameters)
        unit = np.eye(self.n_tasks)
        half = np.einsum("mi,jr->mrij", unit, F)
        dF = (half + half.swapaxes(2, 3)).reshape(-1, self.n_tasks, self.n_tasks)
        d_kappa = np.einsum("mi,mj,m->mij", unit, unit, kappa) if self.diagonal else []
        return np.concatenate([dF, *([d_kappa] if self.diagonal else [])])

    def parameters(self, K):
        """Parameters from the leading `rank` eigenvectors of K.

        Section 3.2: "the eigen-decomposition of K_aug^rho and keeping only the top r
        eigenvectors/values". What is cut from the diagonal of K becomes kappa, if
        there is one.
        """
        values, vectors = np.linalg.eigh(K)
        F = vectors * np.sqrt(np.maximum(values, 0.0))
        F = F[:, : -self.rank - 1 : -1]
        if not self.diagonal:
            return F.ravel()
        rest = np.diagonal(K) - np.square(F).sum(axis=1)
        floor = 1e-6 * np.trace(K) / len(K) + np.finfo(float).tiny
        return np.concatenate([F.ravel(), np.log(np.maximum(rest, floor))])

    def grown(self, parameters, columns):
        """Parameters of the model of a higher rank: F with these columns added."""
        F, _ = self._split(parameters)
        F = np.hstack([F, columns])
        return np.concatenate([F.ravel(), parameters[self.n_factor :]])


def lower_trapezoid(F):
    """L with zeros above the diagonal, L L^T = F F^T and a non-negative diagonal.

    Parameters
    ----------
    F : ndarray of shape (n_tasks, rank)
        Any factor, rank at most n_tasks.

    Returns
    -------
    L : ndarray of shape (n_tasks, rank)
        The factor of the incomplete Cholesky decomposition.
    """
    L = np.linalg.qr(F.T, mode="r").T
    signs = np.where(np.diagonal(L) < 0.0, -1.0, 1.0)
    return np.tril(L * signs)
