"""What the displays ask of estimators: the model inside, its tasks, its predictions."""

from copy import copy
from numbers import Integral

import numpy as np
from numpy.typing import NDArray
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.descriptors import locate_descriptors
from skmtgp._data.labels import Labels, check_labels
from skmtgp._data.numbers import check_numbers
from skmtgp._data.order import refuse_another_order
from skmtgp._data.task_column import task_labels
from skmtgp._estimators.targets import AS_GIVEN
from skmtgp._support.pipelines import at_the_end, end_of
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.wide import WideRegressor

PREDICTED = ", or give its predictions to from_predictions"


def fitted_model(estimator):
    """The model at the end of a pipeline, inside a search, or of stacked columns.

    Parameters
    ----------
    estimator : estimator
        A model, a Pipeline, a RankSearchIC or a search such as GridSearchCV.

    Returns
    -------
    model : estimator
        The model.

    Raises
    ------
    NotFittedError
        If it was not fitted.
    """
    model = _last(estimator)
    check_is_fitted(model)
    return model


def _last(estimator):
    model = end_of(estimator)
    is_wide = isinstance(model, WideRegressor) and hasattr(model, "estimator_")
    return _last(model.estimator_) if is_wide else model


def _refuse_wide(estimator):
    """Raise a TypeError where an estimator takes no rows with a task."""
    if isinstance(estimator, Pipeline):
        _refuse_wide(estimator[-1])
    elif isinstance(estimator, WideRegressor):
        raise TypeError(
            "WideRegressor has a column for each task, and this display takes rows "
            "with a task: pass estimator_ of the WideRegressor, and X and y as "
            "stack_tasks makes them."
        )
    elif hasattr(estimator, "estimator"):
        _refuse_wide(estimator.estimator)


def model_of_tasks(estimator, instead=""):
    """The fitted model, which must be one of skmtgp; `instead` tells what else."""
    model = fitted_model(estimator)
    if not hasattr(model, "tasks_"):
        name = type(model).__name__
        raise TypeError(f"{name} is no model of skmtgp: pass one that is{instead}.")
    return model


def model_with(attribute, estimator, instead):
    """The fitted model, which must have an attribute; `instead` tells what to do."""
    model = fitted_model(estimator)
    if not hasattr(model, attribute):
        name = type(model).__name__
        raise TypeError(f"{name} has no {attribute.rstrip('_')}: {instead}")
    return model


def has_own_units(estimator):
    """Whether a fitted model learned the tasks in units of their own."""
    return getattr(fitted_model(estimator), "normalize_y_", None) == "per_task"


def select_output(values, output, axis=-1):
    """One output of an array that has an axis of outputs.

    Parameters
    ----------
    values : ndarray
        Of a model with several outputs.
    output : int
        Which of them.
    axis : int, default=-1
        That of the outputs.

    Returns
    -------
    selected : ndarray
        Without that axis.
    """
    check_output(output, values.shape[axis])
    return np.take(values, output, axis=axis)


def check_output(output, n_outputs, name="output"):
    """Raise a ValueError unless there is such an output, or such a term."""
    is_int = isinstance(output, Integral) and not isinstance(output, bool)
    if not is_int or not 0 <= output < n_outputs:
        there = f"are {n_outputs} {name}s" if n_outputs > 1 else f"is one {name}"
        allowed = f"an integer from 0 to {n_outputs - 1}" if n_outputs > 1 else "0"
        raise ValueError(f"{name}={output!r} must be {allowed}, as there {there}.")


def _as_learned(estimator):
    """The estimator whose predictions stay as `target_transform` made the targets."""
    model = copy(estimator)
    vars(model).pop("_target", None)
    return model


