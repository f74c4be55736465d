"""Covariances K^rho between tasks: parameters, matrix, gradient.

A task covariance maps a vector of parameters to the M x M matrix K^rho of eq. 6, and
pulls gradients by the matrix back to the parameters. It knows nothing of inputs or
likelihoods. Sparse inference needs the latent functions that the tasks share, K^rho = F
F^T + diag(kappa). `latent` returns F and kappa, and `pull_back_latent` pulls gradients
by them back.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpstrf

from skmtgp._numerics.parallel import limit_threads

FACTOR_BOUND = 10.0
KAPPA_BOUNDS = (1e-16, 1e4)
SHARED_BOUNDS = (1e-12, FACTOR_BOUND**2)


class OfTasks(NamedTuple):
    """Derivatives of a matrix by parameters with one value for each task.

    The derivative by the parameter of task m is zero except in the rows and columns of
    m. It is E_m H + H^T E_m, where the diagonal matrix E_m has ones at those of m.

    Attributes
    ----------
    positions : ndarray of shape (n_tasks,)
        Positions of these parameters.
    half : ndarray of shape (n, n)
        H.
    """

    positions: np.ndarray
    half: np.ndarray


class FixedTaskCovariance:
    """A task covariance without parameters.

    Parameters
    ----------
    matrix : ndarray of shape (n_tasks, n_tasks)
        K^rho.
    between : {0.0, 1.0}, default=0.0
        K^rho between a task that joins and the others.
    """

    n_parameters = n_free = n_kappa = n_own = 0
    shared = False

    def __init__(self, matrix, between=0.0):
        self._matrix, self.between = matrix, between
        self.n_tasks = len(matrix)

    def __str__(self):
        if (self._matrix == self._matrix[0, 0]).all():
            return "all tasks alike"
        apart = not (self._matrix - np.diag(np.diag(self._matrix))).any()
        return "tasks apart" if apart else "fixed task covariance"

    @property
    def apart(self):
        """Whether tasks share nothing."""
        return not np.any(self._matrix - np.diag(np.diagonal(self._matrix)))

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

    def unseen(self, parameters, described=None):
        """A task without data, if all are one function: see WithShared.unseen."""
        if (self._matrix != self._matrix[0, 0]).any():
            return None
        return self.factor(parameters)[:1], 0.0

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from D = dL / dK^rho."""
        return np.empty(0)

    def latent(self, parameters):
        """F and kappa; a column of zeros where tasks share nothing."""
        if (self._matrix == np.diag(np.diagonal(self._matrix))).all():
            return np.zeros((self.n_tasks, 1)), np.diagonal(self._matrix)
        return self.factor(parameters), np.zeros(self.n_tasks)

    def pull_back_latent(self, parameters, d_F, d_kappa):
        """Gradient of the parameters, from those of F and kappa."""
        return np.empty(0)

    def derivatives(self, parameters):
        """Derivatives of K^rho: none."""
        return ()

    def bordered(self, parameters, row, own, position):
        """The model of one more task, related to the others as they are."""
        kept = np.delete(np.arange(self.n_tasks + 1), position)
        matrix = np.full((self.n_tasks + 1, self.n_tasks + 1), self.between)
        matrix[np.ix_(kept, kept)] = self._matrix
        matrix[position, position] = 1.0
        return FixedTaskCovariance(matrix, self.between), parameters

    def parameters(self, K, truncation="eigen"):
        """Parameters of the member nearest to K: none."""
        return np.empty(0)


