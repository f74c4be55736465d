"""Numbers of a diagonal of K^rho that have vanished, and what that costs."""

from math import comb, log

import numpy as np

from skmtgp.model.task_covariance import WithDiagonal


def vanished(prior, theta, least):
    """Which elements of theta are numbers of a diagonal that have vanished.

    Parameters
    ----------
    prior : Prior
        The model.
    theta : ndarray of shape (n_theta,)
        Parameters.
    least : float
        Share of a task's variance that is its own under which it has none.

    Returns
    -------
    vanished : ndarray of bool of shape (n_theta,)
    """
    found, form = np.zeros(len(theta), dtype=bool), prior.task_covariance
    if isinstance(form, WithDiagonal) and form.n_kappa > 1:
        own = prior.unexplained & ~prior.of_noise
        variances = np.diagonal(form.matrix(prior.values(theta).rho))
        found[own] = np.exp(theta[own]) / variances < least
    return found


def price_of_choice(prior, n_vanished):
    """Nats that it costs to choose which numbers of a diagonal vanish.

    Any choice of as many is as likely beforehand (Chen and Chen 2008, extended BIC).
    """
    form = prior.task_covariance
    if not (isinstance(form, WithDiagonal) and form.n_kappa > 1):
        return 0.0
    return log(comb(form.n_kappa, int(n_vanished)))
