"""Metrics of multi-task regression, as the paper reports them."""

from __future__ import annotations

import inspect
import reprlib
from collections.abc import Callable, Mapping
from functools import partial
from numbers import Real
from typing import Any, Literal, TypeAlias, overload

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri
from sklearn.utils import check_consistent_length

from skmtgp._data.labels import Labels, check_labels
from skmtgp._data.numbers import as_array, check_numbers
from skmtgp._data.task_column import task_labels
from skmtgp._support.pipelines import at_the_end

__all__ = [
    "coverage",
    "make_coverage_scorer",
    "make_normalized_mse_scorer",
    "make_standardized_log_loss_scorer",
    "mean_standardized_log_loss",
    "normalized_mean_squared_error",
]

OF_OBSERVATIONS = {"return_std": True, "include_noise": True}
Variances: TypeAlias = Mapping[Any, ArrayLike] | pd.Series | pd.DataFrame  # by task


@overload
def normalized_mean_squared_error(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    *,
    tasks: ArrayLike | None = None,
    y_var: Variances | None = None,
    multioutput: Literal["uniform_average"] = "uniform_average",
) -> float: ...


@overload
def normalized_mean_squared_error(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    *,
    tasks: ArrayLike | None = None,
    y_var: Variances | None = None,
    multioutput: Literal["raw_values"],
) -> NDArray[np.float64]: ...


def normalized_mean_squared_error(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    *,
    tasks: ArrayLike | None = None,
    y_var: Variances | None = None,
    multioutput: Literal["raw_values", "uniform_average"] = "uniform_average",
) -> float | NDArray[np.float64]:
    r"""Mean squared error divided by the variance of the targets, averaged over tasks.

    .. math::
        \mathrm{nMSE} = \frac1M \sum_{m=1}^M
        \frac{\langle (y - \hat y)^2 \rangle_m}{\mathrm{Var}_m[y]}

    Parameters
    ----------
    y_true : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Targets.
    y_pred : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Predictions.
    tasks : array-like of shape (n_samples,), default=None
        Task of each sample. None is one task.
    y_var : mapping of task to float or to array of shape (n_outputs,), default=None
        Variance by which the errors of each task are divided, such as the Series or
        DataFrame ``y.groupby(tasks).var(ddof=0)``. None takes the variance of `y_true`.
        Only with `tasks`.
    multioutput : {"raw_values", "uniform_average"}, default="uniform_average"
        Whether to return one number for each output or their mean.

    Returns
    -------
    nmse : float or ndarray of shape (n_outputs,)
        0 is perfect. Predicting the mean of each task's own test targets has 1.

    Raises
    ------
    TypeError
        If `y_var` is no mapping.
    ValueError
        If the targets of a task are constant or a single sample, which cannot be
        normalised, or if `y_var` has no positive variance for a task.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "dividing the MSE by the
    variance of the test data. The nMSEs are then averaged over the 15 contexts".

    Examples
    --------
    >>> from skmtgp.metrics import normalized_mean_squared_error
    >>> normalized_mean_squared_error([0.0, 2.0, 10.0, 30.0], [0.0, 1.0, 10.0, 30.0],
    ...                               tasks=["a", "a", "b", "b"])
    0.25
    """
    _check_y_var(y_var)
    if y_var is not None and tasks is None:
        raise ValueError("y_var is of each task, but tasks is None: give both.")
    y_true, y_pred, by_task = _check(y_true, y_pred, tasks)
    if y_var is None:
        variances = _variances(y_true, by_task)
    else:
        variances = _given_variances(y_var, by_task, y_true.shape[1])
    errors = by_task.mean(np.square(y_true - y_pred))
    return _average((errors / variances).mean(axis=0), multioutput)


@overload
def mean_standardized_log_loss(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    y_std: ArrayLike,
    *,
    y_train: ArrayLike,
    tasks: ArrayLike | None = None,
    multioutput: Literal["uniform_average"] = "uniform_average",
) -> float: ...


