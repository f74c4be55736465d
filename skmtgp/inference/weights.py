r"""The posterior of the weights of features that tasks share, and its adjoints.

Eq. 3 of the paper with features phi(x) for the latent functions, z_alpha = v_alpha .
phi, and, where K^rho has a diagonal kappa, with a function of each task's own:

.. math::
    f^m(x) = \omega_m^T \phi(x), \quad
    \omega_m = \sum_\alpha F_{m\alpha} v_\alpha + \sqrt{\kappa_m} w_m, \quad
    v_\alpha, w_m \sim N(0, I)

and perhaps a level c_m of variance v, which is integrated out first. Nothing here
depends on the number of rows.
"""

from copy import copy
from typing import NamedTuple

import numpy as np

from skmtgp._numerics.linalg import Cholesky


def invert(cholesky):
    """The symmetric inverse, which takes the place of the factor."""
    lower = np.tril(cholesky.invert())
    return lower + np.tril(lower, -1).T


def products_of(F):
    """F_{m alpha} F_{m beta}, of shape (n_tasks, rank^2)."""
    return np.einsum("ma,mb->mab", F, F).reshape(len(F), -1)


class Weights:
    """Posterior of the weights.

    Parameters
    ----------
    sums : FeatureSums
        What the rows say about them.
    F : ndarray of shape (n_tasks, rank)
        Shares of the tasks in the latent functions.
    kappa : ndarray of shape (n_tasks,)
        Variances of the tasks' own functions.
    noise : ndarray of shape (n_tasks,)
        Noise variances.
    level : float, default=0.0
        Variance of the levels.

    Attributes
    ----------
    share : ndarray of shape (n_tasks,)
        v / (sigma_m^2 + n_m v): of the sum of what is left of the targets, what the
        level takes.
    T : ndarray of shape (n_tasks, n_features, n_features)
        T_m = (I + kappa_m S_m / sigma_m^2)^{-1} S_m / sigma_m^2, the precision with
        which the rows of task m tell F_m . v: its own function is integrated out, and
        its level, by which S_m is less.
    keep : dict
        (I + kappa_m S_m / sigma_m^2)^{-1} of the tasks with functions of their own.
    cholesky : Cholesky
        Of A = I + sum_m F_m F_m^T (x) T_m, the precision of v.
    V : ndarray of shape (rank, n_features)
        Mean of v.
    omega : ndarray of shape (n_tasks, n_features)
        Mean of omega_m.
    levels : ndarray of shape (n_tasks,)
        Mean of c_m.

    Raises
    ------
    NotPositiveDefiniteError
        If a precision cannot be factorised.
    """

    def __init__(self, sums, F, kappa, noise, level=0.0):
        self.sums, self.F, self.kappa, self.noise = sums, F, kappa, noise
        self.level, self.share = level, level / (noise + sums.n * level)
        self.K_diagonal = np.square(F).sum(axis=1) + kappa
        self.T, t, self.log_det = self._integrate_own()
        (n_tasks, rank), m = F.shape, t.shape[1]
        products = products_of(F).T @ self.T.reshape(n_tasks, -1)
        A = products.reshape(rank, rank, m, m).swapaxes(1, 2).reshape(rank * m, -1)
        A.flat[:: len(A) + 1] += 1.0
        self.cholesky = Cholesky(A.T)
        self.log_det += self.cholesky.log_det()
        self.log_det += np.log1p(sums.n * level / noise).sum()
        self.V = self.cholesky.solve((F.T @ t).ravel()).reshape(rank, m)
        shared = F @ self.V
        self.own = t - np.einsum("mij,mj->mi", self.T, shared)
        self.omega = shared + kappa[:, None] * self.own
        own = np.square(self.own).sum(axis=1)
        self.penalty = np.square(self.V).sum() + kappa @ own
        self.levels = self.share * (
            sums.y - np.einsum("mi,mi->m", self.omega, sums.phi)
        )
        if level:
            self.penalty += np.square(self.levels).sum() / level

    def _integrate_own(self):
        """T_m, sum_i phi_i y_i weighed likewise, and the log-determinant of this."""
        sums, shared = self.sums, self.share[:, None] * self.sums.phi
        T = sums.S - shared[..., None] * sums.phi[:, None]
        T /= self.noise[:, None, None]
        t = (sums.s - shared * sums.y[:, None]) / self.noise[:, None]
        self.keep, log_det = {}, 0.0
        for task in np.flatnonzero(self.kappa):
            own = np.eye(len(T[task])) + self.kappa[task] * T[task]
            cholesky = Cholesky(np.asfortranarray(own))
            t[task] = cholesky.solve(t[task])
            log_det += cholesky.log_det()
            self.keep[task] = invert(cholesky)
            T[task] = self._without_own(T[task], self.kappa[task], self.keep[task])
        return T, t, log_det

    def _without_own(self, T, kappa, keep):
        """(I + kappa T)^{-1} T by the way that saves digits; `keep` is its factor."""
        if kappa * np.abs(np.diagonal(T)).max() > 1.0:
            return (np.eye(len(T)) - keep) / kappa
        product = keep @ T
        return 0.5 * (product + product.T)

    def refined(self, sums):
        """Mean weights with more digits, from the residuals that `omega` leaves.

        A step of iterative refinement: without noise half of the digits are lost in
        the Gram matrices, and come back from sums over the rows.

        Parameters
        ----------
        sums : ResidualSums
            Of those residuals.

        Returns
        -------
        V : ndarray of shape (rank, n_features)
            Mean of v.
        omega : ndarray of shape (n_tasks, n_features)
            Mean of omega_m.
        levels : ndarray of shape (n_tasks,)
            Mean of c_m.
        """
        step = sums.error - self.levels * self.noise / (self.level or 1.0)
        own = sums.errors - (self.share * step)[:, None] * self.sums.phi
        own = own / self.noise[:, None] - self.own
        for task, keep in self.keep.items():
            own[task] = keep @ own[task]
        V = self.F.T @ (self.own + own) - self.V
        V = self.cholesky.solve(V.ravel()).reshape(V.shape)
        shared = self.F @ V
        own -= np.einsum("mij,mj->mi", self.T, shared)
        omega = shared + self.kappa[:, None] * own
        step -= np.einsum("mi,mi->m", omega, self.sums.phi)
        return self.V + V, self.omega + omega, self.levels + self.share * step

    def log_density(self, squares):
        """The bound, given the sums of squared residuals of each task.

        Titsias (2009), eq. 9. The quadratic form is computed as the minimum over v, w
        of squares / sigma^2 + |v|^2 + |w|^2: an error of the weights changes it in
        second order only, and never to a value that is too small.
        """
        log_det = self.log_det + self.sums.n @ np.log(2.0 * np.pi * self.noise)
        fit = (squares / self.noise).sum() + self.penalty
        return -0.5 * (log_det + fit + self.K_diagonal @ (self.sums.rest / self.noise))


