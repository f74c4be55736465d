"""What the posteriors share: means in tiles, variances, leave-one-out."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import copy
from functools import cached_property, partial
from itertools import starmap
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import Kernel

from skmtgp._numerics.parallel import map_threads
from skmtgp.inference import tiles
from skmtgp.inference.open_rows import Effect
from skmtgp.inference.unseen import WithUnseen, bordered
from skmtgp.inference.variances import (
    diagonal,
    in_blocks,
    rounding_of,
    without_negatives,
)
from skmtgp.model.several import terms_of

BLOCK_SIZE = 2**22  # elements of the cross-covariance held at a time for the variance
FEW = 2**15  # elements of the last cross-covariance: rows that join need it twice
# Attributes that are made when they are asked for, and not pickled
WHEN_ASKED = "bound", "largest_of_k", "_last_cross"

LEAST_FREEDOM = 1.0  # degrees of freedom that tell a noise variance


class Summand(NamedTuple):
    """A part of the mean of f: sum_i weights_mi k^x(x, inputs_i) + constant_m.

    Attributes
    ----------
    kernel : Kernel
        k^x.
    inputs : ndarray of shape (n_inputs, n_features)
        Rows.
    weights : ndarray of shape (n_tasks, n_inputs)
        Of each task.
    constants : ndarray of shape (n_tasks,)
        Of each task.
    bind : callable
        Of inputs: the fast form of the kernel between rows and these.
    """

    kernel: Kernel
    inputs: np.ndarray
    weights: np.ndarray
    constants: np.ndarray
    bind: Callable


class Posterior(WithUnseen, ABC):
    """Posterior of f at given parameters: the standard GP formulae with eq. 6.

    Parameters
    ----------
    likelihood : Likelihood
        Likelihood with the data and the form of the model.
    theta : ndarray of shape (n_theta,)
        Parameters.

    Attributes
    ----------
    kernel : Kernel or Kernels
        k^x at these parameters.
    K_rho : ndarray of shape ([n_terms,] n_tasks, n_tasks)
        K^rho at these parameters.
    level : float
        Variance of the tasks' levels, which belong to f.
    noise : ndarray of shape (n_samples,)
        Noise variance of each training sample.
    jitter : float or ndarray of shape (n_samples,)
        What was added to the noise variance.
    alpha : ndarray of shape (n_samples,)
        K^{-1} y.
    inputs : ndarray of shape (n_inputs, n_features)
        Inputs between which k^x is computed.
    weights : ndarray of shape ([n_terms,] n_tasks, n_inputs)
        Weight of k^x at each training input in the mean of each task.
    levels : ndarray of shape (n_tasks,)
        Mean of the level of each task.
    log_likelihood : float
        Log marginal likelihood of the targets.
    coefficients : Coefficients or None
        Coefficients of a trend, which belongs to f. `alpha` is then P y.

    Notes
    -----
    A subclass sets `alpha` and `log_likelihood`. Then it calls ``_set_means()``, which
    sets `weights` and `levels`. It has the abstract methods. Means, variances,
    covariances and leave-one-out follow.
    """

    jitter = 0.0
    of_variances = ()  # attributes that means do not need

    def __init__(self, likelihood, theta):
        prior, values = likelihood.prior, likelihood.prior.values(theta)
        self.prior, self.theta = prior, theta
        self.kernel, self.K_rho = prior.kernel_at(theta), prior.K_rho_at(theta)
        self.inputs = likelihood.inputs
        self.tasks, self.level = likelihood.tasks, values.level
        self.noise = likelihood.noise_of_rows(values.noise)

    def __getstate__(self):  # that of a model that has predicted is the same
        return {name: of for name, of in vars(self).items() if name not in WHEN_ASKED}

    def __copy__(self):  # which keeps what was made: kernel and inputs are the same
        posterior = object.__new__(type(self))
        vars(posterior).update(vars(self))
        return posterior

    def of_means(self):
        """The same for means alone, without the matrices of the variances."""
        return without(self, self.of_variances)

    @cached_property
    def bound(self):
        """The fast form of k^x between any rows and the training inputs.

        It is made when it is asked for: a stream of rows may make many posteriors, and
        predict by few.
        """
        prior = self.prior
        return prior.node.bind(prior.values(self.theta).kernel, self.inputs)

    @cached_property
    def largest_of_k(self):
        """Largest value of the k^x of each term, over the training inputs."""
        return [kernel.diag(self.inputs).max() for kernel in terms_of(self.kernel)]

    @property
    def largest(self):
        """Largest prior variance of f, over the training inputs and all tasks."""
        pairs = zip(self.terms, self.largest_of_k, strict=True)
        of_terms = [np.diagonal(K_rho).max() * of_k for (_, K_rho), of_k in pairs]
        return self.level + float(sum(of_terms))

    @property
    def n_tasks(self):
        """Number of tasks that it knows."""
        return self.K_rho.shape[-1]

    @property
    def n_halves(self):
        """How many numbers each of the halves of `latent` has for a row."""
        return len(self.tasks)

    @property
    def terms(self):
        """A list of (k^x, K^rho) of each term."""
        K_rhos = self.K_rho.reshape(-1, self.n_tasks, self.n_tasks)
        return list(zip(terms_of(self.kernel), K_rhos, strict=True))

    @property
    def rounding(self):
        """What rounding may add to a variance, relative to its prior."""
        least = (self.noise + self.jitter).min()
        return rounding_of(len(self.tasks), self.largest, least)

    @abstractmethod
    def explained(self, X, tasks):
        """What the data take off the variance of f, of shape (n_samples,)."""

    @abstractmethod
    def explained_covariance(self, X, tasks):
        """What they take off its covariance, (n_samples, n_samples)."""

    @abstractmethod
    def precision(self):
        """The diagonal of K^{-1}, of shape (n_train,)."""

    @abstractmethod
    def latent(self, X, factor):
        """The latent functions z_a of eq. 3 and 5, of which f^m = sum_a F_ma z_a.

        Parameters
        ----------
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        factor : ndarray of shape (n_tasks, rank)
            F.

        Returns
        -------
        means : ndarray of shape (rank, n_samples)
            Their posterior means at X.
        halves : ndarray of shape (rank, n_train, n_samples)
            C^{-1} cov(y, z_a(X)), where K = C C^T.
        """

    @abstractmethod
    def level_variances(self):
        """Variance of the level of each task, given the data, (n_tasks,)."""

    def mean(self, X, tasks):
        """Mean of f, of shape (n_samples,), for rows of X and their tasks."""
        return self.means_of_terms(X, tasks).sum(axis=0)

    def means_of_terms(self, X, tasks):
        """Means of the terms of f, and last of the level, (n_terms + 1, n_samples).

        That of a trend, if there is one, comes before the level.
        """
        order = np.argsort(tasks, kind="stable")  # few tasks meet in a tile
        X, tasks = X[order], tasks[order]
        means = [self._mean_of_term(*of, X, tasks) for of in self._weighed()]
        if self.coefficients is not None:
            means.append(self.coefficients.means(X, tasks))
        found = np.empty((len(means) + 1, len(X)))
        found[:, order] = [*means, self.levels[tasks]]
        return found

    def _weighed(self):
        """The bound kernel of each term, and its weights."""
        if self.weights.ndim == 2:
            return [(self.bound, self.weights)]
        return list(zip(self.bound, self.weights, strict=True))

    def _mean_of_term(self, bound, weights, X, tasks):
        """The same of one term, for tasks that are sorted."""
        cross = bound.against(X)

        def of_rows(rows):
            present, column = np.unique(tasks[rows], return_inverse=True)
            of_tasks = self._weigh(cross, rows, weights[present])
            return of_tasks[np.arange(len(column)), column]

        return _by_rows(of_rows, len(X))

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
            f^m(x) = sum_i K^rho[m, m_i] k^x(x, x_i) alpha_i and the level of m.
        """

        def of_term(bound, weights):
            cross, weights = bound.against(X), weights[tasks]
            return _by_rows(lambda rows: self._weigh(cross, rows, weights), len(X))

        return sum(starmap(of_term, self._weighed())) + self.levels[tasks]

    def summands(self, tasks):
        """What the means of these tasks are sums of, a list of Summand."""
        of_terms = self.weights.reshape(-1, self.n_tasks, len(self.inputs))
        constants = np.zeros((len(of_terms), len(tasks)))
        constants[0] = self.levels[tasks]
        return [
            Summand(kernel, self.inputs, weights[tasks], of_term, bind)
            for (kernel, bind), weights, of_term in zip(
                kernels_of(self), of_terms, constants, strict=True
            )
        ]

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""

        def of_rows(X, tasks):
            prior = sum(of[tasks, tasks] * k.diag(X) for k, of in self.terms)
            prior = prior + self.level
            return prior - self.explained(X, tasks), prior

        size = max(1, BLOCK_SIZE // len(self.tasks))
        found = in_blocks(of_rows, size, X, tasks, axis=1)
        return without_negatives(*found, self.rounding)

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        return self._covariance(X, tasks, self.explained_covariance)

    def _covariance(self, X, tasks, explained):
        """The same, where `explained` makes what the data take off that of the prior.

        It does once that is there, of which no copy is then left.
        """
        covariance = prior_between(self.terms, self.level, X, tasks)
        prior = np.diagonal(covariance).copy()
        covariance -= explained(X, tasks)
        without_negatives(diagonal(covariance), prior, self.rounding)
        return covariance

    def leave_one_out(self, include_noise=False):
        """Predict each training sample from all others.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the variances are those of the observations, rather than those of f.

        Returns
        -------
        residual : ndarray of shape (n_samples,)
            y_i - mu_i, where mu_i is the mean of f given the other samples.
        variance : ndarray of shape (n_samples,)
            Its variance. Jitter that was added to a singular covariance counts as
            noise.

        Raises
        ------
        ValueError
            If the others do not tell the trend of one.

        Notes
        -----
        Rasmussen and Williams (2006), eq. 5.12: y_i - mu_i = alpha_i / [K^{-1}]_ii,
        and 1 / [K^{-1}]_ii is the variance of y_i given the others.
        """
        precision = self.precision()
        if not precision.all():
            raise ValueError(
                f"Without one of {(precision == 0.0).sum()} rows nothing tells a "
                "coefficient of the trend, and the row cannot be predicted from the "
                "others: such as that of a task with no more rows than coefficients. "
                "Give more rows or fewer columns of the trend, or set "
                "trend_per_task=False."
            )
        noise, of_y = self.noise + self.jitter, 1.0 / precision
        variance = without_negatives(of_y - noise, of_y + noise, self.rounding)
        return self.alpha / precision, variance + noise * include_noise

    def cross(self, X, bound=None):
        """k^x between rows of X and the training inputs, (n_samples, n_inputs).

        Of several terms that of the one with this bound kernel.
        """
        if bound is not None or len(X) * len(self.inputs) > FEW:
            return self._cross(X, bound or self.bound)
        key = X.shape, X.tobytes()
        last = vars(self).get("_last_cross", (None, None))
        if last[0] != key:
            last = vars(self)["_last_cross"] = key, self._cross(X, self.bound)
        return last[1]

    def _cross(self, X, bound):
        shape = len(X), len(self.inputs)
        K_x, _ = bound.against(X).block(*(slice(0, size) for size in shape))
        return np.broadcast_to(K_x, shape)  # which nobody can write to

    def informations(self, tasks, factors, likelihood):
        """G^T K^{-1} G of some tasks: what the samples tell of their rows of F.

        Parameters
        ----------
        tasks : list of int
            The tasks.
        factors : list of ndarray of shape (n_tasks, rank)
            F of each term.
        likelihood : Likelihood
            Whose inputs the training rows have.

        Returns
        -------
        informations : list of ndarray of shape (rank, rank)
        """
        latent = self._latent_functions(factors)
        halves = [
            self.solve(self._values(latent, task, likelihood))[0] for task in tasks
        ]
        return [half.T @ half for half in halves]

    def effect_of_row(self, task, factors, likelihood):
        """How f of a task varies with its row of F, an Effect; see `informations`."""
        latent = self._latent_functions(factors)
        G = self._values(latent, task, likelihood)
        _, solved, of_trend = self.solve(G)
        explained = self.weights_of(self.K_rho[..., [task], :], solved.T)
        constants = -self.level * solved[self.tasks == task].sum(axis=0)
        return Effect(latent.weights - explained, constants, of_trend)

    def _latent_functions(self, factors):
        """A posterior whose means are those of the latent functions of all terms."""
        _ = self.bound  # is made once, before the copy
        latent = copy(self)
        latent.weights = self.weights_of(_side_by_side(factors, self.K_rho), self.alpha)
        latent.levels = np.zeros(latent.weights.shape[-2])
        return latent

    def _values(self, latent, task, likelihood):
        """G: those means at the training rows of a task, zero at other rows."""
        rows, rank = np.flatnonzero(self.tasks == task), len(latent.levels)
        G = np.zeros((len(self.tasks), rank))
        if len(rows):
            G[rows] = latent.mean_of_tasks(likelihood.X[rows], np.arange(rank))
        return G

    def noise_of_rows(self):
        """Noise variance of each training row, with jitter, (n_train,)."""
        return self.noise + self.jitter

    @abstractmethod
    def weights_of(self, loadings, alpha):
        """Weights of k^x at the inputs in means of sums of tasks.

        Parameters
        ----------
        loadings : ndarray of shape ([n_terms,] n_sums or 1, n_tasks)
            Covariances of the sums with the tasks.
        alpha : ndarray of shape (n_train,) or (n_sums, n_train)
            K^{-1} y, the same of all or of each.

        Returns
        -------
        weights : ndarray of shape ([n_terms,] n_sums, n_inputs)
        """

    @abstractmethod
    def solve(self, G):
        """K^{-1} G and what belongs to it; with a trend, P is in the place of K^{-1}.

        Parameters
        ----------
        G : ndarray of shape (n_train, n_columns)
            Numbers of each training row.

        Returns
        -------
        half : ndarray of shape (n_halves, n_columns)
            A root: half^T half is G^T K^{-1} G.
        solved : ndarray of shape (n_train, n_columns)
            K^{-1} G.
        of_trend : ndarray of shape (rank of the trend, n_columns) or None
            (H root)^T K^{-1} G of its columns H and their `root`; None without.
        """

    def _weigh_tasks(self):
        """`weights`, from `K_rho` and `alpha`."""
        return self.weights_of(self.K_rho, self.alpha)

    def _set_means(self):
        """What the means are made of, from `alpha` and `K_rho`."""
        self.weights = self._weigh_tasks()
        of_tasks = np.bincount(self.tasks, self.alpha, self.n_tasks)
        self.levels = self.level * of_tasks

    def _with_loadings(self, unseen):
        """The same that knows tasks without data, too, see `WithUnseen`."""
        posterior, latents = copy(self), self.prior.latents(self.theta)
        K_rhos = [
            bordered(K_rho, F, *of)
            for (_, K_rho), (F, _), of in zip(self.terms, latents, unseen, strict=True)
        ]
        posterior.K_rho = np.array(K_rhos) if len(K_rhos) > 1 else K_rhos[0]
        posterior._set_means()
        return posterior

    def _weigh(self, cross, rows, weights):
        """K^x(X[rows], X_train) times the weights, which are in rows, in tiles."""
        size, n = rows.stop - rows.start, weights.shape[1]
        step = max(1, tiles.TILE**2 // size)
        total = np.zeros((size, len(weights)))
        for cols in (slice(a, min(a + step, n)) for a in range(0, n, step)):
            total += cross.times(rows, cols, weights[:, cols].T)
        return total


def prior_between(terms, level, X, tasks):
    """Prior covariance of f between rows, (n_samples, n_samples), in few copies."""
    covariance = 0.0
    for kernel, K_rho in terms:
        K_x = kernel(X)
        of_term = K_rho[np.ix_(tasks, tasks)]
        of_term *= K_x
        del K_x
        of_term += covariance
        covariance = of_term
    if level:
        same = np.equal.outer(tasks, tasks)
        np.add(covariance, level, out=covariance, where=same)
    return covariance


def without(posterior, names):
    """A copy of a posterior that lacks some attributes."""
    posterior = copy(posterior)
    for name in names:
        vars(posterior).pop(name, None)
    return posterior


def kernels_of(posterior):
    """k^x of each term, and what binds its fast form to inputs."""
    prior = posterior.prior
    of_terms = prior.kernels_with(prior.values(posterior.theta).kernel)
    binds = [partial(node.bind, theta) for _, node, theta in of_terms]
    return list(zip(terms_of(posterior.kernel), binds, strict=True))


def freedom_of_noise(likelihood, posterior):
    r"""Degrees of freedom that the rows leave to each noise variance.

    Parameters
    ----------
    likelihood : Likelihood
        Exact.
    posterior : Posterior
        The same at some parameters.

    Returns
    -------
    freedom : ndarray of shape (n_noise,)
        :math:`\nu_m = \sigma_m^2 \sum_{i \in m} [K^{-1}]_{ii}`, the number of the rows
        less the trace of the matrix that smooths them. What was added to the diagonal
        of a singular covariance counts as noise.
    """
    noise = posterior.noise + posterior.jitter
    return _sum_by_noise(likelihood, noise * posterior.precision())


def residuals_of_noise(likelihood, posterior):
    r"""Sums of the squared residuals, in units of the noise variance of each.

    At the mode of the likelihood they are the degrees of freedom. Where a variance has
    ended at its lower bound they are less.

    Parameters
    ----------
    likelihood, posterior
        See :func:`freedom_of_noise`.

    Returns
    -------
    residuals : ndarray of shape (n_noise,)
        :math:`\sigma_m^2 \sum_{i \in m} \alpha_i^2`.
    """
    noise = posterior.noise + posterior.jitter
    return _sum_by_noise(likelihood, noise * np.square(posterior.alpha))


def _sum_by_noise(likelihood, of_row):
    return np.bincount(likelihood.noise_of_row, of_row, likelihood.prior.n_noise)


def noise_is_told(likelihood, posterior, pull=0.0):
    r"""Whether the rows tell each noise variance that was learned from them.

    At the mode sigma_m^2 is the sum of the squared residuals divided by nu_m, those of
    :func:`freedom_of_noise`. One that is k times as large costs
    :math:`\tfrac12 \nu_m (\log k - 1 + 1/k)` nats as long as nu_m does not grow with
    it: below 1, which is the limit here, 1.8 nats for a hundred times. A prior that
    pulls the noise up takes the place of twice its slope of these degrees.

    Parameters
    ----------
    likelihood : Likelihood
        Exact.
    posterior : Posterior
        At the mode.
    pull : float or ndarray of shape (n_noise,), default=0.0
        Slope of the log density of a prior by the logarithms of the variances.

    Returns
    -------
    told : ndarray of bool of shape (n_noise,)
    """
    # at the mode, or the lower bound, residuals never need more freedom than there is
    told = residuals_of_noise(likelihood, posterior) >= LEAST_FREEDOM
    if told.all():
        return told
    freedom = freedom_of_noise(likelihood, posterior)
    return freedom - 2.0 * pull >= LEAST_FREEDOM


def _by_rows(function, n):
    """``function(rows)`` for n rows, a tile's at a time, put together again."""
    jobs = [(slice(a, min(a + tiles.TILE, n)),) for a in range(0, n, tiles.TILE)]
    return np.concatenate(map_threads(function, jobs))


def _side_by_side(factors, K_rho):
    """F^T of all terms, ([n_terms,] rank, n_tasks), zero where it is that of others."""
    if K_rho.ndim == 2:
        return factors[0].T
    ends = np.cumsum([F.shape[1] for F in factors])
    found = np.zeros((len(factors), ends[-1], K_rho.shape[-1]))
    for of_term, F, end in zip(found, factors, ends, strict=True):
        of_term[end - F.shape[1] : end] = F.T
    return found