@overload
def mean_standardized_log_loss(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    y_std: ArrayLike,
    *,
    y_train: ArrayLike,
    tasks: ArrayLike | None = None,
    multioutput: Literal["raw_values"],
) -> NDArray[np.float64]: ...


def mean_standardized_log_loss(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    y_std: ArrayLike,
    *,
    y_train: ArrayLike,
    tasks: ArrayLike | None = None,
    multioutput: Literal["raw_values", "uniform_average"] = "uniform_average",
) -> float | NDArray[np.float64]:
    r"""Negative log predictive density, minus that of a trivial model.

    .. math::
        \tfrac12 \log 2 \pi s^2 + \frac{(y - \hat y)^2}{2 s^2}

    is the loss of a sample with predictive standard deviation s. The loss with the mean
    and the standard deviation of the training targets is subtracted. The result is
    averaged within each task and then over tasks.

    Parameters
    ----------
    y_true, y_pred : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Targets and predictive means.
    y_std : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Positive standard deviations of the predicted targets, noise included.
    y_train : array-like of shape (n_train,) or (n_train, n_outputs)
        Training targets, which define the trivial model.
    tasks : array-like of shape (n_samples,), default=None
        Task of each sample. None is one task.
    multioutput : {"raw_values", "uniform_average"}, default="uniform_average"
        Whether to return one number for each output or their mean.

    Returns
    -------
    msll : float or ndarray of shape (n_outputs,)
        In nats. 0 is as good as the trivial model; lower is better.

    Raises
    ------
    ValueError
        If a standard deviation is not positive, or if an output is constant in
        training.

    Notes
    -----
    Rasmussen and Williams (2006), section 2.5.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.metrics import mean_standardized_log_loss
    >>> y = np.array([-1.0, 1.0])
    >>> mean_standardized_log_loss(y, [0.0, 0.0], [1.0, 1.0], y_train=y)
    0.0
    """
    y_true, y_pred, by_task = _check(y_true, y_pred, tasks)
    y_std = _check_std(y_std, y_true)
    loss = _log_loss(y_true, y_pred, y_std)
    return _average(_standardized(loss, y_true, y_train, by_task), multioutput)


@overload
def coverage(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    y_std: ArrayLike,
    *,
    level: float = 0.95,
    tasks: ArrayLike | None = None,
    multioutput: Literal["uniform_average"] = "uniform_average",
) -> float: ...


@overload
def coverage(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    y_std: ArrayLike,
    *,
    level: float = 0.95,
    tasks: ArrayLike | None = None,
    multioutput: Literal["raw_values"],
) -> NDArray[np.float64]: ...


def coverage(
    y_true: ArrayLike,
    y_pred: ArrayLike,
    y_std: ArrayLike,
    *,
    level: float = 0.95,
    tasks: ArrayLike | None = None,
    multioutput: Literal["raw_values", "uniform_average"] = "uniform_average",
) -> float | NDArray[np.float64]:
    r"""Share of the targets inside the central interval of the predictive normal.

    .. math::
        \frac1M \sum_{m=1}^M \bigl\langle \,
        |y - \hat y| \le s\, \Phi^{-1}\bigl(\tfrac{1 + p}{2}\bigr)
        \,\bigr\rangle_m

    for a level p and predictive standard deviations s.

    Parameters
    ----------
    y_true, y_pred : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Targets and predictive means.
    y_std : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Positive standard deviations of the predicted targets, noise included.
    level : float, default=0.95
        Probability p of the interval, between 0 and 1.
    tasks : array-like of shape (n_samples,), default=None
        Task of each sample. None is one task.
    multioutput : {"raw_values", "uniform_average"}, default="uniform_average"
        Whether to return one number for each output or their mean.

    Returns
    -------
    share : float or ndarray of shape (n_outputs,)
        0 to 1, averaged within each task and then over tasks. It is about `level` if
        the model knows its errors, and less if it is overconfident.

    Raises
    ------
    ValueError
        If `level` is not between 0 and 1 or a standard deviation is not positive.

    Examples
    --------
    >>> from skmtgp.metrics import coverage
    >>> coverage([0.0, 1.0, 3.0, 0.5], [0.0] * 4, [1.0] * 4)
    0.75
    """
    _check_level(level)
    y_true, y_pred, by_task = _check(y_true, y_pred, tasks)
    y_std = _check_std(y_std, y_true)
    inside = np.abs(y_true - y_pred) <= y_std * ndtri(0.5 + 0.5 * level)
    return _average(_shares(inside, by_task), multioutput)


