"""The posterior of sparse inference."""

from copy import copy

import numpy as np

from skmtgp._numerics.linalg import RESOLVED
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.guide import INFERENCE
from skmtgp._support.warnings import warn
from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError
from skmtgp.inference.flat import Coefficients
from skmtgp.inference.open_rows import Effect
from skmtgp.inference.posterior import Summand, kernels_of, without
from skmtgp.inference.restricted import Means, unexplained
from skmtgp.inference.unseen import WithUnseen, bordered
from skmtgp.inference.variances import (
    diagonal,
    in_blocks,
    largest_prior,
    rounding_of,
    without_negatives,
)
from skmtgp.inference.weights import Covariances
from skmtgp.model.several import terms_of

SINGULAR = 1e-8  # of k^x(x, x): what rounding of an all but singular K_ZZ may add
JITTERS = 10.0 ** np.arange(-12, -3)  # of the largest variance of f, to the noise


class SparsePosterior(WithUnseen):
    """Posterior of f at given parameters, by way of the inducing variables.

    Parameters
    ----------
    bound : SparseBound
        Where the data and the model's form come from.
    theta : ndarray of shape (n_theta,)
        Parameters.
    before : (SparsePosterior, ndarray of shape (n_samples,)), default=None
        One at the same parameters, of which this one shares rows, and where in it each
        row is; -1 for new ones. Its sums over the rows are not made again.

    Attributes
    ----------
    sums : FeatureSums or None
        Over the rows, to which those of others can be added. They take as much memory
        as the rest, and are kept once others have been.
    kernel : Kernel or Kernels
        k^x at these parameters.
    K_rho : ndarray of shape ([n_terms,] n_tasks, n_tasks)
        K^rho at these parameters.
    features : Features
        Whitened features at these parameters.
    V : ndarray of shape (n_latent, n_inducing)
        Mean weights of the latent functions of all terms.
    levels : ndarray of shape (n_tasks,)
        Mean of the level of each task.
    level : float
        Variance of the tasks' levels, which are part of f.
    noise : ndarray of shape (n_tasks,)
        Noise variance of each task.
    rounding : float
        What rounding may add to a variance, relative to its prior.
    log_likelihood : float
        The bound on the log marginal likelihood of the targets.
    coefficients : Coefficients or None
        Of a trend, which is part of f; the rest is then told by what it leaves of the
        targets.
    told : Means or None
        What the rows say of the trend's columns.
    columns : Columns or None
        The targets less the trend, and its columns.

    Notes
    -----
    A mean takes O(m) a point, a variance O(m^2), whatever the rank: the posterior
    covariance of each task's weights is kept.
    """

    covariances = None  # of one for means alone

    def __init__(self, bound, theta, before=None):
        summed = None if before is None else _summed(bound, *before)
        self.bound, self.theta, self.prior = bound, theta, bound.prior
        self.kernel = self.prior.kernel_at(theta)
        self.K_rho = self.prior.K_rho_at(theta)
        self.level = self.prior.values(theta).level
        variance = self.level + sum(
            largest_prior(K_rho, kernel, bound.Z) for kernel, K_rho in self.terms
        )
        with limit_threads(bound.side):
            self.features, weights = _forward(bound, theta, summed, variance)
            self.sums = None if before is None else weights.sums
            sums = bound.residuals(self.features, weights)
            self.log_likelihood = weights.log_density(sums.squares)
            self.columns = self.told = None
            means = weights.refined(sums)
            if weights.turn is not None:
                means = self._set_trend(bound, weights, sums.squares, means)
            self.V, self.omega, self.levels = means
            self.loadings = weights.loadings
            self.by_latent = self._by_latent(weights)
            self.covariances = Covariances(weights)  # spends the factor of `weights`
            # f^m(x) = omega_m . L^{-1} k^x(Z, x), summed over the terms
            self.weights = self.features.pull_back(self.omega.T).T
        self.features.warn_of_jitter()
        self.noise, self.block_size = weights.noise, bound.block_size
        rounding = rounding_of(len(bound.tasks), variance, self.noise.min())
        self.rounding = SINGULAR + rounding

    def _by_latent(self, weights):
        """T_m times the weights of each latent function, (n_tasks, p, n_latent)."""
        return weights.T @ self._in_features(self.V).T

    def _in_features(self, V):
        """Weights of latent functions, (n_latent, n_inducing), among all features."""
        features = np.zeros((len(V), self.loadings.n_terms * V.shape[1]))
        for columns, rows in zip(
            self.loadings.columns, self.loadings.rows, strict=True
        ):
            features[columns, rows] = V[columns]
        return features

    def _set_trend(self, bound, weights, squares, means):
        """What there is to tell of the trend; the means that it leaves are returned."""
        _, _, turn = unexplained(weights.products(squares))
        means = [np.tensordot(turn.T, of, 1) for of in means]
        self.columns = columns = bound.basis.turned(weights.turn @ turn)
        trend = bound.prior.trend
        mean = trend.slopes.ravel() + columns.of_targets
        self.coefficients = Coefficients(trend, mean, columns.of_columns)
        self.told = Means(*(of[1:] for of in means))
        self.of_columns = np.tensordot(turn.T, weights.own, 1)[1:]
        return [of[0] for of in means]

    @property
    def n_halves(self):
        """How many numbers at most each of the halves of `latent` has for a row."""
        return len(self.covariances.inverse) * len(self.bound.Z)

    @property
    def terms(self):
        """A list of (k^x, K^rho) of each term."""
        K_rhos = self.K_rho.reshape(-1, *self.K_rho.shape[-2:])
        return list(zip(terms_of(self.kernel), K_rhos, strict=True))

    def of_means(self):
        """The same for means alone, without the matrices of the variances."""
        return without(self, ["covariances", "by_latent"])

    def mean(self, X, tasks):
        """Mean of f, of shape (n_samples,), for rows of X and their tasks."""
        return self.means_of_terms(X, tasks).sum(axis=0)

    def means_of_terms(self, X, tasks):
        """Means of the terms of f, and last of the level, (n_terms + 1, n_samples).

        That of a trend, if there is one, comes before the level.
        """

        def of_rows(X, tasks):
            present, column = np.unique(tasks, return_inverse=True)
            rows = np.arange(len(X))
            return np.array(
                [means[rows, column] for means in self._means_of_tasks(X, present)]
            )

        with limit_threads(self.bound.side):
            means = [in_blocks(of_rows, self.block_size, X, tasks, axis=1)]
        if self.coefficients is not None:
            means.append(self.coefficients.means(X, tasks))
        return np.vstack([*means, self.levels[tasks]])

    def mean_of_tasks(self, X, tasks):
        """Mean of f for each row of X and each of the tasks, without a trend.

        Parameters
        ----------
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        tasks : ndarray of shape (n_tasks,)
            Tasks.

        Returns
        -------
        mean : ndarray of shape (n_samples, n_tasks)
            f^m(x) = omega_m . phi(x), and the level of m.
        """

        def of_rows(X):
            return sum(self._means_of_tasks(X, tasks))

        with limit_threads(self.bound.side):
            return in_blocks(of_rows, self.block_size, X) + self.levels[tasks]

    def _means_of_tasks(self, X, tasks):
        """Of each term its mean for each row of X and each of the tasks."""
        features = self.features
        parts = zip(features.terms, features.split(self.weights[tasks].T), strict=True)
        return [term.means(X, weights) for term, weights in parts]

    def summands(self, tasks):
        """What the means of these tasks are sums of, a list of Summand."""
        of_terms = self.features.split(self.weights[tasks].T)
        constants = np.zeros((len(of_terms), len(tasks)))
        constants[0] = self.levels[tasks]
        return [
            Summand(kernel, self.features.Z, weights.T, of_term, bind)
            for (kernel, bind), weights, of_term in zip(
                kernels_of(self), of_terms, constants, strict=True
            )
        ]

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""

        def of_rows(X, tasks):
            tile = self.features.tile(X)
            rest, prior = self._prior_variances(tile, X, tasks)
            spread = self._spread(tile.phi, tasks)
            if self.told is not None:
                spread += _squares(self._of_trend(tile.phi, X, tasks))
            return rest + spread, prior

        found = in_blocks(of_rows, self.block_size, X, tasks, axis=1)
        return without_negatives(*found, self.rounding)

    def _prior_variances(self, tile, X, tasks):
        """What the features of rows leave of the variance of f, and that itself."""
        own = [K_rho[tasks, tasks] for _, K_rho in self.terms]
        unexplained = sum(of * rest for of, rest in zip(own, tile.rest.T, strict=True))
        kernels = [kernel for kernel, _ in self.terms]
        prior = sum(of * k.diag(X) for of, k in zip(own, kernels, strict=True))
        return unexplained, prior + self.level

    def _spread(self, phi, tasks):
        """Variances of omega_m . phi + c_m for given features and tasks."""
        spread, covariances = np.empty(len(tasks)), self.covariances
        for task in np.unique(tasks):
            rows = tasks == task
            Sigma, of_task = covariances.Sigma[task], covariances.less(phi, task, rows)
            spread[rows] = np.einsum("ji,ji->i", of_task, Sigma @ of_task)
        return spread + covariances.of_level[tasks]

    def _of_trend(self, phi, X, tasks):
        """What the trend's coefficients add to f, see Coefficients."""
        return self.coefficients.spread(X, tasks, self.told.at(phi, tasks))

    def _with_loadings(self, unseen):
        """The same that knows tasks without data, too, see `WithUnseen`."""
        posterior, loadings, n_more = copy(self), self.loadings, len(unseen[0][0])
        F = [loadings.F[:, columns] for columns in loadings.columns]
        K_rhos = [K_rho for _, K_rho in self.terms]
        found = [
            bordered(*of)
            for of in zip(K_rhos, F, *zip(*unseen, strict=True), strict=True)
        ]
        posterior.K_rho = np.array(found) if len(found) > 1 else found[0]
        posterior.loadings = loadings.with_unseen(unseen)
        if self.covariances is not None:
            posterior.covariances = self.covariances.with_unseen(unseen)
        mix = posterior.loadings.mix
        omega = mix(self.V)[-n_more:]
        posterior.omega = np.vstack([self.omega, omega])
        weights = self.features.pull_back(omega.T).T
        posterior.weights = np.vstack([self.weights, weights])
        posterior.levels = np.append(self.levels, np.zeros(n_more))
        if self.told is not None:
            posterior.told = self.told.with_unseen(mix(self.told.V)[:, -n_more:])
        return posterior

    def level_variances(self):
        """Variance of the level of each task, given the data, (n_tasks,)."""
        found = self.covariances.level_variances()
        return found if self.told is None else found + _squares(self.told.levels)

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        phi, between = self.features.tile(X).phi, np.ix_(tasks, tasks)
        covariance, prior = self.covariances.between(phi, tasks), self.level
        for (kernel, K_rho), part in zip(
            self.terms, self.features.split(phi), strict=True
        ):
            K_x, of_tasks, left = kernel(X), K_rho[between], part.T @ part
            prior = prior + np.diagonal(of_tasks) * np.diagonal(K_x)
            np.subtract(K_x, left, out=left)
            left *= of_tasks
            covariance += left
        if self.told is not None:
            spread = self._of_trend(phi, X, tasks)
            covariance += spread.T @ spread
        without_negatives(diagonal(covariance), prior, self.rounding)
        return covariance

    def leave_one_out(self, include_noise=False):
        """Each training sample predicted from all the others, by the same Z.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the variances are those of the observations, not those of f.

        Returns
        -------
        residual : ndarray of shape (n_samples,)
            y_i - mu_i, where mu_i is the mean of f given the other samples.
        variance : ndarray of shape (n_samples,)
            Its variance.

        Notes
        -----
        Rasmussen and Williams (2006), eq. 5.12, for the model with the features alone:
        [K^{-1} y]_i = e_i / sigma^2 with the residuals e, and [K^{-1}]_ii =
        (1 - h_i) / sigma^2 with h_i = phi_i^T Sigma_m phi_i / sigma^2. What the
        features leave of the variance of f is added. With a trend [K^{-1}]_ii is less
        by the squares of its columns' residuals over sigma^2.
        """
        residual, told, rest, prior, noise, _ = self._all_left_out()
        without_negatives(told, prior, min(self.rounding, 0.5))
        without_negatives(rest, prior, self.rounding)
        return residual, told + rest + noise * include_noise

    def precision(self):
        """The diagonal of the inverse covariance of the samples, by the features."""
        return self._all_left_out()[-1]

    def _all_left_out(self):
        parts = [self._left_out(*block) for block in self.bound.blocks()]
        return np.concatenate(parts, axis=1)

    def _left_out(self, X, tasks, targets):
        tile, noise = self.features.tile(X), self.noise[tasks]
        rest, prior = self._prior_variances(tile, X, tasks)
        share = self._spread(tile.phi, tasks) / noise
        # 1 - h_i is that of a row without others at least. Below 0 it has no digit, and
        # the variance is told as minus the prior's
        left, least = 1.0 - share, noise / (noise + prior - rest)
        left = np.where(left > 0.0, np.maximum(left, least), -least)
        y = targets
        if self.told is not None:
            y, *columns = self.columns.of(tasks, targets).T
            of_trend = _squares(columns - self.told.at(tile.phi, tasks)) / noise
            share = share + of_trend  # a row may tell a coefficient alone
            left = np.where(left > 0.0, np.maximum(left - of_trend, RESOLVED), left)
        error = y - self.levels[tasks]
        error -= np.einsum("ij,ji->i", self.omega[tasks], tile.phi)
        told = noise * share / left
        return np.stack([error / np.abs(left), told, rest, prior, noise, left / noise])

    def informations(self, tasks, factors, likelihood):
        """What the samples tell of rows of F, see Posterior; by sums over them."""
        # once more: `Covariances` has spent the factor
        jitter = self.noise[0] - self.prior.values(self.theta).noise[0]
        _, weights = likelihood.forward(self.theta, jitter=jitter)
        free, found = self._free(factors), []
        for task in tasks:
            G, of_latent, between = self._regressed(task, free)
            # by a root: without noise an inverse would leave no digits
            half = weights.cholesky.half_solve(between.reshape(-1, len(free)))
            information = G @ of_latent - half.T @ half
            if self.told is not None:
                of_trend = self.of_columns[:, task] @ G.T
                information -= of_trend.T @ of_trend
            found.append(information)
        return found

    def effect_of_row(self, task, factors, likelihood):
        """How f of a task varies with its row of F, see Posterior."""
        G, _, between = self._regressed(task, self._free(factors))
        solved = np.tensordot(self.covariances.inverse, between, ([1, 3], [0, 1]))
        at, of_trend = G.T - self._of_task(task, solved), None
        if task in self.covariances.keep:
            at = self.covariances.keep[task].T @ at
        constants = -self.covariances.taken[task] @ at
        if self.told is not None:
            of_trend = self.of_columns[:, task] @ G.T
            at += self.told.omega[:, task].T @ of_trend
            constants += self.told.levels[:, task] @ of_trend
        return Effect(self.features.pull_back(at).T, constants, of_trend)

    def _free(self, factors):
        """Which latent functions have columns of F; a shared one comes before them."""
        pairs = zip(self.loadings.columns, factors, strict=True)
        parts = [np.arange(of.stop - F.shape[1], of.stop) for of, F in pairs]
        return np.concatenate(parts)

    def _regressed(self, task, free):
        """Latent functions as targets of a task.

        Their weights G, (rank, p); T_m G^T, (p, rank); and the same for each latent
        function, times what the task has of it, (n_latent, n_inducing, rank).
        """
        of_latent = self.by_latent[task][:, free]
        between = self.loadings.of_latent(of_latent)
        between = between * self.loadings.F[task][:, None, None]
        return self._in_features(self.V)[free], of_latent, between

    def _of_task(self, task, of_latent):
        """Sums of the latent functions of a task, (n_features, n_sums)."""
        loadings = self.loadings
        parts = [
            np.tensordot(loadings.F[task, of], of_latent[of], 1)
            for of in loadings.columns
        ]
        return np.concatenate(parts)

    def noise_of_rows(self):
        """Noise variance of each training row, (n_train,)."""
        return self.noise[self.bound.tasks]

    def latent(self, X, factor, term=0):
        """The latent functions z_a of a term at X.

        Parameters
        ----------
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        factor : ndarray of shape (n_tasks, rank)
            F, which the posterior knows.
        term : int, default=0
            Which term.

        Returns
        -------
        means : ndarray of shape (rank, n_samples)
            Their posterior means at X.
        halves : ndarray of shape (rank, n_halves, n_samples)
            C_a with cov(z_a, z_b) = delta_ab k^x(X, X) - C_a^T C_b, for functions of
            two terms too, whose prior covariance is zero. n_halves is n_latent times
            the lesser of n_samples and n_inducing. With a trend what its coefficients
            add comes last.
        """
        loadings, phi = self.covariances.loadings, self.features.tile(X).phi
        columns, part = loadings.columns[term], phi[loadings.rows[term]]
        means, halves = self.V[columns] @ part, self._halves(phi, columns, part)
        if self.told is not None:
            of_trend = -(self.told.V[:, columns] @ part).swapaxes(0, 1)
            halves = np.concatenate([halves, of_trend], axis=1)
        return means, halves

    def _halves(self, phi, columns, part):
        """C_a of `latent` without a trend, for the features of a term among all."""
        inverse, loadings = self.covariances.inverse, self.covariances.loadings
        rank, (m, n) = len(inverse), part.shape
        if n > m:  # of the weights: I - A^{-1}
            told = -inverse.swapaxes(1, 2)
            np.einsum("aiai->ai", told)[...] += 1.0
            return _root(told, rank, m)[columns] @ part
        of_latent = loadings.of_latent(phi)
        told = -np.einsum(
            "aji,abjk,bkl->aibl", of_latent, inverse, of_latent, optimize=True
        )
        np.einsum("aial->ail", told)[...] += of_latent.swapaxes(1, 2) @ of_latent
        return _root(told, rank, n)[columns]


