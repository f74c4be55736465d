"""Residuals of each task."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

from numpy.typing import ArrayLike
from scipy.special import ndtri
from sklearn.base import BaseEstimator
from sklearn.utils import check_consistent_length

from skmtgp._data.labels import rows_by_code
from skmtgp.inspection._drawing import Display, check_option, color_of, label_positions
from skmtgp.inspection._models import (
    check_tasks,
    check_vector,
    has_own_units,
    predictions,
    tasks_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class TaskResidualsDisplay(Display):
    """Residuals of each task as box plots.

    Parameters
    ----------
    residuals : array-like of shape (n_samples,)
        Targets minus predictive means, in units of y.
    y_std : array-like of shape (n_samples,), default=None
        Positive standard deviations of the predicted targets, noise included. Only
        standardised residuals need them.
    tasks : array-like of shape (n_samples,), default=None
        Task of each sample. None is one task.

    Attributes
    ----------
    boxes_ : dict of lists of matplotlib artists
        Artists that ``ax.boxplot`` returns: boxes, medians, whiskers, caps and fliers.
        A box goes from the first to the third quartile. The whiskers reach to the last
        sample within 1.5 times its length.
    tasks_ : ndarray of shape (n_tasks,)
        Task of each box, sorted as an estimator's ``tasks_``: numbers by size, text by
        its letters, so "machine 10" comes before "machine 2".
    color : str
        Colour of the predictions. `from_estimator` sets that of the model, see
        :func:`color_of`.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    CoverageDisplay : Whether the standard deviations are right.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor
    >>> from skmtgp.inspection import TaskResidualsDisplay
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 80), np.tile([0, 1], 40)
    >>> y = np.where(task == 0, 1.0, -2.0) * np.sin(x)
    >>> y += 0.1 * rng.standard_normal(80)
    >>> X = np.column_stack([x, task])
    >>> model = MultiTaskGPRegressor(rank=1).fit(X[:40], y[:40])
    >>> TaskResidualsDisplay.from_estimator(model, X[40:], y[40:], kind="standardized")
    <...>
    >>> plt.show()

    From predictions, in units of y:

    >>> mean = model.predict(X[40:])
    >>> TaskResidualsDisplay.from_predictions(y[40:], mean, tasks=task[40:])
    <...>
    >>> plt.show()
    """

    def __init__(
        self,
        *,
        residuals: ArrayLike,
        y_std: ArrayLike | None = None,
        tasks: ArrayLike | None = None,
    ) -> None:
        self.residuals = residuals
        self.y_std = y_std
        self.tasks = tasks

    def plot(
        self,
        *,
        ax: Axes | None = None,
        kind: Literal["auto", "residual", "standardized"] = "auto",
    ) -> Self:
        """Draw a box for each task.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"auto", "residual", "standardized"}, default="auto"
            "residual" has residuals in units of y. "standardized" divides them by
            `y_std`, and shows the central 95 % interval of a standard normal. "auto"
            is "standardized" if the model has learned the tasks in their own units.

        Returns
        -------
        display : TaskResidualsDisplay
            The display itself.

        Raises
        ------
        ValueError
            If `kind` is neither, or if `y_std` is needed and is missing or not
            positive.
        """
        kind = _kind(kind, self.own_units)
        residuals = self._standardized() if kind == "standardized" else self._raw()
        labels = check_tasks(self.tasks, len(residuals))
        check_consistent_length(residuals, labels.codes)
        self.tasks_ = labels.tasks
        groups = [residuals[rows] for rows in rows_by_code(labels.codes)[1]]
        ax = self._set_axes(ax)
        edge = ndtri(0.975)
        for level in (-edge, 0.0, edge) if kind == "standardized" else (0.0,):
            ax.axhline(level, color="0.5", lw=0.8, ls="--" if level else "-", zorder=0)
        self.boxes_ = ax.boxplot(groups, **_box_style(len(groups), self.color))
        ax.set(xlim=(-0.6, len(groups) - 0.4), xlabel="task")
        ax.set_ylabel("residual" + " / standard deviation" * (kind == "standardized"))
        label_positions(ax.xaxis, [str(task) for task in self.tasks_.tolist()])
        return self

    def _raw(self):
        return check_vector(self.residuals, "residuals")

    def _standardized(self):
        if self.y_std is None:
            raise ValueError("kind='standardized' needs y_std.")
        residuals, std = self._raw(), check_vector(self.y_std, "y_std")
        check_consistent_length(residuals, std)
        if not (std > 0.0).all():
            raise ValueError(f"y_std must be positive; its minimum is {std.min()!s}.")
        return residuals / std

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        X: ArrayLike,
        y: ArrayLike,
        *,
        output: int = 0,
        task_feature: int | str | None = None,
        ax: Axes | None = None,
        kind: Literal["auto", "residual", "standardized"] = "auto",
    ) -> Self:
        """Predict test data and draw the residuals.

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
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"auto", "residual", "standardized"}, default="auto"
            "residual" has residuals in units of y. "standardized" divides them by their
            predictive standard deviation; with a `target_transform` these are residuals
            of transformed targets. "auto" is "standardized" if the model has learned
            the tasks in their own units.

        Returns
        -------
        display : TaskResidualsDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model is none of this package.
        ValueError
            If there is no such output or kind, or if the task column is not known.
        """
        own_units = has_own_units(estimator)
        learned = _kind(kind, own_units) == "standardized"
        y_true, mean, std = predictions(estimator, X, y, output, learned=learned)
        tasks = tasks_of(estimator, X, task_feature)
        display = cls._of_predictions(y_true, mean, std, tasks)
        display.color, display.own_units = color_of(estimator), own_units
        return display.plot(ax=ax, kind=kind)

    @classmethod
    def from_predictions(
        cls,
        y_true: ArrayLike,
        y_mean: ArrayLike,
        y_std: ArrayLike | None = None,
        *,
        tasks: ArrayLike | None = None,
        ax: Axes | None = None,
        kind: Literal["auto", "residual", "standardized"] = "auto",
    ) -> Self:
        """Draw the residuals of predictions.

        Parameters
        ----------
        y_true, y_mean : array-like of shape (n_samples,)
            Targets and predictive means.
        y_std : array-like of shape (n_samples,), default=None
            Positive standard deviations of the predicted targets, noise included.
        tasks : array-like of shape (n_samples,), default=None
            Task of each sample. None is one task.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"auto", "residual", "standardized"}, default="auto"
            "residual" and "auto" have residuals in units of y. "standardized" divides
            them by `y_std`.

        Returns
        -------
        display : TaskResidualsDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If `kind` is neither, or if `y_std` is needed and is missing or not
            positive.
        """
        display = cls._of_predictions(y_true, y_mean, y_std, tasks)
        return display.plot(ax=ax, kind=kind)

    @classmethod
    def _of_predictions(cls, y_true, y_mean, y_std, tasks):
        targets, means = check_vector(y_true, "y_true"), check_vector(y_mean, "y_mean")
        check_consistent_length(targets, means)
        return cls(residuals=targets - means, y_std=y_std, tasks=tasks)


def _kind(kind, own_units):
    """The kind of residuals that is meant."""
    check_option("kind", kind, ("auto", "residual", "standardized"))
    if kind != "auto":
        return kind
    return "standardized" if own_units else "residual"


def _box_style(n_boxes, color):
    from matplotlib.colors import to_rgba

    return {
        "positions": range(n_boxes),
        "widths": 0.6,
        "manage_ticks": False,
        "patch_artist": True,
        "boxprops": {"facecolor": to_rgba(color, 0.4), "edgecolor": color},
        "medianprops": {"color": "black"},
        "whiskerprops": {"color": color},
        "capprops": {"color": color},
        "flierprops": {"marker": ".", "ms": 3, "mec": color, "alpha": 0.6},
    }
