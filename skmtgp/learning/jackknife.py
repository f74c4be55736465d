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
from skmtgp._support.warnings import collect_warnings
from skmtgp.inference.leeway import OfAll, widened
from skmtgp.learning.climbing import information_or_zero
from skmtgp.learning.evidence import LEAST_CURVATURE, LogPosterior, Peak
from skmtgp.model.chart import Chart
from skmtgp.model.hyperprior import Hyperprior

STEP = 0.05  # of z, from the mode
MOST_LEVERAGE = 0.8  # beyond, what happens is far from what derivatives tell
MANY_EACH = 20  # rows for each hyperparameter: errors grow by a few percent at most
# Up to so many coordinates and rows the curvature is computed from gradients, beyond it
# is the Fisher information.
MOST_AXES, MOST_ROWS = 100, 500
MOST_COORDINATES = 500  # of more, matrices are as large as those of the rows
N_DIRECTIONS = 32  # across all coordinates, of more of which errors tell hardly more
FAR = 4.0  # deviations: of what is farther off, variances need not tell
LEAST_SQUARE = 0.25  # of errors, on average: if they are less, the model is too unsure


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
        0 where rows are many for the hyperparameters, where these are very many, or
        where errors have no digits.
    n_evaluations : int
        Gradients of the likelihood that it took.
    """
    hyperprior = Hyperprior(likelihood.prior)
    chart = Chart(hyperprior, theta)
    none = np.zeros(len(likelihood.y)), 0
    if not 0 < chart.size <= MOST_COORDINATES:
        return none
    if len(likelihood.y) >= MANY_EACH * chart.size:
        return none
    x = chart.coordinates(theta)
    density = LogPosterior(likelihood, hyperprior, chart)
    n_evaluations = 2 * chart.size if _is_small(density) else 0
    with limit_threads(likelihood.side), collect_warnings() as lost:
        try:
            found = _along_axes(likelihood, density, x)
        except (np.linalg.LinAlgError, ValueError):  # no row, or not each, is left out
            return none[0], n_evaluations
        finally:
            likelihood.release()
    if lost or not all(np.isfinite(of).all() for of in found):
        return none[0], n_evaluations
    deviation, of_error, of_density = found
    leverage = np.square(of_error).sum(axis=0)
    kept = np.minimum(1.0, MOST_LEVERAGE / np.maximum(leverage, MOST_LEVERAGE))
    growth = -(of_error * of_density).sum(axis=0) * kept / (1.0 - kept * leverage)
    return deviation * growth, n_evaluations


def _along_axes(likelihood, density, x):
    """Deviations, and what errors and log densities vary by along each axis."""
    theta = density.chart.theta
    axes, (here, deviation) = _axes(density, x), _left_out(likelihood, theta(x))
    ends = [_left_out(likelihood, theta(x + STEP * axis))[0] for axis in axes]
    slopes = (np.array(ends).reshape(-1, *here.shape) - here) / STEP
    return deviation, slopes[:, 0], slopes[:, 1]


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
        With the evaluations that it took. Otherwise as it was if nothing was learned,
        if rows are many for the hyperparameters, if a row cannot be left out, or if
        there are several terms.
    """
    learned = problem.budget.max_iter and problem.prior.n_terms == 1
    if not learned or is_dask(problem.data.X):
        return mode
    likelihood = problem.likelihood_at(mode)
    growth, n_evaluations = relearned(likelihood, mode.theta)
    mode = mode._replace(n_evaluations=mode.n_evaluations + n_evaluations)
    if not growth.any():
        return mode
    with limit_threads(likelihood.side), collect_warnings() as lost:
        residual, known = posterior.leave_one_out(include_noise=True)
        opened = widened(posterior, likelihood, mode.leeway)
        try:
            _, variance = opened.leave_one_out(include_noise=True)
        except (np.linalg.LinAlgError, ValueError):
            return mode
    before = _sum_of_squares(residual, known)
    times = _sum_of_squares(residual + growth, variance)
    times /= max(before, 1.0 + LEAST_SQUARE * len(residual))
    if lost or not times > 1.0:  # nor a number, where there are no digits
        return mode
    return mode._replace(leeway=(*mode.leeway, OfAll(times)))


def _sum_of_squares(residual, variance):
    """Of errors in deviations, with one more that is as large as it should be."""
    errors = residual / np.sqrt(np.maximum(variance, np.finfo(float).tiny))
    return 1.0 + np.square(np.clip(errors, -FAR, FAR)).sum()


def _axes(density, x):
    """Steps to which the log posterior is -z^T z / 2, one for each z, or across all.

    Along others parameters are at a bound, and stay there without a sample.
    """
    curvature = _curvature if _is_small(density) else _information
    values, vectors = curvature(density, x)
    told = values > LEAST_CURVATURE
    axes = (vectors[:, told] / np.sqrt(values[told])).T
    n = len(axes)
    if n <= N_DIRECTIONS:
        return axes
    normal = np.random.default_rng(0).standard_normal((n, N_DIRECTIONS))
    return np.sqrt(n / N_DIRECTIONS) * np.linalg.qr(normal)[0].T @ axes


def _is_small(density):
    n_rows = len(density.likelihood.y)
    return density.chart.size <= MOST_AXES and n_rows <= MOST_ROWS


def _curvature(density, x):
    """Eigenvalues and eigenvectors, from two gradients for each coordinate."""
    return Peak(density, x, np.nan, 0).curvature()


def _information(density, x):
    """The same of the Fisher information; zeros where it cannot be computed."""
    theta, J = density.chart.theta(x), density.chart.jacobian(x)
    told = information_or_zero(density.likelihood, theta)
    if told.any():
        told = told + density.hyperprior.information()
    return np.linalg.eigh(J.T @ told @ J)


def _left_out(likelihood, theta):
    """Errors of observations given the others, and log densities; and deviations."""
    residual, variance = likelihood.posterior(theta).leave_one_out(include_noise=True)
    deviation = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
    error = residual / deviation
    return np.array([error, -0.5 * np.square(error) - np.log(deviation)]), deviation
