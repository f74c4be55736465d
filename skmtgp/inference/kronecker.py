"""Exact inference with complete data: all tasks at the same inputs, once each.

With N inputs and M tasks it takes time O(N^3 + M^3 + N M (N + M)) and memory O(N^2).
Of q missing cells it takes O(q N M (q + N)) and O(q (q + N)) more.
"""

from abc import abstractmethod
from copy import copy

import numpy as np

from skmtgp._data.complete import design_of
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.eigen import Along, KroneckerEigen
from skmtgp.inference.gaps import GappyEigen
from skmtgp.inference.likelihood import log_density
from skmtgp.inference.posterior import Posterior
from skmtgp.inference.tiles import TiledLikelihood, diagonal_of


class EigenLikelihood(TiledLikelihood):
    """A likelihood whose gradients come from a KroneckerEigen and a few vectors.

    With G = sum_v s_v v v^T - K^{-1}, where v are vectors over all samples and s_v are
    1 or -1, dL = 1/2 sum_ij G_ij dK_ij. K is that of the complete data, whose inputs
    come first; `observed` are their tasks.
    """

    @property
    def side(self):
        """Rows of the matrices on which an evaluation spends its time."""
        return max(len(self.inputs), self.prior.n_tasks)

    def _evaluate(self, theta):
        """The value; NotPositiveDefiniteError where K cannot be decomposed."""
        with limit_threads(self.side), self._workspace() as workspace:
            bound, *values = self._bind(theta)
            self._fill(bound, workspace.K)
            return self._decompose(workspace.K, *values)[0]

    def _differentiate(self, theta):
        """The value and its gradients, see TiledLikelihood."""
        with limit_threads(self.side), self._workspace() as workspace:
            bound, K_rho, *variances = self._bind(theta)
            tapes = self._fill(bound, workspace.K, workspace.tiles)
            value, *rest = self._decompose(workspace.K, K_rho, *variances)
            return value, *self._pull_back(bound, tapes, K_rho, *rest)

    @abstractmethod
    def _decompose(self, K_x, K_rho, level, noise):
        """The value and what its gradients are made of.

        Returns
        -------
        value : float
            Log marginal likelihood.
        eigen : KroneckerEigen
            The complete data's K.
        signs : ndarray of shape (n_vectors,)
            s_v.
        V : ndarray of shape (n_vectors, n_inputs, n_tasks)
            v, 0 where there is no sample.
        K_V : ndarray of shape (n_vectors, n_inputs, n_tasks)
            K^x V.
        """

    def _fill(self, bound, K, memory=None):
        """K^x in K, and for each tile (K_x, tape)."""

        def put(K_x, rows, cols):
            K[rows, cols], K[cols, rows] = K_x, np.transpose(K_x)

        return self._fill_tiles(bound, put, memory)

    def _pull_back(self, bound, tapes, K_rho, eigen, signs, V, K_V):
        """Gradients by kernel theta, K^rho, and the variances of levels and noise."""
        between = np.ix_(self.observed, self.observed)
        signed = signs[:, None, None] * V
        d_kernel = self._pull_back_K_x(bound, tapes, eigen, signed @ K_rho, V)
        # dL/dK^rho = 1/2 (sum_v s_v V^T K^x V - d log|K| / dK^rho)
        D = np.tensordot(signed, K_V, axes=((0, 1), (0, 1)))
        D[between] -= eigen.log_det_by_K_rho()
        d_noise = np.einsum("vim,vim->m", signed, V)
        d_noise[self.observed] -= eigen.log_det_by_noise()
        if self.prior.n_noise == 1:
            d_noise = d_noise.sum(keepdims=True)
        d_level = np.vdot(signed.sum(axis=1), V.sum(axis=1)) - eigen.log_det_by_level()
        return d_kernel, 0.25 * (D + D.T), 0.5 * d_level, 0.5 * d_noise

    def _pull_back_K_x(self, bound, tapes, eigen, left, right):
        """dL/dK^x = 1/2 (sum_v s_v V K^rho V^T - d log|K| / dK^x), contracted."""
        n, N = len(self.inputs), len(eigen.L)
        left, right = (np.moveaxis(a, 0, 1).reshape(n, -1) for a in (left, right))
        scaled, Q, d = eigen.log_det_by_K_x()
        of_levels = Q * d

        def contract(rows, cols, K_x, tape):
            G = left[rows] @ right[cols].T
            old = slice(max(0, N - rows.start)), slice(max(0, N - cols.start))
            # of the complete data alone
            G[old] -= scaled[rows] @ eigen.U[cols].T
            if d.size:
                G[old] += of_levels[rows] @ Q[cols].T
            self._clear_below(G, rows, cols)
            if rows.start == cols.start:
                diagonal = diagonal_of(G)
                diagonal *= 0.5
            return bound.contract(G, tape, rows, cols)

        parts = self._map_tiles(contract, tapes)
        return sum(parts, np.zeros(self.prior.node.n_dims))


