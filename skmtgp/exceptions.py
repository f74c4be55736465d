"""Classes of errors and warnings, one for each kind of numerical failure."""

import numpy as np

__all__ = [
    "AmbiguousFitWarning",
    "AngleUnitWarning",
    "BinaryTargetWarning",
    "ConstantTargetWarning",
    "CorrelatedResidualsWarning",
    "DescriptorWarning",
    "FarLevelsWarning",
    "FixedCorrelationWarning",
    "IncompleteDataWarning",
    "InsufficientMemoryError",
    "JitterWarning",
    "LongFitWarning",
    "NarrowIntervalsWarning",
    "NegativeVarianceWarning",
    "NotPositiveDefiniteError",
    "OutlierWarning",
    "PrecisionWarning",
    "RepeatedRowsWarning",
    "RowEffectsWarning",
    "SamplingWarning",
    "SeveralKernelsWarning",
    "SkewedInputWarning",
    "SkmtgpWarning",
    "SmallTaskWarning",
    "TargetScaleWarning",
    "TaskColumnWarning",
    "TaskUnitWarning",
    "UnderflowWarning",
    "UnidentifiedNoiseWarning",
    "UnrelatedTasksWarning",
]


class InsufficientMemoryError(MemoryError):
    """The matrices of a fit do not fit into the available memory.

    It is raised before anything is allocated. The message says how much memory is
    needed.

    Examples
    --------
    >>> from skmtgp.exceptions import InsufficientMemoryError
    >>> issubclass(InsufficientMemoryError, MemoryError)
    True
    """


class NotPositiveDefiniteError(np.linalg.LinAlgError):
    """A covariance matrix is not positive definite in floating point.

    It is raised if adding to the diagonal does not help, either.

    Examples
    --------
    >>> from skmtgp.exceptions import NotPositiveDefiniteError
    >>> issubclass(NotPositiveDefiniteError, ValueError)
    True
    """


class SkmtgpWarning(Warning):
    """What all warnings of this module are, for one filter.

    Each of them is a `UserWarning` or a `RuntimeWarning` as well.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import SkmtgpWarning
    >>> warnings.simplefilter("error", SkmtgpWarning)
    """


class AmbiguousFitWarning(SkmtgpWarning, UserWarning):
    """Another mode is nearly as likely as the learned one, and predicts differently.

    The rows do not determine which mode is right, and standard deviations of
    predictions ignore this doubt. The message says how many nats the modes differ, and
    how far apart their predictions are. ``hyperparameters="sampled"`` averages over
    both. More rows can decide; so can another kernel, a lower rank or narrower bounds.
    `n_restarts_optimizer` searches for a still better mode.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import AmbiguousFitWarning
    >>> warnings.simplefilter("error", AmbiguousFitWarning)
    """


class AngleUnitWarning(SkmtgpWarning, UserWarning):
    """Positions of joints that turn look like degrees, where radians are expected.

    At least half of these joints move by more than four turns, or one by more than 16.
    The message names their columns. Convert positions, velocities and accelerations
    with ``np.deg2rad``.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import AngleUnitWarning
    >>> warnings.simplefilter("error", AngleUnitWarning)
    """


class BinaryTargetWarning(SkmtgpWarning, UserWarning):
    """The targets of an output have only two values, such as 0 and 1.

    A Gaussian process takes noise for normal, and here it is not. Predictions are of
    the mean, which may be below 0 or above 1. With ``noise="auto"`` all tasks have the
    same noise: that of a task with one step from one value to the other would be
    learned as zero.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import BinaryTargetWarning
    >>> warnings.simplefilter("ignore", BinaryTargetWarning)
    """


class ConstantTargetWarning(SkmtgpWarning, RuntimeWarning):
    """The targets of an output, of a task, or of a long run of its rows are all equal.

    A Gaussian process cannot know how much a constant output varies, and is certain of
    its predictions everywhere. A task whose targets are equal looks as if there were no
    noise, so the noise of all tasks is learned too small.

    Ten rows of a task or more that follow each other may be of a sensor that is stuck,
    if hardly any others of the task are equal. They follow each other in the order of
    fit, or of the input if there is one. Zeros and the ends of the range are not asked.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import ConstantTargetWarning
    >>> warnings.simplefilter("error", ConstantTargetWarning)
    """