def make_normalized_mse_scorer(
    task_feature: int | str = -1, *, y_var: Variances | None = None
) -> Callable[[Any, ArrayLike, ArrayLike], float]:
    """Scorer for model selection: minus the nMSE, averaged over tasks and outputs.

    Parameters
    ----------
    task_feature : int or str, default=-1
        Position or name of the task column of X. A WideRegressor has none: its tasks
        are the columns of y.
    y_var : mapping of task to float or to array of shape (n_outputs,), default=None
        Variance by which the errors of each task are divided, such as the Series or
        DataFrame ``y.groupby(tasks).var(ddof=0)`` of all targets. None takes the
        variance of the scored targets.

    Returns
    -------
    scorer : callable
        ``scorer(estimator, X, y)`` returns minus :func:`normalized_mean_squared_error`
        of ``estimator.predict(X)``. Greater is better and 0 is perfect. Pass it as
        `scoring`.

    Raises
    ------
    TypeError
        If `y_var` is no mapping.

    Notes
    -----
    Without `y_var`, every task in a test fold must have at least two different targets.
    So split the rows within tasks, into at most half as many folds as the smallest task
    has rows.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from sklearn.model_selection import cross_val_score
    >>> from skmtgp.metrics import make_normalized_mse_scorer
    >>> X = np.column_stack([np.arange(12.0), np.tile([1, 2], 6)])
    >>> y = X[:, 0] + X[:, 1]
    >>> scorer = make_normalized_mse_scorer()
    >>> scores = cross_val_score(LinearRegression(), X, y, scoring=scorer, cv=3)
    >>> bool(np.all(scores > -1e-12))
    True

    Where folds hold one row of a small task, the variance of all its targets:

    >>> import pandas as pd
    >>> y_var = pd.Series(y).groupby(X[:, -1]).var(ddof=0)
    >>> scorer = make_normalized_mse_scorer(y_var=y_var)
    >>> scores = cross_val_score(LinearRegression(), X, y, scoring=scorer, cv=12)
    >>> bool(np.all(scores > -1e-12))
    True
    """
    _check_y_var(y_var)
    return partial(_minus_nmse, task_feature=task_feature, y_var=y_var)


def make_standardized_log_loss_scorer(
    y_train: ArrayLike, task_feature: int | str = -1
) -> Callable[[Any, ArrayLike, ArrayLike], float]:
    """Scorer for model selection: minus the MSLL, averaged over tasks and outputs.

    Parameters
    ----------
    y_train : array-like of shape (n_train,) or (n_train, n_outputs)
        Targets whose mean and variance define the trivial model. In cross-validation
        all targets may be used, because they shift the scores of all models equally.
    task_feature : int or str, default=-1
        Position or name of the task column of X. A WideRegressor has none: its tasks
        are the columns of y.

    Returns
    -------
    scorer : callable
        ``scorer(estimator, X, y)`` returns the mean log density of y, less that of the
        trivial model, in nats. Greater is better and 0 is the trivial model. Pass it as
        `scoring`.

    Raises
    ------
    TypeError
        If `y_train` is not an array of numbers.

    Notes
    -----
    The density is that of ``estimator.log_predictive_density(X, y)``, which knows draws
    of hyperparameters, Student's t and `target_transform`. An estimator that has no
    such method is scored by minus :func:`mean_standardized_log_loss` of
    ``estimator.predict(X, return_std=True, include_noise=True)``. The scorer raises a
    ValueError for a y in which the inverse of `target_transform` ends, such as 0 of a
    root: its density is infinite.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import BayesianLinearRegression
    >>> from skmtgp.metrics import make_standardized_log_loss_scorer
    >>> X = np.column_stack([np.arange(12.0), np.tile([1, 2], 6)])
    >>> y = X[:, 0] + np.sin(5 * X[:, 0])
    >>> model = BayesianLinearRegression(noise_rate=0.1).fit(X, y)
    >>> bool(make_standardized_log_loss_scorer(y)(model, X, y) > 1.0)
    True
    """
    _check_y_train(y_train)
    return partial(_minus_msll, y_train=y_train, task_feature=task_feature)


