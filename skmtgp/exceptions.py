"""Numerical failures, each with a class of its own."""

import numpy as np

__all__ = ["JitterWarning", "NotPositiveDefiniteError", "PrecisionWarning"]


class NotPositiveDefiniteError(np.linalg.LinAlgError):
    """A covariance matrix is not positive definite in floating point.

    Raised where adding to its diagonal does not help either.

    Examples
    --------
    >>> from skmtgp.exceptions import NotPositiveDefiniteError
    >>> issubclass(NotPositiveDefiniteError, ValueError)
    True
    """


class JitterWarning(RuntimeWarning):
    """A covariance matrix was factorised only after adding to its diagonal.

    The message says how much was added.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import JitterWarning
    >>> warnings.simplefilter("error", JitterWarning)  # stop where it happens
    """


class PrecisionWarning(RuntimeWarning):
    """Learning ended because the likelihood has too few correct digits to go on.

    It happens where the prior variance has grown to some 1e14 times the noise variance.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import PrecisionWarning
    >>> warnings.simplefilter("ignore", PrecisionWarning)
    """