class CorrelatedResidualsWarning(SkmtgpWarning, UserWarning):
    """Noise is correlated between neighbouring rows, in the order that fit was given.

    This is common if rows are a time series. Learning assumes that the noise of
    different rows is independent. So it learns some of the noise as if it were a
    function of the inputs. The noise variance and standard deviations of predictions
    are then too small. Scores of random folds, and of leaving out one row, are too
    good. A misfit looks the same if the rows are sorted by an input.

    Use folds that keep stretches of rows together,
    :class:`~skmtgp.model_selection.TaskStratifiedGroupKFold`. Choose a higher lower
    bound in `noise_variance_bounds` by these folds, or use fewer rows, farther apart.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import CorrelatedResidualsWarning
    >>> warnings.simplefilter("error", CorrelatedResidualsWarning)
    """


class DescriptorWarning(SkmtgpWarning, UserWarning):
    """The tasks are too few, or too alike, to determine the effect of each descriptor.

    A descriptor is the same for all tasks or follows from the others, or there are as
    many descriptors as tasks. The model explains the tasks that it has. It predicts a
    task that `fit` has not seen with the smallest coefficients that do so. More tasks
    or fewer descriptors help.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import DescriptorWarning
    >>> warnings.simplefilter("error", DescriptorWarning)
    """


class FarLevelsWarning(SkmtgpWarning, RuntimeWarning):
    """Levels of the tasks are so far apart that they may hide the functions.

    The means of tasks differ by more than ten thousand deviations of the targets around
    them, and could not be subtracted. The message says why. Subtract a typical value of
    each task from y before `fit`.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import FarLevelsWarning
    >>> warnings.simplefilter("error", FarLevelsWarning)
    """


class FixedCorrelationWarning(SkmtgpWarning, UserWarning):
    """The form of the task covariance fixes the correlations of all tasks.

    Independent tasks have correlation 0, one function of all tasks has 1, and rank 1
    has -1 or 1, whatever the rows say. An interval of a correlation then tells nothing
    of the tasks. A rank of 2 or more, or ``diagonal=True``, lets rows tell.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import FixedCorrelationWarning
    >>> warnings.simplefilter("error", FixedCorrelationWarning)
    """


class IncompleteDataWarning(SkmtgpWarning, RuntimeWarning):
    """Large data are almost complete, but have repeated or too many missing cells.

    Dense inference is exact for them, too, but takes far more time and memory than
    inference by Kronecker products. That needs data where no cell is observed
    repeatedly and few are missing. The message says how many are.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import IncompleteDataWarning
    >>> warnings.simplefilter("error", IncompleteDataWarning)  # before a long fit
    """


class JitterWarning(SkmtgpWarning, RuntimeWarning):
    """A covariance matrix was factorised only after adding to its diagonal.

    The message says how much was added.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import JitterWarning
    >>> warnings.simplefilter("error", JitterWarning)  # stop where it happens
    """


class LongFitWarning(SkmtgpWarning, UserWarning):
    """A fit will take minutes.

    It is given before learning begins. The message says about how long it will take,
    and what takes less time.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import LongFitWarning
    >>> warnings.simplefilter("ignore", LongFitWarning)
    """


class NarrowIntervalsWarning(SkmtgpWarning, UserWarning):
    """Rows are few for each hyperparameter, so intervals are too narrow.

    There are fewer than four rows for each hyperparameter, or fewer than eight with
    several kernels, with Dask's collections, with more than 500 hyperparameters, and
    with ``learning="staged"`` or "simultaneous". The rows leave the hyperparameters
    more uncertain than predictions count, and a 95 % interval may hold only 80 to 93 %
    of new observations, or 50 to 90 % in the other cases. Sampled hyperparameters count
    it, see :doc:`/guide/intervals`, and have better means, too. Rows with the same
    inputs and task count once here, and noise variances of tasks as one hyperparameter.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import NarrowIntervalsWarning
    >>> warnings.simplefilter("ignore", NarrowIntervalsWarning)
    """