class Adjoint(NamedTuple):
    """What the backward pass needs of all rows.

    The adjoint of phi_i is alpha_i omega_m + C_m phi_i with alpha_i = e_i / sigma_m^2;
    that of k^x(Z, x_i) is L^{-T} times it. Where tasks have more rows than there are
    features, it takes less to multiply C_m by that, and the like, than all of them.

    Attributes
    ----------
    omega : ndarray of shape (n_tasks, n_features)
        Mean weights.
    levels : ndarray of shape (n_tasks,)
        Mean levels.
    C : ndarray of shape (n_tasks, n_features, n_features)
        (K^rho_mm I - Sigma_m) / sigma_m^2.
    with_level : ndarray of shape (n_tasks, n_features)
        -cov(omega_m, c_m) / sigma_m^2, which is added.
    noise : ndarray of shape (n_tasks,)
        sigma_m^2.
    diagonal : ndarray of shape (n_tasks,)
        Adjoints of k^x(x_i, x_i), -1/2 K^rho_mm / sigma_m^2.
    along : ndarray of shape (n_tasks, n_features)
        omega, for the adjoints.
    of_kernel : bool, default=False
        Whether `C`, `with_level` and `along` are those of k^x(Z, x_i).
    """

    omega: np.ndarray
    levels: np.ndarray
    C: np.ndarray
    with_level: np.ndarray
    noise: np.ndarray
    diagonal: np.ndarray
    along: np.ndarray
    of_kernel: bool = False

    def pulled_back(self, half_solve):
        """The same with adjoints of k^x(Z, x_i), by a function that gives L^{-T} b."""
        for C in self.C:
            C[...] = half_solve(C)
        with_level, along = half_solve(self.with_level.T).T, half_solve(self.along.T).T
        return self._replace(with_level=with_level, along=along, of_kernel=True)


