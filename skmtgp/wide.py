"""Tables with a column for each task: stacked, unstacked, learned and predicted."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import partial
from typing import Any, Literal, Self, overload

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin, clone
from sklearn.metrics import r2_score
from sklearn.utils import _safe_indexing
from sklearn.utils.validation import (
    check_consistent_length,
    check_is_fitted,
    validate_data,
)

from skmtgp._data.dask import refuse_dask
from skmtgp._data.labels import check_labels
from skmtgp._data.numbers import (
    as_array,
    as_frame,
    check_numbers,
    column_names,
    refuse_empty,
)
from skmtgp._data.order import refuse_another_order
from skmtgp._estimators.estimator import Estimator, fitting, public
from skmtgp._support.pipelines import at_the_end, end_of, name_in_fit
from skmtgp._support.sklearn_compat import HasMethods, fit_context, with_callbacks
from skmtgp.multitask import MultiTaskGPRegressor

__all__ = ["WideRegressor", "stack_tasks", "unstack_tasks"]

TASK = "task"  # how the column with the tasks is called, where a table has names
STACK = "Stack the columns into rows with a task."


def stack_tasks(
    frame: pd.DataFrame, columns: Sequence[Hashable], *, task: str = TASK
) -> tuple[pd.DataFrame, pd.Series]:
    """Turn a table with a column for each task into one with a row for each value.

    Parameters
    ----------
    frame : DataFrame of shape (n_samples, n_columns)
        Features, and a column for each task, with NaN where nothing was measured.
    columns : sequence
        Names of the columns that are tasks. The others are features.
    task : str, default="task"
        Name of the new column that says which task a row belongs to.

    Returns
    -------
    X : DataFrame of shape (n_values, n_features + 1)
        Features and, in the last column, the task: the name of its column in `frame`.
        Tasks follow each other in the order of `columns`. The index is that of `frame`.
    y : Series of shape (n_values,)
        Measurements, without NaN. It has the index of X.

    Raises
    ------
    TypeError
        If `frame` is not a DataFrame, or `columns` is a single name instead of a
        sequence.
    ValueError
        If a column is missing or given twice, or has no value at all, an infinite
        value, or something that is not a number. If there is already a column `task`.

    See Also
    --------
    unstack_tasks : The way back.
    WideRegressor : Learns and predicts such tables.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skmtgp import stack_tasks
    >>> frame = pd.DataFrame(
    ...     {"depth": [1.0, 2.0], "zinc": [10.0, np.nan], "lead": [30.0, 40.0]}
    ... )
    >>> X, y = stack_tasks(frame, ["zinc", "lead"])
    >>> X.assign(y=y)
       depth  task     y
    0    1.0  zinc  10.0
    0    1.0  lead  30.0
    1    2.0  lead  40.0
    """
    frame = as_frame(frame)
    if not isinstance(frame, pd.DataFrame):
        raise TypeError(
            f"frame must be a DataFrame with named columns, not "
            f"{type(frame).__name__}. WideRegressor takes arrays."
        )
    columns = _check_columns(frame, columns)
    features = frame.drop(columns=columns)
    if task in features.columns:
        raise ValueError(
            f"frame already has a column {task!r}, the name of the new task column. "
            "Choose another name, such as task='variable', or drop that column."
        )
    Y = _check_wide(frame[columns], columns, "frame")
    codes, rows = np.nonzero(~np.isnan(Y.T))
    X = features.iloc[rows].assign(**{task: [columns[code] for code in codes]})
    return X, pd.Series(Y[rows, codes], index=X.index, name="y")


def unstack_tasks(
    X: pd.DataFrame, values: ArrayLike, *, task_feature: Hashable = TASK
) -> pd.DataFrame:
    """Turn values of rows with a task into a table with a column for each task.

    Parameters
    ----------
    X : DataFrame of shape (n_values, n_features)
        Rows as :func:`stack_tasks` makes them. Values with the same index belong to the
        same row of the result.
    values : array-like of shape (n_values,)
        Values to arrange: targets, predictions or standard deviations.
    task_feature : str, default="task"
        Name of the column with the tasks.

    Returns
    -------
    frame : DataFrame of shape (n_samples, n_tasks)
        The values, with NaN where X has no row. Rows and columns are in the order in
        which they first occur in X.

    Raises
    ------
    TypeError
        If X is not a DataFrame.
    ValueError
        If the column is missing, if the lengths differ, or if a task has two rows with
        the same index.

    Examples
    --------
    >>> import pandas as pd
    >>> from skmtgp import stack_tasks, unstack_tasks
    >>> frame = pd.DataFrame({"depth": [1.0, 2.0], "zinc": [10, 20], "lead": [30, 40]})
    >>> X, y = stack_tasks(frame, ["zinc", "lead"])
    >>> unstack_tasks(X, y)
       zinc  lead
    0  10.0  30.0
    1  20.0  40.0
    """
    X = as_frame(X)
    if not isinstance(X, pd.DataFrame):
        raise TypeError(f"X must be a DataFrame, not {type(X).__name__}.")
    if task_feature not in X.columns:
        raise ValueError(
            f"task_feature={task_feature!r} is not a column: {list(X.columns)}."
        )
    values = np.asarray(values)
    if values.shape != (len(X),):
        raise ValueError(
            f"values must be of shape ({len(X)},), one for each row of X, not "
            f"{values.shape}."
        )
    keys = pd.MultiIndex.from_arrays([X.index, X[task_feature]])
    if keys.has_duplicates:
        row, task = keys[keys.duplicated()][0]
        raise ValueError(
            f"Task {task!r} has several rows with the index {row}. Give the rows of "
            "the table distinct indices before stack_tasks: "
            "frame.reset_index(drop=True)."
        )
    rows, tasks = X.index.unique(), X[task_feature].unique()
    wide = pd.Series(values, index=keys).unstack().reindex(index=rows, columns=tasks)
    return wide.rename_axis(index=X.index.name, columns=None)


def _check_columns(frame, columns):
    """The names of the tasks' columns, as a list."""
    if isinstance(columns, str) or not isinstance(columns, Sequence | pd.Index):
        raise TypeError(
            f"columns={columns!r} must be a sequence of names, such as ['a', 'b']."
        )
    columns = list(columns)
    missing = [name for name in columns if name not in frame.columns]
    twice = [name for name in columns if columns.count(name) > 1]
    if missing:
        raise ValueError(
            f"columns has {missing[0]!r}, which is not a column of frame: "
            f"{list(frame.columns)}."
        )
    if twice:
        raise ValueError(f"columns has {twice[0]!r} twice.")
    if not columns or len(columns) == frame.shape[1]:
        raise ValueError(
            f"columns={columns!r} must name one column or more, and leave one or more "
            f"as features, of {list(frame.columns)}."
        )
    return columns