def make_coverage_scorer(
    level: float = 0.95, task_feature: int | str = -1
) -> Callable[[Any, ArrayLike, ArrayLike], float]:
    """Scorer for model selection: minus the error of the coverage.

    Parameters
    ----------
    level : float, default=0.95
        Probability of the interval, between 0 and 1.
    task_feature : int or str, default=-1
        Position or name of the task column of X. A WideRegressor has none: its tasks
        are the columns of y.

    Returns
    -------
    scorer : callable
        ``scorer(estimator, X, y)`` returns minus the absolute difference between
        `level` and the share of y in ``estimator.predict_interval(X, level)``, averaged
        over tasks. 0 is perfect. Pass it as `scoring`. An estimator without such a
        method is scored by :func:`coverage` of ``estimator.predict(X, return_std=True,
        include_noise=True)``.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import BayesianLinearRegression
    >>> from skmtgp.metrics import make_coverage_scorer
    >>> X = np.column_stack([np.arange(12.0), np.tile([1, 2], 6)])
    >>> y = X[:, 0] + np.sin(5 * X[:, 0])
    >>> model = BayesianLinearRegression(noise_rate=0.1).fit(X, y)
    >>> round(make_coverage_scorer(0.95)(model, X, y), 2)
    -0.05
    """
    _check_level(level, _column_meant(level))
    return partial(_minus_miscoverage, level=level, task_feature=task_feature)


def _minus_msll(estimator, X, y, *, y_train, task_feature):
    model, rows = at_the_end(estimator, X)
    if not hasattr(model, "log_predictive_density"):
        y, tasks, found = _compared(estimator, X, y, task_feature, **OF_OBSERVATIONS)
        return -mean_standardized_log_loss(y, *found, y_train=y_train, tasks=tasks)
    log_density = model.log_predictive_density(rows, y)
    y, tasks, [log_density] = _measured(model, X, y, task_feature, log_density)
    _refuse_infinite(y, log_density)
    if _is_wide(model):
        y_train = np.ravel(as_array(y_train)).astype(np.float64)
        y_train = y_train[~np.isnan(y_train)]
    y, _, by_task = _check(y, y, tasks)
    return -float(
        _standardized(-log_density.reshape(y.shape), y, y_train, by_task).mean()
    )


def _refuse_infinite(y, log_density):
    for value in as_array(y)[log_density == np.inf][:1]:
        raise ValueError(
            f"The predictive density of y = {value} is infinite: the inverse of "
            "target_transform ends there. Give a transform without such an end, such "
            "as (np.log1p, np.expm1), or score the coverage."
        )


def _minus_miscoverage(estimator, X, y, *, level, task_feature):
    model, rows = at_the_end(estimator, X)
    if not hasattr(model, "predict_interval"):
        y, tasks, found = _compared(estimator, X, y, task_feature, **OF_OBSERVATIONS)
        return -abs(coverage(y, *found, level=level, tasks=tasks) - level)
    ends = model.predict_interval(rows, level)
    y, tasks, ends = _measured(model, X, y, task_feature, *ends)
    y, _, by_task = _check(y, y, tasks)
    lower, upper = (end.reshape(y.shape) for end in ends)
    return -abs(float(_shares((lower <= y) & (y <= upper), by_task).mean()) - level)


