"""Variances, which are differences: what rounding may do to them, and what not."""

import numpy as np

from skmtgp._numerics.linalg import RESOLVED
from skmtgp._support.guide import INFERENCE
from skmtgp._support.warnings import warn
from skmtgp.exceptions import NegativeVarianceWarning

TINY = np.finfo(np.float64).tiny


def largest_prior(K_rho, kernel, inputs):
    """The largest prior variance of f among these inputs and the tasks."""
    return float(np.diagonal(K_rho).max() * kernel.diag(inputs).max())


def rounding_of(n, prior, noise):
    """What rounding may add to a variance, relative to its prior: some eps cond(K).

    With the weights w = K^{-1} k of the rows in a mean, an error E of K changes the
    variance by w^T E w. |w|^2 is at most prior / noise, E about eps n prior: what
    rounding has done was never above a tenth of this.

    Parameters
    ----------
    n : int
        Number of rows.
    prior : float
        The largest prior variance of a row.
    noise : float
        The smallest noise variance.

    Returns
    -------
    rounding : float
        1 where no digits are left.
    """
    least = max(RESOLVED * n * prior, noise, TINY)  # no overflow
    return min(1.0, float(RESOLVED * (1.0 + n * prior / least)))


def without_negatives(variance, prior, rounding):
    """Variances, in place, with 0 where rounding made them negative.

    Parameters
    ----------
    variance : ndarray of shape (n_samples,)
        Variances.
    prior : ndarray of shape (n_samples,)
        What they are differences of.
    rounding : float
        How negative they may be, relative to that.

    Returns
    -------
    variance : ndarray of shape (n_samples,)
        The same array.

    Warns
    -----
    NegativeVarianceWarning
        If one of them is more negative.
    """
    with np.errstate(over="ignore"):
        relative = variance / np.maximum(np.abs(prior), TINY)
    wrong = relative < -rounding
    if wrong.any():
        warn(
            f"{np.count_nonzero(wrong)} of {len(variance)} variances of f are "
            f"negative, down to {relative.min():.1e} of the prior's; rounding explains "
            f"only {-rounding:.0e}. They are set to 0, but mean nothing, and neither "
            "do the means there. Check that the kernel is positive semi-definite at "
            "these inputs, and that its diag is its diagonal. If both hold, the noise "
            "variance is too small for double precision: raise the lower of "
            f"noise_variance_bounds. {INFERENCE}",
            NegativeVarianceWarning,
        )
    return np.maximum(variance, 0.0, out=variance)


def diagonal(matrix):
    """The diagonal of a matrix, as a view that can be written."""
    return np.einsum("ii->i", matrix)


def in_blocks(function, size, *parts, axis=0):
    """``function(*parts)`` for blocks of their rows, put together again."""
    blocks = [slice(a, a + size) for a in range(0, len(parts[0]), size)]
    return np.concatenate(
        [function(*(part[rows] for part in parts)) for rows in blocks], axis=axis
    )
