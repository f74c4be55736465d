"""The likelihood times priors of the hyperparameters."""

from math import hypot, log

import numpy as np
from scipy.special import huber

from skmtgp._data.dask import is_dask

FAR = 4.0  # deviations from the mean of tasks, beyond which the density is exponential
DEGREES = 4.0  # of freedom of the logarithm of little noise
FAR_BELOW = np.log(1e6)  # its start noise as good as vanishes


class Penalised:
    """A likelihood whose values have a log density of theta added.

    Parameters
    ----------
    likelihood : Likelihood
        All but its values is as it was.
    of_theta : Hyperprior, SomeNoise, EqualTargets or AlikeNoise
        With the methods `log_density` and `information`.
    """

    def __init__(self, likelihood, of_theta):
        self.likelihood, self.of_theta = likelihood, of_theta

    def in_single(self):
        """See Likelihood."""
        return Penalised(self.likelihood.in_single(), self.of_theta)

    def value(self, theta):
        """Log posterior density, but for a constant; -inf where K fails."""
        return self.likelihood.value(theta) + self.of_theta.log_density(theta)[0]

    def value_and_grad(self, theta):
        """The same with its gradient."""
        value, gradient = self.likelihood.value_and_grad(theta)
        of_theta, slope = self.of_theta.log_density(theta)
        return value + of_theta, gradient + slope

    def fisher_information(self, theta):
        """That of the likelihood, and the precision of the density."""
        return self.likelihood.fisher_information(theta) + self.of_theta.information()

    def __getattr__(self, name):
        if name.startswith("__") or name == "likelihood":
            raise AttributeError(name)
        return getattr(self.likelihood, name)


class SomeNoise:
    r"""Almost no noise is unlikely.

    Below a variance c the logarithm of the noise variance has the tail of Student's t
    with four degrees of freedom:

    .. math:: \log p = -\frac52 \log\Bigl(1 + \frac{a^2}4\Bigr), \qquad
        a = \max\Bigl(0, \log c - \frac1M \sum_m \log(\sigma_m^2 + \alpha)\Bigr) .

    Otherwise a few rows would be explained without noise as soon as that gains a nat.
    At 1e-10 of the targets' variance the density is lower by 11 nats. Smooth functions
    without noise gain more than that with a handful of rows. So do hyperparameters, if
    there are nearly as many as rows: then the density falls by a rate more,

    .. math:: -\rho \bigl(\sqrt{1 + a^2} - 1\bigr) .

    Parameters
    ----------
    prior : Prior
        The model, whose noise is learned.
    log_little : float
        Logarithm of c.
    known : float, default=0.0
        Noise variance alpha that is there beside what is learned.
    rate : float, default=0.0
        rho, in nats for each factor of e.
    """

    def __init__(self, prior, log_little, known=0.0, rate=0.0):
        self.of_noise, self.log_little, self.known = prior.of_noise, log_little, known
        self.rate = rate

    def log_density(self, theta):
        """Log density but for a constant, and its gradient."""
        learned, gradient = np.exp(theta[self.of_noise]), np.zeros(len(theta))
        noise = learned + self.known
        mean = float(np.add.reduce(np.log(noise))) / len(noise)
        below = max(0.0, self.log_little - mean)
        if not below:
            return 0.0, gradient
        weight, length = 1.0 + below**2 / DEGREES, hypot(1.0, below)
        slope = (DEGREES + 1.0) / DEGREES * below / weight + self.rate * below / length
        gradient[self.of_noise] = slope * learned / noise / len(noise)
        value = -0.5 * (DEGREES + 1.0) * log(weight) - self.rate * (length - 1.0)
        return value, gradient

    def information(self):
        """None: its tail bends the other way, and above it is flat."""
        return np.zeros((len(self.of_noise),) * 2)