def _minus_nmse(estimator, X, y, *, task_feature, y_var):
    y, tasks, [mean] = _compared(estimator, X, y, task_feature)
    return -normalized_mean_squared_error(y, mean, tasks=tasks, y_var=y_var)


def _compared(estimator, X, y, task_feature, **options):
    """Targets, the task of each, and what `predict` returns of it."""
    model, rows = at_the_end(estimator, X)
    missing = sorted(options.keys() - _parameters(model.predict))
    if missing:
        raise TypeError(
            f"predict of {type(model).__name__} takes no {' and no '.join(missing)}. "
            "The scorer needs deviations of new observations: use a model of skmtgp."
        )
    found = model.predict(rows, **options)
    return _measured(model, X, y, task_feature, *(found if options else [found]))


def _measured(model, X, y, task_feature, *found):
    """Targets, the task of each, and what was found of it.

    The columns of y are the tasks of a WideRegressor, and gaps are left out.
    """
    if not _is_wide(model):
        return y, task_labels(X, task_feature).of_rows(), found
    table = model._targets(y)
    check_consistent_length(table, X)
    measured = ~np.isnan(table)
    tasks = np.broadcast_to(model.outputs_, table.shape)[measured]
    found = [of.reshape(table.shape)[measured] for of in found]
    return table[measured], tasks, found


def _parameters(method):
    """Names of the parameters of a method; all that may be asked for, if it has any."""
    parameters = inspect.signature(method).parameters.values()
    if any(of.kind is of.VAR_KEYWORD for of in parameters):
        return set(OF_OBSERVATIONS)
    return {of.name for of in parameters}


def _is_wide(model):
    """Whether it is a WideRegressor, whose tasks are columns of y."""
    return hasattr(model, "outputs_")


def _standardized(loss, y_true, y_train, by_task):
    """Losses less those of a trivial model, averaged over tasks for each output."""
    y_train = _columns(y_train, "y_train")
    _check_outputs(y_true, y_train, "y_train")
    if _constant(y_train).any():
        raise ValueError("y_train is constant, so there is no trivial model.")
    trivial = _log_loss(y_true, y_train.mean(axis=0), y_train.std(axis=0))
    return by_task.mean(loss - trivial).mean(axis=0)


def _shares(inside, by_task):
    """Shares of targets inside of intervals, averaged over tasks for each output."""
    return by_task.mean(inside.astype(np.float64)).mean(axis=0)


def _variances(targets, by_task):
    """Of the targets of each task, for each output."""
    lowest, highest = (by_task.reduce(of, targets) for of in (np.minimum, np.maximum))
    constant = (lowest == highest).any(axis=1)  # a variance would hold rounding errors
    if constant.any():
        _refuse_constant(by_task, int(constant.argmax()))
    centred = targets - by_task.mean(targets)[by_task.codes]
    return by_task.mean(np.square(centred))


def _refuse_constant(by_task, position):
    why, advice = "", ""
    if by_task.counts[position] == 1:
        why = ", as there is one sample"
        advice = (
            " In cross-validation take fewer folds, give y_var, such as "
            "y.groupby(tasks).var(ddof=0) of all targets, or score cross_val_predict's "
            "predictions at once."
        )
    raise ValueError(
        f"The targets of task {by_task.tasks[position]!r} are constant{why}, so their "
        "errors cannot be normalised by their variance. Leave that task out."
        f"{advice}"
    )


def _check_y_var(y_var):
    if y_var is not None and not hasattr(y_var, "items"):
        raise TypeError(
            f"y_var={reprlib.repr(y_var)} must be a mapping of task to variance, such "
            "as the Series y.groupby(tasks).var(ddof=0)."
        )


def _given_variances(y_var, by_task, n_outputs):
    """Those of the user's for each task and output."""
    # The columns of a frame are outputs.
    given = dict((y_var.T if isinstance(y_var, pd.DataFrame) else y_var).items())
    return [_given_variance(task, given, n_outputs) for task in by_task.tasks]


