"""Predictions of each task along a feature."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.utils import check_consistent_length

from skmtgp._data.numbers import as_frame, check_numbers
from skmtgp._data.task_column import locate_task_column
from skmtgp.inspection._drawing import (
    Display,
    check_axes,
    check_count,
    color_of,
    pyplot,
)
from skmtgp.inspection._models import (
    columns_of_descriptors,
    intervals,
    select_output,
    task_column,
    tasks_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST = 24  # panels; more cannot be read
PANEL = 2.4, 1.9  # inches
LEGIBLE = 12  # a curve needs this part of an axis


class TaskPredictionDisplay(Display):
    """Predictions of each task along a feature, with a panel for each task.

    Parameters
    ----------
    curves : DataFrame
        Columns "task", "x", "mean", "lower" and "upper": predictions of each task, and
        intervals of new observations. Panels have the order of the tasks.
    points : DataFrame
        Columns "task", "x" and "y": the observations.
    truth : DataFrame, default=None
        Columns "task", "x" and "y": the true functions, if known.
    feature : str, default="x"
        Label of the horizontal axis.
    level : float, default=0.95
        Probability of the intervals.
    target : str, default="y"
        Label of the vertical axis.

    Attributes
    ----------
    axes_ : ndarray of Axes of shape (n_tasks,)
        The panels.
    lines_, bands_, observed_ : list
        Means, intervals and observations, one of each for a panel.
    truths_ : list
        Lines of the truth, None for a panel without truth.
    color : str
        Colour of the predictions. `from_estimator` sets that of the model, see
        :func:`color_of`.
    ax_ : matplotlib Axes
        The first panel.
    figure_ : matplotlib Figure
        The figure of the panels.

    See Also
    --------
    TrajectoryDisplay : Along time, without fixing other features.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor
    >>> from skmtgp.inspection import TaskPredictionDisplay
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 40), np.repeat([0, 1], [35, 5])
    >>> X, y = np.column_stack([x, task]), np.sin(x) * np.where(task, 2.0, 1.0)
    >>> y += 0.1 * rng.standard_normal(40)
    >>> model = MultiTaskGPRegressor(rank=1).fit(X, y)
    >>> TaskPredictionDisplay.from_estimator(model, X, y)
    <...>
    >>> plt.show()
    """

    def __init__(
        self,
        *,
        curves: pd.DataFrame,
        points: pd.DataFrame,
        truth: pd.DataFrame | None = None,
        feature: str = "x",
        level: float = 0.95,
        target: str = "y",
    ) -> None:
        self.curves = curves
        self.points = points
        self.truth = truth
        self.feature = feature
        self.level = level
        self.target = target

    def plot(
        self,
        *,
        ax: Axes | Sequence[Axes] | None = None,
        n_cols: int | None = None,
        sharey: bool | Literal["auto"] = "auto",
    ) -> Self:
        """Draw the panels.

        Parameters
        ----------
        ax : matplotlib Axes or sequence of them, default=None
            Axes whose place the panels take, or axes for each task. None makes a new
            figure with a legend. With given axes, ``ax.legend()`` makes a legend.
        n_cols : int, default=None
            Number of panels side by side. None means at most four.
        sharey : bool or "auto", default="auto"
            Whether all panels share the vertical axis. "auto" gives each panel its own
            if half of them would use less than a twelfth of a common axis, as tasks in
            different units do.

        Returns
        -------
        display : TaskPredictionDisplay
            The display itself.

        Raises
        ------
        TypeError
            If `n_cols` is no integer.
        ValueError
            If `n_cols` is below 1, if there are too many tasks for panels, or if there
            are not as many axes as tasks.
        """
        check_count("n_cols", 1 if n_cols is None else n_cols)
        tasks = self.curves["task"].drop_duplicates().tolist()
        if len(tasks) > MOST:
            raise ValueError(
                f"There are {len(tasks)} tasks, more panels than can be read. Choose "
                f"at most {MOST}: tasks=[...] of from_estimator."
            )
        sharey = self._is_one_axis_legible() if sharey == "auto" else sharey
        self.axes_ = _panels(ax, len(tasks), n_cols, sharey)
        self.ax_, self.figure_ = self.axes_[0], self.axes_[0].figure
        self.lines_, self.bands_, self.observed_, self.truths_ = [], [], [], []
        for panel, task in zip(self.axes_, tasks, strict=True):
            self._draw(panel, task)
            self._label(panel, task)
        if ax is None:
            handles = [self.bands_[0], self.lines_[0], self.observed_[0]]
            handles += [line for line in self.truths_ if line is not None][:1]
            style = {"ncols": 4, "frameon": False, "loc": "outside upper center"}
            self.figure_.legend(handles=handles, **style)
        return self

    def _is_one_axis_legible(self):
        """Whether half of the panels have enough of an axis that all share."""
        drawn = self.curves[["task", "lower", "upper"]].melt("task", value_name="y")
        points = self.points[self.points["task"].isin(self.curves["task"])]
        of_tasks = pd.concat([drawn, points])[["task", "y"]].groupby("task")["y"]
        lowest, highest = of_tasks.min(), of_tasks.max()
        of_all = highest.max() - lowest.min()
        return bool((highest - lowest).median() >= of_all / LEGIBLE)

    def _draw(self, ax, task):
        """One panel."""
        curve, points = _of(self.curves, task), _of(self.points, task)
        style = {"color": self.color, "alpha": 0.25, "lw": 0}
        band = ax.fill_between(curve["x"], curve["lower"], curve["upper"], **style)
        band.set_label(f"{100 * self.level:.3g} % interval")
        style = {"color": self.color, "label": "predicted"}
        self.lines_ += ax.plot(curve["x"], curve["mean"], **style)
        self.bands_.append(band)
        truth = None if self.truth is None else _of(self.truth, task)
        if truth is None or truth.empty:
            self.truths_.append(None)
        else:
            style = {"color": "black", "ls": "--", "lw": 1.0, "label": "truth"}
            self.truths_ += ax.plot(truth["x"], truth["y"], **style)
        style = {"color": "0.35", "ms": 3, "mew": 0, "label": "observed"}
        self.observed_ += ax.plot(points["x"], points["y"], "o", **style)

    def _label(self, ax, task):
        """The title, and the axes that have no panel below or to the left."""
        ax.set_title(str(task), fontsize="medium")
        numbers = ax.yaxis.get_major_formatter()
        if hasattr(numbers, "set_useOffset"):  # it would be written over the title
            numbers.set_useOffset(False)
        if ax.xaxis.get_tick_params()["labelbottom"]:  # nothing is below
            ax.set_xlabel(self.feature)
        place = ax.get_subplotspec()
        if place is None or place.is_first_col():
            ax.set_ylabel(self.target)

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        X: ArrayLike,
        y: ArrayLike,
        *,
        feature: int | str | None = None,
        at: Mapping[Any, Any] | None = None,
        truth: Callable[[Any], ArrayLike] | tuple[ArrayLike, ArrayLike] | None = None,
        tasks: Sequence[Any] | str | None = None,
        task_feature: int | str | None = None,
        output: int = 0,
        level: float = 0.95,
        n_points: int = 100,
        ax: Axes | Sequence[Axes] | None = None,
        n_cols: int | None = None,
        sharey: bool | Literal["auto"] = "auto",
    ) -> Self:
        """Predict each task along a feature, and draw it with the observations.

        Parameters
        ----------
        estimator : estimator
            Fitted model of the package, or a Pipeline or search with one.
        X : array-like of shape (n_samples, n_features)
            Inputs of the observations, as the estimator takes them.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets of the observations. The vertical axis has their name, if any.
        feature : int or str, default=None
            Position or name of the feature of the horizontal axis. None takes the only
            one besides the task and its descriptors.
        at : dict, default=None
            Values of other features, by name or position. Features that are not given
            have the median of the task's rows or, for text, the most common value.
        truth : callable or (X, y), default=None
            The truth, if known: a function of inputs such as X, or inputs and targets,
            which are drawn in the order of the feature.
        tasks : sequence or str, default=None
            Labels of the tasks to draw, in this order, or one label that is a string.
            None takes all tasks of X, sorted.
        task_feature : int or str, default=None
            Position or name of the task column, if the estimator does not know it.
        output : int, default=0
            Output to draw, if there are several.
        level : float, default=0.95
            Probability that the band contains a new observation, between 0 and 1.
        n_points : int, default=100
            Number of points of each curve.
        ax : matplotlib Axes or sequence of them, default=None
            Axes whose place the panels take, or axes for each task. None makes a new
            figure.
        n_cols : int, default=None
            Number of panels side by side. None means at most four.
        sharey : bool or "auto", default="auto"
            Whether all panels share the vertical axis, see :meth:`plot`.

        Returns
        -------
        display : TaskPredictionDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model cannot predict intervals, or `n_points` or `n_cols` is no
            integer.
        ValueError
            If there is no such feature, task or output, if `n_points` or `n_cols` is
            below 1, or if X and y do not fit together.
        """
        check_count("n_points", n_points)
        check_count("n_cols", 1 if n_cols is None else n_cols)
        table = _Table.of(estimator, X, feature, task_feature)
        points = table.points(y, output)
        grid = table.grid(_chosen(tasks, table.labels), at or {}, n_points)
        found = [
            select_output(of.reshape(len(of), -1), output)
            for of in intervals(estimator, grid.values(), level)
        ]
        curves = dict(zip(["mean", "lower", "upper"], found, strict=True))
        if callable(truth):
            true = grid.points(truth(grid.values()), output)
        elif truth is not None:
            _check_pair(truth)
            of = _Table.of(estimator, truth[0], feature, task_feature)
            true = of.points(truth[1], output).sort_values("x", kind="stable")
        display = cls(
            curves=pd.DataFrame({"task": grid.labels, "x": grid.x(), **curves}),
            points=points,
            truth=None if truth is None else true,
            feature=str(table.frame.columns[table.feature]),
            level=level,
            target=_name_of(y, output),
        )
        display.color = color_of(estimator)
        return display.plot(ax=ax, n_cols=n_cols, sharey=sharey)


class _Table(NamedTuple):
    """Inputs, with the position of the feature that is drawn and that of the task."""

    frame: pd.DataFrame
    labels: np.ndarray
    feature: int
    task: int
    dtype: Any  # of an array; None where X was a frame

    @classmethod
    def of(cls, estimator, X, feature, task_feature):
        """What the user passed."""
        X = as_frame(X)
        X = X if isinstance(X, pd.DataFrame) else np.asarray(X)
        labels = np.asarray(tasks_of(estimator, X, task_feature), dtype=object)
        frame, dtype = pd.DataFrame(X), getattr(X, "dtype", None)
        names = list(frame.columns) if dtype is None else None
        column = task_column(estimator, X, task_feature)
        task = locate_task_column(column, frame.shape[1], names)
        described = columns_of_descriptors(estimator, task, frame.shape[1], names)
        found = _position(frame, feature, [task, *described])
        return cls(frame, labels, found, task, dtype)

    def x(self):
        """Values of the feature."""
        values = self.frame.iloc[:, self.feature]
        return check_numbers(values, "X", [self.frame.columns[self.feature]])

    def values(self):
        """As the user passed them."""
        return self.frame if self.dtype is None else self.frame.to_numpy(self.dtype)

    def points(self, y, output):
        """Targets along the feature."""
        y = check_numbers(y, "y")
        check_consistent_length(self.frame, y)
        y = select_output(y.reshape(len(y), -1), output)
        return pd.DataFrame({"task": self.labels, "x": self.x(), "y": y})

    def grid(self, tasks, at, n_points):
        """Each task along the feature, the other features held."""
        unknown = [name for name in at if name not in self.frame.columns]
        if unknown:
            raise ValueError(
                f"at has {unknown[0]!r}, which is not a column of X: "
                f"{list(self.frame.columns)}."
            )
        x = self.x()
        x = np.linspace(x.min(), x.max(), n_points)
        parts = []
        for label in tasks:
            rows = self.frame[self.labels == label]
            part = rows.iloc[np.zeros(n_points, dtype=int)].reset_index(drop=True)
            for j, name in enumerate(self.frame.columns):
                if j not in (self.feature, self.task):
                    part[name] = at.get(name, _typical(rows.iloc[:, j]))
            part[self.frame.columns[self.feature]] = x
            parts.append(part)
        labels = np.repeat(np.array([*tasks, None], dtype=object)[:-1], n_points)
        frame = pd.concat(parts, ignore_index=True)
        return self._replace(frame=frame, labels=labels)


def _name_of(y, output):
    """The name of the target, "y" if it has none."""
    columns = getattr(y, "columns", None)
    name = getattr(y, "name", None) if columns is None else columns[output]
    return "y" if name is None else str(name)


def _position(frame, feature, of_tasks):
    """Position of the feature to draw; some columns are of the tasks."""
    names = list(frame.columns)
    others = [name for j, name in enumerate(names) if j not in of_tasks]
    if feature is None:
        if len(others) == 1:
            return names.index(others[0])
        raise ValueError(
            f"X has several features, {others}: say by `feature` which one is to be "
            "the horizontal axis."
        )
    found = names.index(feature) if feature in names else None
    if found is None or found in of_tasks:
        raise ValueError(f"feature={feature!r} is not one of the features: {others}.")
    return found


def _typical(values):
    """The median, or the commonest text."""
    if pd.api.types.is_numeric_dtype(values):
        return values.median()
    try:
        return float(np.median(values.astype(float)))
    except (TypeError, ValueError):
        return values.mode().iloc[0]


def _chosen(tasks, labels):
    """The tasks to draw."""
    known = sorted(set(labels.tolist()))
    if tasks is None:
        return known
    tasks = [tasks] if isinstance(tasks, str) else tasks
    unknown = [label for label in tasks if label not in known]
    if unknown or not len(tasks):
        what = f"has {unknown[0]!r}, which X has not" if unknown else "is empty"
        raise ValueError(f"tasks {what}: choose from {known}.")
    return list(tasks)


def _check_pair(truth):
    """Raise a TypeError unless the truth is inputs and targets."""
    if not isinstance(truth, (tuple, list)) or len(truth) != 2:
        raise TypeError(
            f"truth={truth!r} must be a function of inputs such as X, or a pair of "
            "inputs and targets."
        )


def _of(frame, task):
    """Rows of a task."""
    return frame[[label == task for label in frame["task"]]]


def _panels(ax, n, n_cols, sharey):
    """Axes of the panels, as an array."""
    n_rows = math.ceil(n / (n_cols or 4))
    n_cols = n_cols or math.ceil(n / n_rows)
    if ax is None:
        figure = pyplot().figure(
            figsize=(PANEL[0] * n_cols, PANEL[1] * n_rows + 0.4), layout="constrained"
        )
        axes = figure.subplots(n_rows, n_cols, sharex=True, sharey=sharey)
    elif np.ndim(ax) or isinstance(ax, Sequence):
        axes = np.asarray(ax, dtype=object).ravel()
        if len(axes) != n:
            raise ValueError(f"ax has {len(axes)} axes, but there are {n} tasks.")
        return axes
    else:
        check_axes(ax)
        if ax.get_subplotspec() is None:
            raise ValueError(
                "ax has no place in a grid that panels could take. Make it by "
                "matplotlib.pyplot.subplots, or give one axes for each task."
            )
        ax.set_axis_off()
        place = ax.get_subplotspec().subgridspec(n_rows, n_cols)
        axes = place.subplots(sharex=True, sharey=sharey)
    axes = np.atleast_1d(np.asarray(axes, dtype=object)).ravel()
    for left in axes[n:]:
        left.set_visible(False)
    for k in range(max(0, n - n_cols), n):  # above an empty place, too
        axes[k].xaxis.set_tick_params(labelbottom=True)
    return axes[:n]