class NegativeVarianceWarning(SkmtgpWarning, RuntimeWarning):
    """Variances of predictions are negative, by more than rounding explains.

    They are set to zero, and do not measure any error. Either the kernel is not
    positive semi-definite at these inputs, or its `diag` is not the diagonal of its
    values. Or the noise variance is so small that no correct digits are left. The
    message says how many variances are concerned.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import NegativeVarianceWarning
    >>> warnings.simplefilter("error", NegativeVarianceWarning)
    """


class OutlierWarning(SkmtgpWarning, UserWarning):
    """A few targets are far from all others of their task, or from what these say.

    Before learning: at most one row of ten of a task is 20 times as far from the median
    as the next one, or up to half of them, where one or two values repeat. They may be
    a code for a missing value, such as -999, another unit or a failed sensor. The noise
    is assumed to be Gaussian: one such row raises the noise so much that hardly
    anything else is learned of the task.

    After learning: rows are farther from what all other rows say, by
    :meth:`~skmtgp.MultiTaskGPRegressor.loo_predict`, than Gaussian noise is once in a
    thousand fits. They hide others, so look again after leaving them out.

    Leave out rows that are wrong. Where the values are right,
    ``target_transform=(np.log, np.exp)`` may suit them.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import OutlierWarning
    >>> warnings.simplefilter("error", OutlierWarning)
    """


class PrecisionWarning(SkmtgpWarning, RuntimeWarning):
    """Learning ended because the likelihood has too few correct digits to go on.

    It happens if the prior variance has grown to about 1e14 times the noise variance.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import PrecisionWarning
    >>> warnings.simplefilter("ignore", PrecisionWarning)
    """


class RowEffectsWarning(SkmtgpWarning, UserWarning):
    """Rows have effects of their own, which the tasks share and inputs do not tell.

    Where tasks are observed at the same inputs, as in a table with a column for each,
    a row may be a patient or a place: all its targets are high, or low. One kernel
    takes that for a very rough function of the inputs, and predictions of new rows
    return to the mean. A second kernel, by which a row is related to itself alone,
    leaves the first one to the inputs. The message names a model to try, with the noise
    and the units that this fit has chosen; of several outputs each has a message.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import RowEffectsWarning
    >>> warnings.simplefilter("error", RowEffectsWarning)
    """


class SamplingWarning(SkmtgpWarning, UserWarning):
    """Draws of the hyperparameters represent their posterior poorly.

    Chains move slowly, or stay near modes that they do not leave. The draws are then
    worth few independent ones, and intervals may be too narrow. The warning comes if
    the effective sample size is below 25, R-hat above 1.2, or more than 5 % of the
    trajectories diverged.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import SamplingWarning
    >>> warnings.simplefilter("error", SamplingWarning)
    """


class SeveralKernelsWarning(SkmtgpWarning, UserWarning):
    """Two kernels are likelier than the one that was learned.

    Functions that the tasks share vary at different speeds, or depend on different
    inputs. Or all tasks share a function of one input alone, as the shocks of a year,
    or the targets repeat in time, as seasons do. A list of kernels has length-scales
    for each, see `kernel` and `rank` of :class:`~skmtgp.MultiTaskGPRegressor`. The
    message names a model to try, with the noise and the units that this fit has chosen;
    of several outputs each has a message.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import SeveralKernelsWarning
    >>> warnings.simplefilter("error", SeveralKernelsWarning)
    """


class SkewedInputWarning(SkmtgpWarning, UserWarning):
    """The logarithm of an input that has many small values may be better.

    Such as of a dose, a concentration, a time after an event or an income. Functions
    are likelier along the logarithm by more than ten nats: they change fast at small
    values and slowly at large ones, and one length-scale does not suit both. Or the
    length-scale follows the small values, so that more than a fifth of the range is
    farther than a length-scale from all rows, and predictions there return to the mean.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import SkewedInputWarning
    >>> warnings.simplefilter("error", SkewedInputWarning)
    """


