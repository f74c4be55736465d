"""Predictions along a sequence."""

from __future__ import annotations

from numbers import Real
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri
from sklearn.base import BaseEstimator
from sklearn.utils import check_consistent_length, column_or_1d

from skmtgp.inspection._drawing import Display, color_of
from skmtgp.inspection._models import (
    check_vector,
    fitted_model,
    predictions,
    task_column,
    tasks_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class TrajectoryDisplay(Display):
    """Observed and predicted targets along a sequence, with a band.

    Parameters
    ----------
    y_true : array-like of shape (n_samples,)
        Targets.
    y_mean : array-like of shape (n_samples,)
        Predictive means.
    y_std : array-like of shape (n_samples,)
        Predictive standard deviations of new observations (noise included).
    time : array-like of shape (n_samples,), default=None
        Position of each sample along the sequence: times, or anything else that
        matplotlib can put on an axis. The samples are drawn in this order. None is 0,
        1, ...

    Attributes
    ----------
    observed_ : matplotlib Line2D
        The targets.
    line_ : matplotlib Line2D
        The predictive means.
    band_ : matplotlib PolyCollection
        Central intervals of the predictive normal distributions.
    color : str
        Colour of the predictions. `from_estimator` sets that of the model, see
        :func:`color_of`.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    TaskPredictionDisplay : Each task along a feature.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import PooledGP
    >>> from skmtgp.inspection import TrajectoryDisplay
    >>> time = np.linspace(0, 6, 40)
    >>> X, y = np.column_stack([time, np.zeros(40)]), np.sin(time)
    >>> model = PooledGP().fit(X[::2], y[::2])
    >>> TrajectoryDisplay.from_estimator(model, X, y, time=time)
    <...>
    >>> plt.show()

    The same from predictions:

    >>> mean, std = model.predict(X, return_std=True, include_noise=True)
    >>> TrajectoryDisplay.from_predictions(y, mean, std, time=time)
    <...>
    >>> plt.show()
    """

    def __init__(
        self,
        *,
        y_true: ArrayLike,
        y_mean: ArrayLike,
        y_std: ArrayLike,
        time: ArrayLike | None = None,
    ) -> None:
        self.y_true = y_true
        self.y_mean = y_mean
        self.y_std = y_std
        self.time = time

    def plot(self, *, ax: Axes | None = None, level: float = 0.95) -> Self:
        """Draw targets, predictions and their band.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        level : float, default=0.95
            Probability that the band contains a new observation, between 0 and 1.

        Returns
        -------
        display : TrajectoryDisplay
            The display itself.

        Raises
        ------
        ValueError
            If the data do not fit together, or `level` is not between 0 and 1.
        """
        if not isinstance(level, Real) or not 0.0 < level < 1.0:
            raise ValueError(f"level={level!r} must be a number between 0 and 1.")
        time, y_true, mean, std = self._sorted()
        half = std * ndtri(0.5 + 0.5 * level)
        ax = self._set_axes(ax)
        style = {"color": self.color, "alpha": 0.25, "lw": 0}
        self.band_ = ax.fill_between(
            time,
            mean - half,
            mean + half,
            label=f"{100 * level:.3g} % interval",
            **style,
        )
        self.observed_ = ax.plot(
            time, y_true, "o", color="0.35", ms=3, mew=0, label="observed"
        )[0]
        self.line_ = ax.plot(time, mean, color=self.color, label="predicted")[0]
        ax.set(xlabel="sample" if self.time is None else "time", ylabel="target")
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=3, frameon=False)
        return self

    def _sorted(self):
        """Times, targets, means and standard deviations in the order of the times."""
        names = "y_true", "y_mean", "y_std"
        columns = [check_vector(getattr(self, name), name) for name in names]
        if not (columns[2] >= 0.0).all():
            raise ValueError(f"y_std must not be negative, as {columns[2].min()!s} is.")
        time = np.arange(len(columns[0])) if self.time is None else self.time
        check_consistent_length(*columns)
        columns.insert(0, column_or_1d(time))
        if len(columns[0]) != len(columns[1]):
            raise ValueError(
                f"time has {len(columns[0])} values, but there are {len(columns[1])} "
                "samples: give one for each."
            )
        order = np.argsort(columns[0], kind="stable")
        return [column[order] for column in columns]

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        X: ArrayLike,
        y: ArrayLike,
        *,
        time: ArrayLike | None = None,
        output: int = 0,
        ax: Axes | None = None,
        level: float = 0.95,
    ) -> Self:
        """Predict a sequence and draw it.

        Parameters
        ----------
        estimator : estimator
            Fitted model of the package, or a Pipeline that ends with one.
        X : array-like of shape (n_samples, n_features)
            Inputs of one task, as the estimator takes them.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.
        time : array-like of shape (n_samples,), default=None
            Position of each sample along the sequence. None is 0, 1, ...
        output : int, default=0
            Output to draw, if there are several.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        level : float, default=0.95
            Probability that the band contains a new observation, between 0 and 1.

        Returns
        -------
        display : TrajectoryDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model is none of this package.
        ValueError
            If X has several tasks, whose sequences would run into one another. If there
            is no such output, or if the data do not fit together.

        Notes
        -----
        The rows must be a sequence. Rows drawn at random, as in
        :func:`~skmtgp.datasets.load_puma560`, make a line that jumps. The band is that
        of a normal distribution. A `target_transform` makes intervals that are not
        symmetric; draw those of ``predict_interval`` instead.
        """
        _check_one_task(estimator, X)
        y_true, mean, std = predictions(estimator, X, y, output)
        display = cls(y_true=y_true, y_mean=mean, y_std=std, time=time)
        display.color = color_of(estimator)
        return display.plot(ax=ax, level=level)

    @classmethod
    def from_predictions(
        cls,
        y_true: ArrayLike,
        y_mean: ArrayLike,
        y_std: ArrayLike,
        *,
        time: ArrayLike | None = None,
        ax: Axes | None = None,
        level: float = 0.95,
    ) -> Self:
        """Draw predictions of a sequence.

        Parameters
        ----------
        y_true, y_mean : array-like of shape (n_samples,)
            Targets and predictive means.
        y_std : array-like of shape (n_samples,)
            Predictive standard deviations of new observations (noise included).
        time : array-like of shape (n_samples,), default=None
            Position of each sample along the sequence. None is 0, 1, ...
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        level : float, default=0.95
            Probability that the band contains a new observation, between 0 and 1.

        Returns
        -------
        display : TrajectoryDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If the data do not fit together, or `level` is not between 0 and 1.
        """
        display = cls(y_true=y_true, y_mean=y_mean, y_std=y_std, time=time)
        return display.plot(ax=ax, level=level)


def _check_one_task(estimator, X):
    """Raise a ValueError if X is known to have several tasks."""
    fitted_model(estimator)
    try:
        column = task_column(estimator, X)
    except ValueError:  # a pipeline that does not tell it
        return
    tasks = np.unique(tasks_of(estimator, X, column)).tolist()
    if len(tasks) > 1:
        raise ValueError(
            f"X has rows of {len(tasks)} tasks, {tasks[:5]}, whose sequences would run "
            "into one another. Draw one at a time, X[X[task_feature] == task], or all "
            "in panels of their own by TaskPredictionDisplay."
        )
