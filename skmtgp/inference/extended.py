r"""Exact inference with complete data and a few more rows, of tasks that joined later.

With K the covariance of the complete data, B that between them and the other rows, and
K_b that of those,

.. math:: \begin{pmatrix} K & B \\ B^T & K_b \end{pmatrix}^{-1}
    = \begin{pmatrix} K^{-1} & 0 \\ 0 & 0 \end{pmatrix} + \begin{pmatrix} P \\ -I
    \end{pmatrix} S^{-1} \begin{pmatrix} P^T & -I \end{pmatrix},
    \quad P = K^{-1} B, \quad S = K_b - B^T P,

so that K is only seen through its eigen-decomposition. S is the covariance of the other
rows given the complete data. Levels are in K and K_b, not in B: the tasks are others.
"""

import numpy as np

from skmtgp._numerics.linalg import Cholesky, cholesky_with_jitter
from skmtgp.inference.kronecker import EigenLikelihood, KroneckerLikelihood
from skmtgp.inference.likelihood import log_density
from skmtgp.inference.posterior import Posterior


class ExtendedLikelihood(EigenLikelihood):
    """The likelihood of complete data of some tasks and any data of novel ones.

    Parameters
    ----------
    prior, X, tasks, y
        See KroneckerLikelihood.
    novel : sequence of int
        The novel tasks.
    base : KroneckerLikelihood, default=None
        Of the other tasks, in a model where some of the novel ones are not known yet.

    Attributes
    ----------
    base : KroneckerLikelihood
        Of the complete data.
    old, new : ndarray of shape (n_old,) and (n_new,)
        Rows of the complete data, and the others.
    inputs : ndarray of shape (n_inputs + n_new, n_features)
        Those of the complete data, then those of the other rows.
    """

    def __init__(self, prior, X, tasks, y, novel, base=None):
        is_novel = np.isin(tasks, novel)
        self.old, self.new = np.flatnonzero(~is_novel), np.flatnonzero(is_novel)
        self.novel, old = list(novel), self.old
        if base is None:
            self.base = KroneckerLikelihood(prior, X[old], tasks[old], y[old])
        else:
            self.base = base.with_tasks(prior, tasks[old], y[old])
        self.observed, self.n_missing = self.base.observed, self.base.n_missing
        inputs = np.vstack([self.base.inputs, X[self.new]])
        super().__init__(prior, X, tasks, y, inputs)

    def posterior(self, theta):
        """The posterior of f given y.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        posterior : ExtendedPosterior
            Where S is singular in floating point, a JitterWarning says what was added
            to it.
        """
        return ExtendedPosterior(self, theta)

    def _decompose(self, K_x, K_rho, level, noise):
        N, tasks = len(self.base.inputs), self.tasks[self.new]
        corner = K_x[:N, :N].copy(order="F")
        eigen = self.base.decomposed(corner, K_rho, level, noise)
        # B^T, of shape (n_new, n_inputs, n_observed), and P^T
        cross = K_x[N:, :N, None] * K_rho[tasks][:, None, self.observed]
        P = eigen.solve(cross)
        S = K_rho[np.ix_(tasks, tasks)] * K_x[N:, N:]
        S += level * np.equal.outer(tasks, tasks)
        S -= np.tensordot(cross, P, axes=((1, 2), (1, 2)))
        S.flat[:: len(S) + 1] += noise[self.noise_of_row[self.new]]
        cholesky = Cholesky(np.asfortranarray(S))
        of_base = eigen.half(self.base.rotated(eigen))
        alpha = eigen.rotate_back(eigen.alpha(of_base))
        rest = self.y[self.new] - np.tensordot(cross, alpha, axes=2)
        half = cholesky.half_solve(rest)
        value = self.base.log_density(eigen, of_base)
        value += log_density(half @ half, cholesky.log_det(), len(half))
        V = self._vectors(cholesky, half, P, alpha, len(K_rho))
        return value, eigen, np.append(1.0, -np.ones(len(S))), V, K_x @ V

    def _vectors(self, cholesky, half, P, alpha, n_tasks):
        """K^{-1} y, sign 1, and the columns of (P, -I)^T S^{-1/2}, sign -1."""
        n_new, N, _ = P.shape
        columns = np.hstack([P.reshape(n_new, -1), -np.eye(n_new)])
        columns = cholesky.half_solve(columns)
        first = np.append(alpha, np.zeros(n_new)) - half @ columns
        old, new = np.split(np.vstack([first, columns]), [alpha.size], axis=1)
        V = np.zeros((1 + n_new, N + n_new, n_tasks))
        V[:, :N, self.observed] = old.reshape(-1, *alpha.shape)
        V[:, N + np.arange(n_new), self.tasks[self.new]] = new
        return V


