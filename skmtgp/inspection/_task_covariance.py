"""Picture of how the tasks are related."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.cluster.hierarchy import leaves_list, linkage
from scipy.spatial.distance import squareform
from sklearn.base import BaseEstimator
from sklearn.utils import check_array, check_consistent_length

from skmtgp._numerics.linalg import correlation
from skmtgp.inspection._drawing import (
    LEAST,
    Display,
    check_option,
    label_positions,
    letter_size,
    longest,
    points,
)
from skmtgp.inspection._models import (
    check_output,
    has_own_units,
    model_of_tasks,
    model_with,
    select_output,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class TaskCovarianceDisplay(Display):
    r"""Task covariance or correlation as a coloured matrix.

    Parameters
    ----------
    task_covariance : array-like of shape (n_tasks, n_tasks)
        :math:`K^\rho`, in squared units of y.
    tasks : array-like of shape (n_tasks,), default=None
        Labels of the tasks. None is 0, 1, ...

    Attributes
    ----------
    im_ : matplotlib AxesImage
        The matrix.
    text_ : ndarray of shape (n_tasks, n_tasks) of matplotlib Text, or None
        Values in the cells, if they are written.
    colorbar_ : matplotlib Colorbar or None
        Scale of the colours.
    order_ : ndarray of shape (n_tasks,)
        Position in `tasks` of each row of the picture.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    skmtgp.MultiTaskGPRegressor : Learns a task covariance.

    Notes
    -----
    The tasks' functions often have much in common, so all correlations are near 1.
    ``deviations=True`` shows how each task differs from their average: :math:`C K^\rho
    C` with :math:`C = I - 1 1^T / M`.
    1. ``deviations=True`` shows how each task differs from their average,
    :math:`C K^\rho C` with :math:`C = I - 1 1^T / M`.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor
    >>> from skmtgp.inspection import TaskCovarianceDisplay
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 60), np.repeat([0, 1, 2], 20)
    >>> y = np.array([1.0, -2.0, 0.5])[task] * np.sin(x)
    >>> model = MultiTaskGPRegressor(rank=1).fit(np.column_stack([x, task]), y)
    >>> display = TaskCovarianceDisplay.from_estimator(model)
    >>> plt.show()

    The same in another way:

    >>> display.plot(kind="correlation", order="similarity")
    <...>
    >>> plt.show()
    """

    def __init__(
        self, *, task_covariance: ArrayLike, tasks: Sequence | None = None
    ) -> None:
        self.task_covariance = task_covariance
        self.tasks = tasks

    def plot(
        self,
        *,
        ax: Axes | None = None,
        kind: Literal["auto", "covariance", "correlation"] = "auto",
        order: Literal["given", "similarity"] = "given",
        deviations: bool = False,
        include_values: bool | Literal["auto"] = "auto",
        cmap: str = "RdBu_r",
        colorbar: bool = True,
    ) -> Self:
        """Draw the matrix.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"auto", "covariance", "correlation"}, default="auto"
            What to draw. "auto" draws correlations if the model has learned the tasks
            in their own units: such covariances cannot be compared.
        order : {"given", "similarity"}, default="given"
            "given" is the order of `tasks`. "similarity" puts tasks with high
            correlation next to each other: hierarchical clustering by average linkage
            of one minus the correlation, with the best order of the leaves.
        deviations : bool, default=False
            Whether to draw the matrix of the tasks' deviations from their average.
        include_values : bool or "auto", default="auto"
            Whether to write the values in the cells. "auto" does so if they can be
            read.
        cmap : str or matplotlib Colormap, default="RdBu_r"
            Colours; the middle one is zero.
        colorbar : bool, default=True
            Whether to add the scale of the colours.

        Returns
        -------
        display : TaskCovarianceDisplay
            The display itself.

        Raises
        ------
        ValueError
            If `kind` or `order` is neither, or if the matrix does not fit the tasks.
        """
        check_option("kind", kind, ("auto", "covariance", "correlation"))
        if kind == "auto":
            kind = "correlation" if self.own_units else "covariance"
        matrix, labels = self._matrix(kind, order, deviations)
        ax = self._set_axes(ax)
        most = 1.0 if kind == "correlation" else np.abs(matrix).max() or 1.0
        self.im_ = ax.imshow(matrix, vmin=-most, vmax=most, cmap=cmap)
        self.colorbar_ = None
        if colorbar:
            name = f"task {kind}" + (" of deviations" if deviations else "")
            self.colorbar_ = self.figure_.colorbar(self.im_, ax=ax, label=name)
        label_positions(ax.xaxis, labels)
        label_positions(ax.yaxis, labels)
        self.text_ = self._write_values(matrix, kind, include_values)
        return self

    def _matrix(self, kind, order, deviations):
        """What is drawn, and the names of its rows."""
        check_option("order", order, ("given", "similarity"))
        K = check_array(self.task_covariance, input_name="task_covariance")
        if K.shape[0] != K.shape[1]:
            raise ValueError(f"task_covariance has shape {K.shape}; it must be square.")
        tasks = np.arange(len(K)) if self.tasks is None else np.asarray(self.tasks)
        check_consistent_length(K, tasks)
        if deviations:
            K = K - K.mean(axis=0) - K.mean(axis=1)[:, None] + K.mean()
        R = correlation(K)
        self.order_ = _by_similarity(R) if order == "similarity" else np.arange(len(K))
        drawn = R if kind == "correlation" else K
        rows = np.ix_(self.order_, self.order_)
        return drawn[rows], [str(task) for task in tasks[self.order_].tolist()]

    def _write_values(self, matrix, kind, include_values):
        """Values in the cells, light on dark."""
        text = _format_of(matrix, kind)
        texts = [[text(value) for value in row] for row in matrix]
        widest = max(longest(row) for row in texts)
        room = points(self.ax_.xaxis) / len(matrix)
        size = min(letter_size(), 0.4 * room, 1.4 * room / widest)
        if not include_values or (include_values == "auto" and size < LEAST):
            return None
        drawn = np.empty(matrix.shape, dtype=object)
        for (i, j), value in np.ndenumerate(matrix):
            red, green, blue, _ = self.im_.cmap(self.im_.norm(value))
            dark = 0.3 * red + 0.6 * green + 0.1 * blue < 0.5
            place = {"ha": "center", "va": "center", "fontsize": size}
            color = "white" if dark else "black"
            drawn[i, j] = self.ax_.text(j, i, texts[i][j], color=color, **place)
        return drawn

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        *,
        output: int = 0,
        term: int = 0,
        ax: Axes | None = None,
        kind: Literal["auto", "covariance", "correlation"] = "auto",
        order: Literal["given", "similarity"] = "given",
        deviations: bool = False,
        include_values: bool | Literal["auto"] = "auto",
        cmap: str = "RdBu_r",
        colorbar: bool = True,
    ) -> Self:
        """Draw the task covariance that a model has learned.

        Parameters
        ----------
        estimator : estimator
            Fitted model: MultiTaskGPRegressor, IndependentGP, PooledGP, RankSearchIC,
            or a Pipeline that ends with one.
        output : int, default=0
            Output to draw, if there are several.
        term : int, default=0
            Term to draw, if there are several, in the order of the model's kernels.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"auto", "covariance", "correlation"}, default="auto"
            What to draw. "auto" draws correlations if the model has learned the tasks
            in their own units: such covariances cannot be compared.
        order : {"given", "similarity"}, default="given"
            Order of the tasks, see :meth:`plot`.
        deviations : bool, default=False
            Whether to draw the matrix of the tasks' deviations from their average.
        include_values : bool or "auto", default="auto"
            Whether to write the values in the cells.
        cmap : str or matplotlib Colormap, default="RdBu_r"
            Colours; the middle one is zero.
        colorbar : bool, default=True
            Whether to add the scale of the colours.

        Returns
        -------
        display : TaskCovarianceDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model has no task covariance, or is none of this package.
        ValueError
            If there is no such output or term, or an option cannot be used.
        """
        instead = "its tasks are learned alone, so that there is nothing to show."
        model = model_of_tasks(estimator)
        model = model_with("task_covariance_", model, instead)
        n_outputs, n_tasks = len(model.log_marginal_likelihoods_), len(model.tasks_)
        K = model.task_covariance_.reshape(n_outputs, -1, n_tasks, n_tasks)
        of_terms = select_output(K, output, axis=0)
        check_output(term, len(of_terms), "term")
        display = cls(task_covariance=of_terms[term], tasks=model.tasks_)
        display.own_units = has_own_units(model)
        return display.plot(
            ax=ax,
            kind=kind,
            order=order,
            deviations=deviations,
            include_values=include_values,
            cmap=cmap,
            colorbar=colorbar,
        )


def _by_similarity(R) -> NDArray[np.intp]:
    """The order of the leaves of a hierarchical clustering of the tasks."""
    if len(R) < 3:
        return np.arange(len(R))
    distance = squareform(1.0 - 0.5 * (R + R.T), checks=False)
    return leaves_list(linkage(distance, "average", optimal_ordering=True))


def _format_of(matrix, kind):
    """One format for all values: they are compared at a glance."""
    variances = np.diag(matrix)[np.diag(matrix) > 0.0]
    if kind == "correlation" or not len(variances):
        spec = ".2f"
    elif 1e-3 <= variances.max() < min(1e4, 100.0 * variances.min()):
        power = math.floor(math.log10(variances.max()))
        spec = f".{max(0, 1 - power + (power >= 0))}f"
    else:
        spec = ".1e"
    # The sign is that of matplotlib's axes.
    return lambda value: f"{value:{spec}}".replace("-", "\N{MINUS SIGN}")
