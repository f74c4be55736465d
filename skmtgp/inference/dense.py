"""Exact inference with the dense n x n covariance matrix."""

from copy import copy
from functools import cached_property
from itertools import chain

import numpy as np
from scipy.linalg.blas import dsyr, dsyrk

from skmtgp._numerics.linalg import Cholesky, SingleCholesky, cholesky_with_jitter
from skmtgp._numerics.parallel import limit_threads
from skmtgp._numerics.updates import UpdatedCholesky
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.flat import Flat
from skmtgp.inference.likelihood import log_density
from skmtgp.inference.posterior import Posterior
from skmtgp.inference.tiles import TasksOfSide, TiledLikelihood, diagonal_of
from skmtgp.inference.whole import MOST_TASKS, Whole
from skmtgp.model._nodes import allocate
from skmtgp.model.several import BoundSeveral

CALL = 4000  # pairs of samples whose product takes as long as one call more
# Rows for which single precision saves time; of more the trace is seldom so small
IN_SINGLE = range(500, 4001)
# The trace of K by the least noise variance, up to which it is exact to about a
# hundredth of a nat
WELL_CONDITIONED = 2e4
UNTOLD = 1e-9  # of the precision of a row that alone tells a coefficient: rounding


class DenseLikelihood(TiledLikelihood):
    """The likelihood of any data, by the Cholesky decomposition of K.

    Parameters
    ----------
    prior, X, tasks, y, known
        See Likelihood.
    """

    def __init__(self, prior, X, tasks, y, known=None):
        super().__init__(prior, X, tasks, y, inputs=X, known=known)
        self.basis = prior.trend and prior.trend.basis(X, tasks)
        if self.basis is not None and not self.basis.rank:  # zero at some of the rows
            self.basis = None

    @cached_property
    def _parts(self):
        """Which tasks the rows and columns of each tile have."""
        sides = chain.from_iterable(self.blocks)
        return {(of.start, of.stop): TasksOfSide(self.tasks[of]) for of in sides}

    @cached_property
    def _whole(self):
        """Sums over all pairs, where K is one tile and tasks are few; else None."""
        if len(self.blocks) > 1 or self.prior.n_tasks > MOST_TASKS:
            return None
        return Whole(self.tasks, self.prior.n_tasks)

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

    def in_single(self):
        """See Likelihood."""
        if len(self.X) not in IN_SINGLE or self.basis is not None:
            return self
        single = copy(self)
        single.single = True
        return single

    def covariance(self, theta):
        """K: lower triangle of an ndarray of shape (n_samples, n_samples)."""
        return self._fill(*self._bind(theta), np.empty((len(self.X),) * 2))[0]

    def _evaluate(self, theta):
        """The value; NotPositiveDefiniteError where K cannot be factorised."""
        with limit_threads(self.side), self._workspace() as workspace:
            *of_f, noise = self._bind(theta)
            K = self._fill(*of_f, noise, workspace.K)[0]
            return self.solve(self._factorise(K, noise), noise)[0]

    def _differentiate(self, theta):
        """The value and its gradients, see TiledLikelihood."""
        with limit_threads(self.side), self._workspace() as workspace:
            return self._differentiate_in(workspace, *self._bind(theta))

    def _differentiate_in(self, workspace, bound, K_rho, level, noise):
        memory = workspace.K, workspace.tiles
        K, tapes = self._fill(bound, K_rho, level, noise, *memory)
        cholesky = self._factorise(K, noise)
        value, alpha, flat = self.solve(cholesky, noise)
        G = dsyr(-1.0, alpha, a=cholesky.invert(), lower=1, overwrite_a=1)
        if flat is not None:  # P = K^{-1} - V V^T in place of K^{-1}
            G = dsyrk(-1.0, flat.V, beta=1.0, c=G, lower=1, overwrite_c=1)
        diagonal = diagonal_of(G)
        diagonal *= 0.5
        d_noise = self._by_noise(diagonal, noise)
        return value, *self._contract(bound, K_rho, tapes, G.T), d_noise

    def _by_noise(self, halves, noise):
        """Gradient by the noise variances, from half the diagonal of G."""
        d_row = -halves
        if self.known is not None:
            slope = self.known.slope(noise[self.noise_of_row])
            d_row = d_row / self.known.counts + slope
        return np.bincount(self.noise_of_row, d_row, self.prior.n_noise)

    def _factorise(self, K, noise):
        """The factor of K, in single precision where that is asked for and enough."""
        if not self.single:
            return Cholesky(K)
        enough = np.trace(K) < WELL_CONDITIONED * self.noise_of_rows(noise).min()
        return SingleCholesky(K) if enough else Cholesky(K)

    def solve(self, cholesky, noise):
        """The log density of y, K^{-1} y, and Flat if there is a trend.

        With a trend the second is P y. `cholesky` is the factor C of K, `noise` has the
        variances that are learned.
        """
        half, flat, n = cholesky.half_solve(self.y), None, len(self.y)
        log_det = cholesky.log_det()
        if self.basis is not None:
            flat = Flat(cholesky, self.basis)
            half, n = flat.rest(half), n - self.basis.rank
            log_det += flat.log_det
        value = log_density(half @ half, log_det, n)
        if self.known is not None:
            value += self.known.log_density(noise[self.noise_of_row])
        return value, cholesky.half_solve(half, transposed=True), flat

    def _bind(self, theta):
        """k^x and K^rho of each term, the variances of levels and noise."""
        bound, K_rho, *variances = super()._bind(theta)
        bounds = bound if isinstance(bound, BoundSeveral) else BoundSeveral([bound])
        return bounds, K_rho.reshape(-1, *K_rho.shape[-2:]), *variances

    def _fill(self, bound, K_rho, level, noise, K, memory=None):
        """K (lower triangle, Fortran order) in K, and for each tile (K_x, tape)."""

        def put(K_x, rows, cols):
            tile = K[rows, cols]
            np.multiply(K_x[0], self._between(K_rho[0], rows, cols), out=tile)
            for of_term, of_tasks in zip(K_x[1:], K_rho[1:], strict=True):
                between = self._between(of_tasks, rows, cols)
                tile += np.multiply(between, of_term, out=between)
            if level:
                for block in self._blocks_of_tasks(tile, rows, cols):
                    block += level
            if memory:  # nothing is written there until the gradient takes the tile
                self._clear_below(tile, rows, cols)

        if self._whole is not None:
            new = iter(memory[0]).__next__ if memory else allocate
            kept = self._whole.fill(bound, K_rho, level, K, new)
        else:
            kept = self._fill_tiles(bound, put, memory)
        diagonal = diagonal_of(K)
        diagonal += self.noise_of_rows(noise)
        return K.T, kept

    def _blocks_of_tasks(self, tile, rows, cols):
        """The parts of a tile that are between samples of the same task."""
        of_rows, of_cols = self._tasks_of(rows).ranges, self._tasks_of(cols).ranges
        for task in of_rows.keys() & of_cols.keys():
            yield tile[of_rows[task], of_cols[task]]

    def _tasks_of(self, side):
        """Which tasks the rows or the columns of a tile have."""
        return self._parts[side.start, side.stop]

    def _between(self, K_rho, rows, cols):
        """K^rho for each pair of samples of a tile."""
        rows, cols = self._tasks_of(rows), self._tasks_of(cols)
        met = K_rho[rows.span, cols.span]  # of many tasks few
        return met.take(cols.places, axis=1).take(rows.places, axis=0)

    def _contract(self, bound, K_rho, tapes, G):
        """Gradients by the kernel's theta, K^rho and the levels' variance.

        With G = K^{-1} - alpha alpha^T, dL = -1/2 sum_ij G_ij dK_ij, summed over the
        upper triangle alone with half the diagonal.
        """

        def contract(rows, cols, K_x, tape):
            of_tile = G[rows, cols]
            d_level = self._sum_within_tasks(of_tile, rows, cols)
            H = [self._sum_by_task(of_tile, of_term, rows, cols) for of_term in K_x]
            W = [self._between(of_tasks, rows, cols) for of_tasks in K_rho]
            for weights in W:
                weights *= of_tile
            return bound.contract(W, tape, rows, cols), np.array(H), d_level

        if self._whole is not None:
            of_all = self._whole.contract(bound, tapes, G, levels=self.prior.levels)
            d_kernel, D, d_level = of_all
            return d_kernel, D if len(D) > 1 else D[0], d_level
        d_kernel, d_level = np.zeros(self.prior.node.n_dims), 0.0
        D = np.zeros(K_rho.shape)
        for (rows, cols), (d_tile, H, d_level_of_tile) in zip(
            self.blocks, self._map_tiles(contract, tapes), strict=True
        ):
            d_kernel -= d_tile
            d_level -= d_level_of_tile
            present = self._tasks_of(rows).tasks, self._tasks_of(cols).tasks
            D[:, present[0][:, None], present[1]] -= H
        D = D + D.swapaxes(1, 2)
        D *= 0.5
        return d_kernel, D if len(D) > 1 else D[0], d_level

    def _sum_within_tasks(self, G, rows, cols):
        """Sum over pairs of samples of the same task, if there are levels."""
        if not self.prior.levels:
            return 0.0
        return sum(block.sum() for block in self._blocks_of_tasks(G, rows, cols))

    def _sum_by_task(self, G, K_x, rows, cols):
        """Sums of G * K^x over the pairs of samples of each two tasks."""
        of_rows, of_cols = self._tasks_of(rows), self._tasks_of(cols)
        if np.ndim(K_x) == 0 or G.size < CALL * len(of_rows.tasks):
            H = np.add.reduceat(G * K_x, of_cols.starts, axis=1)
            return np.add.reduceat(H, of_rows.starts, axis=0)
        parts = of_rows.ranges.values()  # in one pass over both, without their product
        H = [np.einsum("ij,ij->j", G[of], K_x[of]) for of in parts]
        return np.add.reduceat(H, of_cols.starts, axis=1)


