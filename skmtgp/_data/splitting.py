"""Cross-validation in which every training set has every task."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import issparse
from sklearn.model_selection import StratifiedKFold
from sklearn.utils import check_consistent_length, check_random_state

from skmtgp._data.labels import listed, rows_by_code
from skmtgp._data.task_column import task_labels
from skmtgp._support.warnings import warn
from skmtgp.exceptions import TaskColumnWarning

__all__ = ["TaskStratifiedKFold"]

NEVER = -1  # the fold of rows that are not tested


class TaskStratifiedKFold(StratifiedKFold):
    """K-fold cross-validation in which every fold trains on every task.

    Each task's rows are distributed evenly over the test sets, as
    :class:`~sklearn.model_selection.StratifiedKFold` does with classes. Most models
    with a task column cannot predict a task without training rows. ``KFold`` on rows
    sorted by task, or ``GroupKFold`` by task, would ask them to.

    Parameters
    ----------
    n_splits : int, default=5
        Number of folds, 2 or more.
    task_feature : int or str, default=-1
        Position or name of the column with the task labels in the X that is split. In a
        search over a pipeline that is the X before the first step.
    shuffle : bool, default=False
        Whether to distribute the rows of each task at random. Otherwise the rows in a
        test set are consecutive.
    random_state : int, RandomState instance or None, default=None
        Source of randomness with `shuffle`.

    See Also
    --------
    TaskStratifiedGroupKFold : The same, and rows of a group stay together.
    TaskTimeSeriesSplit : Folds in order of time, for forecasts.
    sklearn.model_selection.StratifiedKFold : The same by the classes in y.
    RankSearchIC : Chooses the rank without cross-validation.

    Notes
    -----
    A task with fewer rows than `n_splits` is in the training set of every fold, and in
    the test sets of as many folds as it has rows. A task of one row is never tested,
    with a warning. At least one task must have `n_splits` rows or more. If a task has
    fewer than twice `n_splits` rows, some test set has only one of its rows, with no
    variance to normalise errors by. Give
    :func:`~skmtgp.metrics.make_normalized_mse_scorer` the variance of all targets,
    `y_var`.

    In a training set the tasks take turns. So
    :func:`~sklearn.model_selection.learning_curve`, which takes its first rows, has
    every task if there are enough rows, and all tasks in proportion.
    ``learning_curve(..., shuffle=True)`` permutes the rows and destroys this; let this
    class shuffle instead. ``HalvingGridSearchCV`` also draws rows at random; give it a
    `min_resources` that leaves no task out.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.model_selection import cross_val_score
    >>> from skmtgp import MultiTaskGPRegressor
    >>> from skmtgp.model_selection import TaskStratifiedKFold
    >>> x, task = np.tile(np.linspace(0, 6, 12), 3), np.repeat([0, 1, 2], 12)
    >>> X, y = np.column_stack([x, task]), (1 + task) * np.sin(x)
    >>> cv = TaskStratifiedKFold(3, shuffle=True, random_state=0)
    >>> for train, test in cv.split(X):
    ...     print(np.unique(task[train]), np.bincount(task[test]))
    [0 1 2] [4 4 4]
    [0 1 2] [4 4 4]
    [0 1 2] [4 4 4]
    >>> scores = cross_val_score(MultiTaskGPRegressor(rank=1), X, y, cv=cv)
    >>> bool(scores.min() > 0.9)
    True
    """

    def __init__(
        self,
        n_splits: int = 5,
        *,
        task_feature: int | str = -1,
        shuffle: bool = False,
        random_state: np.random.RandomState | int | None = None,
    ) -> None:
        super().__init__(n_splits, shuffle=shuffle, random_state=random_state)
        self.task_feature = task_feature

    def split(
        self, X: ArrayLike, y: Any = None, groups: Any = None
    ) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Generate the rows of the training and the test set of each fold.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Only its length is used.
        groups : object, default=None
            Ignored, with a warning.

        Yields
        ------
        train : ndarray of shape (n_train,)
            Positions of the rows to fit; the tasks take turns.
        test : ndarray of shape (n_test,)
            Positions of the rows to predict, in order.

        Raises
        ------
        ValueError
            If there is no such column, a label cannot be used, or all tasks have fewer
            rows than `n_splits`.

        Warns
        -----
        TaskColumnWarning
            If a task has one row: it is in every training set.
        """
        tasks, codes = tasks_of_rows(self, X, y)
        counts = np.bincount(codes)
        check_most(self, counts, "row")
        _warn_of_lone(tasks[counts == 1].tolist())
        if groups is not None:
            warn("groups is ignored by TaskStratifiedKFold.", UserWarning)
        fold_of_row = np.where(counts[codes] == 1, NEVER, self._deal(codes))
        yield from sets(fold_of_row, codes, self.n_splits)

    def _deal(self, codes):
        """The fold in whose test set each row is.

        That of StratifiedKFold, which would warn of tasks with fewer rows than folds:
        they are not in every test set, but in every training set.
        """
        first = np.unique(codes, return_index=True)[1]
        by_appearance = np.argsort(np.argsort(first))[codes]
        dealt = np.arange(len(codes)) % self.n_splits
        rng = check_random_state(self.random_state)
        fold, done = np.empty(len(codes), dtype=int), 0
        for rows in rows_by_code(by_appearance)[1]:
            of_task = np.sort(dealt[done : done + len(rows)])
            if self.shuffle:
                rng.shuffle(of_task)
            fold[rows], done = of_task, done + len(rows)
        return fold


def tasks_of_rows(splitter, X, y):
    """The tasks of the rows that are split."""
    if issparse(X):
        raise TypeError(
            f"Sparse data was passed for X, but {type(splitter).__name__} reads the "
            "task column of dense data only. Use X.toarray() to convert it."
        )
    check_consistent_length(X, y)
    return task_labels(X, splitter.task_feature, splitter)


def _warn_of_lone(tasks):
    """Say which tasks have a row that no test set can have."""
    if tasks:
        which = naming("One row alone", tasks)
        warn(
            f"{which}: it is in every training set and never tested. Where each row "
            "has to be tested, as by cross_val_predict, leave tasks of one row out.",
            TaskColumnWarning,
        )


def check_most(splitter, counts, what):
    """Whether some task has so many rows, or groups, as there are folds."""
    if not counts.size:
        raise ValueError("X has 0 rows; a minimum of 1 is required.")
    if counts.max() < splitter.n_splits:
        raise ValueError(
            f"n_splits={splitter.n_splits} is above the number of {what}s of every "
            f"task, which is {counts.max()} at most. Set n_splits to that or less."
        )


def naming(what, tasks):
    """What there is of some tasks, of which up to five are named."""
    return f"{what} of task {listed(tasks)}"


def sets(fold_of_row, codes, n_splits):
    """Training and test rows of each fold."""
    for fold in range(n_splits):
        test = fold_of_row == fold
        yield in_turns(np.flatnonzero(~test), codes), np.flatnonzero(test)


def in_turns(rows, codes):
    """The rows in an order in which any first ones have the tasks in proportion."""
    tasks = pd.Series(codes[rows])
    of_task = tasks.groupby(tasks)
    share = of_task.cumcount() / of_task.transform("size")
    return rows[np.argsort(share.to_numpy(), kind="stable")]
