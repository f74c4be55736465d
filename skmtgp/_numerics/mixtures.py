"""Mixtures of normal distributions: quantiles, densities, moments of functions."""

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri

HALVINGS = 60  # of a bracket: to rounding
# Nodes of the trapezoidal rule, in standard deviations: exact to rounding of what is
# smooth, to some thousandths where there are kinks.
NODES = np.linspace(-8.0, 8.0, 129)
WEIGHTS = np.exp(-0.5 * NODES**2)
WEIGHTS /= WEIGHTS.sum()


def quantiles(means, deviations, p):
    """Quantiles of equal mixtures of normal distributions.

    Parameters
    ----------
    means : ndarray of shape (n_components, ...)
        Means of the components.
    deviations : ndarray of the same shape
        Their standard deviations; 0 is a component at its mean.
    p : float
        Probability, between 0 and 1.

    Returns
    -------
    quantiles : ndarray of shape (...)
        Where p of the distribution is below. It lies between the least and the largest
        quantile of the components, where halving finds it; of one component it is its
        own.
    """
    of_components = means + deviations * ndtri(p)
    lower, upper = of_components.min(axis=0), of_components.max(axis=0)
    width = np.maximum(deviations, np.finfo(float).tiny)
    for _ in range(HALVINGS if len(means) > 1 else 0):
        middle = 0.5 * (lower + upper)
        below = ndtr((middle - means) / width).mean(axis=0) < p
        lower, upper = np.where(below, middle, lower), np.where(below, upper, middle)
    return 0.5 * (lower + upper)


def log_density(means, deviations, values):
    """Log density of equal mixtures of normal distributions.

    Parameters
    ----------
    means : ndarray of shape (n_components, ...)
        Means of the components.
    deviations : ndarray of the same shape
        Their standard deviations. 0 is a narrow peak at the mean, and infinity is -inf.
    values : ndarray of shape (...)
        Where it is sought.

    Returns
    -------
    log_density : ndarray of shape (...)
    """
    widths = np.maximum(deviations, np.finfo(float).tiny)
    with np.errstate(over="ignore"):  # so far away there is none
        away = np.square((values - means) / widths)
    of_components = -0.5 * away - np.log(widths)
    mixed = logsumexp(of_components, axis=0) - np.log(len(means))
    return mixed - 0.5 * np.log(2.0 * np.pi)


def weights_left_out(residuals, variances):
    r"""How much each draw of the hyperparameters counts where a sample is left out.

    The draws are from their posterior given all samples. Given all but one it is less
    by the density of that one (Gelfand, Dey and Chang 1992), so that a draw counts by

    .. math:: 1 / p(y_i \mid y_{-i}, \theta),

    and at most by sqrt(n_draws) times the mean of that (Ionides 2008): few draws would
    else count alone.

    Parameters
    ----------
    residuals : ndarray of shape (n_draws, ...)
        Each observation minus its mean given all others, by each draw.
    variances : ndarray of the same shape
        Its variance, with that of the noise.

    Returns
    -------
    weights : ndarray of the same shape
        1 on average over the draws.
    """
    variances = np.maximum(variances, np.finfo(float).tiny)
    with np.errstate(over="ignore"):  # so far away that no other draw counts
        logs = 0.5 * (np.square(residuals) / variances + np.log(variances))
    logs = np.minimum(logs, np.finfo(float).max)
    weights = np.exp(logs - logs.max(axis=0))
    most = np.sqrt(len(weights)) * weights.mean(axis=0)
    weights = np.minimum(weights, most)
    return weights / weights.mean(axis=0)


def as_one(means, variances, weights):
    """Mean and variance of mixtures of normals.

    Parameters
    ----------
    means, variances : ndarray of shape (n_components, ...)
        Of the components.
    weights : ndarray that broadcasts to this shape
        Of each, 1 on average over the components.

    Returns
    -------
    mean, variance : ndarray of shape (...)
    """
    mean = (weights * means).mean(axis=0)
    return mean, (weights * (variances + np.square(means - mean))).mean(axis=0)


def moments(means, deviations, function, weights=1.0):
    """Mean and variance of a function of what has a mixture of normals.

    Parameters
    ----------
    means : ndarray of shape (n_components, ...)
        Means of the components.
    deviations : ndarray of the same shape
        Their standard deviations.
    function : callable
        Takes and gives arrays of any shape, element by element.
    weights : float or ndarray of the same shape, default=1.0
        Of the components, 1 on average.

    Returns
    -------
    mean, variance : ndarray of shape (...)
    """
    around = function(means.mean(axis=0))  # what is squared beside it is small
    first, second = np.zeros((2, *around.shape))
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        away = function(means + node * deviations) - around
        first += weight * (weights * away).mean(axis=0)
        second += weight * (weights * np.square(away)).mean(axis=0)
    return around + first, np.maximum(second - np.square(first), 0.0)