class LowRank:
    """K^rho = F F^T with F of shape (n_tasks, rank).

    Parameters
    ----------
    n_tasks : int
        Number of tasks M.
    rank : int
        Rank r of F F^T, 0 to M.

    Attributes
    ----------
    n_parameters : int
        The M r numbers of F, row by row.
    n_free : int
        r (2 M + 1 - r) / 2, the count of an incomplete Cholesky decomposition in
        eq. 8.

    Notes
    -----
    F need not be a trapezoid while it is learned. The r (r - 1) / 2 rotations that this
    leaves do not change the likelihood and cost nothing. A trapezoid would single out
    the first r tasks, and it has singular points at those of their block: learning from
    the same start ends at worse modes.
    """

    n_kappa = n_own = 0
    shared = False

    def __init__(self, n_tasks, rank):
        self.n_tasks, self.rank = n_tasks, rank
        self.n_parameters = n_tasks * rank
        self.n_free = rank * (2 * n_tasks + 1 - rank) // 2

    def __str__(self):
        return f"rank {self.rank}"

    @property
    def apart(self):
        """Whether tasks share nothing, whatever the parameters are."""
        return self.rank == 0

    @property
    def factor_shape(self):
        """Shape of the factor that is learned."""
        return self.n_tasks, self.rank

    @property
    def unit(self):
        """Frobenius norm of a factor whose tasks have a variance of 1 on average."""
        return np.sqrt(self.n_tasks)

    def with_rank(self, rank):
        """The same form of another rank."""
        return LowRank(self.n_tasks, rank)

    def columns(self, parameters):
        """F as it is learned, of shape (n_tasks, rank)."""
        return parameters.reshape(self.n_tasks, self.rank)

    def bounds(self, scale):
        """Bounds of the parameters, of shape (n_parameters, 2).

        They are wide, but keep K^rho from growing without end where an amplitude of the
        kernel can shrink with it, at the cost of the digits of small noise variances.

        Parameters
        ----------
        scale : float
            Root mean square of the targets.
        """
        most = FACTOR_BOUND * scale
        return np.tile([-most, most], (self.n_parameters, 1))

    def matrix(self, parameters):
        """K^rho, of shape (n_tasks, n_tasks)."""
        F = self.columns(parameters)
        return F @ F.T

    def factor(self, parameters):
        """F rotated to a lower trapezoid, of shape (n_tasks, rank)."""
        return lower_trapezoid(self.columns(parameters))

    def unseen(self, parameters, described=None):
        """A task without data: the mean of the rows of F, see `WithShared.unseen`."""
        return self.columns(parameters).mean(axis=0, keepdims=True), 0.0

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from the symmetric D = dL / dK^rho."""
        return 2.0 * (D @ self.columns(parameters)).ravel()

    def latent(self, parameters):
        """F, of shape (n_tasks, rank), and kappa, which is zero."""
        return self.columns(parameters), np.zeros(self.n_tasks)

    def pull_back_latent(self, parameters, d_F, d_kappa):
        """Gradient of the parameters, from those of F and kappa."""
        return d_F[:, : self.rank].ravel()

    def derivatives(self, parameters):
        """Derivatives of K^rho: an OfTasks for each column of F."""
        for a, column in enumerate(self.columns(parameters).T):
            positions = np.arange(a, self.n_parameters, self.rank)
            yield OfTasks(positions, np.broadcast_to(column, (self.n_tasks,) * 2))

    def parameters(self, K, truncation="eigen"):
        """Parameters of a matrix of this rank near K.

        Parameters
        ----------
        K : ndarray of shape (n_tasks, n_tasks)
            Positive semi-definite.
        truncation : {"eigen", "cholesky"}, default="eigen"
            Section 3.2: "computing the eigen-decomposition of K_aug^rho and keeping
            only the top r eigenvectors/values; it could also be implemented using an
            incomplete Cholesky decomposition".
        """
        leading = leading_columns if truncation == "cholesky" else leading_eigenvectors
        return leading(K, self.rank).ravel()

    def directions(self, D):
        """Columns to add to F, the best ones last, from D = dL / dK^rho."""
        with limit_threads(len(D)):
            return np.linalg.eigh(D)[1]

    def grown(self, parameters, columns):
        """Parameters of the model of a higher rank: F with these columns added."""
        return np.hstack([self.columns(parameters), columns]).ravel()

    def with_row(self, parameters, row, own, position):
        """Parameters with another row of F of a task; see `bordered`."""
        F = self.columns(parameters).copy()
        F[position] = row
        return F.ravel()

    def bordered(self, parameters, row, own, position):
        """The model of one more task, section 3.3.

        Parameters
        ----------
        parameters : ndarray of shape (n_parameters,)
            Those of the tasks so far.
        row : ndarray of shape (rank,)
            The new task's row of F.
        own : float or None
            Standard deviation of what it shares with no other task: F gets a column
            with this element alone. None: no such column.
        position : int
            Where it goes among the tasks.

        Returns
        -------
        form : LowRank
            Of one more task.
        parameters : ndarray of shape (form.n_parameters,)
            Its parameters.
        """
        F = np.insert(self.columns(parameters), position, row, axis=0)
        if own is not None:
            F = np.column_stack([F, own * (np.arange(len(F)) == position)])
        return LowRank(*F.shape), F.ravel()


class Enlarged:
    """Another task covariance and something more, whose logarithms come last.

    Parameters
    ----------
    form : FixedTaskCovariance, LowRank or another
        The other one. Its parameters come first.
    n_more : int
        How many positive numbers come last.
    """

    def __init__(self, form, n_more):
        self.form, self.n_tasks, self.n_more = form, form.n_tasks, n_more
        self.n_parameters = form.n_parameters + n_more
        self.n_free = form.n_free + n_more

    @property
    def rank(self):
        """Rank of the other one."""
        return self.form.rank

    @property
    def shared(self):
        """Whether one function of all tasks is part of it."""
        return self.form.shared

    @property
    def factor_shape(self):
        """Shape of the other one's factor."""
        return getattr(self.form, "factor_shape", (self.n_tasks, 0))

    @property
    def unit(self):
        """Frobenius norm of the other one's factor, see LowRank."""
        return self.form.unit

    def _split(self, parameters):
        n = self.form.n_parameters
        return parameters[:n], np.exp(parameters[n:])

    def _with_same(self, of_form, parameters):
        """Parameters of the other one, and the last of these."""
        return np.concatenate([of_form, parameters[self.form.n_parameters :]])

    def columns(self, parameters):
        """The other one's F as it is learned, of shape (n_tasks, rank)."""
        return self.form.columns(self._split(parameters)[0])

    def factor(self, parameters):
        """The other one's factor, of shape (n_tasks, rank)."""
        return self.form.factor(self._split(parameters)[0])

    def directions(self, D):
        """Columns to add to F, the best ones last, from D = dL / dK^rho."""
        return self.form.directions(D)

    def grown(self, parameters, columns):
        """Parameters of the model of a higher rank: F with these columns added."""
        grown = self.form.grown(self._split(parameters)[0], columns)
        return self._with_same(grown, parameters)

    def with_row(self, parameters, row, own, position):
        """Parameters with another row of the other one's F; see LowRank."""
        found = self.form.with_row(self._split(parameters)[0], row, own, position)
        return self._with_same(found, parameters)


