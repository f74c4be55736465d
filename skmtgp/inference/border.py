r"""The border of K^rho: a novel task, the paper's section 3.3.

The tasks so far are f^m = sum_a F_ma z_a, with latent functions z_a of covariance k^x
(eq. 3 and 5). A novel task is f = sum_a l_a z_a, and perhaps w z_new of its own, and
perhaps a level. With
theta^x, sigma^2 and F frozen, the likelihood of all data depends on (l, w) through
p(y_new | y_old) alone, a Gaussian of as many dimensions as the new task has samples.
"""

import numpy as np
from scipy.linalg import qr

from skmtgp._numerics.linalg import Cholesky
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.likelihood import log_density
from skmtgp.model.several import terms_of
from skmtgp.model.trend import Basis


class BorderLikelihood:
    """log p(y_new | y_old) as a function of the novel task's row (l, w).

    Parameters
    ----------
    posterior : Posterior
        Of the tasks so far.
    factor : ndarray of shape (n_tasks, rank)
        F, with F F^T the task covariance but for its diagonal. Of several terms a list
        of theirs; `own`, `shared` and `equal` are then lists, too.
    X : ndarray of shape (n_samples, n_features)
        Inputs of the novel task.
    y : ndarray of shape (n_samples,)
        Its targets.
    noise : float or ndarray of shape (n_samples,)
        Noise variance of the novel task, or of each of its samples.
    own : bool
        Whether there is a w.
    level : float, default=0.0
        Variance of its level.
    shared : float, default=None
        What the novel task has of a function that all tasks share alike, if they do;
        `factor` is then without it.
    equal : float, default=0.0
        Variance of a function of its own that is known, beside that of w.
    trend : ndarray of shape (n_samples, n_coefficients), default=None
        Columns of a trend: those of the coefficients that the posterior knows or, where
        tasks have coefficients of their own, those of the new task's, which are
        integrated out.
    error : float, default=0.0
        Variance of an error of the model, a function of the novel task, relative to the
        prior variance of the task.
    inflation : float, default=1.0
        Of the covariance of the novel task given the others, without noise and error.

    Attributes
    ----------
    rank, own : int
        Numbers of l, those of all terms, and of w, which come last in a row.
    of_term : ndarray of shape (rank + own,)
        The term of each element of a row.
    means : ndarray of shape (rank, n_samples)
        Posterior means of the latent functions at X.
    y : ndarray of shape (n_samples,)
        Targets, less the mean of the function that all share. With a trend of the new
        task alone all are contrasts of the samples, which it is no part of.
    carried : float or ndarray of shape (n_samples, n_samples)
        Covariance of errors that come from other tasks, see `carry`.
    signs : ndarray of shape (n_halves, 1)
        1 of what takes off the variance, -1 of what coefficients of a trend add.
    """

    def __init__(
        self,
        posterior,
        factor,
        X,
        y,
        noise,
        own,
        level=0.0,
        shared=None,
        equal=0.0,
        trend=None,
        error=0.0,
        inflation=1.0,
    ):
        terms, owns = [(factor, shared, equal)], [own]
        if isinstance(factor, list):
            terms, owns = list(zip(factor, shared, equal, strict=True)), own
        self.noise = np.diag(np.broadcast_to(noise, len(y)))
        self.level, self.y = np.full((len(y),) * 2, level), y
        self.K_x = np.array([kernel(X) for kernel in terms_of(posterior.kernel)])
        self.with_error = 1.0 + error
        self.fixed, self.half_of_fixed = np.empty(len(terms)), 0.0
        means, halves = zip(
            *(self._of_term(posterior, X, q, *of) for q, of in enumerate(terms)),
            strict=True,
        )
        self.means, self.halves = np.concatenate(means), np.concatenate(halves)
        of_l = [q for q, of in enumerate(means) for _ in of]
        of_w = [q for q, has_own in enumerate(owns) if has_own]
        self.rank, self.own = len(of_l), len(of_w)
        self.of_term = np.array(of_l + of_w, dtype=int)
        self.signs, self.carried = np.ones((self.halves.shape[1], 1)), 0.0
        if trend is not None:
            self._add_trend(posterior.coefficients, trend)
        if inflation != 1.0:
            self._inflate(inflation)

    def _inflate(self, inflation):
        """Take a larger covariance given the old tasks, with the same error."""
        self.with_error = 1.0 + (self.with_error - 1.0) / inflation
        self.K_x, self.level = inflation * self.K_x, inflation * self.level
        self.halves = np.sqrt(inflation) * self.halves
        self.half_of_fixed = np.sqrt(inflation) * self.half_of_fixed

    def _add_trend(self, coefficients, T):
        """Take account of a trend, of known coefficients or of the new task's own."""
        rank = coefficients.root.shape[1]
        self.signs[-rank:] = -1.0
        if not coefficients.trend.per_task:
            self.y = self.y - T @ coefficients.beside_slopes
            known = np.zeros((len(self.signs), len(T)))
            known[-rank:] = coefficients.root.T @ T.T
            self.half_of_fixed = self.half_of_fixed + known
            return
        Z = contrasts(T)
        self.y, self.means, self.halves = Z.T @ self.y, self.means @ Z, self.halves @ Z
        self.half_of_fixed = self.half_of_fixed @ Z
        self.K_x, self.level = Z.T @ self.K_x @ Z, self.level @ Z
        self.level, self.noise = Z.T @ self.level, Z.T @ self.noise @ Z

    def _of_term(self, posterior, X, q, F, shared, equal):
        """Means and halves of a term; what is known of it is taken off the targets.

        Halves are C^{-1} cov(y_old, z_a(X)), where K_old = C C^T.
        """
        if shared is None and not F.shape[1]:
            shared = 0.0  # independent tasks: a function of which they have nothing
        fixed = np.array([] if shared is None else [shared])
        F, n = np.hstack([np.tile(fixed, (len(F), 1)), F]), len(fixed)
        term = {"term": q} if len(self.K_x) > 1 else {}
        means, halves = posterior.latent(X, F, **term)
        self.y = self.y - fixed @ means[:n]
        of_fixed = np.tensordot(fixed, halves[:n], axes=1)
        self.half_of_fixed = self.half_of_fixed + of_fixed
        self.fixed[q] = fixed @ fixed + equal
        return means[n:], halves[n:]

    def carry(self, shares, factor, spread=()):
        """Take account of errors of the tasks that the row was learned from.

        They are independent, and as large as those of new tasks with these rows. This
        takes the place of what was carried before. It is for one term.

        Parameters
        ----------
        shares : ndarray of shape (n_tasks,)
            What the novel task has of the error of each.
        factor : ndarray of shape (n_tasks, rank)
            Their rows.
        spread : array-like of shape (n_rows, rank), default=()
            S, if the novel task's own row is not known, but has the covariance S^T S:
            then its function has more variance on average.
        """
        rows = shares[:, None] * np.insert(factor, 0, 1.0, axis=1)
        if len(spread):
            rows = np.vstack([rows, np.insert(spread, 0, 0.0, axis=1)])
        R = np.linalg.qr(rows, mode="r")  # as much, in few rows
        of_fixed = np.broadcast_to(self.half_of_fixed, self.halves.shape[1:])
        halves = np.concatenate([of_fixed[None], self.halves])
        squares = np.square(R) @ np.append(self.fixed, np.ones(self.rank))
        own = np.square(R[:, 0]).sum()
        self.carried = squares.sum() * self.K_x[0] + own * self.level
        half = np.tensordot(R, halves, axes=1).reshape(-1, halves.shape[2])
        self.carried -= half.T @ half

    def value(self, row):
        """The log density; -inf where it cannot be computed."""
        try:
            return self._solved(row)[0]
        except NotPositiveDefiniteError:
            return -np.inf

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
        try:
            value, alpha, cholesky, half = self._solved(row)
        except NotPositiveDefiniteError:
            return -np.inf, np.full(len(row), np.nan)
        G = np.outer(alpha, alpha) - cholesky.solve(np.eye(len(alpha)))
        slopes = np.array([np.vdot(G, K_x) for K_x in self.K_x])
        gradient = self.with_error * slopes[self.of_term] * row
        gradient[: self.rank] += self.means @ alpha
        gradient[: self.rank] -= np.tensordot(
            self.halves, self.signs * half @ G, axes=2
        )
        return value, gradient

    def _solved(self, row):
        """The log density, S^{-1} (y - mean), S factorised, C^{-1} cov(y_old, f)."""
        S, half = self._covariance(row)
        cholesky = Cholesky(np.asfortranarray(S))
        rest = self.y - row[: self.rank] @ self.means
        alpha = cholesky.solve(rest)
        value = log_density(rest @ alpha, cholesky.log_det(), len(rest))
        return value, alpha, cholesky, half

    def fisher_information(self, row):
        """Fisher information of the border, of shape (len(row), len(row)).

        Of a Gaussian: dmean_p^T S^{-1} dmean_q + 1/2 tr(S^{-1} dS_p S^{-1} dS_q).
        """
        S, half = self._covariance(row)
        dS = 2.0 * self.with_error * row[:, None, None] * self.K_x[self.of_term]
        between = (self.signs * half).T @ self.halves  # of each latent function
        dS[: self.rank] -= between + between.swapaxes(1, 2)
        inverse = np.linalg.pinv(S, hermitian=True)
        scores = inverse @ dS
        information = 0.5 * np.einsum("pij,qji->pq", scores, scores)
        shared = slice(self.rank)
        information[shared, shared] += self.means @ inverse @ self.means.T
        return information

    def weighted(self, row):
        """Information and gradient of a row, if the covariance did not depend on it.

        Returns
        -------
        information, gradient : ndarrays of shape (rank, rank) and (rank,)
            M S^{-1} M^T and M S^{-1} (y - M^T l) of the means M, the row l and its S.
        """
        S, _ = self._covariance(row)
        solved = np.linalg.pinv(S, hermitian=True) @ self.means.T
        rest = self.y - row[: self.rank] @ self.means
        return self.means @ solved, rest @ solved

    def _covariance(self, row):
        """Covariance of y_new given y_old, and C^{-1} cov(y_old, f(X))."""
        half = self.half_of_fixed
        half = half + np.tensordot(row[: self.rank], self.halves, axes=1)
        squares = np.bincount(self.of_term, np.square(row), len(self.K_x))
        S = np.tensordot(self.with_error * (squares + self.fixed), self.K_x, axes=1)
        S += self.level + self.noise + self.carried - (self.signs * half).T @ half
        return S, half

    def pairs(self, mean=0.0, scale=None):
        """The same likelihood at many borders at once, without the old rows.

        See :class:`PairedBorder`.
        """
        return PairedBorder(self, mean, scale)


