r"""Which task is it? What samples of a task tell of its row of F, over all outputs.

The rows of the outputs are linear in u, :math:`f_j = c_j + A_j u`, and u is normal with
mean 0 and covariance I: it stands for the task's descriptors, which the outputs share,
or for the rows themselves. Given u the samples are normal, see `inference.border`.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from skmtgp._numerics.linalg import Cholesky
from skmtgp._support.warnings import warn
from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError
from skmtgp.inference.border import BorderLikelihood
from skmtgp.inference.likelihood import log_density
from skmtgp.inference.posterior import BLOCK_SIZE, Posterior
from skmtgp.inference.variances import in_blocks

MOST_STEPS, TOL = 50, 1e-6  # of Fisher scoring; nats that a step is expected to gain
# Linear steps before it. At the start samples without noise are millions of nats below
# the mode: after these scoring took one step or two, not forty.
N_REWEIGHTED = 5  # at most
N_CLIMBS = 2  # where the errors that a task carries depend on u, each time held
ROUNDING = 1e-11  # of a log density of millions of nats, as an exact model has them
HALVINGS = 30
NOISIER = 10.0, 100.0  # times the noise variance, if the covariance is singular
ALIKE = 1e-2  # deviations, squared, between what need not be followed further


class Learned(NamedTuple):
    """The tasks from which it was learned how a row follows from u.

    Errors of their functions carry over to another task: its row is a sum of theirs.

    Attributes
    ----------
    centre, slopes : ndarrays of shape (n_tasks,) and (n_tasks, n_u)
        The share that it has of each task is centre + slopes u.
    factor : ndarray of shape (n_tasks, rank)
        Their rows.
    """

    centre: np.ndarray
    slopes: np.ndarray
    factor: np.ndarray

    def shares(self, u):
        """What it has of each task."""
        return self.centre + self.slopes @ u

    def mean_squares(self, u, root):
        """Means of the squares of shares, u being normal with covariance R R^T."""
        return np.square(self.shares(u)) + np.square(self.slopes @ root).sum(axis=1)


class Output(NamedTuple):
    """An output of a model at the samples, in the model's own units.

    Attributes
    ----------
    posterior : Posterior
        Of the model.
    X : ndarray of shape (n_samples, n_inputs)
        Inputs of the kernel.
    y : ndarray of shape (n_samples,)
        Targets.
    noise : ndarray of shape (n_tasks + 1,)
        Noise variance of the samples of each task, and of another one.
    error : ndarray of shape (n_tasks + 1,)
        Variance of the model's own error, relative to the task's prior variance, for
        each task and for another one.
    factor : ndarray of shape (n_tasks, rank)
        F.
    row : pair of ndarrays of shape (rank,) and (rank, n_u)
        c and A, of which the row of another task is c + A u.
    inflation : float
        How much larger the variance of another task is than the posterior's.
    learned : Learned, default=None
        Tasks whose errors carry over to another one.
    """

    posterior: Posterior
    X: np.ndarray
    y: np.ndarray
    noise: np.ndarray
    error: np.ndarray
    factor: np.ndarray
    row: tuple[np.ndarray, np.ndarray]
    inflation: float = 1.0
    learned: Learned | None = None

    @property
    def prior(self):
        """The model."""
        return self.posterior.prior

    def border(self):
        """The likelihood of the samples as those of another task."""
        theta = self.posterior.theta
        return BorderLikelihood(
            self.posterior,
            self.factor,
            self.X,
            self.y,
            self.noise[-1],
            own=False,
            level=self.posterior.level,
            shared=self.prior.shared_loading(theta),
            equal=self.unshared(),
            error=self.error[-1],
            inflation=self.inflation,
        )

    def noisier(self, factor):
        """The same with more noise."""
        return self._replace(noise=factor * self.noise)

    def unshared(self):
        """Variance of what tasks have of their own, in units of k^x, on average."""
        _, kappa = self.prior.latent(self.posterior.theta)
        return float(kappa.mean())

    def known(self, task):
        """Log density of the samples as those of a known task."""
        tasks = np.full(len(self.X), task)
        covariance = self.posterior.covariance(self.X, tasks)
        own = self.error[task] * self.posterior.K_rho[task, task]
        covariance += own * self.posterior.kernel(self.X)
        covariance.flat[:: len(covariance) + 1] += self.noise[task]
        return log_normal(self.y, self.posterior.mean(self.X, tasks), covariance)

    def each(self):
        """Log density of each sample by itself, (n_samples, n_tasks + 1)."""
        n, n_tasks = len(self.X), len(self.factor)
        means, variances = np.empty((2, n, n_tasks + 1))
        for task in range(n_tasks):
            tasks = np.full(n, task)
            means[:, task] = self.posterior.mean(self.X, tasks)
            variances[:, task] = self.posterior.variance(self.X, tasks)
        of_tasks = self.error[:-1] * np.diagonal(self.posterior.K_rho)
        variances[:, :-1] += np.outer(self.posterior.kernel.diag(self.X), of_tasks)
        size = self.posterior.n_halves * (self.factor.shape[1] + 1)
        size = max(1, BLOCK_SIZE // size)
        means[:, -1], variances[:, -1] = in_blocks(self._another, size, self.X, axis=1)
        variances += self.noise
        z = np.square(self.y[:, None] - means) / variances
        return -0.5 * (z + np.log(2.0 * np.pi * variances))

    def _another(self, X):
        """Mean and variance of f of another task at rows X, u integrated out."""
        c, A = self.row
        shared = self.prior.shared_loading(self.posterior.theta)
        given = np.zeros(0) if shared is None else np.array([shared])
        factor = np.hstack([np.tile(given, (len(self.factor), 1)), self.factor])
        c = np.append(given, c)
        spread = np.zeros((len(c),) * 2)
        spread[len(given) :, len(given) :] = A @ A.T
        means, halves = self.posterior.latent(X, factor)
        own = np.outer(c, c) + spread
        carried, n_own = self._carried(given)
        told = np.einsum("ab,aij,bij->j", own + carried, halves, halves, optimize=True)
        diagonal = self.posterior.kernel.diag(X)
        prior = (np.trace(own + carried) + n_own * self.unshared()) * diagonal
        variance = np.maximum(prior - told, 0.0) + n_own * self.posterior.level
        variance *= self.inflation
        variance += self.error[-1] * (np.trace(own) + self.unshared()) * diagonal
        variance += np.einsum("ai,ab,bi->i", means, spread, means)
        return np.stack([c @ means, variance])

    def _carried(self, given):
        """Squares of rows whose errors it has, and their number with its own."""
        if self.learned is None:
            return 0.0, 1.0
        n_u, F = self.learned.slopes.shape[1], self.learned.factor
        squares = self.learned.mean_squares(np.zeros(n_u), np.eye(n_u))
        F = np.hstack([np.tile(given, (len(F), 1)), F])
        return F.T @ (squares[:, None] * F), 1.0 + squares.sum()


class Found(NamedTuple):
    """The most probable u.

    Attributes
    ----------
    u : ndarray of shape (n_u,)
        Where the density of u given the samples is highest.
    root : ndarray of shape (n_u, n_u)
        R, of which R R^T is the covariance of u, by the Fisher information there.
    log_evidence : float
        Log density of the samples, u integrated out by Laplace's method.
    """

    u: np.ndarray
    root: np.ndarray
    log_evidence: float

    @property
    def covariance(self):
        """Of u, of shape (n_u, n_u)."""
        return self.root @ self.root.T


class Unknown:
    """Samples of a task of which u is unknown.

    Parameters
    ----------
    outputs : list of Output
        At the samples.
    """

    def __init__(self, outputs):
        self.borders = [output.border() for output in outputs]
        self.maps = [output.row for output in outputs]
        self.learned = [output.learned for output in outputs]
        self.n_climbs = N_CLIMBS if any(self.learned) else 1

    def carry(self, u, root=None):
        """Let the task carry errors of others as it does at u; they are held there.

        Parameters
        ----------
        u : ndarray of shape (n_u,)
            Mean of u.
        root : ndarray of shape (n_u, n_roots), default=None
            R, of which R R^T is its covariance: what is carried is the mean over u, and
            so is the variance of the task's own function. None means that u is known.
        """
        root = np.zeros((len(u), 0)) if root is None else root
        for border, learned, (_, A) in zip(
            self.borders, self.learned, self.maps, strict=True
        ):
            if learned is not None:
                shares = np.sqrt(learned.mean_squares(u, root))
                border.carry(shares, learned.factor, (A @ root).T)

    def value_and_grad(self, u):
        """Log density of the samples and u but for a constant, and its gradient."""
        value, gradient = -0.5 * u @ u, -u
        for border, (c, A) in zip(self.borders, self.maps, strict=True):
            of_output, slope = border.value_and_grad(c + A @ u)
            value, gradient = value + of_output, gradient + A.T @ slope
        return value, gradient

    def value(self, u):
        """The same density alone."""
        pairs = zip(self.borders, self.maps, strict=True)
        return sum((border.value(c + A @ u) for border, (c, A) in pairs), -0.5 * u @ u)

    def information(self, u):
        """Fisher information of u, with that of its prior."""
        found = np.eye(len(u))
        for border, (c, A) in zip(self.borders, self.maps, strict=True):
            found += A.T @ border.fisher_information(c + A @ u) @ A
        return found

    def reweight(self, u, root=None):
        """The mode if the covariance of the samples were always that at u.

        A linear problem. Where the samples are far more exact than what is known of u,
        scoring takes tens of steps to get near the mode, and this takes a few. What is
        solved for is the step: u itself has too few digits.

        Parameters
        ----------
        u, root
            At which errors are carried, see `carry`.

        Returns
        -------
        u, root : ndarrays of shape (n_u,) and (n_u, n_u)
            The mode, and the root of its covariance.
        """
        self.carry(u, root)
        H, gradient = np.eye(len(u)), -u
        for border, (c, A) in zip(self.borders, self.maps, strict=True):
            of_row, slope = border.weighted(c + A @ u)
            H, gradient = H + A.T @ of_row @ A, gradient + A.T @ slope
        root = inverse_root(H)
        return u + root @ (root.T @ gradient), root

    def climb(self, u):
        """The mode that Fisher scoring with a line search leads to from u.

        Parameters
        ----------
        u : ndarray of shape (n_u,)
            Where it begins.

        Returns
        -------
        found : Found
        """
        value, gradient = self.value_and_grad(u)
        for _ in range(MOST_STEPS):
            step = np.linalg.solve(self.information(u), gradient)
            gain = gradient @ step
            least = TOL + ROUNDING * abs(value)
            while gain > least:
                further = u + step
                found = self.value_and_grad(further)
                if found[0] >= value + 1e-4 * gain:
                    break
                step, gain = 0.5 * step, 0.5 * gain
            else:  # no step gains: it is there, but for rounding
                break
            u, (value, gradient) = further, found
        root = inverse_root(self.information(u))
        return Found(u, root, value + np.linalg.slogdet(root)[1])


def inverse_root(H):
    """R with R R^T = H^{-1}, of an information that has that of the prior in it, I."""
    values, vectors = np.linalg.eigh(H)
    return vectors / np.sqrt(np.maximum(values, 1.0))


def identify(outputs, starts):
    """The better mode of two starts.

    Parameters
    ----------
    outputs : list of Output
        At the samples of a task of which u is unknown.
    starts : ndarray of shape (n_starts, n_u)
        Of which the likeliest is followed, and 0.

    Returns
    -------
    found : Found
    outputs : list of Output
        As given, or with more noise if their covariance is singular without.

    Raises
    ------
    NotPositiveDefiniteError
        If the covariance of the samples is singular in floating point, even with 100
        times the noise.

    Warns
    -----
    JitterWarning
        If it is with the noise as given.
    """
    for factor in (1.0, *NOISIER):
        noisier = [of.noisier(factor) for of in outputs]
        found = _better(Unknown(noisier), starts)
        if np.isfinite(found.log_evidence):
            if factor > 1.0:
                _warn_of_noise(factor)
            return found, noisier
    raise NotPositiveDefiniteError(
        "The covariance of the samples is singular: some are too close to each other "
        "for a model with so little noise. Give their noise, a larger floor, or fewer "
        "samples."
    )


def _warn_of_noise(factor):
    warn(
        "Some samples are so close to each other that their covariance is singular in "
        f"floating point. They were taken to have {factor:.0f} times the noise "
        "variance. Give the noise of the samples, or fewer of them.",
        JitterWarning,
    )


def _better(unknown, starts):
    """The better mode; its evidence is -inf where the covariance is singular."""
    middle = np.zeros_like(starts[0])
    unknown.carry(middle)
    likeliest = max(starts, key=unknown.value)
    first, second = (_near_mode(unknown, u) for u in (middle, likeliest))
    modes = [_mode(unknown, *first)]
    if _distance(*first, second[0]) > ALIKE:
        modes.append(_mode(unknown, *second))
    return max(modes, key=lambda mode: mode.log_evidence)


def _near_mode(unknown, u):
    """Where some linear steps lead, and the root of its covariance."""
    root = None
    for _ in range(N_REWEIGHTED):
        before, (u, root) = u, unknown.reweight(u, root)
        if _distance(u, root, before) < ALIKE:
            break
    return u, root


def _distance(u, root, other):
    """Of another u, squared, in deviations."""
    return np.square(np.linalg.solve(root, u - other)).sum()


def _mode(unknown, u, root):
    """The mode that climbs from near it lead to."""
    for _ in range(unknown.n_climbs):
        unknown.carry(u, root)
        found = unknown.climb(u)
        u, root, _ = found
    return found


def log_normal(y, mean, covariance):
    """Log density of normal numbers; -inf where the covariance is singular."""
    try:
        cholesky = Cholesky(np.asfortranarray(covariance))
    except NotPositiveDefiniteError:
        return -np.inf
    half = cholesky.half_solve(y - mean)
    return log_density(half @ half, cholesky.log_det(), len(y))


def follow(log_responsibilities, log_densities, usual, switching):
    """Responsibilities of classes, row after row, of a stream that may switch.

    They are logarithms: of a class that is far less probable than others, the
    responsibility itself may be 0 in floating point, and so for good without switches.

    Parameters
    ----------
    log_responsibilities : ndarray of shape (n_classes,)
        Before the first row.
    log_densities : ndarray of shape (n_rows, n_classes)
        Of each row if it is of the class.
    usual : ndarray of shape (n_classes,)
        Probability of each after a switch.
    switching : float
        Probability of a switch between two rows.

    Returns
    -------
    log_responsibilities : ndarray of shape (n_rows, n_classes)
        Given the rows so far.
    """
    found, log_now = np.empty(log_densities.shape), log_responsibilities
    with np.errstate(divide="ignore"):  # never or always switching
        stays, switches = np.log1p(-switching), np.log(switching * usual)
    for k, log_density_of_row in enumerate(log_densities):
        log_now = log_density_of_row + np.logaddexp(stays + log_now, switches)
        found[k] = log_now = log_now - logsumexp(log_now)
    return found
