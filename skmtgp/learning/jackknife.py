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
a known one: that of errors of left-out samples. The mean square of these errors, over
that of the errors in closed form, is what variances at the mode are too small by.
"""

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.leeway import OfAll, widened
from skmtgp.learning.evidence import LEAST_CURVATURE, LogPosterior, Peak
from skmtgp.model.chart import Chart
from skmtgp.model.hyperprior import Hyperprior

STEP = 0.05  # of z, from the mode
MOST_LEVERAGE = 0.8  # beyond, what happens is far from what derivatives tell
# Of rows for each hyperparameter: with as many, errors grow by a percent or two.
MANY_EACH = 30
# Of so many coordinates the curvature is computed from gradients, one each. Of more it
# is that of the Fisher information.
MOST_AXES = 150
N_DIRECTIONS = 32  # across all coordinates, of more of which errors tell hardly more
FAR = 4.0  # deviations: of what is farther off, variances need not tell


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
    n_evaluations : int
        Gradients of the likelihood that it took.
    """
    hyperprior = Hyperprior(likelihood.prior)
    chart = Chart(hyperprior, theta)
    if not chart.size or len(likelihood.y) >= MANY_EACH * chart.size:
        return np.zeros(len(likelihood.y)), 0
    x = chart.coordinates(theta)
    with limit_threads(likelihood.side):
        here, deviation = _left_out(likelihood, theta)
        axes = _axes(LogPosterior(likelihood, hyperprior, chart), x)
        ends = (chart.theta(x + STEP * axis) for axis in axes)
        found = np.array([_left_out(likelihood, end)[0] for end in ends])
    likelihood.release()
    of_error, of_density = np.moveaxis((found - here) / STEP, 1, 0)
    leverage = np.minimum(np.square(of_error).sum(axis=0), MOST_LEVERAGE)
    growth = -deviation * (of_error * of_density).sum(axis=0) / (1.0 - leverage)
    return growth, chart.size + 1 if chart.size <= MOST_AXES else 0


def with_growth(problem, mode, posterior):
    """The mode whose variances are those that errors of left-out samples suggest.

    Parameters
    ----------
    problem : Problem
        What was learned.
    mode : Mode
        What was found, with what is open around it.
    posterior : Posterior
        At this mode.

    Returns
    -------
    mode : Mode
        With the evaluations that it took. As it was if nothing was learned, if rows are
        many for the hyperparameters, or if there are several terms.
    """
    learned = problem.budget.max_iter and problem.prior.n_terms == 1
    if not learned or is_dask(problem.data.X):
        return mode
    likelihood = problem.likelihood_at(mode)
    growth, n_evaluations = relearned(likelihood, mode.theta)
    if not growth.any():
        return mode
    mode = mode._replace(n_evaluations=mode.n_evaluations + n_evaluations)
    with limit_threads(likelihood.side):
        residual, known = posterior.leave_one_out(include_noise=True)
        open_ = widened(posterior, likelihood, mode.leeway)
        _, variance = open_.leave_one_out(include_noise=True)
    times = _sum_of_squares(residual + growth, variance)
    times /= _sum_of_squares(residual, known)
    if not times > 1.0:  # nor a number, where there are no digits
        return mode
    return mode._replace(leeway=(*mode.leeway, OfAll(times)))


def _sum_of_squares(residual, variance):
    """Of errors in deviations, with one more that is as large as it should be."""
    errors = residual / np.sqrt(np.maximum(variance, np.finfo(float).tiny))
    return 1.0 + np.square(np.clip(errors, -FAR, FAR)).sum()


def _axes(density, x):
    """Steps to which the log posterior is -z^T z / 2, one for each z, or across all."""
    n = len(x)
    if n <= MOST_AXES:
        values, vectors = Peak(density, x, np.nan, 0).curvature(one_sided=True)
    else:
        values, vectors = np.linalg.eigh(density.metric(x))  # of each coordinate 1 more
        values = np.maximum(values - 1.0, LEAST_CURVATURE)
    axes = (vectors / np.sqrt(values)).T
    if n <= N_DIRECTIONS:
        return axes
    normal = np.random.default_rng(0).standard_normal((n, N_DIRECTIONS))
    return np.sqrt(n / N_DIRECTIONS) * np.linalg.qr(normal)[0].T @ axes


def _left_out(likelihood, theta):
    """Errors of observations given the others, and log densities; and deviations."""
    residual, variance = likelihood.posterior(theta).leave_one_out(include_noise=True)
    deviation = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
    error = residual / deviation
    return np.array([error, -0.5 * np.square(error) - np.log(deviation)]), deviation