class Covariances:
    """Posterior covariances of the weights.

    Parameters
    ----------
    weights : Weights
        The factor of its precision becomes the inverse. It is not kept.

    Attributes
    ----------
    inverse : ndarray of shape (rank, rank, n_features, n_features)
        Of A, the covariances of v_alpha and v_beta.
    Sigma : ndarray of shape (n_tasks, n_features, n_features)
        Covariances of omega_m.
    taken : ndarray of shape (n_tasks, n_features)
        c_m falls by `taken` . omega_m, whatever omega_m is.
    along : ndarray of shape (n_tasks, n_features)
        -cov(omega_m, c_m).
    of_level : ndarray of shape (n_tasks,)
        Variance of c_m for a given omega_m.
    """

    def __init__(self, weights):
        self.F, self.kappa, self.keep = weights.F, weights.kappa, weights.keep
        self.taken = weights.share[:, None] * weights.sums.phi
        self.of_level, self.level = weights.share * weights.noise, weights.level
        rank, m = weights.V.shape
        inverse = invert(weights.cholesky).reshape(rank, m, rank, m)
        self.inverse = np.ascontiguousarray(inverse.swapaxes(1, 2))
        self.Sigma = self.shared(slice(None))
        for task, keep in self.keep.items():
            own = self.kappa[task] * keep
            self.Sigma[task] = own + keep @ self.Sigma[task] @ keep
        self.along = np.einsum("mij,mj->mi", self.Sigma, self.taken)

    def shared(self, tasks):
        """Covariances of F_m . v."""
        rank, _, m, _ = self.inverse.shape
        B = products_of(self.F[tasks]) @ self.inverse.reshape(rank * rank, -1)
        return B.reshape(-1, m, m)

    def level_variances(self):
        """Variances of c_m, whatever omega_m is."""
        return self.of_level + np.einsum("mi,mi->m", self.along, self.taken)

    def with_unseen(self, loadings, own):
        """The same with tasks without data, which share some of the functions."""
        known, m, n_unseen = len(self.F), self.Sigma.shape[1], len(loadings)
        F = np.zeros((known + n_unseen, self.F.shape[1]))
        F[:known], F[known:, : loadings.shape[1]] = self.F, loadings
        other, unseen = copy(self), np.arange(known, len(F))
        other.F, other.kappa = F, np.append(self.kappa, np.full(n_unseen, own))
        other.keep = self.keep | dict.fromkeys(unseen, np.eye(m))
        Sigma = other.shared(unseen) + own * np.eye(m)
        other.Sigma = np.concatenate([self.Sigma, Sigma])
        without_level = np.zeros((n_unseen, m))
        other.taken = np.vstack([self.taken, without_level])
        other.along = np.vstack([self.along, without_level])
        other.of_level = np.append(self.of_level, np.full(n_unseen, self.level))
        return other

    def less(self, phi, task, rows):
        """Features of some rows of a task, less what its level takes of them."""
        return phi[:, rows] - self.taken[task][:, None]

    def between(self, phi, tasks):
        """Posterior covariances of omega_m . phi + c_m for given features and tasks.

        Parameters
        ----------
        phi : ndarray of shape (n_features, n_samples)
            Features, in columns.
        tasks : ndarray of shape (n_samples,)
            Task of each column.

        Returns
        -------
        covariance : ndarray of shape (n_samples, n_samples)
            O((rank n_features)^2) each.
        """
        own = np.equal.outer(tasks, tasks) * self.of_level[tasks]
        phi = phi - self.taken[tasks].T
        kept = phi.copy()
        for task, keep in self.keep.items():
            rows = np.flatnonzero(tasks == task)
            kept[:, rows] = keep @ phi[:, rows]
            of_task = self.kappa[task] * phi[:, rows].T @ kept[:, rows]
            own[np.ix_(rows, rows)] += of_task
        shares = np.einsum("ia,ji->aji", self.F[tasks], kept)
        solved = np.einsum("abjk,bki->aji", self.inverse, shares, optimize=True)
        return own + np.tensordot(shares, solved, ([0, 1], [0, 1]))