def _as_table(values):
    """As pandas has it, or as an array."""
    values = as_frame(values)
    return (
        values if isinstance(values, pd.DataFrame | pd.Series) else np.asarray(values)
    )


def _check_wide(values, columns, name="y"):
    """Targets as float64, of shape (n_samples, n_tasks), with NaN for gaps."""
    Y = _with_gaps(values, columns, name)
    empty = np.flatnonzero(np.isnan(Y).all(axis=0))
    if empty.size:
        raise ValueError(
            f"Column {columns[empty[0]]!r} of {name} has no value, so this task cannot "
            "be learned. Leave it out."
        )
    return Y


def _with_gaps(values, columns, name):
    frame = pd.DataFrame(_as_table(values))
    gaps = frame.isna().to_numpy()
    Y = check_numbers(frame.where(~gaps, 0.0), name, columns)
    return np.where(gaps, np.nan, Y)


def _alpha_of(cells, alpha, shape, names, *, named):
    """Known noise variances of values of y; a number, or None, holds for all.

    `cells` are their rows and columns, and `shape` is that of y. `named` is whether the
    columns of a frame must have the names.
    """
    if alpha is None or np.ndim(alpha) == 0:
        return alpha
    table = _as_table(alpha)
    if table.shape != shape:
        raise ValueError(
            f"alpha must be a number or of the shape of y, {shape}, not {table.shape}."
        )
    if named and isinstance(table, pd.DataFrame):
        columns = column_names(table)
        if columns != names:
            raise ValueError(
                f"alpha has the columns {columns}, and y has {names}. Give "
                "alpha[y.columns]."
            )
    values = _with_gaps(table, names, "alpha")[cells]
    for k in np.flatnonzero(np.isnan(values))[:1]:
        row, column = (of[k] for of in cells)
        raise ValueError(
            f"alpha is NaN in row {row} of column {names[column]!r}, whose noise it is."
        )
    return values