def _given_variance(task, variances, n_outputs):
    if task not in variances:
        known = reprlib.repr(list(variances))
        raise ValueError(f"y_var has no variance of task {task!r}; it has {known}.")
    variance = np.atleast_1d(np.asarray(variances[task], dtype=np.float64))
    if variance.shape != (n_outputs,):
        raise ValueError(
            f"y_var of task {task!r} has shape {variance.shape}, not one variance for "
            f"each of {n_outputs} outputs."
        )
    if not ((variance > 0.0) & np.isfinite(variance)).all():
        raise ValueError(
            f"y_var of task {task!r} is {variances[task]!s}, but must be positive."
        )
    return variance


def _log_loss(y, mean, std):
    return 0.5 * np.square((y - mean) / std) + np.log(std) + 0.5 * np.log(2.0 * np.pi)


def _columns(y, name) -> NDArray[np.float64]:
    y = check_numbers(y, name)
    return y[:, None] if y.ndim == 1 else y


def _constant(y):
    return y.min(axis=0) == y.max(axis=0)  # a variance would hold rounding errors


def _check_outputs(y_true, other, name):
    if y_true.shape[1] != other.shape[1]:
        raise ValueError(
            f"y_true has {y_true.shape[1]} outputs and {name} has {other.shape[1]}."
        )


def _check_level(level, advice=""):
    if not isinstance(level, Real) or not 0.0 < level < 1.0:
        raise ValueError(f"level={level!r} must be a number between 0 and 1.{advice}")


def _check_y_train(y_train):
    try:
        is_array = np.asarray(y_train, dtype=np.float64).ndim > 0
    except (TypeError, ValueError):
        is_array = False
    if not is_array:
        raise TypeError(
            f"y_train={reprlib.repr(y_train)} must be the training targets, an array "
            f"of numbers.{_column_meant(y_train)}"
        )


def _column_meant(value):
    """Advice where a name came in place of what is the first argument."""
    return f" Did you mean task_feature={value!r}?" if isinstance(value, str) else ""


def _check_std(y_std, y_true) -> NDArray[np.float64]:
    y_std = _columns(y_std, "y_std")
    check_consistent_length(y_true, y_std)
    _check_outputs(y_true, y_std, "y_std")
    if not (y_std > 0.0).all():
        raise ValueError(f"y_std must be positive; its minimum is {y_std.min()!s}.")
    return y_std


class _ByTask:
    """Sums over the rows of each task.

    Parameters
    ----------
    labels : Labels
        The task of each row.
    """

    def __init__(self, labels):
        self.tasks, self.codes = labels.tasks.tolist(), labels.codes
        self.counts = np.bincount(labels.codes)
        self._order = np.argsort(labels.codes, kind="stable")
        self._starts = np.cumsum(self.counts) - self.counts

    def reduce(self, function, values):
        """A ufunc over the rows of each task, of shape (n_tasks, n_outputs)."""
        rows = np.ascontiguousarray(values[self._order].T)  # sums in pairs, exacter
        return function.reduceat(rows, self._starts, axis=1).T

    def mean(self, values):
        """Of shape (n_tasks, n_outputs)."""
        return self.reduce(np.add, values) / self.counts[:, None]


def _check(y_true, y_pred, tasks):
    """Targets and predictions as columns, and what sums them by task."""
    y_true, y_pred = _columns(y_true, "y_true"), _columns(y_pred, "y_pred")
    check_consistent_length(y_true, y_pred)
    _check_outputs(y_true, y_pred, "y_pred")
    if tasks is None:
        labels = Labels(np.array(["all"]), np.zeros(len(y_true), dtype=int))
    else:
        labels = check_labels(tasks)
    check_consistent_length(y_true, labels.codes)
    return y_true, y_pred, _ByTask(labels)


def _average(per_output, multioutput):
    if multioutput == "raw_values":
        return per_output
    if multioutput == "uniform_average":
        return float(per_output.mean())
    raise ValueError(
        f"multioutput={multioutput!r} must be 'raw_values' or 'uniform_average'."
    )
