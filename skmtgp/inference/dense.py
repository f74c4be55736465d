"""Exact inference with the dense n x n covariance matrix."""

import contextlib
from itertools import chain, pairwise
from math import isqrt

import numpy as np

from skmtgp._contraction import allocate, compile_kernel
from skmtgp._linalg import Cholesky, cholesky_with_jitter
from skmtgp._parallel import limit_threads, map_threads
from skmtgp.exceptions import NotPositiveDefiniteError

TILE = 240
FISHER_ROWS = 200
FISHER_SIZE = 2**24  # elements of the derivatives by all parameters


class DenseLikelihood:
    r"""Log marginal likelihood of one output over all tasks, eq. 6.

    .. math::
        \log p(t | X) = -\tfrac12 t^T K^{-1} t - \tfrac12 \log|K| - \tfrac n2 \log 2\pi,
        \quad K_{ij} = K^\rho_{m_i m_j} k^x(x_i, x_j) + \sigma^2_{m_i} \delta_{ij}

    Parameters
    ----------
    kernel : Kernel
        k^x; only its form matters, theta sets its free hyperparameters.
    task_covariance : FixedTaskCovariance or LowRank
        Form of K^rho.
    X : ndarray of shape (n_samples, n_features)
        Inputs without the task column, sorted by task.
    tasks : ndarray of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1, ascending.
    y : ndarray of shape (n_samples,)
        Targets, of which the model takes the mean to be zero.
    n_noise : int, default=1
        1 for a noise variance shared by the tasks, n_tasks for one each.

    Notes
    -----
    theta is the concatenation of the kernel's theta, the parameters of K^rho and the
    logarithms of the noise variances.
    """

    def __init__(self, kernel, task_covariance, X, tasks, y, n_noise=1):
        self.kernel, self.node = kernel, compile_kernel(kernel)
        self.task_covariance = task_covariance
        self.X, self.tasks, self.y = X, tasks, y
        self.n_noise = n_noise
        self.noise_of_row = tasks if n_noise > 1 else np.zeros_like(tasks)
        n = len(X)
        edges = np.linspace(0, n, -(-n // TILE) + 1 if self.node.tileable else 2)
        tiles = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        self.pairs = [(a, b) for i, a in enumerate(tiles) for b in tiles[i:]]
        self.present = {
            tile.start: np.unique(tasks[tile], return_index=True) for tile in tiles
        }
        side = max(tile.stop - tile.start for tile in tiles)
        self.upper = np.triu(np.ones((side, side)), 1)
        np.fill_diagonal(self.upper, 0.5)
        self._spare = []

    def __getstate__(self):
        return vars(self) | {"_spare": []}

    def split(self, theta):
        """Theta's three parts: kernel, K^rho, log noise variances."""
        return np.split(theta, [self.node.n_dims, len(theta) - self.n_noise])

    def value(self, theta):
        """Log marginal likelihood; -inf where K cannot be factorised."""
        with limit_threads(len(self.X)), self._workspace() as workspace:
            try:
                cholesky = Cholesky(self._fill(*self._bind(theta), workspace.K)[0])
            except NotPositiveDefiniteError:
                return -np.inf
            return self.log_density(cholesky, cholesky.half_solve(self.y))

    def value_and_grad(self, theta):
        """Log marginal likelihood and its gradient; -inf and nan where K fails.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        value : float
            Log marginal likelihood.
        gradient : ndarray of shape (n_theta,)
            Its gradient.
        """
        try:
            value, d_kernel, D, d_noise = self._differentiate(theta)
        except NotPositiveDefiniteError:
            return -np.inf, np.full(len(theta), np.nan)
        d_rho = self.task_covariance.pull_back(self.split(theta)[1], D)
        return value, np.concatenate([d_kernel, d_rho, d_noise])

    def task_gradient(self, theta):
        """Derivative of the value with respect to K^rho, (n_tasks, n_tasks)."""
        return self._differentiate(theta)[2]

    def fisher_information(self, theta):
        """Fisher information of theta, from some of the rows.

        At most FISHER_ROWS, and fewer where there are thousands of parameters.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        information : ndarray of shape (n_theta, n_theta)
            1/2 tr(K^{-1} dK_p K^{-1} dK_q), scaled to all rows.
        """
        self.release()  # the derivatives need as much memory
        n = len(self.X)
        most = min(n, FISHER_ROWS, 1 + isqrt(FISHER_SIZE // len(theta)))
        rows = np.linspace(0, n - 1, most).astype(int)
        K, derivatives = self._derivatives(theta, rows)
        inverse, scores = np.linalg.inv(K), np.empty((len(theta), most, most))
        for score, derivative in zip(scores, derivatives, strict=True):
            np.matmul(inverse, derivative, out=score)
        information, flat = np.empty((len(theta),) * 2), scores.reshape(len(theta), -1)
        for a in range(0, len(theta), 16):  # a few transposed at a time
            transposed = scores[a : a + 16].swapaxes(1, 2).reshape(-1, most * most)
            information[a : a + 16] = 0.5 * transposed @ flat.T
        return information * (n / most)

    def _derivatives(self, theta, rows):
        """K of some rows, and its derivatives by theta, one after another."""
        kernel, rho, log_noise = self.split(theta)
        tasks, noise_of_row = self.tasks[rows], self.noise_of_row[rows]
        between, noise = np.ix_(tasks, tasks), np.exp(log_noise)
        K_rho = self.task_covariance.matrix(rho)[between]
        kernel = self.kernel.clone_with_theta(kernel)
        K_x, dK_x = kernel(self.X[rows], eval_gradient=True)
        dK_rho = self.task_covariance.derivatives(rho)
        derivatives = chain(
            (d * K_rho for d in np.moveaxis(dK_x, 2, 0)),
            (d[between] * K_x for d in dK_rho),
            (np.diag(v * (noise_of_row == k)) for k, v in enumerate(noise)),
        )
        return K_x * K_rho + np.diag(noise[noise_of_row]), derivatives

    def posterior(self, theta):
        """The posterior of f given y.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        posterior : DensePosterior
            Where the covariance is singular in floating point, a JitterWarning says
            what was added to it.
        """
        return DensePosterior(self, theta)

    def extended(self, task_covariance, X, tasks, y, n_noise):
        """The same kernel with other tasks and other data."""
        return DenseLikelihood(self.kernel, task_covariance, X, tasks, y, n_noise)

    def covariance(self, theta):
        """K: lower triangle of an ndarray of shape (n_samples, n_samples)."""
        return self._fill(*self._bind(theta), np.empty((len(self.X),) * 2))[0]

    def release(self):
        """Give back the memory that is kept for the next evaluation."""
        self._spare.clear()

    def log_density(self, cholesky, half):
        """Log density of y, given the factor C of K and half = C^{-1} y."""
        n = len(self.y)
        return -0.5 * (half @ half + cholesky.log_det() + n * np.log(2.0 * np.pi))

    @contextlib.contextmanager
    def _workspace(self):
        """The memory of an evaluation before, or new memory where there is none."""
        workspace = self._spare.pop() if self._spare else Workspace(self.pairs)
        try:
            yield workspace
        finally:
            self._spare.append(workspace)

    def _bind(self, theta):
        """k^x, K^rho and the noise variances at theta."""
        kernel, rho, log_noise = self.split(theta)
        bound, K_rho = self.node.bind(kernel, self.X), self.task_covariance.matrix(rho)
        return bound, K_rho, np.exp(log_noise)

    def _differentiate(self, theta):
        """The value and its gradients by kernel theta, K^rho and log noise."""
        with limit_threads(len(self.X)), self._workspace() as workspace:
            return self._differentiate_in(workspace, *self._bind(theta))

    def _differentiate_in(self, workspace, bound, K_rho, noise):
        K, tapes = self._fill(bound, K_rho, noise, workspace.K, workspace.tiles)
        cholesky = Cholesky(K)
        half = cholesky.half_solve(self.y)
        value = self.log_density(cholesky, half)
        alpha = cholesky.half_solve(half, transposed=True)
        inverse = cholesky.invert().T  # its upper triangle, in C order
        d_kernel, D = self._contract(bound, K_rho, tapes, alpha, inverse)
        d_row = 0.5 * (np.square(alpha) - np.diagonal(inverse))
        d_noise = noise * np.bincount(self.noise_of_row, d_row, self.n_noise)
        return value, d_kernel, D, d_noise

    def _fill(self, bound, K_rho, noise, K, memory=None):
        """K (lower triangle, Fortran order) in K, and for each tile (K_x, tape).

        `memory` has Arrays for each tile; without it nothing is kept.
        """

        def fill(rows, cols, arrays):
            new = iter(arrays).__next__ if arrays else allocate
            K_x, tape = bound.block(rows, cols, new)
            np.multiply(K_x, self._between(K_rho, rows, cols), out=K[rows, cols])
            return (K_x, tape) if arrays else None

        memory = memory or [None] * len(self.pairs)
        jobs = [
            (*pair, arrays) for pair, arrays in zip(self.pairs, memory, strict=True)
        ]
        kept = map_threads(fill, jobs)
        K.flat[:: len(K) + 1] += noise[self.noise_of_row]
        return K.T, kept

    def _between(self, K_rho, rows, cols):
        """K^rho for each pair of samples of a tile."""
        return K_rho.take(self.tasks[cols], axis=1).take(self.tasks[rows], axis=0)

    def _contract(self, bound, K_rho, tapes, alpha, inverse):
        """Gradients with respect to the kernel's theta and to K^rho.

        With G = alpha alpha^T - K^{-1}, dL = 1/2 sum_ij G_ij dK_ij, summed over the
        upper triangle alone with half the diagonal.
        """

        def contract(pair, kept):
            (rows, cols), (K_x, tape) = pair, kept
            G = np.multiply.outer(alpha[rows], alpha[cols])
            G -= inverse[rows, cols]
            if rows == cols:  # the lower half of this tile is not the inverse's
                G *= self.upper[: len(G), : len(G)]
            H = self._sum_by_task(G * K_x, rows, cols)
            G *= self._between(K_rho, rows, cols)
            return bound.contract(G, tape, rows, cols), H

        jobs = list(zip(self.pairs, tapes, strict=True))
        d_kernel, D = np.zeros(self.node.n_dims), np.zeros_like(K_rho)
        for (rows, cols), (d_tile, H) in zip(
            self.pairs, map_threads(contract, jobs), strict=True
        ):
            d_kernel += d_tile
            present = self.present[rows.start][0], self.present[cols.start][0]
            D[present[0][:, None], present[1]] += H
        return d_kernel, 0.5 * (D + D.T)

    def _sum_by_task(self, H, rows, cols):
        """Block sums of the tile H, whose rows and columns are sorted by task."""
        H = np.add.reduceat(H, self.present[cols.start][1], axis=1)
        return np.add.reduceat(H, self.present[rows.start][1], axis=0)


class Workspace:
    """The memory of an evaluation, for the next one: fresh memory takes time.

    Parameters
    ----------
    pairs : list of (slice, slice)
        Rows and columns of each tile, the last tile at the last row.

    Attributes
    ----------
    K : ndarray of shape (n_samples, n_samples)
        Place for the covariance.
    tiles : list of Arrays
        Places for what the gradient needs of each tile.
    """

    def __init__(self, pairs):
        self.K = np.empty((pairs[-1][0].stop,) * 2)
        self.tiles = [Arrays((a.stop - a.start, b.stop - b.start)) for a, b in pairs]


class Arrays:
    """Arrays of one shape without end, the same ones in each iteration."""

    def __init__(self, shape):
        self.shape, self.made = shape, []

    def __iter__(self):
        yield from self.made
        while True:
            self.made.append(np.empty(self.shape))
            yield self.made[-1]


class DensePosterior:
    """Posterior of f at given parameters: the standard GP formulae with eq. 6.

    Parameters
    ----------
    likelihood : DenseLikelihood
        Where the data and the model's form come from.
    theta : ndarray of shape (n_theta,)
        Parameters.

    Attributes
    ----------
    kernel : Kernel
        k^x at these parameters.
    K_rho : ndarray of shape (n_tasks, n_tasks)
        K^rho at these parameters.
    noise : ndarray of shape (n_samples,)
        Noise variance of each training sample.
    alpha : ndarray of shape (n_samples,)
        K^{-1} y.
    log_likelihood : float
        Log marginal likelihood of the targets.
    """

    def __init__(self, likelihood, theta):
        kernel, rho, log_noise = likelihood.split(theta)
        self.kernel = likelihood.kernel.clone_with_theta(kernel)
        self.bound = likelihood.node.bind(kernel, likelihood.X)
        self.K_rho = likelihood.task_covariance.matrix(rho)
        self.tasks = likelihood.tasks
        self.noise = np.exp(log_noise)[likelihood.noise_of_row]
        self.cholesky = cholesky_with_jitter(lambda: likelihood.covariance(theta))
        half = self.cholesky.half_solve(likelihood.y)
        self.log_likelihood = likelihood.log_density(self.cholesky, half)
        self.alpha = self.cholesky.half_solve(half, transposed=True)
        self.weights = self.K_rho[:, self.tasks] * self.alpha

    def mean(self, X, tasks):
        """Mean of f, of shape (n_samples,), for rows of X and their tasks."""
        order = np.argsort(tasks, kind="stable")  # few tasks meet in a tile
        cross, tasks, mean = (
            self.bound.against(X[order]),
            tasks[order],
            np.empty(len(X)),
        )

        def of_rows(rows):
            present, column = np.unique(tasks[rows], return_inverse=True)
            of_tasks = self._weigh(cross, rows, self.weights[present])
            return of_tasks[np.arange(len(column)), column]

        mean[order] = _by_rows(of_rows, len(X))
        return mean

    def mean_of_tasks(self, X, tasks):
        """Mean of f for each row of X and each of the tasks.

        Parameters
        ----------
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        tasks : ndarray of shape (n_tasks,)
            Tasks.

        Returns
        -------
        mean : ndarray of shape (n_samples, n_tasks)
            f^m(x) = sum_i K^rho[m, m_i] k^x(x, x_i) alpha_i.
        """
        cross, weights = self.bound.against(X), self.weights[tasks]
        return _by_rows(lambda rows: self._weigh(cross, rows, weights), len(X))

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""
        prior = self.K_rho[tasks, tasks] * self.kernel.diag(X)
        explained = np.square(self._half(X, tasks)).sum(axis=0)
        return np.maximum(prior - explained, 0.0)

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        half = self._half(X, tasks)
        covariance = self.K_rho[np.ix_(tasks, tasks)] * self.kernel(X) - half.T @ half
        diagonal = np.einsum("ii->i", covariance)  # a view
        np.maximum(diagonal, 0.0, out=diagonal)  # as in `variance`
        return covariance

    def leave_one_out(self, include_noise=False):
        """Each training sample predicted from all the others.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the variances are those of the observations, not those of f.

        Returns
        -------
        residual : ndarray of shape (n_samples,)
            y_i - mu_i, where mu_i is the mean of f given the other samples.
        variance : ndarray of shape (n_samples,)
            Its variance. What was added to the diagonal of a covariance that is
            singular in floating point counts as noise.

        Notes
        -----
        Rasmussen and Williams (2006), eq. 5.12: y_i - mu_i = alpha_i / [K^{-1}]_ii,
        and 1 / [K^{-1}]_ii is the variance of y_i given the others.
        """
        precision = self.cholesky.inverse_diagonal()
        noise = self.noise + self.cholesky.jitter
        variance = np.maximum(1.0 / precision - noise, 0.0)
        return self.alpha / precision, variance + noise * include_noise

    def cross(self, X):
        """k^x between rows of X and the training inputs, (n_samples, n_train)."""
        shape = len(X), len(self.tasks)
        K_x, _ = self.bound.against(X).block(*(slice(0, size) for size in shape))
        return np.broadcast_to(K_x, shape)

    def _weigh(self, cross, rows, weights):
        """K^x(X[rows], X_train) times the weights, which are in rows, in tiles."""
        size, n = rows.stop - rows.start, len(self.tasks)
        step = max(1, TILE**2 // size)
        total = np.zeros((size, len(weights)))
        for cols in (slice(a, min(a + step, n)) for a in range(0, n, step)):
            total += cross.times(rows, cols, weights[:, cols].T)
        return total

    def _half(self, X, tasks):
        """C^{-1} K(X_train, X), where K_train = C C^T."""
        between = self.K_rho[np.ix_(self.tasks, tasks)]
        return self.cholesky.half_solve(between * self.cross(X).T)


def _by_rows(function, n):
    """``function(rows)`` for n rows, a tile's at a time, put together again."""
    jobs = [(slice(a, min(a + TILE, n)),) for a in range(0, n, TILE)]
    return np.concatenate(map_threads(function, jobs))
