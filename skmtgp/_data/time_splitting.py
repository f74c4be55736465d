"""Cross-validation of forecasts: test sets come after their training sets."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.model_selection import TimeSeriesSplit

from skmtgp._data.numbers import DATES
from skmtgp._data.splitting import in_turns, naming, tasks_of_rows
from skmtgp._data.task_column import find_column
from skmtgp._support.warnings import warn
from skmtgp.exceptions import TaskColumnWarning

__all__ = ["TaskTimeSeriesSplit"]


class TaskTimeSeriesSplit(TimeSeriesSplit):
    """Folds in order of time, which test later rows of known tasks.

    Each fold trains on all rows before some time, of all tasks, and tests the rows
    after it. :class:`~sklearn.model_selection.TimeSeriesSplit` does so by the positions
    of the rows. Here the cut is between two values of a time column: rows may be in any
    order, and all rows of a time are on the same side. A fold does not test tasks that
    begin after its cut, because most models cannot predict them.

    Parameters
    ----------
    n_splits : int, default=5
        Number of folds, 2 or more.
    time_feature : int or str
        Position or name of the column with the times in the X that is split: numbers or
        dates. In a search over a pipeline that is the X before the first step, so that
        the pipeline may make numbers of dates.
    task_feature : int or str, default=-1
        Position or name of the column with the task labels in the same X.
    max_train_size : int, default=None
        Most times of a training set, the latest ones. None takes all.
    test_size : int, default=None
        Times of each test set. None is the number of times // (`n_splits` + 1).
    gap : int, default=0
        Times between a training set and its test set that neither has: 3 asks how well
        the fourth week ahead and later ones are predicted.
    min_train_rows : int, default=1
        A task with fewer rows in a training set is left out of that fold altogether.
        A trend of each task, for example, needs more rows than coefficients.

    See Also
    --------
    TaskStratifiedKFold : New rows between those that are known.
    sklearn.model_selection.TimeSeriesSplit : The same by rows, for
        :class:`~skmtgp.WideRegressor`.

    Notes
    -----
    `test_size`, `gap` and `max_train_size` count distinct times, such as dates or
    weeks, whatever the number of rows at each. Test sets do not overlap. Together they
    cover the last `n_splits` * `test_size` times, without the rows of tasks that are
    left out. A task whose rows no fold can test gets a warning. In a training set the
    tasks take turns, as in :class:`TaskStratifiedKFold`, each in the order of its rows.

    A table for :class:`~skmtgp.WideRegressor` has no task column. If its rows are in
    order of time, ``TimeSeriesSplit`` is right for it. But if a column has no value in
    some training set, that fold fails. Then make rows with a task of the table by
    :func:`~skmtgp.stack_tasks`, and use this class. Or set a `test_size` so small that
    the first training set has values of all columns.

    Examples
    --------
    >>> import pandas as pd
    >>> from skmtgp.model_selection import TaskTimeSeriesSplit
    >>> X = pd.DataFrame({"week": [*range(8), 5, 6, 7], "store": [*"aaaaaaaa", *"bbb"]})
    >>> cv = TaskTimeSeriesSplit(3, time_feature="week", task_feature="store")
    >>> for train, test in cv.split(X):  # store b opens in week 5
    ...     weeks, stores = X["week"], X["store"]
    ...     print(f"up to {weeks[train].max()}:", *stores[test] + weeks[test].map(str))
    up to 1: a2 a3
    up to 3: a4 a5
    up to 5: a6 a7 b6 b7
    """

    def __init__(
        self,
        n_splits: int = 5,
        *,
        time_feature: int | str,
        task_feature: int | str = -1,
        max_train_size: int | None = None,
        test_size: int | None = None,
        gap: int = 0,
        min_train_rows: int = 1,
    ) -> None:
        _check_count("max_train_size", max_train_size, 1, or_none=True)
        _check_count("test_size", test_size, 1, or_none=True)
        _check_count("gap", gap, 0)
        _check_count("min_train_rows", min_train_rows, 1)
        super().__init__(
            n_splits, max_train_size=max_train_size, test_size=test_size, gap=gap
        )
        self.time_feature = time_feature
        self.task_feature = task_feature
        self.min_train_rows = min_train_rows

    def split(
        self, X: ArrayLike, y: Any = None, groups: Any = None
    ) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Generate the rows of the training and the test set of each fold.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the times in column `time_feature` and the task labels in
            column `task_feature`.
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
            If there is no such column, or a time or a label cannot be used. If there
            are too few times, or a fold has no row to test.

        Warns
        -----
        TaskColumnWarning
            If a task has rows at the times of test sets, but no fold tests it.
        """
        tasks, codes = tasks_of_rows(self, X, y)
        time, times, name = _times_of_rows(self, X)
        self._check_times(len(times), name)
        if groups is not None:
            warn("groups is ignored by TaskTimeSeriesSplit.", UserWarning)
        folds = [
            self._fold(k, time, codes, *of) for k, of in enumerate(super().split(times))
        ]
        first = len(times) - self.n_splits * self._size(len(times))
        tested = [codes[test] for _, test in folds]
        _warn_of_untested(tasks, np.setdiff1d(codes[time >= first], np.hstack(tested)))
        for train, test in folds:
            yield in_turns(train, codes), test

    def _size(self, n_times):
        """Times of a test set."""
        return self.test_size or n_times // (self.n_splits + 1)

    def _check_times(self, n_times, name):
        """Raise a ValueError where the times are too few."""
        size = max(self._size(n_times), 1)
        needed = self.n_splits * size + self.gap + 1
        if n_times < needed:
            raise ValueError(
                f"n_splits={self.n_splits}, test_size={size} and gap={self.gap} need "
                f"{needed} distinct times or more. Column {name} has {n_times}. "
                "Set a smaller n_splits, test_size or gap."
            )

    def _fold(self, k, time, codes, early, late):
        """Rows to train and to test, of tasks that have enough rows to train."""
        train = (early[0] <= time) & (time <= early[-1])
        test = (late[0] <= time) & (time <= late[-1])
        rows = np.bincount(codes[train], minlength=codes.max() + 1)
        known = rows[codes] >= self.min_train_rows
        if not (test & known).any():
            raise ValueError(
                f"Fold {k + 1} of {self.n_splits} has no row to test: no task that "
                f"has rows at its times also has min_train_rows={self.min_train_rows} "
                "before them. Set a smaller n_splits, min_train_rows or gap, or a "
                "larger test_size."
            )
        return np.flatnonzero(train & known), np.flatnonzero(test & known)


