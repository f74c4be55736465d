"""The likelihood times priors of the hyperparameters."""

import numpy as np

# Of the targets' variance: less noise than that is seldom, and few rows do not tell it.
LITTLE = 1e-2
DEGREES = 4.0  # of freedom of its logarithm below; at 1e-10 it is down by 11 nats


class Penalised:
    """A likelihood whose values have a log density of theta added.

    Parameters
    ----------
    likelihood : Likelihood
        All but its values is as it was.
    of_theta : Hyperprior, SomeNoise or AlikeNoise
        With the methods `log_density` and `information`.
    """

    def __init__(self, likelihood, of_theta):
        self.likelihood, self.of_theta = likelihood, of_theta

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
    r"""Noise is seldom next to nothing.

    Below a hundredth :math:`c` of the targets' variance, or where learning starts if
    that is less, logarithms of noise variances have the tail of Student's t with four
    degrees of freedom:

    .. math:: \log p = -\frac52 \sum_m \log\Bigl(1 + \frac{a_m^2}4\Bigr), \qquad
        a_m = \max(0, \log c - \log \sigma_m^2) .

    Few rows that can be explained without noise would else be, for a nat. Many that are
    without noise gain far more than the eleven nats that this takes.

    Parameters
    ----------
    prior : Prior
        The model.
    """

    def __init__(self, prior):
        self.of_noise = prior.of_noise & np.not_equal(*prior.bounds())
        self.little = min(np.log(LITTLE * prior.scale**2), prior.log_noise)

    def log_density(self, theta):
        """Log density but for a constant, and its gradient."""
        below = np.maximum(0.0, self.little - theta) * self.of_noise
        weight = 1.0 + below**2 / DEGREES
        value = -0.5 * (DEGREES + 1.0) * float(np.log(weight).sum())
        return value, (DEGREES + 1.0) / DEGREES * below / weight

    def information(self):
        """None: its tail bends the other way, and above it is flat."""
        return np.zeros((len(self.of_noise),) * 2)


class AlikeNoise:
    r"""Noise variances of tasks are more or less alike.

    Their logarithms are normal around a common mean, of which nothing is known:

    .. math:: \log p = -\frac1{2 s^2} \sum_m (\log \sigma_m^2 - \mu)^2, \qquad
        \mu = \frac1M \sum_m \log \sigma_m^2 .

    The few rows of a task would else be explained without noise, now and then.

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
        away = theta[self.of_noise] - theta[self.of_noise].mean()
        gradient = np.zeros_like(theta)
        gradient[self.of_noise] = -self.precision * away
        return -0.5 * self.precision * float(away @ away), gradient

    def information(self):
        """Its precision, of shape (n_theta, n_theta)."""
        found, n = np.zeros((len(self.of_noise),) * 2), self.of_noise.sum()
        block = self.precision * (np.eye(n) - 1.0 / n)
        found[np.ix_(self.of_noise, self.of_noise)] = block
        return found
