r"""Errors of left-out samples whose hyperparameters are not learned from them either.

Rasmussen and Williams (2006), section 5.4.2, have each sample's error given the others
in closed form, at the hyperparameters of all samples. Where samples are few these know
the sample well, and the error is too small. What it would be without that follows from
derivatives at the mode.

Let z be coordinates in which the log posterior of the hyperparameters is
:math:`-z^T z / 2` near the mode, and :math:`e_i = (y_i - \mu_i) / \sigma_i` the error.
Without sample i the log posterior has :math:`\log p(y_i | y_{-i}, z)` less. Its
gradient is d, and its curvature nearly :math:`-g g^T`, with the gradient g of the
error, as in the method of Gauss and Newton. So the mode is at
:math:`-(I - g g^T)^{-1} d` without the sample, where its error is

.. math:: e_i - \frac{g^T d}{1 - g^T g}.

Here :math:`g^T g` is what the leverage is in linear regression, of which the formula is
a known one: that of errors of left-out samples.
"""

import numpy as np

from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.evidence import LogPosterior, Peak
from skmtgp.model.chart import Chart
from skmtgp.model.hyperprior import Hyperprior

STEP = 0.1  # of z, from the mode to either side
MOST_LEVERAGE = 0.9  # beyond, what happens is far from what derivatives tell
# Of rows for each hyperparameter: with as many, errors grow by a percent or two.
MANY_EACH = 30


def relearned(likelihood, theta):
    """By how much errors grow where theta is learned without the sample.

    Parameters
    ----------
    likelihood : Likelihood
        Of one output, of one term.
    theta : ndarray of shape (n_theta,)
        The mode.

    Returns
    -------
    growth : ndarray of shape (n_samples,)
        To add to residuals given the others, in the likelihood's units and order. It is
        0 where rows are many for the hyperparameters.
    """
    hyperprior = Hyperprior(likelihood.prior)
    chart = Chart(hyperprior, theta)
    n = len(likelihood.y)
    if not chart.size or n >= MANY_EACH * chart.size:
        return np.zeros(n)
    x = chart.coordinates(theta)
    with limit_threads(likelihood.side):
        density = LogPosterior(likelihood, hyperprior, chart)
        values, vectors = Peak(density, x, np.nan, 0).curvature(one_sided=True)
        axes = (vectors / np.sqrt(values)).T
        pairs = [(chart.theta(x + STEP * z), chart.theta(x - STEP * z)) for z in axes]
        slopes = np.array([_slopes(likelihood, *pair) for pair in pairs])
        deviation = np.sqrt(_left_out(likelihood, theta)[1])
    likelihood.release()
    of_error, of_density = np.moveaxis(slopes, 1, 0)
    leverage = np.minimum(np.square(of_error).sum(axis=0), MOST_LEVERAGE)
    return -deviation * (of_error * of_density).sum(axis=0) / (1.0 - leverage)


def _slopes(likelihood, above, below):
    """Those of each sample's error and log density, along an axis, (2, n_samples)."""
    found = []
    for theta in (above, below):
        residual, variance = _left_out(likelihood, theta)
        error = residual / np.sqrt(variance)
        found.append([error, -0.5 * (np.square(error) + np.log(variance))])
    return np.subtract(*found) / (2.0 * STEP)


def _left_out(likelihood, theta):
    """Residuals of observations given the others, and their variances."""
    residual, variance = likelihood.posterior(theta).leave_one_out(include_noise=True)
    return residual, np.maximum(variance, np.finfo(float).tiny)
