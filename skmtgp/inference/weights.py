r"""The posterior of the weights of features that tasks share.

Eq. 3 of the paper with features phi(x) for the latent functions, z_alpha = v_alpha .
phi, and, where K^rho has a diagonal kappa, with a function of each task's own:

.. math::
    f^m(x) = \omega_m^T \phi(x), \quad
    \omega_m = \sum_\alpha F_{m\alpha} v_\alpha + \sqrt{\kappa_m} w_m, \quad
    v_\alpha, w_m \sim N(0, I)

and perhaps a level c_m of variance v, which is integrated out first. Features and
weights of several terms are stacked, see :mod:`skmtgp.inference.loadings`. Nothing here
depends on the number of rows. With a trend targets have several columns, which come
first in the shapes below, see :mod:`skmtgp.inference.restricted`.
"""

from copy import copy

import numpy as np

from skmtgp._numerics.linalg import Cholesky
from skmtgp.inference.restricted import unexplained, whitening


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
    V : ndarray of shape ([n_columns,] n_latent, n_inducing)
        Mean of v.
    omega : ndarray of shape ([n_columns,] n_tasks, n_features)
        Mean of omega_m.
    levels : ndarray of shape ([n_columns,] n_tasks)
        Mean of c_m.
    turn : ndarray of shape (n_columns, n_columns), default=None
        The three are of y and the trend's columns times this.

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
        self._set_means(t)
        self.turn = None
        if sums.y.ndim > 1:
            self._turn()
        self.penalty = self._penalty()

    def _set_means(self, t):
        """Of v, omega_m and c_m, from what `_integrate_own` has of the targets."""
        loadings, sums = self.loadings, self.sums
        self.V = self._solve(loadings.mix_back(t))
        shared = loadings.mix(self.V)
        self.own = t - _times(self.T, shared)
        self.omega = shared + loadings.own * self.own
        of_f = np.einsum("...mi,mi->...m", self.omega, sums.phi)
        self.levels = self.share * (sums.y - of_f)

    def _solve(self, t):
        """A^{-1} t, for t of shape ([n_columns,] n_latent, n_inducing)."""
        columns = t.reshape(*t.shape[:-2], -1).T
        return self.cholesky.solve(columns).T.reshape(t.shape)

    def _turn(self):
        """Go on with what the trend leaves of the targets, and with what is left of it.

        Its log-determinant is part of that of the bound.
        """
        sums, noise = self.sums, self.noise
        by_task = sums.squares - self.share * sums.y[:, None] * sums.y
        told = self._weighed().reshape(len(sums.y), -1)
        products = (by_task / noise).sum(axis=2)
        products -= told @ self.omega.reshape(len(told), -1).T
        sizes = np.einsum("kkm,m->k", sums.squares, 1.0 / noise)
        self.turn, log_det = whitening(products, sizes)
        self.log_det += log_det - (len(sizes) - 1) * np.log(2.0 * np.pi)
        means = self.V, self.own, self.omega, self.levels
        means = [np.tensordot(self.turn.T, of, 1) for of in means]
        self.V, self.own, self.omega, self.levels = means

    def _penalty(self):
        """|v|^2 + |w|^2 + |c|^2 / v: products of the columns of several targets."""
        found = self._products(self.V) + self._products(self.own, self.loadings.own)
        if self.level:
            found += self._products(self.levels) / self.level
        return found

    def _products(self, a, by=None):
        if self.turn is None:
            squares = np.square(a)
            return squares.sum() if by is None else np.vdot(by, squares)
        flat = a.reshape(len(a), -1)
        return (flat if by is None else flat * by.ravel()) @ flat.T

    def _weighed(self):
        """sum_i phi_i y_i / sigma^2, less what the levels take, of each task."""
        sums, shared = self.sums, self.share[:, None] * self.sums.phi
        return (sums.s - shared * sums.y[..., None]) / self.noise[:, None]

    def _integrate_own(self):
        """T_m, sum_i phi_i y_i weighed likewise, and the log-determinant of this."""
        sums, shared = self.sums, self.share[:, None] * self.sums.phi
        T = sums.S - shared[..., None] * sums.phi[:, None]
        T /= self.noise[:, None, None]
        t = self._weighed()
        self.keep, log_det, kappa = {}, 0.0, self.loadings.kappa
        for task, q in zip(*np.nonzero(kappa), strict=True):
            rows, of_task = self.loadings.rows[q], t[..., task, :].T
            keep, of_term = _integrate_term(T[task], of_task, rows, kappa[task, q])
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
        V : ndarray of shape ([n_columns,] n_latent, n_inducing)
            Mean of v.
        omega : ndarray of shape ([n_columns,] n_tasks, n_features)
            Mean of omega_m.
        levels : ndarray of shape ([n_columns,] n_tasks)
            Mean of c_m.
        """
        step = sums.error - self.levels * self.noise / (self.level or 1.0)
        own = sums.errors - (self.share * step)[..., None] * self.sums.phi
        own = own / self.noise[:, None] - self.own
        for task, keep in self.keep.items():
            own[..., task, :] = (keep @ own[..., task, :].T).T
        V = self._solve(self.loadings.mix_back(self.own + own) - self.V)
        shared = self.loadings.mix(V)
        own -= _times(self.T, shared)
        omega = shared + self.loadings.own * own
        step -= np.einsum("...mi,mi->...m", omega, self.sums.phi)
        return self.V + V, self.omega + omega, self.levels + self.share * step

    def products(self, squares):
        """y^T V^{-1} y with the covariance V, or products of the columns as they are.

        Parameters
        ----------
        squares : ndarray of shape ([n_columns, n_columns,] n_tasks)
            Sums of squared residuals of each task.
        """
        return (squares / self.noise).sum(axis=-1) + self.penalty

    def log_density(self, squares):
        """The bound, given the sums of squared residuals of each task.

        Titsias (2009), eq. 9. The quadratic form is computed as the minimum over v, w
        of squares / sigma^2 + |v|^2 + |w|^2: an error of the weights changes it in
        second order only, and never to a value that is too small.
        """
        log_det = self.log_det + self.sums.n @ np.log(2.0 * np.pi * self.noise)
        fit = self.products(squares)
        if self.turn is not None:
            fit, of_trend, _ = unexplained(fit)
            log_det += of_trend
        rest = np.vdot(self.K_diagonal, self.sums.rest / self.noise[:, None])
        return -0.5 * (log_det + fit + rest)


def _times(T, omega):
    """T_m omega_m of symmetric T_m, for omega of one column of targets or several."""
    if omega.ndim == 2:
        return np.einsum("mij,mj->mi", T, omega)
    return (omega.swapaxes(0, 1) @ T).swapaxes(0, 1)


def _integrate_term(T, t, rows, kappa):
    """Integrate a task's own function of a term out of T and t, in place.

    Parameters
    ----------
    T : ndarray of shape (n_features, n_features)
        Precision with which the rows of the task tell its weights.
    t : ndarray of shape (n_features[, n_columns])
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
    t[others] -= (kappa * t[rows].T @ cross).T
    T[np.ix_(others, others)] -= kappa * half.T @ half
    T[rows, others], T[others, rows] = taken, taken.T
    return taken.T


def _without_own(T, kappa, keep):
    """(I + kappa T)^{-1} T by the way that saves digits; `keep` is its factor."""
    if kappa * np.abs(np.diagonal(T)).max() > 1.0:
        return (np.eye(len(T)) - keep) / kappa
    product = keep @ T
    return 0.5 * (product + product.T)


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
        rank, m = weights.V.shape[-2:]
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
        unseen : list of (ndarray, ndarray)
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
