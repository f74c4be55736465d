"""What the likelihoods share: parameters, failures, the Fisher information."""

import contextlib
from abc import ABC, abstractmethod
from math import isqrt

import numpy as np

from skmtgp._data.known import noise_of
from skmtgp._numerics.parallel import limit_threads
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.information import information
from skmtgp.model._nodes import Parts
from skmtgp.model.task_covariance import OfTasks

FISHER_ROWS = 200
# Tasks without rows tell nothing: of many tasks there are more rows, up to so many
FISHER_ROWS_PER_TASK, FISHER_MOST = 4, 600
FISHER_SIZE = 2**24  # elements of the derivatives
WIDE = 1e3  # variance of a trend, relative to the trace of K


class Likelihood(ABC):
    r"""Log marginal likelihood of one output over all tasks.

    .. math::
        \log p(t | X) = -\tfrac12 t^T K^{-1} t - \tfrac12 \log|K| - \tfrac n2 \log 2\pi

    with the covariance K of the prior, eq. 6.

    Parameters
    ----------
    prior : Prior
        The model; theta sets its hyperparameters.
    X : ndarray of shape (n_samples, n_features)
        Inputs without the task column, sorted by task.
    tasks : ndarray of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1, ascending.
    y : ndarray of shape (n_samples,)
        Targets. The model assumes that their mean is zero.
    known : Known, default=None
        Known noise of each row.

    Notes
    -----
    A subclass sets ``inputs``, the rows between which matrices need k^x, and has the
    abstract methods. ``prior.values(theta)`` takes theta apart and
    ``prior.gradient(theta, ...)`` makes the gradient. If K cannot be factorised, it
    raises a :class:`~skmtgp.exceptions.NotPositiveDefiniteError`, which learning treats
    as a rejected step.
    """

    n_missing = 0  # cells without a row that it eliminates
    single = False  # whether it has seven digits where these are enough

    def __init__(self, prior, X, tasks, y, known=None):
        self.prior, self.X, self.tasks, self.y = prior, X, tasks, y
        self.known = known

    @property
    def noise_of_row(self):
        """Which noise variance each row has."""
        of_tasks = self.prior.n_noise > 1
        return self.tasks if of_tasks else np.zeros(len(self.tasks), dtype=int)

    def noise_of_rows(self, noise):
        """Noise variance of each row, from those that are learned."""
        return noise_of(self.known, noise[self.noise_of_row])

    def usual_log_noise(self, theta):
        """Logarithm of the noise variance of a task whose rows do not tell it.

        The mean of those that were learned, each counted as often as it has rows: that
        of two rows may be next to nothing.
        """
        counts = np.bincount(self.noise_of_row, minlength=self.prior.n_noise)
        return np.average(self.prior.log_noise_at(theta), weights=counts)

    @property
    def side(self):
        """Rows of the matrices on which an evaluation spends its time."""
        return len(self.inputs)

    @abstractmethod
    def _evaluate(self, theta):
        """The value; NotPositiveDefiniteError where K cannot be factorised."""

    @abstractmethod
    def _evaluate_with_grad(self, theta):
        """The same with the gradient by theta."""

    @abstractmethod
    def task_gradient(self, theta):
        """Derivative of the value with respect to K^rho, (n_tasks, n_tasks)."""

    @abstractmethod
    def posterior(self, theta):
        """Return the posterior of f given y.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        posterior : Posterior
            If the covariance is singular in floating point, a JitterWarning says what
            was added to it.
        """

    @abstractmethod
    def release(self):
        """Free the memory that is kept for the next evaluation."""

    def in_single(self):
        """The same with seven digits, if that saves time: to learn from, not to keep.

        Where data have little noise, it has all digits as before.
        """
        return self

    def value(self, theta):
        """Return the log marginal likelihood, or -inf if K cannot be factorised."""
        try:
            value = self._evaluate(theta)
        except NotPositiveDefiniteError:
            return -np.inf
        return value if np.isfinite(value) else -np.inf

    def value_and_grad(self, theta):
        """Return the log marginal likelihood and its gradient; -inf and nan if K fails.

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
        with contextlib.suppress(NotPositiveDefiniteError):
            value, gradient = self._evaluate_with_grad(theta)
            if np.isfinite(value):
                return value, gradient
        return -np.inf, np.full(len(theta), np.nan)

    def fisher_information(self, theta):
        """Fisher information of theta, from some of the rows.

        These are at most FISHER_ROWS. There are more for many tasks, and fewer with
        hundreds of derivatives.

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
        of_rho, n = self._of_rho(theta), len(self.X)
        rows = self._some_rows(of_rho)
        with limit_threads(len(rows)):
            of_some = self._information(theta, rows, of_rho)
        return of_some * (n / len(rows)) + self._of_repeats(theta)

    def _of_rho(self, theta):
        """Derivatives of K^rho of each term, lists."""
        prior = self.prior
        of_terms = zip(prior.terms, prior.theta_of_terms(theta), strict=True)
        return [list(form.derivatives(rho)) for (_, form), (_, rho) in of_terms]

    def _some_rows(self, of_rho):
        """The rows of which the Fisher information is computed."""
        prior, n = self.prior, len(self.X)
        n_matrices = prior.node.n_dims + sum(map(len, of_rho)) + prior.levels + 1
        most = min(n, rows_of_information(n, prior.n_tasks) + prior.n_coefficients)
        most = min(most, 1 + isqrt(FISHER_SIZE // n_matrices))
        return np.linspace(0, n - 1, most).astype(int)

    def _information(self, theta, rows, of_rho):
        """The Fisher information of some rows."""
        return information(*self._derivatives(theta, rows, of_rho))

    def _derivatives(self, theta, rows, of_rho):
        """K of some rows, their tasks, and its derivatives by the parts of theta."""
        prior, values = self.prior, self.prior.values(theta)
        X, tasks, learned, known = self._some(rows, values.noise)
        of_f, of_terms = self._derivatives_of_f(theta, X, tasks, of_rho)
        noise = noise_of(known, learned)
        by_noise = noise if known is None else learned / known.counts
        of_tasks = OfTasks(np.arange(prior.n_noise), 0.5 * by_noise)
        of_rest = [
            [values.level] * prior.levels,
            [of_tasks if prior.n_noise > 1 else by_noise],
        ]
        K = of_f + values.level * np.equal.outer(tasks, tasks)
        K[np.diag_indices_from(K)] += noise
        if prior.trend is not None:
            K += wide(prior.trend.basis(X, tasks), np.trace(K))
        return K, tasks, [*of_terms, *of_rest]

    def _derivatives_of_f(self, theta, X, tasks, of_rho):
        """The covariance of f, and its derivatives by k^x and by K^rho of each term."""
        of_f, by_kernels, by_rho = 0.0, [], []
        K_rho = self.prior.K_rho_at(theta).reshape(-1, *[self.prior.n_tasks] * 2)
        all_rows = Parts(np.zeros(len(X), dtype=int))
        of_kernels = self.prior.derivatives(theta, X, all_rows)
        for (K_x, dK_x), of_tasks, of_term in zip(
            of_kernels, K_rho, of_rho, strict=True
        ):
            K_x, between = K_x[0], _between(of_tasks, tasks)
            by_kernels.append([d[0] * between for d in dK_x])
            by_rho.append([_between_samples(d, tasks, K_x) for d in of_term])
            of_f = of_f + K_x * between
        return of_f, [*by_kernels, *by_rho]

    def _some(self, rows, noise):
        """X, tasks, learned noise and what is known of some rows, sorted by task."""
        tasks = np.asarray(self.tasks[rows])
        order = np.argsort(tasks, kind="stable")
        X = np.asarray(self.X[rows], dtype=float)[order]
        learned = noise[np.asarray(self.noise_of_row[rows])[order]]
        return X, tasks[order], learned, self.known and self.known.part(rows[order])

    def _of_repeats(self, theta):
        """What repeats of rows tell of the noise, beside their means."""
        if self.known is None:
            return 0.0
        learned = self.prior.values(theta).noise[self.noise_of_row]
        told = self.known.information(learned)
        n_noise, found = self.prior.n_noise, np.zeros(len(theta))
        found[len(theta) - n_noise :] = np.bincount(self.noise_of_row, told, n_noise)
        return np.diag(found)


def rows_of_information(n, n_tasks):
    """How many of n rows the Fisher information is computed from, at most."""
    of_tasks = min(FISHER_ROWS_PER_TASK * n_tasks, FISHER_MOST)
    return min(n, max(FISHER_ROWS, of_tasks))


def _between(of_tasks, tasks):
    """A matrix of the tasks, for each pair of samples; faster than `np.ix_`."""
    return of_tasks.take(tasks, axis=1).take(tasks, axis=0)


def _between_samples(d_rho, tasks, K_x):
    """Derivatives of K by parameters of K^rho, from those of K^rho."""
    if isinstance(d_rho, OfTasks):
        return d_rho._replace(half=_between(d_rho.half, tasks) * K_x)
    return _between(d_rho, tasks) * K_x


def wide(basis, size):
    """A covariance of the trend so wide that the inverse of K is without it.

    Of the Fisher information alone, for which three digits are enough.
    """
    return WIDE * size * basis.Q @ basis.Q.T


def log_density(fit, log_det, n):
    """Of n numbers y ~ N(0, K), with fit = y^T K^{-1} y."""
    return -0.5 * (fit + log_det + n * np.log(2.0 * np.pi))