def predictions(estimator, X, y, output, *, learned=False):
    """Targets of one output and what is predicted of new observations.

    Parameters
    ----------
    estimator : estimator
        Fitted.
    X : array-like of shape (n_samples, n_features)
        Inputs.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Targets.
    output : int
        Which of them.
    learned : bool, default=False
        Whether all are as `target_transform` makes the targets, where predictions are
        normal, rather than in units of y.

    Returns
    -------
    y_true, y_mean, y_std : ndarrays of shape (n_samples,)
        Targets, predictive means and standard deviations, with the noise.

    Raises
    ------
    NotFittedError
        If the estimator was not fitted.
    TypeError
        If it is no model of this package.
    ValueError
        If y has not the outputs of the model, or not this one, or if it has the index
        labels of X in another order.
    """
    _refuse_wide(estimator)
    target = model_of_tasks(estimator, PREDICTED)._target
    refuse_another_order(X, y)
    model, rows = at_the_end(estimator, X)
    if learned and target is not AS_GIVEN:
        model = _as_learned(model)
    mean, std = model.predict(rows, return_std=True, include_noise=True)
    y = check_numbers(y, "y")
    if y.shape != mean.shape:
        raise ValueError(
            f"y has shape {y.shape}, but the predictions have shape {mean.shape}."
        )
    columns = [values.reshape(len(mean), -1) for values in (y, mean, std)]
    if learned:
        columns[0] = target.forward(columns[0])
    return tuple(select_output(values, output) for values in columns)


def intervals(estimator, X, level):
    """Means, and intervals of new observations.

    Parameters
    ----------
    estimator : estimator
        Fitted model, or a Pipeline or search that ends with one.
    X : array-like of shape (n_samples, n_features)
        Inputs.
    level : float
        Probability of the intervals.

    Returns
    -------
    mean, lower, upper : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        In units of y.

    Raises
    ------
    TypeError
        If the model has no intervals.
    """
    _refuse_wide(estimator)
    instead = "draw what it predicts by hand."
    model, X = at_the_end(estimator, X)
    model = model_with("predict_interval", model, instead)
    return (model.predict(X), *model.predict_interval(X, level))


def task_column(estimator, X, task_feature=None):
    """Position or name of the task column of the X that an estimator takes.

    Parameters
    ----------
    estimator : estimator
        Fitted or not.
    X : array-like of shape (n_samples, n_features)
        Inputs.
    task_feature : int or str, default=None
        What the user says.

    Returns
    -------
    task_feature : int or str
        The user's, or else that of the estimator or of a pipeline's first step, or
        that of its last step where X has a column of that name.

    Raises
    ------
    ValueError
        If none tells it.
    """
    _refuse_wide(estimator)
    if task_feature is not None:
        return task_feature
    first = _step(estimator, 0)
    if hasattr(first, "task_feature"):
        return first.task_feature
    name = getattr(_step(estimator, -1), "task_feature", None)
    if isinstance(name, str) and name in getattr(X, "columns", ()):
        return name
    raise ValueError(
        f"{type(first).__name__} does not tell which column of X holds the tasks: pass "
        "task_feature, its position or name."
    )


def columns_of_descriptors(estimator, task, n_features, names=None):
    """Positions of the columns of X that describe tasks, as the first step says.

    Parameters
    ----------
    estimator : estimator
        Fitted or not.
    task : int
        Position of the task column.
    n_features : int
        Number of columns.
    names : list of n_features, default=None
        Their names, if they have any.

    Returns
    -------
    positions : list of int
    """
    described = getattr(_step(estimator, 0), "task_descriptors", None)
    if described is None:
        return []
    columns = locate_descriptors(described, task, n_features, names)
    return np.delete(np.arange(n_features), task)[columns].tolist()


def _step(estimator, position):
    """What a pipeline, perhaps inside a search, begins or ends with."""
    if isinstance(estimator, Pipeline):
        return _step(estimator[position], position)
    if hasattr(estimator, "task_feature") or not hasattr(estimator, "estimator"):
        return estimator
    if estimator.estimator is None:  # of a RankSearchIC
        return MultiTaskGPRegressor()
    return _step(estimator.estimator, position)


def tasks_of(estimator, X, task_feature=None):
    """The task of each row of the X that an estimator takes."""
    return task_labels(X, task_column(estimator, X, task_feature)).of_rows()


def check_vector(values, name) -> NDArray[np.float64]:
    """Numbers, one for each sample."""
    values = check_numbers(values, name)
    if values.ndim != 1:
        raise ValueError(
            f"{name} has shape {values.shape}, but must have shape (n_samples,): pass "
            "one output."
        )
    return values


def check_tasks(tasks, n_samples):
    """The tasks of samples; a single one where there are none."""
    if tasks is None:
        return Labels(np.array(["all"]), np.zeros(n_samples, dtype=int))
    return check_labels(tasks)