class SmallTaskWarning(SkmtgpWarning, UserWarning):
    """Some tasks have one to three rows in fit, and others have more.

    So few rows do not determine how a task is related to the others. Where two or more
    tasks have more rows, `fit` takes their rows of the factor for the population that a
    small task comes from, as ``add_task`` does, and its intervals count what its rows
    leave open. Predictions of such a task may still be off, and their intervals too
    narrow. ``hyperparameters="sampled"`` has wider ones.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import SmallTaskWarning
    >>> warnings.simplefilter("error", SmallTaskWarning)
    """


class TargetScaleWarning(SkmtgpWarning, UserWarning):
    """Targets that are never negative are far likelier on another scale.

    Noise or functions grow with the targets: prices, concentrations and counts often do
    so. A model of them has intervals that are too narrow where targets are large and
    too wide where they are small, down to below zero. Parameter `target_transform`
    takes a function and its inverse, and predictions stay in the units of the targets.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import TargetScaleWarning
    >>> warnings.simplefilter("error", TargetScaleWarning)
    """


class TaskColumnWarning(SkmtgpWarning, UserWarning):
    """The column that counts as the task column may be the wrong one, or need tidying.

    It has more tasks than half of the rows, of more than 20, or labels that differ in
    spaces or case alone, or, in cross-validation, a task of one row. Or it is the last
    column by default, and has integers and the name of a quantity, such as "hour" or
    "count"; or another column has integers and a name such as "site" or "patient_id";
    or the one before it looks more like labels, as if something had been appended to X.
    The message says what to do.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import TaskColumnWarning
    >>> warnings.simplefilter("error", TaskColumnWarning)
    """


class TaskUnitWarning(SkmtgpWarning, UserWarning):
    """A task that joins a fitted model seems to be measured in another unit.

    Its targets vary ten times as much as those of the known tasks, or less than a tenth
    of their noise, and the model has one unit for all tasks. Its intervals then hold
    far too much or too little. Convert the targets, or fit a model with
    ``normalize_y="per_task"`` to all rows, see :doc:`/guide/levels`.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import TaskUnitWarning
    >>> warnings.simplefilter("error", TaskUnitWarning)
    """


class UnderflowWarning(SkmtgpWarning, RuntimeWarning):
    """A feature or target is so small that squares of its values may vanish.

    If they vanish, the feature or target counts as constant. From about 1e-158 on they
    lose digits, and predictions do, too. Standard deviations in units of such a target
    mean nothing. Use other units to avoid this.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import UnderflowWarning
    >>> warnings.simplefilter("error", UnderflowWarning)
    """


class RepeatedRowsWarning(SkmtgpWarning, UserWarning):
    """Rows are there twice, as if measurements of the same agreed exactly.

    All rows with the same inputs have the same target, too. Or `sample_weight` counts
    some rows more than once, without `repeat_variance`, as bagging does. So the noise
    that is learned may be far too small, and with it the standard deviations of
    predictions.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import RepeatedRowsWarning
    >>> warnings.simplefilter("error", RepeatedRowsWarning)
    """


class UnidentifiedNoiseWarning(SkmtgpWarning, RuntimeWarning):
    """The rows do not determine the noise variance that was learned from them.

    The model follows the rows so closely that less than one degree of freedom is left
    for the noise. This is common with a few rows for each task. The noise variance may
    be too small by many orders of magnitude, and with it the standard deviations of
    predictions.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import UnidentifiedNoiseWarning
    >>> warnings.simplefilter("error", UnidentifiedNoiseWarning)
    """


class UnrelatedTasksWarning(SkmtgpWarning, UserWarning):
    """A model of each task by itself is likelier than the one that was learned.

    All tasks have the same kernel, and this one does not suit all of them: their
    functions depend on different inputs, or some vary faster than others. No two tasks
    are closely related. :class:`~skmtgp.SingleTaskGP` learns each task by itself, and
    :class:`~skmtgp.RankSearchIC` compares both.

    Examples
    --------
    >>> import warnings
    >>> from skmtgp.exceptions import UnrelatedTasksWarning
    >>> warnings.simplefilter("error", UnrelatedTasksWarning)
    """
