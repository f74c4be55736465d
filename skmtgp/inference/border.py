r"""The border of K^rho: a novel task, the paper's section 3.3.

The tasks so far are f^m = sum_a F_ma z_a, with latent functions z_a of covariance k^x
(eq. 3 and 5). A novel task is f = sum_a l_a z_a, and perhaps w z_new of its own, and
perhaps a level. With
theta^x, sigma^2 and F frozen, the likelihood of all data depends on (l, w) through
p(y_new | y_old) alone, a Gaussian of as many dimensions as the new task has samples.
"""

import numpy as np

from skmtgp._numerics.linalg import Cholesky
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.likelihood import log_density


class BorderLikelihood:
    """log p(y_new | y_old) as a function of the novel task's row (l, w).

    Parameters
    ----------
    posterior : Posterior
        Of the tasks so far.
    factor : ndarray of shape (n_tasks, rank)
        F, with F F^T the task covariance but for its diagonal.
    X : ndarray of shape (n_samples, n_features)
        Inputs of the novel task.
    y : ndarray of shape (n_samples,)
        Its targets.
    noise : float
        Noise variance of the novel task.
    own : bool
        Whether there is a w.
    level : float, default=0.0
        Variance of its level.
    shared : float, default=None
        What the novel task has of a function that all tasks share alike, if they do;
        `factor` is then without it.
    equal : float, default=0.0
        Variance of a function of its own that is known, beside that of w.

    Attributes
    ----------
    means : ndarray of shape (rank, n_samples)
        Posterior means of the latent functions at X.
    y : ndarray of shape (n_samples,)
        Targets, less the mean of the function that all share.
    """

    def __init__(
        self, posterior, factor, X, y, noise, own, level=0.0, shared=None, equal=0.0
    ):
        self.rank, self.own, self.y = factor.shape[1], own, y
        self.noise, self.level, self.equal = noise, level, equal
        self.K_x = posterior.kernel(X)
        if shared is None and not self.rank:
            shared = 0.0  # independent tasks: a function of which they have nothing
        self.fixed = np.array([] if shared is None else [shared])
        factor = np.hstack([np.tile(self.fixed, (len(factor), 1)), factor])
        # halves: C^{-1} cov(y_old, z_a(X)), where K_old = C C^T
        means, halves = posterior.latent(X, factor)
        of_fixed, self.means = np.split(means, [len(self.fixed)])
        self.y = y - self.fixed @ of_fixed
        self.half_of_fixed = np.tensordot(self.fixed, halves[: len(self.fixed)], axes=1)
        self.halves = halves[len(self.fixed) :]

    def value(self, row):
        """The log density; -inf where it cannot be computed."""
        return self.value_and_grad(row)[0]

    def value_and_grad(self, row):
        """The log density and its gradient.

        Parameters
        ----------
        row : ndarray of shape (rank,), or (rank + 1,) with w last
            The border.

        Returns
        -------
        value : float
            Log density of the new targets given the old ones.
        gradient : ndarray of the shape of row
            Its gradient; nan where the value is -inf.
        """
        S, half = self._covariance(row)
        try:
            cholesky = Cholesky(np.asfortranarray(S))
        except NotPositiveDefiniteError:
            return -np.inf, np.full(len(row), np.nan)
        rest = self.y - row[: self.rank] @ self.means
        alpha = cholesky.solve(rest)
        value = log_density(rest @ alpha, cholesky.log_det(), len(rest))
        G = np.outer(alpha, alpha) - cholesky.solve(np.eye(len(rest)))
        gradient = np.vdot(G, self.K_x) * row
        gradient[: self.rank] += self.means @ alpha
        gradient[: self.rank] -= np.tensordot(self.halves, half @ G, axes=2)
        return value, gradient

    def fisher_information(self, row):
        """Fisher information of the border, of shape (len(row), len(row)).

        Of a Gaussian: dmean_p^T S^{-1} dmean_q + 1/2 tr(S^{-1} dS_p S^{-1} dS_q).
        """
        S, half = self._covariance(row)
        dS = 2.0 * row[:, None, None] * self.K_x
        between = half.T @ self.halves  # of each latent function
        dS[: self.rank] -= between + between.swapaxes(1, 2)
        inverse = np.linalg.pinv(S, hermitian=True)
        scores = inverse @ dS
        information = 0.5 * np.einsum("pij,qji->pq", scores, scores)
        shared = slice(self.rank)
        information[shared, shared] += self.means @ inverse @ self.means.T
        return information

    def weighted(self, row):
        """S^{-1} times the means of the latent functions and the targets, at a border.

        Returns
        -------
        by_means, by_targets : ndarray of shape (rank, rank) and (rank,)
            Normal equations of a border with this covariance of the targets.
        """
        S, _ = self._covariance(row)
        solved = np.linalg.pinv(S, hermitian=True) @ self.means.T
        return self.means @ solved, self.y @ solved

    def _covariance(self, row):
        """Covariance of y_new given y_old, and C^{-1} cov(y_old, f(X))."""
        half = self.half_of_fixed
        half = half + np.tensordot(row[: self.rank], self.halves, axes=1)
        amplitude = row @ row + self.fixed @ self.fixed + self.equal
        S = amplitude * self.K_x - half.T @ half + self.level
        S.flat[:: len(S) + 1] += self.noise
        return S, half
