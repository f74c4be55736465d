"""Numerical failures, each with a class of its own."""

import numpy as np

__all__ = [
    "AmbiguousFitWarning",
    "ConstantTargetWarning",
    "CorrelatedResidualsWarning",
    "DescriptorWarning",
    "IncompleteDataWarning",
    "InsufficientMemoryError",
    "JitterWarning",
    "LongFitWarning",
    "NegativeVarianceWarning",
    "NotPositiveDefiniteError",
    "PrecisionWarning",
    "SamplingWarning",
    "TaskColumnWarning",
    "UnderflowWarning",
    "UnidentifiedNoiseWarning",
]


class InsufficientMemoryError(MemoryError):
    """The matrices of a fit cannot be held in the memory that is available.

    Raised before anything is allocated; the message says how much is needed.

    Examples
    --------
    >>> from skmtgp.exceptions import InsufficientMemoryError
    >>> issubclass(InsufficientMemoryError, MemoryError)
    True
    """


class NotPositiveDefiniteError(np.linalg.LinAlgError):
    """A covariance matrix is not positive definite in floating point.

    Raised where adding to its diagonal does not help either.

    Examples
    --------
    >>> from skmtgp.exceptions import NotPositiveDefiniteError
    >>> issubclass(NotPositiveDefiniteError, ValueError)
    True
    """


class AmbiguousFitWarning(UserWarning):
    """Another mode is nearly as likely as the learned one, and predicts differently.

    The rows do not say which of them is right, and standard deviations of predictions
    do not have the doubt about it. The message says how many nats the modes are apart,
    and how far their predictions are. ``hyperparameters="sampled"`` averages over both.
    More rows tell them apart; so may another kernel, a lower rank or narrower bounds.
    `n_restarts_optimizer` looks for a better mode still.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import AmbiguousFitWarning
    >>> warnings.simplefilter("error", AmbiguousFitWarning)
    """


class ConstantTargetWarning(RuntimeWarning):
    """A Gaussian process was fitted to an output that is constant over many rows.

    It cannot tell how much the output varies, and is certain of it everywhere.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import ConstantTargetWarning
    >>> warnings.simplefilter("error", ConstantTargetWarning)
    """


class CorrelatedResidualsWarning(UserWarning):
    """Noise is correlated between neighbouring rows, in the order that fit was given.

    This is common where rows are a time series. Learning takes the noise of all rows
    for independent, so that some of it is learned as if it were a function of the
    inputs: the noise variance and standard deviations of predictions are too small, and
    scores of random folds, and of leaving out one row, too good. A misfit of
    rows that are sorted by an input looks the same.

    What helps are folds that keep stretches of rows together,
    :class:`~skmtgp.model_selection.TaskStratifiedGroupKFold`; a higher lower bound in
    `noise_variance_bounds`, chosen by these folds; and fewer rows, farther apart.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import CorrelatedResidualsWarning
    >>> warnings.simplefilter("error", CorrelatedResidualsWarning)
    """


class DescriptorWarning(UserWarning):
    """The tasks are too few, or too alike, to tell what each of their descriptors does.

    Some descriptor is the same for all tasks, follows from the others, or there are as
    many descriptors as tasks. The model explains the tasks that it has; one that fit
    has not seen is predicted by the smallest coefficients that do. More tasks help, or
    fewer descriptors.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import DescriptorWarning
    >>> warnings.simplefilter("error", DescriptorWarning)
    """


class IncompleteDataWarning(RuntimeWarning):
    """Data that would be complete have repeated or too few cells, and many rows.

    Dense inference is exact for them too, but takes far more time and memory than
    inference by Kronecker products, for which no cell may be observed repeatedly and
    few may be missing. The message says how many are.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import IncompleteDataWarning
    >>> warnings.simplefilter("error", IncompleteDataWarning)  # before a long fit
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


class LongFitWarning(UserWarning):
    """A fit will take minutes.

    Given before it begins, with about how long, and what takes less.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import LongFitWarning
    >>> warnings.simplefilter("ignore", LongFitWarning)
    """


class NegativeVarianceWarning(RuntimeWarning):
    """Variances of predictions are negative, by more than rounding explains.

    They are taken for zero, and so are no measure of any error. The kernel is not
    positive semi-definite at these inputs, or its `diag` is not the diagonal of its
    values; or the noise variance is so small that no digits are left. The message says
    how many variances it concerns.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import NegativeVarianceWarning
    >>> warnings.simplefilter("error", NegativeVarianceWarning)
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


class SamplingWarning(UserWarning):
    """Draws of the hyperparameters do not tell their posterior well.

    Chains move slowly, or lie around modes that they do not leave, so that the draws
    are worth few independent ones and intervals may be too narrow. The message gives
    the effective sample size, R-hat and the number of divergent trajectories.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import SamplingWarning
    >>> warnings.simplefilter("error", SamplingWarning)
    """


class TaskColumnWarning(UserWarning):
    """The column that is taken for the tasks may be another one, or need tidying.

    It has more tasks than half of the rows, or labels that differ in spaces or case
    alone, or, in cross-validation, a task of one row. Or it is the last column, by
    default, and the one before it looks more like labels, as where something was
    appended to X. The message says what to do.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import TaskColumnWarning
    >>> warnings.simplefilter("error", TaskColumnWarning)
    """


class UnderflowWarning(RuntimeWarning):
    """A feature or target is so small that squares of its values may vanish.

    Where they do, it counts as constant; where they only lose digits, which begins at
    some 1e-158, predictions do too. Standard deviations in units of such a target mean
    nothing. Other units avoid this.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import UnderflowWarning
    >>> warnings.simplefilter("error", UnderflowWarning)
    """


class UnidentifiedNoiseWarning(RuntimeWarning):
    """The rows do not tell a noise variance that was learned from them.

    The model follows them so closely that they leave less than one degree of freedom
    to it. This is common with a few rows of each task. The noise variance may be too
    small by many orders of magnitude, and the standard deviations of predictions with
    it.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import UnidentifiedNoiseWarning
    >>> warnings.simplefilter("error", UnidentifiedNoiseWarning)
    """