def _names(values):
    """Names of the columns of targets, which are checked."""
    if values.ndim not in (1, 2):
        raise ValueError(
            f"y has {values.ndim} dimensions: give a column for each task, of shape "
            "(n_samples, n_outputs), or (n_samples,) for a single one."
        )
    names = [0] if values.ndim == 1 else column_names(values)
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise ValueError(f"y has the column {twice[0]!r} twice. Rename one of them.")
    if not names:
        raise ValueError("y has no columns: give one for each task.")
    return names


def _advise_text(columns, k):
    """What to do where a column of X holds text."""
    return (
        " Encode it, with a OneHotEncoder in a ColumnTransformer with "
        "remainder='passthrough' before the WideRegressor for example. If it names the "
        f"tasks, fit the model itself, with task_feature={columns[k]!r}."
    )


def _check_labels(names):
    """Raise a ValueError where names of columns cannot be those of tasks."""
    try:
        check_labels(pd.Series(names, dtype=object))
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"The columns of y, {names!r}, cannot name the tasks. Name all of them by "
            f"strings, with y.columns = y.columns.map(str) for example: {error}"
        ) from error


class WideRegressor(MetaEstimatorMixin, RegressorMixin, Estimator):
    """Model of tasks for targets with a column for each task.

    Use this if your table has X without a task column, and Y with a column for each
    task and NaN where nothing was measured. The columns of Y are stacked into rows with
    a task, and the model learns them together. Its predictions are arranged in columns
    again.

    Parameters
    ----------
    estimator : estimator, default=None
        Model of the stacked rows, with the task in the last column: a
        MultiTaskGPRegressor, another model of this package, or a pipeline that ends
        with one. None is ``MultiTaskGPRegressor()``.
    task : str, default="task"
        Name of the task column, if X is a frame.

    Attributes
    ----------
    estimator_ : estimator
        The fitted model. Its tasks are `outputs_`. If X is an array, names that are
        strings are its tasks, and of others their positions.
    outputs_ : ndarray of shape (n_outputs,)
        Names of the columns of Y, or their positions.
    n_features_in_ : int
        Number of columns of X.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    stack_tasks : Makes the stacked table, for models and splitters of this package.
    MultiTaskGPRegressor : Takes Y with several columns, and learns each separately.

    Notes
    -----
    Without gaps the rows are complete data. Their likelihood is computed much faster,
    and nearly as fast with up to a tenth of the values missing. See
    :doc:`/guide/inference`.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import WideRegressor
    >>> rng = np.random.default_rng(0)
    >>> X = rng.uniform(0, 6, (30, 1))
    >>> Y = np.sin(X) * [1.0, 2.0, -1.0] + 0.05 * rng.standard_normal((30, 3))
    >>> Y[5:, 2] = np.nan
    >>> model = WideRegressor().fit(X, Y)
    >>> model.predict([[1.5], [4.5]]).round()
    array([[ 1.,  2., -1.],
           [-1., -2.,  1.]])
    """

    _parameter_constraints = {
        "estimator": [HasMethods(["fit", "predict"]), None],
        "task": [str],
    }

    _call_hints = {
        "return_cov": "For a covariance of all outputs draw them together, by "
        "sample_y; or learn the rows of stack_tasks with a MultiTaskGPRegressor, whose "
        "predict has return_cov."
    }

    def __init__(
        self, estimator: BaseEstimator | None = None, *, task: str = TASK
    ) -> None:
        self.estimator = estimator
        self.task = task

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: ArrayLike, y: ArrayLike, alpha: ArrayLike | None = None) -> Self:
        """Learn all columns of the targets together.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, without a column of tasks.
        y : array-like of shape (n_samples, n_outputs) or (n_samples,)
            Targets, with NaN where nothing was measured.
        alpha : float or array-like of the shape of y, default=None
            Known noise variance of each value, in squared units of y. It is added to
            the learned one, see :meth:`MultiTaskGPRegressor.fit`. It may be NaN where y
            is. None is 0.

        Returns
        -------
        self : WideRegressor
            Fitted estimator.

        Raises
        ------
        TypeError
            If X, y or `alpha` is a Dask collection, or if the model takes no `alpha`.
        ValueError
            If a column of y has no value or an infinite one, or if the model cannot use
            X, y or `alpha`. The estimator is then as it was before.
        """
        with fitting(self, X, y):
            self._fit(X, y, alpha)
        return self

    def _fit(self, X, y, alpha):
        for name, data in (("X", X), ("y", y), ("alpha", alpha)):
            refuse_dask(name, data, STACK)
        if y is None:
            raise ValueError(
                f"{type(self).__name__} requires y to be passed, but the target y is "
                "None."
            )
        refuse_another_order(X, y)
        table, targets = self._table(X, reset=True), _as_table(y)
        self._single, names = targets.ndim == 1, _names(targets)
        model = MultiTaskGPRegressor() if self.estimator is None else self.estimator
        self._check_task_feature(model)
        self._name_tasks(model, table, names)
        refuse_another_order(X, alpha, "alpha")
        Y = _check_wide(targets, names)
        check_consistent_length(table, Y)
        codes, rows = np.nonzero(~np.isnan(Y.T))
        stacked = self._stack(table, rows, codes)
        named, shape = isinstance(targets, pd.DataFrame), targets.shape
        alpha = _alpha_of((rows, codes), alpha, shape, names, named=named)
        known = {} if alpha is None else {name_in_fit(model, "alpha"): alpha}
        self.estimator_ = clone(model).fit(stacked, Y[rows, codes], **known)
        self._cells, self._shape = (rows, codes), Y.shape

    def _name_tasks(self, model, table, names):
        """Keep the names of the outputs, and the labels of their tasks.

        Other models than ours, and steps of a pipeline, take numbers alone from an
        array.
        """
        self.outputs_ = np.empty(len(names), dtype=object)
        self.outputs_[:] = names
        text = all(isinstance(name, str) for name in names)
        named = isinstance(table, pd.DataFrame)
        if named:
            _check_labels(names)
        if named or (text and isinstance(model, Estimator)):
            self._labels = self.outputs_
        else:
            self._labels = np.arange(len(names))

    def _check_task_feature(self, model):
        """Raise a ValueError where a model of the package asks for another column."""
        if not isinstance(model, Estimator):
            return
        asked = getattr(getattr(model, "estimator", None) or model, "task_feature", -1)
        if isinstance(asked, str) and asked != self.task:
            raise ValueError(
                f"The estimator has task_feature={asked!r}, but WideRegressor makes "
                f"the task column, with the name task={self.task!r}. Set "
                f"task={asked!r} of the WideRegressor, or leave task_feature=-1."
            )

    def _table(self, X, *, reset):
        """X as a frame, or as an array where its columns had no names in fit."""
        X = as_frame(X)
        refuse_empty("X", X)
        if isinstance(X, pd.DataFrame) and all(isinstance(c, str) for c in X.columns):
            if self.task in X.columns:
                raise ValueError(
                    f"X already has a column {self.task!r}, the name of the new task "
                    "column. Set `task` to another name. If X has the tasks already, "
                    "fit the model itself."
                )
            table = validate_data(self, X, reset=reset, skip_check_array=True)
        else:
            options = {"dtype": None, "ensure_all_finite": False}
            table = validate_data(self, X, reset=reset, **options)
        return self._as_in_fit(table)

    def _as_in_fit(self, table):
        """A table with names where fit had them, and an array where it had none."""
        names = getattr(self, "feature_names_in_", None)
        if names is None:
            return np.asarray(table)
        if isinstance(table, pd.DataFrame):
            return table
        return pd.DataFrame(table, columns=names).infer_objects()

    def _stack(self, table, rows, codes):
        """Rows of X, and as the last column the task of each."""
        if self.estimator is None or isinstance(self.estimator, Estimator):
            used = _safe_indexing(table, np.unique(rows))  # a pipeline may encode text
            check_numbers(used, "X", advise=partial(_advise_text, column_names(used)))
        if isinstance(table, pd.DataFrame):
            return table.iloc[rows].assign(**{self.task: self._labels[codes]})
        kind = object if table.dtype.kind in "OSU" else np.float64
        return np.column_stack([table[rows].astype(kind), self._labels[codes]])

    def _ask(self, method, X, *args, alpha=None, **kwargs):
        """What a method of the model gives for each row of X and each task.

        `alpha` has the known noise of each.
        """
        check_is_fitted(self)
        table = self._table(X, reset=False)
        n, n_outputs = len(table), len(self.outputs_)
        codes, rows = np.divmod(np.arange(n * n_outputs), n)
        stacked = self._stack(table, rows, codes)
        shape = (n,) if self._single else (n, n_outputs)
        kwargs |= self._known(X, alpha, (rows, codes), shape)
        model, stacked = at_the_end(self.estimator_, stacked)
        found = _method(model, method)(stacked, *args, **kwargs)
        if not isinstance(found, tuple):
            return self._arrange(found, n)
        return tuple(self._arrange(part, n) for part in found)

    def _known(self, X, alpha, cells, shape):
        """Known noise variances of cells as the model takes them; {} without any."""
        if alpha is None:
            return {}
        refuse_dask("alpha", alpha, STACK)
        refuse_another_order(X, alpha, "alpha")
        names = self.outputs_.tolist()
        numbered = list(range(len(names)))
        columns = [] if not hasattr(alpha, "columns") else alpha.columns.tolist()
        named = names != numbered or set(columns) == set(numbered)
        return {"alpha": _alpha_of(cells, alpha, shape, names, named=named)}

    def _arrange(self, values, n):
        """Values of the rows, the tasks as the second axis; none for a single one."""
        wide = values.reshape(len(self.outputs_), n, *values.shape[1:])
        return wide[0] if self._single else np.moveaxis(wide, 0, 1)

    @overload
    def predict(
        self,
        X: ArrayLike,
        return_std: Literal[False] = False,
        include_noise: bool = False,
    ) -> NDArray[np.float64]: ...

    @overload
    def predict(
        self, X: ArrayLike, return_std: Literal[True], include_noise: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @overload
    def predict(
        self, X: ArrayLike, return_std: bool = False, include_noise: bool = False
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @public
    def predict(
        self, X: ArrayLike, return_std: bool = False, include_noise: bool = False
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict all outputs.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs.
        return_std : bool, default=False
            Whether to return standard deviations, too.
        include_noise : bool, default=False
            Whether they are those of new observations, rather than of f. The noise is
            the learned one, even if `fit` had an `alpha`: if new values have such
            noise, too, their deviation is ``np.sqrt(y_std**2 + alpha)``.

        Returns
        -------
        y_mean : ndarray of shape (n_samples, n_outputs) or (n_samples,)
            Predictive mean, in units of y.
        y_std : ndarray of the shape of y_mean
            Standard deviation. Only if `return_std`.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        ValueError
            If X has other columns than in `fit`, or cannot be used.
        """
        asked = {"return_std": return_std, "include_noise": include_noise}
        return self._ask("predict", X, **{k: v for k, v in asked.items() if v})

    @public
    def predict_interval(
        self,
        X: ArrayLike,
        level: float = 0.95,
        include_noise: bool = True,
        *,
        alpha: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict an interval that contains each output with a given probability.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs.
        level : float, default=0.95
            Probability of the interval.
        include_noise : bool, default=True
            Whether the interval is that of a new observation, rather than of f. The
            noise is the learned one, and `alpha` if you give it here: that of `fit` is
            not in new values.
        alpha : float or array-like of shape (n_samples, n_outputs), default=None
            Known noise variance of each new observation, in squared units of y, and of
            shape (n_samples,) if y had one dimension in `fit`. It is added to the
            learned one. None is 0.

        Returns
        -------
        lower, upper : ndarray of shape (n_samples, n_outputs) or (n_samples,)
            Ends of the interval, in units of y.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        TypeError
            If `alpha` is a Dask collection, or if the model takes no `alpha`.
        ValueError
            If X, `level` or `alpha` cannot be used.
        """
        return self._ask("predict_interval", X, level, include_noise, alpha=alpha)

    @public
    def conformal_interval(
        self,
        X: ArrayLike,
        level: float = 0.95,
        *,
        by_task: bool = False,
        alpha: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict an interval that is as wide as errors of left-out values.

        See :meth:`MultiTaskGPRegressor.conformal_interval`. Values of the same row are
        hardly exchangeable with others: where rows are noisy as a whole, intervals are
        too narrow.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs.
        level : float, default=0.95
            Share of new values that intervals are to contain.
        by_task : bool, default=False
            Whether each output's intervals have the width of its own errors.
        alpha : float or array-like of shape (n_samples, n_outputs), default=None
            Known noise variance of each new value, see `predict_interval`.

        Returns
        -------
        lower, upper : ndarray of shape (n_samples, n_outputs) or (n_samples,)
            Ends of the interval, in units of y.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        TypeError
            If the estimator has no `conformal_interval`, or takes no `alpha`.
        ValueError
            If X, `level` or `alpha` cannot be used, or if there are too few values for
            `level`.
        """
        options = {"by_task": by_task, "alpha": alpha}
        return self._ask("conformal_interval", X, level, **options)

    @public
    def log_predictive_density(
        self, X: ArrayLike, y: ArrayLike, *, alpha: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """Return the log density of each new value by itself.

        See :meth:`MultiTaskGPRegressor.log_predictive_density`.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs.
        y : array-like of shape (n_samples, n_outputs) or (n_samples,)
            Values, with NaN where nothing was measured.
        alpha : float or array-like of the shape of y, default=None
            Known noise variance of each value, in squared units of y. It may be NaN
            where y is. None is 0.

        Returns
        -------
        log_density : ndarray of the shape of y
            Natural logarithm of the density in units of y; NaN where y is.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        TypeError
            If the estimator has no `log_predictive_density`, or takes no `alpha`.
        ValueError
            If X, y or `alpha` cannot be used.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import WideRegressor
        >>> rng = np.random.default_rng(0)
        >>> X = rng.uniform(0, 6, (30, 1))
        >>> Y = np.sin(X) * [1.0, 2.0] + 0.05 * rng.standard_normal((30, 2))
        >>> model = WideRegressor().fit(X, Y)
        >>> model.log_predictive_density([[1.5], [4.5]], [[1, 2], [1, np.nan]]) > -5
        array([[ True,  True],
               [False, False]])
        """
        check_is_fitted(self)
        refuse_another_order(X, y)
        table, Y = self._table(X, reset=False), self._targets(y)
        check_consistent_length(table, Y)
        codes, rows = np.nonzero(~np.isnan(Y.T))
        found = np.full(Y.shape, np.nan)
        known = self._known(X, alpha, (rows, codes), np.shape(y))
        if len(rows):
            model, X = at_the_end(self.estimator_, self._stack(table, rows, codes))
            ask = _method(model, "log_predictive_density")
            found[rows, codes] = ask(X, Y[rows, codes], **known)
        return found[:, 0] if self._single else found

    @public
    def loo_predict(
        self, include_noise: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict each value of `fit` from all the others.

        Other columns of its row are among these. No model is fitted again; see
        :meth:`MultiTaskGPRegressor.loo_predict`.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether deviations are those of the value that was left out, or of f.

        Returns
        -------
        y_mean, y_std : ndarray of shape (n_samples, n_outputs) or (n_samples,)
            Means and standard deviations, in the units of y; NaN where nothing was
            measured.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        TypeError
            If the estimator has no `loo_predict`.
        """
        check_is_fitted(self)
        ask = _method(end_of(self.estimator_), "loo_predict", ", or cross-validate")
        found = np.full((2, *self._shape), np.nan)
        found[:, *self._cells] = ask(include_noise)
        mean, std = found[:, :, 0] if self._single else found
        return mean, std

    @public
    def sample_y(
        self,
        X: ArrayLike,
        n_samples: int = 1,
        random_state: Any = 0,
        include_noise: bool = False,
    ) -> NDArray[np.float64]:
        """Draw functions of all outputs together.

        Parameters
        ----------
        X : array-like of shape (n_rows, n_features)
            Inputs.
        n_samples : int, default=1
            Number of draws.
        random_state : int, RandomState or None, default=0
            Source of randomness.
        include_noise : bool, default=False
            Whether to add noise to the draws.

        Returns
        -------
        y : ndarray of shape (n_rows, n_outputs, n_samples) or (n_rows, n_samples)
            Draws, in units of y.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        ValueError
            If X cannot be used.
        InsufficientMemoryError
            If there is no memory for matrices between all rows, or for the draws.
        """
        return self._ask("sample_y", X, n_samples, random_state, include_noise)

    @public
    def score(
        self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None
    ) -> float:
        """Return the R² of each output, averaged, of the values that y has.

        NaN is left out, and so are columns with fewer than two values.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs.
        y : array-like of shape (n_samples, n_outputs) or (n_samples,)
            Targets, with NaN where nothing was measured.
        sample_weight : array-like of shape (n_samples,), default=None
            Weights of the rows.

        Returns
        -------
        score : float
            1 is perfect. Predicting the mean of each column has 0.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        ValueError
            If X or y cannot be used.
        """
        refuse_another_order(X, y)
        mean = np.reshape(self.predict(X), (-1, len(self.outputs_)))
        Y = self._targets(y)
        check_consistent_length(mean, Y, sample_weight)
        seen = ~np.isnan(Y)
        told = np.flatnonzero(seen.sum(axis=0) > 1)
        if not len(told):
            raise ValueError(
                "No column of y has two values to compare predictions with."
            )
        scores = []
        for j in told:
            rows = seen[:, j]
            weight = None if sample_weight is None else as_array(sample_weight)[rows]
            pair = Y[rows, j], mean[rows, j]
            scores.append(r2_score(*pair, sample_weight=weight))
        return float(np.mean(scores))

    def _targets(self, y):
        """Numbers of shape (n_samples, n_outputs), NaN where nothing was measured."""
        table = _as_table(y)
        self._check_outputs(table)
        return _with_gaps(table, self.outputs_.tolist(), "y")

    def _check_outputs(self, y):
        """Raise a ValueError where targets have other columns than in fit."""
        names, known = _names(y), self.outputs_.tolist()
        if len(names) != len(known):
            raise ValueError(
                f"y has {len(names)} columns, but the model was fitted to {len(known)}."
            )
        named = isinstance(y, pd.DataFrame) and known != list(range(len(known)))
        if named and names != known:
            raise ValueError(
                f"y has the columns {names}, but the model was fitted to {known}. Give "
                "them in this order."
            )

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags


def _method(model, name, instead=""):
    """A method of the model, or a TypeError; `instead` tells what else there is."""
    if not hasattr(model, name):
        raise TypeError(
            f"{type(model).__name__} has no {name}: set `estimator` to a Gaussian "
            f"process of skmtgp{instead}."
        )
    return getattr(model, name)
