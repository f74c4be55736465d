"""Cross-validation by task in which rows of a group stay together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.utils import check_random_state

from skmtgp._data.order import refuse_another_order
from skmtgp._data.splitting import check_most, naming, sets, tasks_of_rows

__all__ = ["TaskStratifiedGroupKFold"]


class TaskStratifiedGroupKFold(StratifiedGroupKFold):
    """K-fold cross-validation by task in which the rows of a group stay together.

    As in :class:`TaskStratifiedKFold`, every fold trains on every task, and tests every
    task as far as it has groups. The rows of a group, such as a second of a recording,
    a trajectory or a day, are all in the training set or all in the test set. So a
    model cannot learn the noise that neighbouring rows share from one set and predict
    it in the other.

    Parameters
    ----------
    n_splits : int, default=5
        Number of folds, 2 or more.
    task_feature : int or str, default=-1
        Position or name of the column with the task labels in the X that is split. In a
        search over a pipeline that is the X before the first step.
    shuffle : bool, default=False
        Whether to distribute groups of the same size in a random order, instead of the
        order of their first rows.
    random_state : int, RandomState instance or None, default=None
        Source of randomness with `shuffle`.

    See Also
    --------
    TaskStratifiedKFold : The same for rows that tell nothing of each other's noise.
    sklearn.model_selection.StratifiedGroupKFold : The same by the classes in y.

    Notes
    -----
    Groups are distributed one by one, beginning with those that have the largest shares
    of their tasks. Each goes to the fold that has least of the same tasks. A group may
    have rows of several tasks. A label that occurs in several tasks is a single group.
    To keep the seconds of several recordings apart, give them different numbers.

    A task with fewer groups than `n_splits` is in the training set of every fold, and
    in the test sets of as many folds as it has groups. At least one task must have
    `n_splits` groups or more, and each task at least two. In a training set the tasks
    take turns, as in :class:`TaskStratifiedKFold`.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.model_selection import TaskStratifiedGroupKFold
    >>> row = np.arange(120)  # ten in a second, six seconds in a task
    >>> task, second = row // 60, row // 10
    >>> X = np.column_stack([np.sin(row), task])
    >>> cv = TaskStratifiedGroupKFold(3)
    >>> for train, test in cv.split(X, groups=second):
    ...     print(np.unique(task[train]), np.unique(second[test]))
    [0 1] [0 3 6 9]
    [0 1] [ 1  4  7 10]
    [0 1] [ 2  5  8 11]
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
        self, X: ArrayLike, y: Any = None, groups: ArrayLike | None = None
    ) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Generate the rows of the training and the test set of each fold.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Only its length is used.
        groups : array-like of shape (n_samples,)
            Group label of each row, of any type.

        Yields
        ------
        train : ndarray of shape (n_train,)
            Positions of the rows to fit; the tasks take turns.
        test : ndarray of shape (n_test,)
            Positions of the rows to predict, in order.

        Raises
        ------
        ValueError
            If there is no such column, or a label cannot be used. If `groups` is not
            given, is missing in some rows, or has the index labels of X in another
            order. If a task has only one group, all tasks
            have fewer than `n_splits`, or groups with several tasks leave a training
            set without a task.
        """
        tasks, codes = tasks_of_rows(self, X, y)
        refuse_another_order(X, groups, "groups")
        group = _codes_of_groups(groups, len(codes))
        size = group.max(initial=-1) + 1, len(tasks)
        counts = np.bincount(group * size[1] + codes, minlength=np.prod(size))
        counts = counts.reshape(size)
        _check_groups(self, tasks, np.count_nonzero(counts, axis=0))
        fold_of_group = self._deal(tasks, counts)
        yield from sets(fold_of_group[group], codes, self.n_splits)

    def _deal(self, tasks, counts):
        """The fold in whose test set each group is, from its rows of each task.

        It goes to the fold where it adds least to the sum of squared shares that the
        folds have of the tasks, but, if it can be, not where all of a task would be.
        """
        total = counts.sum(axis=0)
        order = np.arange(len(counts))
        if self.shuffle:
            check_random_state(self.random_state).shuffle(order)
        share = (counts / total).sum(axis=1)
        load = np.zeros((self.n_splits, len(tasks)), dtype=int)
        fold = np.empty(len(counts), dtype=int)
        for g in order[np.argsort(-share[order], kind="stable")]:
            has_all = (load + counts[g] == total).any(axis=1)
            crowded = load @ (counts[g] / total**2)
            fold[g] = np.lexsort((load.sum(axis=1), crowded, has_all))[0]
            load[fold[g]] += counts[g]
        left = tasks[(load == total).any(axis=0)].tolist()
        if left:
            raise ValueError(
                f"{naming('All rows', left)} would be in one fold, because groups "
                "have rows of several tasks. Make groups smaller, or give each task "
                "groups of its own."
            )
        return fold


def _check_groups(splitter, tasks, counts):
    """Whether so many groups of each task are enough."""
    alone = tasks[counts < 2].tolist()
    if alone:
        raise ValueError(
            f"{naming('One group alone', alone)}: no fold can have the task in both "
            "its training and its test set. Give 2 groups or more of every task, or "
            "leave its rows out."
        )
    check_most(splitter, counts, "group")


def _codes_of_groups(groups, n):
    """The group of each row, numbered in the order of their first rows."""
    if groups is None or np.shape(groups) != (n,):
        found = "None" if groups is None else f"of shape {np.shape(groups)}"
        raise ValueError(
            f"groups is {found}, but TaskStratifiedGroupKFold needs the label of each "
            f"row's group, of shape ({n},). For rows without groups use "
            "TaskStratifiedKFold."
        )
    codes, _ = pd.factorize(pd.Series(groups))
    missing = np.flatnonzero(codes < 0)
    if missing.size:
        raise ValueError(
            f"groups has {missing.size} missing labels (NaN, None or NA), the first in "
            f"row {missing[0]}. Every row needs its group."
        )
    return codes