class DensePosterior(Posterior):
    """Posterior of f by the Cholesky decomposition of K.

    Parameters
    ----------
    likelihood : DenseLikelihood
        Where the data and the model's form come from.
    theta : ndarray of shape (n_theta,)
        Parameters.
    before : (DensePosterior, ndarray of shape (n_samples,)), default=None
        One at the same parameters, of which this one shares rows, and where in it each
        row is; -1 for new ones. What they share is not decomposed again.

    Attributes
    ----------
    cholesky : Cholesky
        Of K.
    flat : Flat or None
        What the trend's basis is, if there is one.
    """

    of_variances = "cholesky", "flat"

    def __init__(self, likelihood, theta, before=None):
        super().__init__(likelihood, theta)
        self.cholesky = None if before is None else self._update(likelihood, *before)
        if self.cholesky is None:
            self.cholesky = cholesky_with_jitter(lambda: likelihood.covariance(theta))
        self.jitter = self.cholesky.jitter
        noise = likelihood.prior.values(theta).noise
        solved = likelihood.solve(self.cholesky, noise)
        self.log_likelihood, self.alpha, self.flat = solved
        if self.flat is not None:
            self.coefficients = self.flat.coefficients(likelihood, self.cholesky)
        self._set_means()

    def _update(self, likelihood, before, origin):
        """The factor of K from that of other rows; None where it is better made anew.

        Which is after as many rows have gone as there are, on average in O(n^2) too,
        and where there was jitter, or must be.
        """
        cholesky = UpdatedCholesky.of(before.cholesky)
        gone = np.setdiff1d(np.arange(len(before.tasks)), origin)
        new = np.flatnonzero(origin < 0)
        if before.jitter or cholesky.n_dropped + len(gone) > len(origin):
            return None
        if len(gone):
            cholesky = cholesky.without(gone)
        if not len(new):
            return cholesky
        rows = likelihood.X[new], likelihood.tasks[new]
        known = likelihood.known and likelihood.known.part(new)
        corner = DenseLikelihood(likelihood.prior, *rows, likelihood.y[new], known)
        cross = self._cross_covariance(*rows)[origin >= 0]
        try:
            return cholesky.bordered(new, cross, corner.covariance(self.theta))
        except NotPositiveDefiniteError:
            return None

    def weights_of(self, loadings, alpha):
        """Weights of k^x at the inputs in means of sums of tasks, see Posterior."""
        return loadings[..., self.tasks] * alpha

    def solve(self, G):
        """Roots of G^T K^{-1} G, K^{-1} G, and the trend's part, see Posterior."""
        half, of_trend = self.cholesky.half_solve(G), None
        if self.flat is not None:
            of_trend = self.flat.B.T @ half
            half = self.flat.rest(half)
        return half, self.cholesky.half_solve(half, transposed=True), of_trend

    def latent(self, X, factor, term=0):
        """The latent functions z_a of a term at X: means and C^{-1} cov(y, z_a(X))."""
        of_rows = factor[self.tasks].T  # (rank, n_train)
        cross = self.cross(X, self._weighed()[term][0])  # (n_samples, n_train)
        means = of_rows * self.alpha @ cross.T
        halves = [self.cholesky.half_solve(row[:, None] * cross.T) for row in of_rows]
        halves = np.array(halves).reshape(len(factor.T), *cross.T.shape)
        if self.flat is not None:  # whose coefficients add what is left of it
            of_trend = -self.flat.B.T @ halves
            halves = np.concatenate([halves, of_trend], axis=1)
        return means, halves

    def explained(self, X, tasks):
        """What the data take off the variance of f, of shape (n_samples,)."""
        half = self._half(X, tasks)
        told = np.square(half).sum(axis=0)
        if self.flat is None:
            return told
        return told - np.square(self._spread(X, tasks, half)).sum(axis=0)

    def explained_covariance(self, X, tasks):
        """What they take off its covariance, (n_samples, n_samples)."""
        half = self._half(X, tasks)
        if self.flat is None:
            return half.T @ half
        spread = self._spread(X, tasks, half)
        return half.T @ half - spread.T @ spread

    def _spread(self, X, tasks, half):
        """What the trend's coefficients add to f, see Coefficients."""
        return self.coefficients.spread(X, tasks, self.flat.B.T @ half)

    def level_variances(self):
        """Variance of the level of each task, given the data, (n_tasks,)."""
        if not self.level:
            return np.zeros(self.n_tasks)
        half = self.cholesky.half_solve(np.eye(self.n_tasks)[self.tasks])
        if self.flat is not None:
            half = self.flat.rest(half)
        told = np.square(self.level * half).sum(axis=0)
        return np.maximum(self.level - told, 0.0)

    def precision(self):
        """The diagonal of K^{-1}, or of P with a trend, of shape (n_train,).

        It is zero of rows without which a coefficient is not told.
        """
        diagonal = self.cholesky.inverse_diagonal()
        if self.flat is None:
            return diagonal
        rest = diagonal - np.square(self.flat.V).sum(axis=1)
        return np.where(rest > UNTOLD * diagonal, rest, 0.0)

    def _half(self, X, tasks):
        """C^{-1} K(X_train, X), where K_train = C C^T."""
        return self.cholesky.half_solve(self._cross_covariance(X, tasks))

    def _cross_covariance(self, X, tasks):
        """K(X_train, X), of f."""
        several = isinstance(self.bound, BoundSeveral)
        bounds = list(self.bound) if several else [self.bound]
        between = np.ix_(self.tasks, tasks)
        of_terms = zip(bounds, self.terms, strict=True)
        cross = sum(K_rho[between] * self.cross(X, b).T for b, (_, K_rho) in of_terms)
        if self.level:
            cross += self.level * np.equal.outer(self.tasks, tasks)
        return cross
