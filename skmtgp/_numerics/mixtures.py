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


def moments(means, deviations, function):
    """Mean and variance of a function of what has a mixture of normals.

    Parameters
    ----------
    means : ndarray of shape (n_components, ...)
        Means of the components, which are equally likely.
    deviations : ndarray of the same shape
        Their standard deviations.
    function : callable
        Takes and gives arrays of any shape, element by element.

    Returns
    -------
    mean, variance : ndarray of shape (...)
    """
    around = function(means.mean(axis=0))  # what is squared beside it is small
    first, second = np.zeros((2, *around.shape))
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        away = function(means + node * deviations) - around
        first += weight * away.mean(axis=0)
        second += weight * np.square(away).mean(axis=0)
    return around + first, np.maximum(second - np.square(first), 0.0)