class PairedBorder:
    r"""The likelihood of a border by the covariances of pairs of latent functions.

    A row is ``mean + scale @ u``, with coordinates u. So f = sum_a u_a g_a, where the
    g_a are sums of latent functions. The last one is the sum that the mean makes, with
    what the novel task shares with all, and with noise: its u is 1. If the novel task
    has a function of its own, the old tasks tell nothing of that. Then

    .. math:: S = \sum_{ab} u_a u_b C_{ab}, \qquad
        C_{ab} = \mathrm{cov}(g_a(X), g_b(X) | y_{old}).

    One border takes :math:`O(r n^3 + r^2 n^2)`, n being the number of samples. The
    number of old rows does not matter.

    Parameters
    ----------
    border : BorderLikelihood
        The likelihood.
    mean : float or ndarray of shape (n_row,), default=0.0
        The row whose coordinates are zeros.
    scale : ndarray of shape (n_row, n_row), default=None
        What coordinates add to it; None is the identity.

    Attributes
    ----------
    C : ndarray of shape (n_row + 1, n_row + 1, n_samples**2)
        C_ab.
    means : ndarray of shape (n_row + 1, n_samples)
        Means of g_a, the last less the targets.
    """

    def __init__(self, border, mean=0.0, scale=None):
        n, n_row = len(border.y), border.rank + border.own
        self.means = np.zeros((n_row + 1, n))
        self.means[: border.rank], self.means[-1] = border.means, -border.y
        halves = np.zeros((n_row + 1, n, len(border.signs)))
        halves[: border.rank] = border.halves.swapaxes(1, 2)
        halves[-1] = np.transpose(border.half_of_fixed)
        flat = halves.reshape(-1, len(border.signs))
        told = (flat * border.signs.T) @ flat.T
        C = -told.reshape(n_row + 1, n, n_row + 1, n).transpose(0, 2, 1, 3)
        each = np.arange(n_row)
        C[each, each] += border.with_error * border.K_x[border.of_term]
        C[-1, -1] = border._covariance(np.zeros(n_row))[0]
        to_row = np.eye(n_row + 1)  # from (u, 1) to (l, w, 1)
        to_row[:-1, -1] = mean
        if scale is not None:
            to_row[:-1, :-1] = scale
        self.means = to_row.T @ self.means
        C = (to_row.T @ C.reshape(n_row + 1, -1)).reshape(n_row + 1, n_row + 1, -1)
        self.C = to_row.T @ C

    def evaluate(self, U):
        """Log densities, gradients and Hessians.

        Parameters
        ----------
        U : ndarray of shape (n_borders, n_row)
            Coordinates of borders.

        Returns
        -------
        values : ndarray of shape (n_borders,)
            -inf where one cannot be computed; its derivatives are nan.
        gradients : ndarray of shape (n_borders, n_row)
            By the coordinates.
        hessians : ndarray of shape (n_borders, n_row, n_row)
        """
        n = self.means.shape[1]
        W, log_det, rest, dm, T = self._relative_to_covariance(U)
        values = log_density(np.square(rest).sum(axis=1), log_det, n)
        values[np.isnan(values)] = -np.inf
        pull = np.einsum("kaij,kj->kai", T, rest)
        gradients = np.einsum("kai,ki->ka", dm + 0.5 * pull, rest)
        gradients -= 0.5 * np.einsum("kaii->ka", T)
        return values, gradients, self._hessians(W, rest, T, dm + pull)

    def fisher_information(self, u):
        """Fisher information of the coordinates, of shape (n_row, n_row)."""
        *_, dm, T = self._relative_to_covariance(u[None])
        T = T[0].reshape(len(u), -1)
        return dm[0] @ dm[0].T + 0.5 * T @ T.T

    def _relative_to_covariance(self, U):
        """W with W S W^T = I, log|S|; W times residuals, and slopes of mean and S."""
        n_all, n = self.means.shape
        U = np.hstack([U, np.ones((len(U), 1))])
        half_dS = (U @ self.C.reshape(n_all, -1)).reshape(len(U), n_all, -1)
        W, log_det = _whitening((U[:, None] @ half_dS).reshape(-1, n, n))
        rest = -np.einsum("kij,kj->ki", W, U @ self.means)
        half_dS = half_dS[:, :-1].reshape(len(U), -1, n, n)
        dS = half_dS + half_dS.swapaxes(2, 3)
        T = W[:, None] @ dS @ W.swapaxes(1, 2)[:, None]
        return W, log_det, rest, self.means[:-1] @ W.swapaxes(1, 2), T

    def _hessians(self, W, rest, T, along):
        """Second derivatives: those of the first ones, and those of S."""
        alpha = np.einsum("kij,ki->kj", W, rest)
        G = alpha[:, :, None] * alpha[:, None] - W.swapaxes(1, 2) @ W
        T = T.reshape(*T.shape[:2], -1)
        hessians = 0.5 * T @ T.swapaxes(1, 2) - along @ along.swapaxes(1, 2)
        n_all = len(self.C)
        by_pair = G.reshape(len(G), -1) @ self.C.reshape(n_all**2, -1).T
        return hessians + by_pair.reshape(-1, n_all, n_all)[:, :-1, :-1]


def _whitening(S):
    """W with W S W^T = I and log|S| of each; nan where S is not positive definite."""
    try:
        L = np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        L = np.stack([_cholesky_or_nan(of) for of in S])
    log_det = 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
    return np.linalg.inv(L), log_det


def _cholesky_or_nan(S):
    try:
        return np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        return np.full_like(S, np.nan)


def contrasts(T):
    """An orthonormal basis of what columns are no part of, (n_samples, n_contrasts)."""
    rank = Basis(T).rank
    return qr(T / np.linalg.norm(T, axis=0), pivoting=True)[0][:, rank:]