class EqualTargets:
    r"""Tasks whose targets are all equal tell nothing of the noise.

    Without noise they need no function: their n rows have a density that grows as
    :math:`\sigma^{-(n - 1)}`, without bound. That is taken back,

    .. math:: \log p = \sum_m \frac{n_m - 1}2 \log(\sigma_m^2 + \alpha) .

    Parameters
    ----------
    prior : Prior
        The model, whose noise is learned.
    n_equal : ndarray of shape (n_noise,)
        n_m - 1, or the sum of them over the tasks if they share the noise.
    known : float, default=0.0
        Noise variance alpha that is there beside what is learned.
    """

    def __init__(self, prior, n_equal, known=0.0):
        self.of_noise, self.n_equal, self.known = prior.of_noise, n_equal, known

    def log_density(self, theta):
        """Log density but for a constant, and its gradient."""
        learned = np.exp(theta[self.of_noise])
        noise, gradient = learned + self.known, np.zeros(len(theta))
        gradient[self.of_noise] = 0.5 * self.n_equal * learned / noise
        return 0.5 * float(self.n_equal @ np.log(noise)), gradient

    def information(self):
        """None: it is a line."""
        return np.zeros((len(self.of_noise),) * 2)


def may_vanish(prior):
    """Whether noise is learned, with no bound near its start.

    A bound within six powers of ten is that of a user, or of rounding.
    """
    bounded = prior.log_noise_bounds[0] > prior.log_noise - FAR_BELOW
    return not (bounded or prior.noise_is_fixed)


def told(likelihood):
    """The likelihood with `EqualTargets`, if there are any."""
    density = of_equal_targets(likelihood.prior, likelihood)
    return likelihood if density is None else Penalised(likelihood, density)


def of_equal_targets(prior, data):
    """`EqualTargets` of data, or of a likelihood; None without any."""
    n_equal = count_equal(data.tasks, data.y, prior.n_tasks, data.known)
    if not n_equal.any():
        return None
    if prior.n_noise == 1:
        n_equal = n_equal.sum(keepdims=True)
    alpha = 0.0 if data.known is None else float(data.known.variance.mean())
    return EqualTargets(prior, n_equal, alpha)


def count_equal(tasks, y, n_tasks, known=None):
    """Measurements beyond the first of tasks whose targets are all equal, (n_tasks,).

    None where no other task has targets that differ, nor of a Dask array.
    """
    first = np.zeros(n_tasks)
    if is_dask(y):
        return first
    first[tasks[::-1]] = y[::-1]
    differs = y != first[tasks]
    counts = np.bincount(tasks, None if known is None else known.counts, n_tasks)
    if known is not None:
        differs = differs | (known.spread > 0.0)
    differ = np.bincount(tasks, differs, n_tasks) > 0.0
    return np.maximum(counts - 1.0, 0.0) * ~differ * differ.any()


class AlikeNoise:
    r"""Noise variances of tasks are more or less alike.

    Their logarithms are normal around a common mean, of which nothing is known:

    .. math:: \log p = -\frac1{2 s^2} \sum_m (\log \sigma_m^2 - \mu)^2, \qquad
        \mu = \frac1M \sum_m \log \sigma_m^2 .

    Beyond four deviations the density falls exponentially (Huber's loss): a task may be
    exact beside noisy ones. The few rows of a task would else be explained without
    noise, now and then.

    Parameters
    ----------
    prior : Prior
        The model, with noise for each task.
    deviation : float
        s.
    """

    def __init__(self, prior, deviation):
        self.of_noise, self.precision = prior.of_noise, deviation**-2.0

    def log_density(self, theta):
        """Log density but for a constant, and its gradient."""
        logs = theta[self.of_noise]
        away = np.sqrt(self.precision) * (logs - logs.mean())
        slope = -np.sqrt(self.precision) * np.clip(away, -FAR, FAR)
        gradient = np.zeros_like(theta)
        gradient[self.of_noise] = slope - slope.mean()
        return -float(huber(FAR, away).sum()), gradient

    def information(self):
        """Its precision where they are alike, of shape (n_theta, n_theta)."""
        found, n = np.zeros((len(self.of_noise),) * 2), self.of_noise.sum()
        block = self.precision * (np.eye(n) - 1.0 / n)
        found[np.ix_(self.of_noise, self.of_noise)] = block
        return found