class ExtendedPosterior(Posterior):
    """Posterior of f given complete data and a few more rows.

    Parameters
    ----------
    likelihood : ExtendedLikelihood
        Where the data and the model's form come from.
    theta : ndarray of shape (n_theta,)
        Parameters.
    base : KroneckerPosterior, default=None
        Given the complete data alone, in a model of perhaps fewer tasks.

    Attributes
    ----------
    base : KroneckerPosterior
        Given the complete data alone.
    cholesky : Cholesky
        Of S.
    """

    of_variances = ("cholesky",)

    def __init__(self, likelihood, theta, base=None):
        super().__init__(likelihood, theta)
        self.old, self.new = likelihood.old, likelihood.new
        self.X, tasks = likelihood.X[self.new], self.tasks[self.new]
        if base is None:
            base = likelihood.base.posterior(theta)
        else:
            base = base.with_tasks(likelihood.base, theta)
        self.base = base
        mean, S, cross = base.joint(self.X, tasks)
        S += np.diag(self.noise[self.new])
        self.cholesky = cholesky_with_jitter(lambda: S.copy(order="F"))
        self.jitter = np.zeros(len(self.tasks))
        self.jitter[self.new] = self.cholesky.jitter
        half = self.cholesky.half_solve(likelihood.y[self.new] - mean)
        self.log_likelihood = base.log_likelihood + log_density(
            half @ half, self.cholesky.log_det(), len(half)
        )
        self._set_alpha(self.cholesky.half_solve(half, transposed=True), cross)

    def _set_alpha(self, of_new, cross):
        """K^{-1} y: that of the complete data less P times that of the others."""
        base, self.alpha = self.base, np.empty(len(self.tasks))
        weighed = cross.T @ (of_new[:, None] * self._loadings_of_base())
        self.A = base.A - base.eigen.solve(weighed)
        self.alpha[self.old], self.alpha[self.new] = base.by_row(self.A), of_new
        self._set_means()

    def weights_of(self, loadings, alpha):
        """Weights of k^x at the inputs in means of sums of tasks, see Posterior."""
        of_new = loadings[:, self.tasks[self.new]] * alpha[..., self.new]
        of_old = self.base.weights_of(loadings, alpha[..., self.old])
        return np.hstack([of_old, of_new])

    def solve(self, G):
        """Roots of G^T K^{-1} G, and K^{-1} G, see Posterior."""
        base = self.base
        of_old, solved, _ = base.solve(G[self.old])
        given = self._cross_to_base()
        explained = np.tensordot(given, base.by_input(solved.T), ([1, 2], [1, 2]))
        half = self.cholesky.half_solve(G[self.new] - explained)
        found = np.empty_like(G)
        found[self.new] = self.cholesky.half_solve(half, transposed=True)
        told = np.tensordot(found[self.new].T, given, 1)
        taken = np.array(list(map(base.by_row, base.eigen.solve(told))))
        found[self.old] = solved - taken.T
        return np.vstack([of_old, half]), found, None

    def _with_loadings(self, unseen):
        """The same that knows tasks without data, too, see `WithUnseen`."""
        posterior = super()._with_loadings(unseen)
        posterior.base = self.base._with_loadings(unseen)
        return posterior

    def _cross_to_base(self):
        """B^T, of shape (n_new, n_inputs, n_observed)."""
        return self.base.cross(self.X)[..., None] * self._loadings_of_base()[:, None]

    def _loadings_of_base(self):
        """K^rho of the other rows and the tasks of the complete data."""
        return self.K_rho[np.ix_(self.tasks[self.new], self.base.observed)]

    def latent(self, X, factor):
        """The latent functions z_a at X: means and C^{-1} cov(y, z_a(X))."""
        own, (_, of_old) = self.tasks[self.new], self.base.latent(X, factor)
        cross = self.cross(X)
        means = self.weights_of(factor.T, self.alpha) @ cross.T
        loadings = self.K_rho[np.ix_(self.base.observed, own)]
        prior = factor[own].T[..., None] * cross[:, -len(own) :].T
        given = prior - self.base.half(self.X, loadings).T @ of_old
        of_new = [self.cholesky.half_solve(of_latent) for of_latent in given]
        return means, np.hstack([of_old, np.stack(of_new)])

    def explained(self, X, tasks):
        """What the data take off the variance of f, of shape (n_samples,)."""
        of_new = np.square(self._half(X, tasks)).sum(axis=0)
        return self.base.explained(X, tasks) + of_new

    def explained_covariance(self, X, tasks):
        """What they take off its covariance, (n_samples, n_samples)."""
        half = self._half(X, tasks)
        return self.base.explained_covariance(X, tasks) + half.T @ half

    def _half(self, X, tasks):
        """S^{-1/2} times the covariance of the other rows and f(X), given the old."""
        own = self.tasks[self.new]
        prior = self.K_rho[np.ix_(own, tasks)] * self.cross(X)[:, -len(own) :].T
        prior += self.level * np.equal.outer(own, tasks)
        explained = self.base.explained_between(self.X, own, X, tasks)
        return self.cholesky.half_solve(prior - explained)

    def level_variances(self):
        """Variance of the level of each task, given the data, (n_tasks,)."""
        if not self.level:
            return np.zeros(len(self.K_rho))
        own = self.tasks[self.new]
        told = self.level * np.equal.outer(own, np.arange(len(self.K_rho)))
        told[:, self.base.observed] = self.base.covariances_with_levels(self.X, own)
        told = np.square(self.cholesky.half_solve(told)).sum(axis=0)
        return np.maximum(self.base.level_variances() - told, 0.0)

    def precision(self):
        """The diagonal of K^{-1}, of shape (n_train,)."""
        P = self.base.eigen.solve(self._cross_to_base())
        columns = self.cholesky.half_solve(P.reshape(len(P), -1))
        of_old = np.square(columns).sum(axis=0).reshape(P.shape[1:])
        precision = np.empty(len(self.tasks))
        precision[self.old] = self.base.precision() + self.base.by_row(of_old)
        precision[self.new] = self.cholesky.inverse_diagonal()
        return precision