class KroneckerLikelihood(EigenLikelihood):
    """The likelihood of complete data, of which some cells may be missing.

    Parameters
    ----------
    prior, X, tasks, y
        See Likelihood. K^rho may have tasks without data.
    design : ndarray of shape (n_inputs, n_tasks), default=None
        The row of each input and task, -1 if missing, where it is known already.

    Attributes
    ----------
    observed : ndarray of shape (n_observed,)
        The tasks with data.
    rows : ndarray of shape (n_inputs, n_observed)
        The row of each input and task; -1 where the cell is missing.
    cells : tuple of (ndarray of shape (q,), ndarray of shape (q,))
        The input and the position in `observed` of each missing cell.
    inputs : ndarray of shape (n_inputs, n_features)
        The inputs.
    Y : ndarray of shape (n_inputs, n_observed)
        The targets, and 0 where one is missing.

    Raises
    ------
    ValueError
        If a cell has several rows, or too many are missing.
    """

    novel = ()

    def __init__(self, prior, X, tasks, y, design=None):
        self.observed, codes = np.unique(tasks, return_inverse=True)
        self.rows = design_of(X, codes) if design is None else design
        if self.rows is None:
            raise ValueError("The tasks are not observed at the same inputs once each.")
        there = self.rows >= 0
        first = self.rows[np.arange(len(self.rows)), there.argmax(axis=1)]
        super().__init__(prior, X, tasks, y, X[first])
        self.cells, self.Y = np.nonzero(~there), np.where(there, y[self.rows], 0.0)
        self.n_missing = len(self.cells[0])

    def with_tasks(self, prior, tasks, y):
        """The same data in a model that has more tasks, without data.

        Parameters
        ----------
        prior : Prior
            Of all tasks.
        tasks, y : ndarray of shape (n_samples,)
            Positions of the tasks there, and the targets.

        Returns
        -------
        likelihood : KroneckerLikelihood
        """
        likelihood = copy(self)
        likelihood.prior, likelihood.tasks, likelihood.y = prior, tasks, y
        likelihood.observed = np.unique(tasks)
        likelihood.Y = np.where(self.rows >= 0, y[self.rows], 0.0)
        return likelihood

    def posterior(self, theta):
        """The posterior of f given y.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        posterior : KroneckerPosterior
            Nothing is ever added to its covariance.
        """
        return KroneckerPosterior(self, theta)

    def log_density(self, eigen, half):
        """Log density of y, given K and the root's part of y."""
        return log_density(np.vdot(half, half), eigen.log_det(), len(self.y))

    def rotated(self, eigen):
        """Coefficients of y, and of what is missing of it, along the eigenvectors."""
        return eigen.completed(eigen.rotate(self.Y))

    def eigen(self, theta):
        """K decomposed."""
        bound, K_rho, level, noise = self._bind(theta)
        K_x = np.empty((len(self.inputs),) * 2)
        self._fill(bound, K_x)
        return self.decomposed(K_x.T, K_rho, level, noise)

    def decomposed(self, K_x, K_rho, level, noise):
        """K decomposed, from K^x in Fortran order, which is overwritten."""
        parts = K_x, K_rho, noise, self.observed, level
        if self.n_missing:
            return GappyEigen(*parts, self.cells)
        return KroneckerEigen(*parts)

    def _decompose(self, K_x, K_rho, level, noise):
        eigen = self.decomposed(K_x.T, K_rho, level, noise)
        half = eigen.half(self.rotated(eigen))
        alpha, V = eigen.alpha(half), np.zeros((2, *self.Y.shape[:1], len(K_rho)))
        V[0][:, self.observed] = eigen.rotate_back(alpha)
        V[1][:, self.observed] = eigen.rotate_back(eigen.L[:, None] * alpha)
        return self.log_density(eigen, half), eigen, np.ones(1), V[:1], V[1:]


