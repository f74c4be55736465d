"""The likelihood times the weak priors of the hyperparameters."""

import numpy as np

from skmtgp.model.hyperprior import Hyperprior


class WithHyperprior:
    """A likelihood whose values have the log density of theta's prior added.

    Parameters
    ----------
    likelihood : Likelihood
        All but its values is as it was.
    """

    def __init__(self, likelihood):
        self.likelihood = likelihood
        self.hyperprior = Hyperprior(likelihood.prior)

    def value(self, theta):
        """Log posterior density, but for a constant; -inf where K fails."""
        return self.likelihood.value(theta) + self.hyperprior.log_density(theta)[0]

    def value_and_grad(self, theta):
        """The same with its gradient."""
        value, gradient = self.likelihood.value_and_grad(theta)
        of_prior, slope = self.hyperprior.log_density(theta)
        return value + of_prior, gradient + slope

    def fisher_information(self, theta):
        """That of the likelihood, and the precision of the prior."""
        information = self.likelihood.fisher_information(theta)
        return information + np.diag(self.hyperprior.precision)

    def __getattr__(self, name):
        if name.startswith("__") or name == "likelihood":
            raise AttributeError(name)
        return getattr(self.likelihood, name)
