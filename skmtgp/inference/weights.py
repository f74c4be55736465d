r"""The posterior of the weights of features that tasks share, and its adjoints.

Eq. 3 of the paper with features phi(x) for the latent functions, z_alpha = v_alpha .
phi, and, where K^rho has a diagonal kappa, with a function of each task's own:

.. math::
    f^m(x) = \omega_m^T \phi(x), \quad
    \omega_m = \sum_\alpha F_{m\alpha} v_\alpha + \sqrt{\kappa_m} w_m, \quad
    v_\alpha, w_m \sim N(0, I)

and perhaps a level c_m of variance v, which is integrated out first. Features and
weights of several terms are stacked, see :mod:`skmtgp.inference.loadings`. Nothing here
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


class Weights:
    """Posterior of the weights.

    Parameters
    ----------
    sums : FeatureSums
        What the rows say about them.
    loadings : Loadings
        What tasks have of the latent functions, F, and of their own, kappa.
    noise : ndarray of shape (n_tasks,)
        Noise variances.
    level : float, default=0.0
        Variance of the levels.

    Attributes
    ----------
    K_diagonal : ndarray of shape (n_tasks, n_terms)
        K^rho_mm of each term.
    share : ndarray of shape (n_tasks,)
        v / (sigma_m^2 + n_m v): of the sum of what is left of the targets, what the
        level takes.
    T : ndarray of shape (n_tasks, n_features, n_features)
        T_m = (I + S_m D_m / sigma_m^2)^{-1} S_m / sigma_m^2 with D_m, which has kappa_m
        of each feature's term on its diagonal: the precision with which the rows of
        task m tell F_m . v. Its own functions are integrated out, and its level, by
        which S_m is less.
    keep : dict
        (I + S_m D_m / sigma_m^2)^{-1} of the tasks with functions of their own.
    cholesky : Cholesky
        Of A = I + sum_m F_m F_m^T (x) T_m, the precision of v.
    V : ndarray of shape (n_latent, n_inducing)
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

    def __init__(self, sums, loadings, noise, level=0.0):
        self.sums, self.loadings, self.noise = sums, loadings, noise
        self.level, self.share = level, level / (noise + sums.n * level)
        self.K_diagonal = loadings.variances
        self.T, t, self.log_det = self._integrate_own()
        A = loadings.precision(self.T)
        A.flat[:: len(A) + 1] += 1.0
        self.cholesky = Cholesky(A.T)
        self.log_det += self.cholesky.log_det()
        self.log_det += np.log1p(sums.n * level / noise).sum()
        V = self.cholesky.solve(loadings.mix_back(t).ravel())
        self.V = V.reshape(-1, loadings.n_inducing)
        shared = loadings.mix(self.V)
        self.own = t - np.einsum("mij,mj->mi", self.T, shared)
        self.omega = shared + loadings.own * self.own
        self.penalty = np.square(self.V).sum()
        self.penalty += np.vdot(loadings.own, np.square(self.own))
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
        self.keep, log_det, kappa = {}, 0.0, self.loadings.kappa
        for task, q in zip(*np.nonzero(kappa), strict=True):
            rows = self.loadings.rows[q]
            keep, of_term = _integrate_term(T[task], t[task], rows, kappa[task, q])
            before = self.keep.get(task)
            self.keep[task] = keep if before is None else keep @ before
            log_det += of_term
        return T, t, log_det

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
        V : ndarray of shape (n_latent, n_inducing)
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
        V = self.loadings.mix_back(self.own + own) - self.V
        V = self.cholesky.solve(V.ravel()).reshape(V.shape)
        shared = self.loadings.mix(V)
        own -= np.einsum("mij,mj->mi", self.T, shared)
        omega = shared + self.loadings.own * own
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
        rest = np.vdot(self.K_diagonal, self.sums.rest / self.noise[:, None])
        return -0.5 * (log_det + fit + rest)


def _integrate_term(T, t, rows, kappa):
    """Integrate a task's own function of a term out of T and t, in place.

    Parameters
    ----------
    T : ndarray of shape (n_features, n_features)
        Precision with which the rows of the task tell its weights.
    t : ndarray of shape (n_features,)
        Precision times weights.
    rows : slice
        The features of the term.
    kappa : float
        Variance of the function.

    Returns
    -------
    keep : ndarray of shape (n_features, n_features)
        By which both are multiplied, (I + T D)^{-1}: D is kappa at those features.
    log_det : float
        Of I + T D.
    """
    of_term = T[rows, rows]
    own = np.eye(len(of_term)) + kappa * of_term
    cholesky = Cholesky(np.asfortranarray(own))
    t[rows] = cholesky.solve(t[rows])
    others = np.delete(np.arange(len(T)), rows)
    taken = _take_off(T, t, rows, others, kappa, cholesky) if len(others) else None
    log_det, keep = cholesky.log_det(), invert(cholesky)
    T[rows, rows] = _without_own(of_term, kappa, keep)
    if taken is None:
        return keep, log_det
    whole = np.eye(len(T))
    whole[others, rows], whole[rows, rows] = -kappa * taken, keep
    return whole, log_det


