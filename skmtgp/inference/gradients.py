"""The gradient of the bound: its adjoints, before and after the pass over the rows.

Nothing here depends on the number of rows. Features and weights of several terms are
stacked, see :mod:`skmtgp.inference.loadings`. What targets have a part in is a sum over
their columns, of which a trend makes several: those of
:mod:`skmtgp.inference.restricted`.
"""

from typing import NamedTuple

import numpy as np

from skmtgp.inference.weights import Covariances


class Adjoint(NamedTuple):
    """What the backward pass needs of all rows.

    The adjoint of phi_i is alpha_i omega_m + C_m phi_i with alpha_i = e_i / sigma_m^2;
    that of k^x(Z, x_i) is L^{-T} times it. Where tasks have more rows than there are
    features, it takes less to multiply C_m by that, and the like, than all of them.

    Attributes
    ----------
    omega : ndarray of shape ([n_columns,] n_tasks, n_features)
        Mean weights.
    levels : ndarray of shape ([n_columns,] n_tasks)
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
    along : ndarray of shape ([n_columns,] n_tasks, n_features)
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
        with_level, along = half_solve(self.with_level.T).T, _rows(self.along)
        along = half_solve(along.T).T.reshape(self.along.shape)
        return self._replace(with_level=with_level, along=along, of_kernel=True)


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
        weights, V = self.weights, _rows(self.weights.V[..., columns, :])
        Omega = V.T @ V + np.tensordot(scale, weights.sums.S[:, rows, rows], 1)
        Omega += np.einsum("aaij->ij", self.covariances.inverse[columns, columns])
        Omega.flat[:: len(Omega) + 1] -= columns.stop - columns.start
        for task, P in self.P.items():
            own, kappa = weights.own[..., task, rows], weights.loadings.kappa[task, q]
            own = np.atleast_2d(own)
            Omega += kappa * (own.T @ own - P[rows, rows])
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
            Of each term by F, (n_tasks, rank), and kappa, (n_tasks,): zero for tasks
            without any function of their own.
        d_level : float
        d_noise : ndarray of shape (n_tasks,)
        """
        weights, sums = self.weights, self.weights.sums
        rest = sums.rest / weights.noise[:, None]
        latents = self._by_latents(back.errors / weights.noise[:, None], rest)
        of_level, spread = self._spreads()
        d_level = _summed(np.square(weights.levels), 1) + of_level - weights.level
        d_level = d_level.sum() / weights.level**2 if weights.level else 0.0
        d_noise = (spread + _trace(back.squares)) / weights.noise
        d_noise += (weights.K_diagonal * rest).sum(axis=1) - sums.n
        return latents, 0.5 * d_level, 0.5 * d_noise / weights.noise

    def _by_latents(self, a, rest):
        """Gradients by F and kappa of each term, from Phi_m^T K^{-1} y of each task."""
        loadings, latents = self.weights.loadings, []
        overlaps = loadings.overlaps(self.weights.T, self.covariances.inverse)
        by_F = -np.einsum("mb,mba->ma", loadings.F, overlaps)
        for of_term, (columns, rows) in zip(rest.T, self._terms(), strict=True):
            F, V = loadings.F[:, columns], self.weights.V[..., columns, :]
            of_targets = _summed(a[..., rows] @ V.swapaxes(-1, -2), 2)
            d_F = by_F[:, columns] + of_targets - F * of_term[:, None]
            latents.append((d_F, 0.5 * self._by_own(a, of_term, rows)))
        return latents

    def _by_own(self, a, rest, rows):
        """Twice the gradient by kappa of a term with these features."""
        found = np.zeros(len(rest))
        for task, P in self.P.items():
            told = np.square(a[..., task, rows]).sum() - np.trace(P[rows, rows])
            found[task] = told - rest[task]
        return found

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
        D = _summed(a[..., rows] @ a[..., rows].swapaxes(-1, -2), 2)
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


def _rows(a):
    """The rows of all columns of targets, one below the other."""
    return a.reshape(-1, a.shape[-1])


def _summed(a, ndim):
    """The sum over columns of targets, of an array that else has `ndim` axes."""
    return a.sum(axis=0) if a.ndim > ndim else a


def _trace(squares):
    """The same of products of columns with each other, (n_tasks,)."""
    return squares if squares.ndim == 1 else np.einsum("kkm->m", squares)