class KroneckerPosterior(Posterior):
    """Posterior of f given complete data.

    Parameters
    ----------
    likelihood : KroneckerLikelihood
        Where the data and the model's form come from.
    theta : ndarray of shape (n_theta,)
        Parameters.

    Attributes
    ----------
    eigen : KroneckerEigen
        K.
    A, of_f : ndarray of shape (n_inputs, n_observed)
        K^{-1} y of each input and task, and what of it tells of f.
    """

    of_variances = ("eigen",)

    def __init__(self, likelihood, theta):
        super().__init__(likelihood, theta)
        self.observed, self.rows = likelihood.observed, likelihood.rows
        self.eigen = eigen = likelihood.eigen(theta)
        rotated = likelihood.rotated(eigen)
        half = eigen.half(rotated)
        self.log_likelihood = likelihood.log_density(eigen, half)
        alpha = eigen.alpha(half)
        self.A = eigen.rotate_back(alpha)
        self.alpha = self.by_row(self.A)
        # f has no part along eigenvectors of eigenvalue zero, but alpha a large one
        self.of_f = eigen.rotate_back(alpha * (eigen.values > 1.0))
        self.of_levels = eigen.levels.means(rotated) if eigen.levels else 0.0
        self._set_means()

    def with_tasks(self, likelihood, theta):
        """The posterior in a model of more tasks, with nothing decomposed again.

        Parameters
        ----------
        likelihood : KroneckerLikelihood
            Of the same data and more tasks, see there.
        theta : ndarray of shape (n_theta,)
            Parameters, the same but for those of tasks without data.

        Returns
        -------
        posterior : KroneckerPosterior
        """
        _ = self.largest_of_k  # is made once, before the copy, for all that join
        posterior, prior = copy(self), likelihood.prior
        posterior.prior, posterior.theta = prior, theta
        posterior.K_rho = prior.K_rho_at(theta)
        posterior.tasks, posterior.observed = likelihood.tasks, likelihood.observed
        posterior.noise = likelihood.noise_of_rows(prior.values(theta).noise)
        posterior._set_means()
        return posterior

    def _set_means(self):
        """What the means are made of; levels keep digits as their own means."""
        super()._set_means()
        self.levels[self.observed] = self.of_levels

    def _weigh_tasks(self):
        """Of k^x at each input in the mean of each task, with the digits of `of_f`."""
        return self.K_rho[:, self.observed] @ self.of_f.T

    def weights_of(self, loadings, alpha):
        """Weights of k^x at the inputs in means of sums of tasks, see Posterior."""
        return (self.by_input(alpha) @ loadings[:, self.observed, None])[..., 0]

    def solve(self, G):
        """Roots of G^T K^{-1} G, and K^{-1} G, see Posterior."""
        half = self.eigen.half(self.eigen.rotate(self.by_input(G.T)))
        solved = self.eigen.rotate_back(self.eigen.alpha(half))
        of_rows = np.array(list(map(self.by_row, solved)))
        return half.reshape(len(half), -1).T, of_rows.T, None

    def latent(self, X, factor):
        """The latent functions z_a at X: means and C^{-1} cov(y, z_a(X))."""
        of_tasks, cross = factor[self.observed], self.cross(X)
        means, along = of_tasks.T @ self.A.T @ cross.T, cross @ self.eigen.U
        rotated = along[:, :, None] * (of_tasks.T @ self.eigen.W)[:, None, None]
        halves = self.eigen.half(rotated).reshape(*rotated.shape[:2], -1)
        return means, halves.swapaxes(1, 2)

    def half(self, X, loadings):
        """C^{-1} cov(y, g(X)), where K = C C^T, for sums g of the latent functions.

        Parameters
        ----------
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        loadings : ndarray of shape (n_observed, n_samples or 1)
            cov(f^m(x), g(x')) = loading k^x(x, x') for each observed task m.

        Returns
        -------
        half : ndarray of shape (n_train, n_samples)
            Its rows are in the order of the eigenvalues.
        """
        return self._half(self._along_x(X), loadings)

    def _half(self, along_x, loadings):
        """The same, from how the rows are along the eigenvectors."""
        rotated = along_x[..., None] * (self.eigen.W.T @ loadings).T[:, None]
        return self.eigen.half(rotated).reshape(len(along_x), -1).T

    def explained(self, X, tasks):
        """What the data take off the variance of f, of shape (n_samples,)."""
        along, left, novel = self._along(X, tasks)
        weights = (1.0 / self.eigen.values) @ np.square(along.columns)
        explained = np.einsum("ti,it->t", np.square(along.of_x), weights[:, tasks])
        explained -= np.square(self.eigen.hidden(along, left)).sum(axis=0)
        if not self.level:
            return explained
        own = left @ self.eigen.levels.covariance
        return explained + self.level - np.einsum("im,im->i", own, left) - novel

    def explained_covariance(self, X, tasks):
        """What they take off its covariance, (n_samples, n_samples)."""
        along = self._along(X, tasks)
        return self._between(along, along)

    def explained_between(self, X, tasks, Z, tasks_of_Z):
        """What the data take off cov(f(X), f(Z))."""
        return self._between(self._along(X, tasks), self._along(Z, tasks_of_Z))

    def _between(self, left, right):
        """The same, from how both are along the eigenvectors, see `_along`."""
        explained = self.eigen.products(left[0], right[0])
        explained -= self.eigen.hidden(*left[:2]).T @ self.eigen.hidden(*right[:2])
        if self.level:
            explained += self._explained_of_levels(left, right)
        return explained

    def _explained_of_levels(self, left, right):
        """What the data take off the covariances of levels, and give to the rest."""
        (of_X, left_of_X, novel_X), (of_Z, left_of_Z, novel_Z) = left, right
        same = np.equal.outer(of_X.tasks, of_Z.tasks)
        explained = self.level * same
        explained -= left_of_X @ self.eigen.levels.covariance @ left_of_Z.T
        return explained - np.multiply.outer(novel_X, novel_Z > 0.0) * same

    def joint(self, X, tasks):
        """Mean and covariance of f, and k^x(X, inputs), of which both are made."""
        cross = self.cross(X)
        along = self._dependence(cross @ self.eigen.U, tasks)
        covariance = self._covariance(X, tasks, lambda *_: self._between(along, along))
        mean = np.einsum("ij,ij->i", cross, self.weights[tasks]) + self.levels[tasks]
        return mean, covariance, cross

    def _along(self, X, tasks):
        """How f at X is along the eigenvectors, see `_dependence`."""
        return self._dependence(self._along_x(X), tasks)

    def _dependence(self, along_x, tasks):
        """How f is along the eigenvectors, and depends on the levels beside.

        `along_x` is k^x(X, inputs) U, of shape (n_samples, n_inputs).

        Returns
        -------
        along : Along
            Its covariances with the cells.
        left : ndarray of shape (n_samples, n_observed) or None
            How it depends on the levels of the observed tasks once the cells are
            known; None without levels.
        novel : ndarray of shape (n_samples,) or None
            Variance of the level of a task without data.
        """
        along = Along(along_x, self._along_tasks(), tasks)
        if not self.level:
            return along, None, None
        left = -self.eigen.levels.told(along.of_x, along.columns[:, tasks])
        left += np.equal.outer(tasks, self.observed)
        return along, left, self.level * ~np.isin(tasks, self.observed)

    def _along_x(self, X):
        """k^x(X, inputs) U, of shape (n_samples, n_inputs)."""
        return self.cross(X) @ self.eigen.U

    def _along_tasks(self):
        """W^T K^rho, of shape (n_observed, n_tasks)."""
        return self.eigen.W.T @ self.K_rho[self.observed]

    def level_variances(self):
        """Variance of the level of each task, given the data, (n_tasks,)."""
        variances = np.full(len(self.K_rho), self.level)
        if self.level:
            hidden = np.square(self.eigen.hidden_levels()).sum(axis=0)
            told = np.diagonal(self.eigen.levels.covariance)
            variances[self.observed] = told + hidden
        return variances

    def covariances_with_levels(self, X, tasks):
        """Of f with the levels of the observed tasks, (n_samples, n_observed)."""
        along, left, _ = self._along(X, tasks)
        hidden = self.eigen.hidden(along, left).T @ self.eigen.hidden_levels()
        return left @ self.eigen.levels.covariance + hidden

    def precision(self):
        """The diagonal of K^{-1}, of shape (n_train,)."""
        return self.by_row(self.eigen.inverse_diagonal())

    def by_input(self, of_rows):
        """Numbers of each training row, (..., n_train), by input and observed task."""
        there = self.rows >= 0
        by_input = np.zeros((*of_rows.shape[:-1], *self.rows.shape))
        by_input[..., there] = of_rows[..., self.rows[there]]
        return by_input

    def by_row(self, of_inputs):
        """Numbers of each input and task, in the order of the training rows."""
        there = self.rows >= 0
        by_row = np.empty(there.sum())
        by_row[self.rows[there]] = of_inputs[there]
        return by_row