class WithShared(Enlarged):
    """Another task covariance + a 1 1^T, a function that all tasks share equally.

    Parameters
    ----------
    form : LowRank
        The other task covariance. Its parameters come first, the logarithm of a last.
    """

    n_kappa = n_own = 0
    shared = True

    def __init__(self, form):
        super().__init__(form, 1)

    def __str__(self):
        return f"shared and {self.form}" if self.rank else "shared"

    def with_rank(self, rank):
        """The same form of another rank."""
        return WithShared(self.form.with_rank(rank))

    def bounds(self, scale):
        """Bounds of the parameters, of shape (n_parameters, 2)."""
        shared = np.log(np.multiply(SHARED_BOUNDS, scale**2))
        return np.vstack([self.form.bounds(scale), shared])

    def matrix(self, parameters):
        """K^rho, of shape (n_tasks, n_tasks)."""
        parameters, [a] = self._split(parameters)
        return self.form.matrix(parameters) + a

    def unseen(self, parameters, described=None):
        """Tasks without data, by what all share and what varies among them.

        Parameters
        ----------
        parameters : ndarray of shape (n_parameters,)
            Those of the tasks with data.
        described : ndarray of shape (n_unseen, n_rows), default=None
            What is known of each, see :class:`~skmtgp.model.described.Described`.

        Returns
        -------
        loadings : ndarray of shape (1, n_common) or (n_unseen, n_common)
            Of the first of the latent functions, those that can be told. Without
            descriptors they are the mean of the tasks', and
            `skmtgp.model.population` says what they may differ by.
        own : float
            Variance of what they have beside these, and of what nothing is told: the
            average over the tasks.
        """
        parameters, [a] = self._split(parameters)
        known = self.form.unseen(parameters, described)
        if known is None:
            own = np.diagonal(self.form.matrix(parameters)).mean()
            return np.sqrt([[a]]), own
        return np.insert(known[0], 0, np.sqrt(a), axis=1), known[1]

    def latent(self, parameters):
        """F and kappa: a column of sqrt(a), then the other one's."""
        parameters, a = self._split(parameters)
        F, kappa = self.form.latent(parameters)
        return np.column_stack([np.full(self.n_tasks, np.sqrt(a)), F]), kappa

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from the symmetric D = dL / dK^rho."""
        parameters, a = self._split(parameters)
        return np.concatenate([self.form.pull_back(parameters, D), a * D.sum()])

    def pull_back_latent(self, parameters, d_F, d_kappa):
        """Gradient of the parameters, from those of F and kappa."""
        parameters, a = self._split(parameters)
        gradient = self.form.pull_back_latent(parameters, d_F[:, 1:], d_kappa)
        return np.concatenate([gradient, 0.5 * np.sqrt(a) * d_F[:, 0].sum()])

    def derivatives(self, parameters):
        """Derivatives of K^rho: the other one's, and a matrix."""
        parameters, [a] = self._split(parameters)
        yield from self.form.derivatives(parameters)
        yield np.full((self.n_tasks, self.n_tasks), a)

    def parameters(self, K, truncation="eigen"):
        """Parameters from K: a is the mean beside its diagonal, but not all of it."""
        total, M = np.trace(K) / len(K), len(K)
        beside = (K.sum() - np.trace(K)) / max(1, M * (M - 1))
        a = np.clip(beside, 1e-2 * total + np.finfo(float).tiny, None)
        return np.append(self.form.parameters(K - a, truncation), np.log(a))

    def bordered(self, parameters, row, own, position):
        """The model of one more task, which shares the same function."""
        form, inner = self.form.bordered(self._split(parameters)[0], row, own, position)
        return WithShared(form), self._with_same(inner, parameters)


