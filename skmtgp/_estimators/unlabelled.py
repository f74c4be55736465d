"""X of an unknown task, as a fitted model takes it.

Transformers and models want the columns that they were fitted to, those of the task
among them. So a known task's label and descriptors are put in their place; what they
are does not matter to the inputs of the kernel.
"""

import numpy as np
import pandas as pd
from sklearn.pipeline import Pipeline

from skmtgp._data.checks import check_test
from skmtgp._data.descriptors import locate_descriptors
from skmtgp._data.numbers import as_frame
from skmtgp._data.task_column import locate, locate_task_column
from skmtgp._estimators.compiled import are_label, place_of_task


def inputs_of_any_task(estimator, model, X):
    """Inputs of the kernel of rows whose task is not known, or does not count.

    Parameters
    ----------
    estimator : Pipeline or BaseMultiTaskGP
        What takes X.
    model : BaseMultiTaskGP
        Its last step, or itself.
    X : array-like of shape (n_samples, n_features)
        As in `fit`, with or without the task's column and its descriptors.

    Returns
    -------
    inputs : ndarray of shape (n_samples, n_inputs)

    Raises
    ------
    TypeError
        If the transformers do not leave a task's label as it is.
    ValueError
        If X lacks columns.
    """
    steps = estimator.steps[:-1] if isinstance(estimator, Pipeline) else []
    steps = [step for _, step in steps if step not in (None, "passthrough")]
    if steps and not hasattr(steps[0], "task_feature"):
        X, steps = _transformed(steps, model, X), []
    table = _transform(steps, _with_task([*steps, model][0], model, X))
    features, _ = check_test(model, table)
    return (
        features if model._descriptors is None else model._descriptors.inputs(features)
    )


def _transform(steps, table):
    """What transformers make of a table, one after another."""
    for step in steps:
        table = step.transform(table)
    return table


def _transformed(steps, model, X):
    """What transformers make of X that know no tasks, such as a ColumnTransformer."""
    if not hasattr(steps[0], "n_features_in_"):
        _refuse_steps(steps)
    place, (position, _) = place_of_task(steps[0], model), locate(model)
    X = as_frame(X)
    X = X if isinstance(X, pd.DataFrame) else np.asarray(X)
    label, other = model.tasks_[[0, -1]].tolist()
    table = _transform(steps, _with_label(steps[0], place, model, X, label))
    probe = _transform(steps, _with_label(steps[0], place, model, X[:1], other))
    for found, expected in [(table, label), (probe, other)]:
        columns = found.iloc if isinstance(found, pd.DataFrame) else found
        if not are_label(columns[:, position], expected):
            _refuse_steps(steps)
    return table


def _refuse_steps(steps):
    names = ", ".join(type(step).__name__ for step in steps)
    raise TypeError(
        "TaskIdentifier takes a Pipeline whose transformers leave the labels of the "
        f"tasks as they are, and cannot tell which column of X has them before {names}."
        " Make it the last column of X and of what the transformers make of it. Or fit "
        "the Pipeline to frames, with set_output(transform='pandas') of the "
        "transformers, and name the column by task_feature of the model."
    )


def _with_label(first, place, model, X, label):
    """X with the label of a task, as a first step takes it that knows no tasks."""
    names, n = getattr(first, "feature_names_in_", None), first.n_features_in_
    if isinstance(X, pd.DataFrame) and names is not None:
        given, known = model._descriptors, {names[place]: label}
        if given is not None:  # any will do: those of a known task follow
            pairs = zip(given.names.tolist(), given.table[0].tolist(), strict=True)
            known = {name: of for name, of in pairs if name not in X.columns} | known
        return _with_columns(X, known, names)
    table = np.asarray(X)
    if table.ndim != 2 or table.shape[1] not in (n, n - 1):
        raise ValueError(
            f"X has shape {table.shape}, but must have {n} columns, as the model takes "
            f"them, or {n - 1}, without the task."
        )
    if isinstance(label, (str, bool)):
        table = table.astype(object)
    others = np.delete(table, place, axis=1) if table.shape[1] == n else table
    return np.insert(others, place, label, axis=1)


def _with_columns(X, known, names):
    """The columns of a frame with these names, of which some are known."""
    missing = [name for name in names if name not in {*known, *X.columns}]
    if missing:
        raise ValueError(f"X lacks the columns {missing} that the model takes.")
    return X.assign(**known)[list(names)]


def _with_task(first, model, X):
    """X with the columns of a known task, as the first step takes them."""
    names, n = getattr(first, "feature_names_in_", None), first.n_features_in_
    position = locate_task_column(first.task_feature, n, names)
    columns, values = [position], [model.tasks_[0].item()]
    if first.task_descriptors is not None:
        given = first.task_descriptors, position, n, names
        columns += np.delete(np.arange(n), position)[
            locate_descriptors(*given)
        ].tolist()
        values += model._descriptors.table[0].tolist()
    X = as_frame(X)
    if isinstance(X, pd.DataFrame) and names is not None:
        return _with_columns(X, dict(zip(names[columns], values, strict=True)), names)
    table = np.asarray(X)
    others = np.delete(np.arange(n), columns)
    if table.ndim != 2 or table.shape[1] not in (n, len(others)):
        raise ValueError(
            f"X has shape {table.shape}, but must have {n} columns, as the model takes "
            f"them, or {len(others)}, without the task and its descriptors."
        )
    full = np.empty((len(table), n), dtype=object)
    full[:, columns] = values
    full[:, others] = table if len(others) == table.shape[1] else table[:, others]
    return full
