"""Descriptors of tasks: columns of X that are constant within a task."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from skmtgp._data.labels import rows_by_code
from skmtgp._data.task_column import locate_columns
from skmtgp._numerics.linalg import RESOLVED, svd
from skmtgp._support.warnings import warn
from skmtgp.exceptions import DescriptorWarning

SAME = 1e-9  # of its deviation over tasks: what a descriptor may differ by when read


def locate_descriptors(task_descriptors, position, n_features, names=None):
    """Positions of the descriptors among the columns without that of the task.

    Parameters
    ----------
    task_descriptors : sequence of int or str
        Positions or names of columns of X.
    position : int
        That of the task column.
    n_features : int
        Number of columns, the task column counted.
    names : sequence of str, default=None
        Names of the columns, if they have any.

    Returns
    -------
    columns : ndarray of shape (n_descriptors,)

    Raises
    ------
    TypeError
        If one is neither an int nor a str.
    ValueError
        If there is no such column, if one is the task column or given twice, or if no
        column is left.
    """
    columns = locate_columns(
        task_descriptors,
        "task_descriptors",
        position,
        n_features,
        names,
        "a label describes nothing.",
    )
    if len(columns) == n_features - 1:
        raise ValueError(
            f"task_descriptors={list(task_descriptors)!r} leaves no column of X for "
            "the inputs of the kernel; give at least 1."
        )
    return columns


@dataclass(frozen=True)
class Descriptors:
    """What is known of each task.

    Attributes
    ----------
    columns : ndarray of shape (n_descriptors,)
        Where they are among the columns of X without the task's.
    names : ndarray of shape (n_descriptors,)
        Names of the columns, or their positions in X.
    table : ndarray of shape (n_tasks, n_descriptors)
        Their values.
    learned : ndarray of shape (n_learned, n_descriptors)
        The same of the tasks that the model was learned from, in whose units they are.
    """

    columns: np.ndarray
    names: np.ndarray
    table: np.ndarray
    learned: np.ndarray

    def inputs(self, features):
        """The other columns."""
        return np.delete(features, self.columns, axis=1)

    def with_inputs(self, inputs, values):
        """The columns that inputs and descriptors of one row come from."""
        row = np.empty(len(inputs) + len(values))
        row[self.columns], row[np.delete(np.arange(len(row)), self.columns)] = (
            values,
            inputs,
        )
        return row

    @cached_property
    def centre(self):
        """Mean of each over the tasks."""
        return self.learned.mean(axis=0)

    @cached_property
    def scale(self):
        """Deviation of each over the tasks; infinite where it is always the same."""
        deviation = self.learned.std(axis=0)
        varies = deviation > RESOLVED * np.abs(self.learned).max(axis=0)
        return np.where(varies, deviation, np.inf)

    @cached_property
    def whitening(self):
        """From [1, standardised descriptors] to rows of Q, with Q^T Q = n_tasks I.

        Linear maps of the descriptors make no difference then, and descriptors that go
        together are no trouble. It has as many columns as can be told apart.
        """
        D = self._standardised(self.learned)
        _, S, V = svd(D)
        kept = S / S[0] > RESOLVED
        return V[kept].T * (np.sqrt(len(D)) / S[kept])

    def _standardised(self, table):
        z = (table - self.centre) / self.scale
        return np.column_stack([np.ones(len(z)), z])

    def rows(self, table):
        """Rows of Q, of shape (n_tasks, n_rows), of descriptors of any tasks."""
        return self._standardised(table) @ self.whitening

    @property
    def n_rows(self):
        """How many columns Q has, which B has rows."""
        return self.whitening.shape[1]

    @property
    def Q(self):
        """Those of the tasks."""
        return self.rows(self.table)

    def with_task(self, values, position):
        """The same with one more task, in the same units."""
        return replace(self, table=np.insert(self.table, position, values, axis=0))

    def unseen(self, features, codes):
        """Rows of Q of the tasks beyond those that are known."""
        first = np.unique(codes, return_index=True)[1]
        first = first[codes[first] >= len(self.table)]
        return self.rows(features[first][:, self.columns])

    def check(self, features, labels, known):
        """Raise a ValueError where they vary within a task, or are not those of fit.

        Parameters
        ----------
        features : ndarray of shape (n_samples, n_features - 1)
            Columns of X without the task's.
        labels : Labels
            The task of each row.
        known : ndarray of shape (n_tasks,)
            Tasks that the table has.
        """
        values = self.of_tasks(features, labels)
        table = dict(zip(known.tolist(), self.table, strict=True))
        least = SAME * np.where(np.isfinite(self.scale), self.scale, 0.0)
        for label, found in zip(labels.tasks.tolist(), values, strict=True):
            fitted = table.get(label, found)
            differ = np.abs(found - fitted) > least + SAME * np.abs(fitted)
            if differ.any():
                j = int(differ.argmax())
                raise ValueError(
                    f"The descriptor {self.names[j]!r} of task {label!r} is "
                    f"{float(found[j])}, but was {float(fitted[j])} in fit. Give that "
                    "value. Or use a new label: new tasks are predicted from their "
                    "descriptors."
                )

    def of_tasks(self, features, labels):
        """Descriptors of each of the labels, (n_labels, n_descriptors), checked."""
        values = features[:, self.columns]
        found = np.empty((len(labels.tasks), values.shape[1]))
        for code, rows in zip(*rows_by_code(labels.codes), strict=True):
            found[code] = values[rows[0]]
            varies = (values[rows] != found[code]).any(axis=0)
            if varies.any():
                j = int(varies.argmax())
                some = np.unique(values[rows, j])[:3].tolist()
                raise ValueError(
                    f"The descriptor {self.names[j]!r} varies within task "
                    f"{labels.tasks[code].item()!r}: it has the values "
                    f"{', '.join(map(str, some))}. Descriptors are constant within a "
                    "task. Leave this one out of task_descriptors, and it is a feature."
                )
        return found


def read_descriptors(columns, names, features, labels):
    """The descriptors of the tasks that a model learns from.

    Parameters
    ----------
    columns : ndarray of shape (n_descriptors,)
        Where they are among the columns of X without the task's.
    names : ndarray of shape (n_features - 1,)
        Names of those columns.
    features : ndarray of shape (n_samples, n_features - 1)
        The columns.
    labels : Labels
        The task of each row.

    Returns
    -------
    descriptors : Descriptors
        A DescriptorWarning says where the tasks do not tell them apart.

    Raises
    ------
    ValueError
        If one varies within a task.
    """
    empty = np.empty((0, len(columns)))
    found = Descriptors(columns, names[columns], empty, empty)
    table = found.of_tasks(features, labels)
    found = replace(found, table=table, learned=table)
    n_told, n = found.n_rows, len(columns) + 1
    if n_told < n:
        warn(
            f"The {len(table)} tasks do not tell what each of the {n - 1} descriptors "
            f"does: [1, descriptors] has rank {n_told}, not {n}. New tasks are "
            "predicted with the smallest coefficients that explain the known tasks. "
            "Give more tasks or fewer descriptors.",
            DescriptorWarning,
        )
    return found