class WithDiagonal(Enlarged):
    """Another task covariance + diag(kappa), with a positive kappa for each task.

    Parameters
    ----------
    form : FixedTaskCovariance, LowRank or WithShared
        The other task covariance. Its parameters come first, the logarithms of kappa
        last.
    equal : bool, default=False
        Whether kappa is the same number for all tasks. With only a function that all
        tasks share, this is compound symmetry. With nothing else, the tasks are
        independent.

    Notes
    -----
    kappa is what the other task covariance leaves unexplained, so it is kept high
    together with the noise. If there is nothing else, it is the variance of the
    functions, and is not kept high.
    """

    def __init__(self, form, equal=False):
        super().__init__(form, 1 if equal else form.n_tasks)
        self.equal, self.n_own = equal, self.n_more
        rests = form.n_free or isinstance(form, FixedTaskCovariance)
        self.n_kappa = self.n_more if rests else 0

    def __str__(self):
        if self.equal and self.rank == 0:
            return "compound symmetry" if self.shared else "independent"
        return f"{self.form} and {'equal ' * self.equal}diagonal"

    @property
    def apart(self):
        """Whether tasks share nothing, whatever the parameters are."""
        return getattr(self.form, "apart", False)

    def with_rank(self, rank):
        """The same form of another rank."""
        return WithDiagonal(self.form.with_rank(rank), self.equal)

    def _of_tasks(self, kappa):
        """One number for each task."""
        return np.broadcast_to(kappa, self.n_tasks)

    def _summed(self, of_tasks):
        """What falls to each number of kappa, from what falls to each task."""
        return of_tasks.sum(keepdims=True) if self.equal else of_tasks

    def bounds(self, scale):
        """Bounds of the parameters, of shape (n_parameters, 2)."""
        kappa = np.log(np.multiply(KAPPA_BOUNDS, scale**2))
        return np.vstack([self.form.bounds(scale), np.tile(kappa, (self.n_more, 1))])

    def matrix(self, parameters):
        """K^rho, of shape (n_tasks, n_tasks)."""
        parameters, kappa = self._split(parameters)
        return self.form.matrix(parameters) + np.diag(self._of_tasks(kappa))

    def unseen(self, parameters, described=None):
        """A task without data: the other one's, and the mean of kappa."""
        parameters, kappa = self._split(parameters)
        known = self.form.unseen(parameters, described)
        return known and (known[0], known[1] + kappa.mean())

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from the symmetric D = dL / dK^rho."""
        parameters, kappa = self._split(parameters)
        gradient = self.form.pull_back(parameters, D)
        return np.concatenate([gradient, self._summed(np.diagonal(D)) * kappa])

    def latent(self, parameters):
        """F and kappa: the other one's, and the diagonal; F has a column at least."""
        parameters, own = self._split(parameters)
        F, kappa = self.form.latent(parameters)
        return F if F.shape[1] else np.zeros((self.n_tasks, 1)), kappa + own

    def pull_back_latent(self, parameters, d_F, d_kappa):
        """Gradient of the parameters, from those of F and kappa."""
        parameters, own = self._split(parameters)
        gradient = self.form.pull_back_latent(parameters, d_F, d_kappa)
        return np.concatenate([gradient, self._summed(d_kappa) * own])

    def derivatives(self, parameters):
        """Derivatives of K^rho: the other one's, and those by the diagonal.

        They are an OfTasks, or a matrix where it is one number.
        """
        parameters, kappa = self._split(parameters)
        yield from self.form.derivatives(parameters)
        own = np.diag(self._of_tasks(kappa))
        positions = np.arange(self.form.n_parameters, self.n_parameters)
        yield own if self.equal else OfTasks(positions, 0.5 * own)

    def parameters(self, K, truncation="eigen"):
        """Parameters from K: what the other one leaves of its diagonal is kappa."""
        parameters = self.form.parameters(K, truncation)
        rest = np.diagonal(K - self.form.matrix(parameters))
        rest = self._summed(rest) / (self.n_tasks if self.equal else 1)
        floor = 1e-6 * np.trace(K) / len(K) + np.finfo(float).tiny
        return np.concatenate([parameters, np.log(np.maximum(rest, floor))])

    def with_smallest(self, parameters, scale):
        """Parameters of the other one with the smallest diagonal of their bounds."""
        smallest = self.bounds(scale)[-self.n_more :, 0]
        return np.concatenate([parameters, smallest])

    def with_row(self, parameters, row, own, position):
        """Parameters with another row of F, and the square of `own` for its kappa."""
        found = super().with_row(parameters, row, own, position)
        if not self.equal:
            found[self.form.n_parameters + position] = 2.0 * np.log(own)
        return found

    def bordered(self, parameters, row, own, position):
        """The model of one more task, whose kappa is the square of `own`, or equal."""
        parameters, log_kappa = np.split(parameters, [self.form.n_parameters])
        form, parameters = self.form.bordered(parameters, row, None, position)
        if not self.equal:
            log_kappa = np.insert(log_kappa, position, 2.0 * np.log(own))
        return WithDiagonal(form, self.equal), np.concatenate([parameters, log_kappa])


