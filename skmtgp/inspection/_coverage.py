"""Coverage of intervals, for each task."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.utils import check_consistent_length

from skmtgp._data.labels import rows_by_code
from skmtgp.inspection._drawing import Display, color_of
from skmtgp.inspection._models import (
    check_tasks,
    check_vector,
    predictions,
    tasks_of,
)
from skmtgp.metrics import coverage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEVELS = tuple(np.linspace(0.05, 0.95, 19).tolist())


class CoverageDisplay(Display):
    """Empirical coverage of central intervals against their level, for each task.

    Parameters
    ----------
    levels : array-like of shape (n_levels,)
        Nominal levels of the intervals, between 0 and 1.
    coverages : array-like of shape (n_tasks, n_levels)
        Share of each task's targets inside the intervals.
    tasks : array-like of shape (n_tasks,), default=None
        Labels of the tasks, used as labels of the lines.

    Attributes
    ----------
    task_lines_ : list of n_tasks matplotlib Line2D
        Coverage of each task, in the order of an estimator's ``tasks_`` if found from
        predictions. Empty if there is only one task.
    line_ : matplotlib Line2D
        Mean over the tasks, :func:`skmtgp.metrics.coverage`.
    diagonal_ : matplotlib Line2D
        Line of a perfectly calibrated model.
    color : str
        Colour of the predictions. `from_estimator` sets that of the model, see
        :func:`color_of`.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    skmtgp.metrics.coverage : The mean at one level.

    Notes
    -----
    Below the diagonal the model is overconfident. Above it, its intervals are too wide.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor
    >>> from skmtgp.inspection import CoverageDisplay
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 80), np.tile([0, 1], 40)
    >>> y = np.where(task == 0, 1.0, -2.0) * np.sin(x)
    >>> y += 0.1 * rng.standard_normal(80)
    >>> X = np.column_stack([x, task])
    >>> model = MultiTaskGPRegressor(rank=1).fit(X[:40], y[:40])
    >>> CoverageDisplay.from_estimator(model, X[40:], y[40:])
    <...>
    >>> plt.show()

    The same from predictions:

    >>> mean, std = model.predict(X[40:], return_std=True, include_noise=True)
    >>> CoverageDisplay.from_predictions(y[40:], mean, std, tasks=task[40:])
    <...>
    >>> plt.show()
    """

    def __init__(
        self,
        *,
        levels: ArrayLike,
        coverages: ArrayLike,
        tasks: ArrayLike | None = None,
    ) -> None:
        self.levels = levels
        self.coverages = coverages
        self.tasks = tasks

    def plot(self, *, ax: Axes | None = None) -> Self:
        """Draw a line for each task, their mean and the diagonal.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.

        Returns
        -------
        display : CoverageDisplay
            The display itself.
        """
        levels, coverages = np.asarray(self.levels), np.atleast_2d(self.coverages)
        ax = self._set_axes(ax, figsize=(4.8, 4.8))
        self.diagonal_ = ax.plot(
            [0, 1], [0, 1], color="black", lw=1, ls="--", label="calibrated"
        )[0]
        several = len(coverages) > 1
        self.task_lines_ = self._draw_tasks(levels, coverages) if several else []
        name = f"mean of {len(coverages)} tasks" if several else "coverage"
        self.line_ = ax.plot(
            levels, coverages.mean(axis=0), color=self.color, lw=2.4, label=name
        )[0]
        ax.set(xlim=(0, 1), ylim=(-0.01, 1.01), aspect="equal")
        ax.set(xlabel="nominal level", ylabel="share of targets inside")
        ax.legend()
        return self

    def _draw_tasks(self, levels, coverages):
        """A line for each task with its name, and one word for all in the legend."""
        thin = {"color": "0.6", "lw": 0.8, "alpha": 0.7}
        lines = self.ax_.plot(levels, coverages.T, **thin)
        tasks = range(len(lines)) if self.tasks is None else self.tasks
        for line, task in zip(lines, tasks, strict=True):
            line.set_label(f"_{task}")
        self.ax_.plot([], [], label="each task", **thin)
        return lines

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        X: ArrayLike,
        y: ArrayLike,
        *,
        output: int = 0,
        task_feature: int | str | None = None,
        levels: ArrayLike = LEVELS,
        ax: Axes | None = None,
    ) -> Self:
        """Predict test data and draw the coverage of the intervals.

        Parameters
        ----------
        estimator : estimator
            Fitted model of the package, or a Pipeline that ends with one.
        X : array-like of shape (n_samples, n_features)
            Inputs as the estimator takes them.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.
        output : int, default=0
            Output to draw, if there are several.
        task_feature : int or str, default=None
            Position or name of the task column of X. None takes that of the estimator,
            of a pipeline's first step, or of its model if X has a column of that name.
        levels : array-like of shape (n_levels,), default=0.05, 0.1, ..., 0.95
            Nominal levels of the intervals, between 0 and 1.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.

        Returns
        -------
        display : CoverageDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model is none of this package.
        ValueError
            If there is no such output, if a level is not between 0 and 1, or if the
            task column is not known.

        Notes
        -----
        With a `target_transform` the intervals are those of transformed targets, which
        contain the same share.
        """
        columns = predictions(estimator, X, y, output, learned=True)
        tasks = tasks_of(estimator, X, task_feature)
        display = cls._of_predictions(*columns, tasks, levels)
        display.color = color_of(estimator)
        return display.plot(ax=ax)

    @classmethod
    def from_predictions(
        cls,
        y_true: ArrayLike,
        y_mean: ArrayLike,
        y_std: ArrayLike,
        *,
        tasks: ArrayLike | None = None,
        levels: ArrayLike = LEVELS,
        ax: Axes | None = None,
    ) -> Self:
        """Draw the coverage of the intervals of predictions.

        Parameters
        ----------
        y_true, y_mean : array-like of shape (n_samples,)
            Targets and predictive means.
        y_std : array-like of shape (n_samples,)
            Positive standard deviations of the predicted targets, noise included.
        tasks : array-like of shape (n_samples,), default=None
            Task of each sample. None is one task.
        levels : array-like of shape (n_levels,), default=0.05, 0.1, ..., 0.95
            Nominal levels of the intervals, between 0 and 1.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.

        Returns
        -------
        display : CoverageDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If a level is not between 0 and 1 or a standard deviation is not positive.
        """
        return cls._of_predictions(y_true, y_mean, y_std, tasks, levels).plot(ax=ax)

    @classmethod
    def _of_predictions(cls, y_true, y_mean, y_std, tasks, levels):
        given = {"y_true": y_true, "y_mean": y_mean, "y_std": y_std}
        columns = [check_vector(values, name) for name, values in given.items()]
        labels = check_tasks(tasks, len(columns[0]))
        check_consistent_length(*columns, labels.codes)
        levels, found = np.atleast_1d(levels), []
        for rows in rows_by_code(labels.codes)[1]:
            alone = [values[rows] for values in columns]
            found.append([coverage(*alone, level=p) for p in levels.tolist()])
        return cls(levels=levels, coverages=np.array(found), tasks=labels.tasks)