class Gradients:
    """The gradient of the bound, before and after the backward pass over the rows.

    Parameters
    ----------
    weights : Weights
        The factor of its precision becomes the inverse.

    Attributes
    ----------
    covariances : Covariances
        Of the weights.
    P : dict
        Phi^T K^{-1} Phi of the tasks with functions of their own.
    """

    def __init__(self, weights):
        self.weights, self.covariances = weights, Covariances(weights)
        self.P = {}
        for task in weights.keep:
            T, [B] = weights.T[task], self.covariances.shared([task])
            self.P[task] = T - T @ B @ T

    def adjoint(self):
        """What the backward pass over the rows needs."""
        weights, scale = self.weights, self.weights.K_diagonal / self.weights.noise
        C = self.covariances.Sigma / -weights.noise[:, None, None]
        np.einsum("mii->mi", C)[...] += scale[:, None]
        with_level = self.covariances.along / weights.noise[:, None]
        means, noise = (weights.omega, weights.levels), weights.noise
        return Adjoint(*means, C, with_level, noise, -0.5 * scale, weights.omega)

    def omega_bar(self):
        """sum_i phibar_i phi_i^T, the adjoint of K_ZZ for `Features.contract`.

        sum_m Sigma_m S_m / sigma_m^2 is the identity minus A^{-1}, and the like, so
        that no sum over the tasks takes a product of matrices.
        """
        weights = self.weights
        scale = weights.K_diagonal / weights.noise
        Omega = weights.V.T @ weights.V + np.tensordot(scale, weights.sums.S, 1)
        Omega += np.einsum("aaij->ij", self.covariances.inverse)
        Omega.flat[:: len(Omega) + 1] -= len(weights.V)
        for task, P in self.P.items():
            own, kappa = weights.own[task], weights.kappa[task]
            Omega += kappa * (np.multiply.outer(own, own) - P)
        return 0.5 * (Omega + Omega.T)

    def by_parameters(self, back):
        """Gradients by F, kappa, and the variances of levels and noise.

        Those by F are not taken from the derivative by K^rho, whose terms of the size
        of 1 / sigma^2 cancel.

        Parameters
        ----------
        back : GradientSums
            The backward pass.

        Returns
        -------
        d_F : ndarray of shape (n_tasks, rank)
        d_kappa : ndarray of shape (n_tasks,)
            Zero where kappa is.
        d_level : float
        d_noise : ndarray of shape (n_tasks,)
        """
        weights, sums = self.weights, self.weights.sums
        rest = sums.rest / weights.noise
        a = back.errors / weights.noise[:, None]
        d_F = a @ weights.V.T - weights.F * rest[:, None]
        d_F -= np.einsum("mb,mba->ma", weights.F, self._overlaps())
        d_kappa = np.zeros(len(rest))
        for task, P in self.P.items():
            d_kappa[task] = np.square(a[task]).sum() - np.trace(P) - rest[task]
        of_level, spread = self._spreads()
        d_level = np.square(weights.levels) + of_level - weights.level
        d_level = d_level.sum() / weights.level**2 if weights.level else 0.0
        d_noise = (spread + back.squares) / weights.noise
        d_noise += weights.K_diagonal * rest - sums.n
        return d_F, 0.5 * d_kappa, 0.5 * d_level, 0.5 * d_noise / weights.noise

    def _spreads(self):
        """Variances of c_m, and sums of those of f at the rows, for each task."""
        sums, covariances = self.weights.sums, self.covariances
        of_level = covariances.level_variances()
        spread = np.einsum("mij,mij->m", sums.S, covariances.Sigma)
        spread -= 2.0 * np.einsum("mi,mi->m", covariances.along, sums.phi)
        return of_level, spread + sums.n * of_level

    def _overlaps(self):
        """tr(T_m cov(v_alpha, v_beta)), of shape (n_tasks, rank, rank)."""
        (n_tasks, rank), inverse = self.weights.F.shape, self.covariances.inverse
        by_pair = inverse.reshape(rank * rank, -1).T
        flat = self.weights.T.reshape(n_tasks, -1) @ by_pair
        return flat.reshape(n_tasks, rank, rank)

    def task_gradient(self, back):
        """Derivative of the bound by K^rho, of shape (n_tasks, n_tasks).

        With alpha = K^{-1} y and the features Phi_m of a task's rows, half of
        a_m . a_m' - tr(Phi_m^T [K^{-1}]_mm' Phi_m'), less half the trace term.
        """
        weights, F, T = self.weights, self.weights.F, self.weights.T
        inverse = self.covariances.inverse
        a = back.errors / weights.noise[:, None]
        D = a @ a.T
        for task, F_m in enumerate(F):
            half = T[task] @ np.tensordot(F_m, inverse, 1)  # (rank, m, m)
            D[task] += np.einsum("nb,bij,nij->n", F, half, T, optimize=True)
            D[task, task] -= (
                np.trace(T[task]) + weights.sums.rest[task] / weights.noise[task]
            )
        return 0.25 * (D + D.T)