def identity(n_tasks, diagonal=False):
    """K^rho = I: tasks that are independent given the kernel (iGP)."""
    form = FixedTaskCovariance(np.eye(n_tasks))
    return WithDiagonal(form) if diagonal else form


def ones(n_tasks, diagonal=False):
    """K^rho = 1 1^T: tasks that cannot be told apart (pGP)."""
    form = FixedTaskCovariance(np.ones((n_tasks, n_tasks)), between=1.0)
    return WithDiagonal(form) if diagonal else form


def low_rank(n_tasks, rank, diagonal=False, shared=False):
    """K^rho = F F^T of the given rank (mGP), perhaps with a function that all share.

    `diagonal` is whether it has a diagonal; "equal" is one of one number.
    """
    return enlarged(LowRank(n_tasks, rank), diagonal, shared)


def enlarged(form, diagonal=False, shared=False):
    """The form with a function that all share and a diagonal, if asked for."""
    form = WithShared(form) if shared else form
    return WithDiagonal(form, isinstance(diagonal, str)) if diagonal else form


def leading_eigenvectors(K, rank):
    """F of shape (n_tasks, rank) with the F F^T nearest to K."""
    with limit_threads(len(K)):
        values, vectors = np.linalg.eigh(K)
    F = vectors * np.sqrt(np.maximum(values, 0.0))
    return F[:, ::-1][:, :rank]


def leading_columns(K, rank):
    """F of shape (n_tasks, rank) of the incomplete Cholesky decomposition of K.

    The largest diagonal element that is left is the next pivot.
    """
    factor, pivots, n_columns, _ = dpstrf(K, lower=1)
    F = np.zeros((len(K), rank))
    kept = min(rank, n_columns)
    F[pivots - 1, :kept] = np.tril(factor)[:, :kept]
    return F


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
    if not F.shape[1]:
        return F
    L = np.linalg.qr(F.T, mode="r").T
    signs = np.where(np.diagonal(L) < 0.0, -1.0, 1.0)
    return np.tril(L * signs)