def _forward(bound, theta, summed, variance):
    """The first pass, with more noise where rounding would leave no precision.

    `variance` is the largest of f.
    """
    failed = None
    for jitter in (0.0, *JITTERS):
        try:
            found = bound.forward(theta, summed, jitter * variance)
        except NotPositiveDefiniteError as error:
            failed = failed or error
            continue
        if jitter:
            warn(
                "What the training data tell of the inducing variables is not positive "
                f"definite in floating point; {jitter * variance:.1e} ({jitter:.0e} of "
                "the variance of f) was added to the noise variance. A larger "
                f"noise_variance avoids this. {INFERENCE}",
                JitterWarning,
            )
        return found
    raise failed


def _summed(bound, before, origin):
    """The sums of another posterior, and the rows that they lack.

    None if there are none, or others: a task has joined, inducing inputs have, or rows
    have gone.
    """
    same = before.sums and len(before.noise) == bound.prior.n_tasks
    same = same and np.array_equal(before.bound.Z, bound.Z)
    if not same or np.count_nonzero(origin >= 0) < before.sums.n.sum():
        return None
    new, one, two = np.flatnonzero(origin < 0), before.bound.basis, bound.basis
    if one is None or two is None:
        return (before.sums, new) if one is two else None
    turn = one.turn_to(two)
    return None if turn is None else (before.sums.turned(turn), new)


def _squares(columns):
    """Sums of squares of columns, which come first."""
    return np.square(columns).sum(axis=0)


def _root(A, rank, n):
    """C_a of shape (n_halves, n) with C_a^T C_b = A_ab; negatives are rounding."""
    values, vectors = np.linalg.eigh(A.reshape(rank * n, rank * n))
    half = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    return half.reshape(-1, rank, n).swapaxes(0, 1)
