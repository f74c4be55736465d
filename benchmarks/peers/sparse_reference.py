"""The sparse model from its textbook formulae: what scores the peers' parameters.

Titsias (2009), eq. 9, for inducing points U: with the features phi of a point,
L phi = K(U, point), K(U, U) = L L^T, the model of y is linear regression on them. It is
solved by a QR decomposition of [Phi; sigma I], whose digits suffice for the smallest
noise, a block of rows at a time.
"""

import numpy as np
from reference import covariance, factorise
from scipy.linalg import qr, solve_triangular


class SparsePosterior:
    """The model at given parameters and inducing points.

    Parameters
    ----------
    parameters : Parameters
        Of the model.
    problem : Problem
        Training data.
    points : ndarray of shape (n_points, 25)
        Inducing points, the tasks in the last column.
    block : int, default=5000
        Rows at a time.

    Attributes
    ----------
    bound : float
        Lower bound on the log marginal likelihood.
    jitter : float
        What had to be added to the diagonal of K(U, U).
    """

    def __init__(self, parameters, problem, points, block=5000):
        self.parameters, self.block = parameters, block
        self.points = points[:, :-1], points[:, -1].astype(int)
        K = covariance(parameters, *self.points, *self.points)
        self.L, self.jitter = factorise(K, 0.0)
        noise, k, n = parameters.noise, len(points), len(problem.y)
        R, explained = self.decompose(problem)
        diagonal = np.abs(np.diagonal(R))
        log_det = (n - k) * np.log(noise) + 2.0 * np.log(diagonal[:k]).sum()
        constant = n * np.log(2.0 * np.pi)
        left = prior_variance(parameters, problem.u, problem.tasks).sum() - explained
        square = (diagonal[k] ** 2 + left) / noise
        self.bound = -0.5 * (square + log_det + constant)
        w = solve_triangular(R[:k, :k], R[:k, k])
        self.weights = solve_triangular(self.L, w, lower=True, trans="T")

    def decompose(self, problem):
        """R of [Phi, y; sigma I, 0], and the sum of the squares of Phi."""
        k, explained = len(self.L), 0.0
        R = np.sqrt(self.parameters.noise) * np.eye(k, k + 1)
        for a in range(0, len(problem.y), self.block):
            rows = slice(a, a + self.block)
            K = self.against(problem.u[rows], problem.tasks[rows])
            Phi = solve_triangular(self.L, K.T, lower=True).T
            explained += np.square(Phi).sum()
            stacked = np.vstack([R, np.column_stack([Phi, problem.y[rows]])])
            R = qr(stacked, mode="r", overwrite_a=True)[0][: k + 1]
        return R, explained

    def against(self, u, tasks):
        """Covariance of f at some rows and at the inducing points."""
        return covariance(self.parameters, u, tasks, *self.points)

    def mean(self, u, tasks):
        """Mean of f, of shape (n_samples,)."""
        starts = range(0, len(u), self.block)
        blocks = [slice(a, a + self.block) for a in starts]
        return np.concatenate(
            [self.against(u[b], tasks[b]) @ self.weights for b in blocks]
        )


def prior_variance(parameters, u, tasks):
    """Variances of f."""
    p = parameters
    linear = p.bias + np.square(u) @ p.weights
    return np.diagonal(p.K_rho)[tasks] * (linear + p.amplitude)
