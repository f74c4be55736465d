"""Quantiles of mixtures of normal distributions."""

import numpy as np
from scipy.special import ndtr, ndtri

HALVINGS = 60  # of a bracket: to rounding


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