def _take_off(T, t, rows, others, kappa, cholesky):
    """What a task's own function of a term takes off the features of other terms.

    Solved, not multiplied with an inverse: without noise that would leave no digits.
    """
    cross = T[rows, others]
    half = cholesky.half_solve(cross)
    taken = cholesky.half_solve(half, transposed=True)
    t[others] -= kappa * t[rows] @ cross
    T[np.ix_(others, others)] -= kappa * half.T @ half
    T[rows, others], T[others, rows] = taken, taken.T
    return taken.T


def _without_own(T, kappa, keep):
    """(I + kappa T)^{-1} T by the way that saves digits; `keep` is its factor."""
    if kappa * np.abs(np.diagonal(T)).max() > 1.0:
        return (np.eye(len(T)) - keep) / kappa
    product = keep @ T
    return 0.5 * (product + product.T)


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
        (K^rho_mm - Sigma_m) / sigma_m^2, where K^rho_mm of each feature's term is
        diagonal.
    with_level : ndarray of shape (n_tasks, n_features)
        -cov(omega_m, c_m) / sigma_m^2, which is added.
    noise : ndarray of shape (n_tasks,)
        sigma_m^2.
    diagonal : ndarray of shape (n_tasks, n_terms)
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
    inverse : ndarray of shape (n_latent, n_latent, n_inducing, n_inducing)
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
        self.loadings, self.keep = weights.loadings, weights.keep
        self.taken = weights.share[:, None] * weights.sums.phi
        self.of_level, self.level = weights.share * weights.noise, weights.level
        rank, m = weights.V.shape
        inverse = invert(weights.cholesky).reshape(rank, m, rank, m)
        self.inverse = np.ascontiguousarray(inverse.swapaxes(1, 2))
        self.Sigma = self.loadings.covariances(self.inverse)
        for task, keep in self.keep.items():
            own = self.loadings.own[task][:, None] * keep
            self.Sigma[task] = own + keep.T @ self.Sigma[task] @ keep
        self.along = np.einsum("mij,mj->mi", self.Sigma, self.taken)

    def level_variances(self):
        """Variances of c_m, whatever omega_m is."""
        return self.of_level + np.einsum("mi,mi->m", self.along, self.taken)

    def with_unseen(self, unseen):
        """The same with tasks without data, which share some of the functions.

        Parameters
        ----------
        unseen : list of (ndarray, float)
            See `Loadings.with_unseen`.
        """
        other, known, p = copy(self), len(self.Sigma), self.Sigma.shape[1]
        other.loadings = self.loadings.with_unseen(unseen)
        new = np.arange(known, len(other.loadings.F))
        other.keep = self.keep | dict.fromkeys(new, np.eye(p))
        Sigma = other.loadings.covariances(self.inverse, new)
        np.einsum("mii->mi", Sigma)[...] += other.loadings.own[new]
        other.Sigma = np.concatenate([self.Sigma, Sigma])
        without_level = np.zeros((len(new), p))
        other.taken = np.vstack([self.taken, without_level])
        other.along = np.vstack([self.along, without_level])
        other.of_level = np.append(self.of_level, np.full(len(new), self.level))
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
            O((n_latent n_inducing)^2) each.
        """
        own = np.equal.outer(tasks, tasks) * self.of_level[tasks]
        phi, loadings = phi - self.taken[tasks].T, self.loadings
        kept = phi.copy()
        for task, keep in self.keep.items():
            rows = np.flatnonzero(tasks == task)
            kept[:, rows] = keep @ phi[:, rows]
            of_task = (loadings.own[task] * phi[:, rows].T) @ kept[:, rows]
            own[np.ix_(rows, rows)] += of_task
        shares = loadings.shares(kept, tasks)
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
            T = weights.T[task]
            [B] = weights.loadings.covariances(self.covariances.inverse, [task])
            self.P[task] = T - T @ B @ T

    def adjoint(self):
        """What the backward pass over the rows needs."""
        weights, scale = self.weights, self._scale()
        C = self.covariances.Sigma / -weights.noise[:, None, None]
        np.einsum("mii->mi", C)[...] += weights.loadings.of_features(scale)
        with_level = self.covariances.along / weights.noise[:, None]
        means, noise = (weights.omega, weights.levels), weights.noise
        return Adjoint(*means, C, with_level, noise, -0.5 * scale, weights.omega)

    def _scale(self):
        """K^rho_mm / sigma_m^2 of each term, of shape (n_tasks, n_terms)."""
        return self.weights.K_diagonal / self.weights.noise[:, None]

    def omega_bars(self):
        """sum_i phibar_i phi_i^T of each term, the adjoints of K_ZZ.

        sum_m Sigma_m S_m / sigma_m^2 is the identity minus A^{-1}, and the like, so
        that no sum over the tasks takes a product of matrices.

        Returns
        -------
        Omegas : list of ndarray of shape (n_inducing, n_inducing)
            For `Features.contract`.
        """
        loadings, scale = self.weights.loadings, self._scale()
        places = zip(scale.T, loadings.columns, loadings.rows, strict=True)
        return [self._omega_bar(q, *of) for q, of in enumerate(places)]

    def _omega_bar(self, q, scale, columns, rows):
        weights, V = self.weights, self.weights.V[columns]
        Omega = V.T @ V + np.tensordot(scale, weights.sums.S[:, rows, rows], 1)
        Omega += np.einsum("aaij->ij", self.covariances.inverse[columns, columns])
        Omega.flat[:: len(Omega) + 1] -= len(V)
        for task, P in self.P.items():
            own, kappa = weights.own[task, rows], weights.loadings.kappa[task, q]
            Omega += kappa * (np.multiply.outer(own, own) - P[rows, rows])
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
        latents : list of (ndarray, ndarray)
            Of each term by F, (n_tasks, rank), and kappa, (n_tasks,): zero where that
            is.
        d_level : float
        d_noise : ndarray of shape (n_tasks,)
        """
        weights, sums = self.weights, self.weights.sums
        rest = sums.rest / weights.noise[:, None]
        latents = self._by_latents(back.errors / weights.noise[:, None], rest)
        of_level, spread = self._spreads()
        d_level = np.square(weights.levels) + of_level - weights.level
        d_level = d_level.sum() / weights.level**2 if weights.level else 0.0
        d_noise = (spread + back.squares) / weights.noise
        d_noise += (weights.K_diagonal * rest).sum(axis=1) - sums.n
        return latents, 0.5 * d_level, 0.5 * d_noise / weights.noise

    def _by_latents(self, a, rest):
        """Gradients by F and kappa of each term, from Phi_m^T K^{-1} y of each task."""
        loadings, V, latents = self.weights.loadings, self.weights.V, []
        overlaps = np.einsum(
            "mb,mba->ma",
            loadings.F,
            loadings.overlaps(self.weights.T, self.covariances.inverse),
        )
        for q, columns in enumerate(loadings.columns):
            of_term, rest_of_term = a[:, loadings.rows[q]], rest[:, q]
            F = loadings.F[:, columns]
            d_F = of_term @ V[columns].T - F * rest_of_term[:, None]
            d_F -= overlaps[:, columns]
            d_kappa = np.zeros(len(rest))
            for task in np.flatnonzero(loadings.kappa[:, q]):
                P = self.P[task][loadings.rows[q], loadings.rows[q]]
                told = np.square(of_term[task]).sum() - np.trace(P)
                d_kappa[task] = told - rest_of_term[task]
            latents.append((d_F, 0.5 * d_kappa))
        return latents

    def _spreads(self):
        """Variances of c_m, and sums of those of f at the rows, for each task."""
        sums, covariances = self.weights.sums, self.covariances
        of_level = covariances.level_variances()
        spread = np.einsum("mij,mij->m", sums.S, covariances.Sigma)
        spread -= 2.0 * np.einsum("mi,mi->m", covariances.along, sums.phi)
        return of_level, spread + sums.n * of_level

    def task_gradients(self, back):
        """Derivatives of the bound by K^rho, of shape (n_terms, n_tasks, n_tasks).

        With alpha = K^{-1} y and the features Phi_m of a task's rows, half of
        a_m . a_m' - tr(Phi_m^T [K^{-1}]_mm' Phi_m'), less half the trace term.
        """
        weights, n_terms = self.weights, self.weights.loadings.n_terms
        a = back.errors / weights.noise[:, None]
        return np.array([self._task_gradient(a, q) for q in range(n_terms)])

    def _task_gradient(self, a, q):
        """That by K^rho of one term."""
        weights, rows = self.weights, self.weights.loadings.rows[q]
        T, F = weights.T[:, rows], weights.loadings.F
        rest = weights.sums.rest[:, q] / weights.noise
        D = a[:, rows] @ a[:, rows].T
        for task in range(len(D)):
            D[task, task] -= np.trace(T[task, :, rows]) + rest[task]
            half = self._told_of(T[task], F[task])  # (rank, m, m)
            for columns, of_others in self._terms():
                block = half[columns], T[:, :, of_others]
                D[task] += np.einsum(
                    "nb,bij,nij->n", F[:, columns], *block, optimize=True
                )
        return 0.25 * (D + D.T)

    def _told_of(self, T, F):
        """sum_a F_a T cov(v_a, v_b), of shape (n_latent, n_inducing, n_inducing)."""
        inverse = self.covariances.inverse
        return sum(
            T[:, rows] @ np.tensordot(F[columns], inverse[columns], 1)
            for columns, rows in self._terms()
        )

    def _terms(self):
        """Columns and rows of each term."""
        loadings = self.weights.loadings
        return zip(loadings.columns, loadings.rows, strict=True)