def _check_count(name, value, least, *, or_none=False):
    """Raise an error where a parameter is no integer, or too small."""
    if or_none and value is None:
        return
    needed = f"an integer of {least} or more" + ", or None" * or_none
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Integral):
        raise TypeError(f"{name}={value!r} must be {needed}.")
    if value < least:
        raise ValueError(f"{name}={value} must be {needed}.")


def _warn_of_untested(tasks, codes):
    """Say which tasks begin too late to be tested."""
    if codes.size:
        which = naming("No fold tests rows", tasks[codes].tolist())
        warn(
            f"{which}: too few rows come before those that could be tested, see "
            "min_train_rows. Scores tell nothing of such tasks.",
            TaskColumnWarning,
        )


def _times_of_rows(splitter, X):
    """Number of each row's time, the distinct times in order, and the column's name."""
    where = splitter.time_feature, splitter, "time_feature", "column of times"
    X, position, name = find_column(X, *where)
    of_tasks = find_column(X, splitter.task_feature, splitter)
    if position == of_tasks[1]:
        raise ValueError(
            f"Column {name} is also the task column. Set time_feature to the column of "
            "times, and task_feature to that of the tasks."
        )
    columns = X.iloc if isinstance(X, pd.DataFrame) else X
    values = _orderly(pd.Series(columns[:, position]).reset_index(drop=True), name)
    missing = np.flatnonzero(values.isna())
    if missing.size:
        raise ValueError(
            f"Column {name} has {missing.size} missing times, the first in row "
            f"{missing[0]}. Fill them in, or leave their rows out."
        )
    try:
        return *pd.factorize(values, sort=True), name
    except (TypeError, ValueError):  # with time zones and without, for example
        raise ValueError(
            f"Column {name} holds times that have no common order, such as "
            f"{values.iloc[0]!r} and {values.iloc[-1]!r}. Convert them to one type, by "
            "pd.to_datetime for example."
        ) from None


def _orderly(values, name):
    """Times as numbers or dates, which have an order."""
    if isinstance(values.dtype, pd.CategoricalDtype):
        values = values.astype(object)
    values = values.infer_objects()
    if values.dtype == object or pd.api.types.is_string_dtype(values):
        found = values.dropna()
        if found.map(lambda value: isinstance(value, DATES)).all():
            _refuse_several(found, name)
            return values
        return values.map(partial(_number, name=name), na_action="ignore")
    if pd.api.types.is_complex_dtype(values):
        _refuse(values.iloc[0], name)
    if pd.api.types.is_numeric_dtype(values):
        numbers = values.to_numpy(float, na_value=np.nan)
        for value in numbers[np.isinf(numbers)]:
            _refuse(float(value), name)
    return values


def _number(value, name):
    """A time as a number; a ValueError where it is text that is none."""
    if isinstance(value, Integral):  # which may have more digits than a float
        return value
    try:
        number = float(value)
    except (TypeError, ValueError):
        _refuse(value, name)
    return number if np.isfinite(number) else _refuse(value, name)


def _refuse(value, name):
    raise ValueError(
        f"Column {name} holds {value!r}, but times must be finite numbers or dates. "
        "Convert them, by pd.to_datetime for example."
    ) from None


def _refuse_several(found, name):
    """Raise a ValueError where dates are of types that have no common order."""
    kinds = sorted({type(value).__name__ for value in found})
    if len(kinds) > 1:
        raise ValueError(
            f"Column {name} holds times of several types: {', '.join(kinds)}. Convert "
            "them to one, by pd.to_datetime for example."
        )
