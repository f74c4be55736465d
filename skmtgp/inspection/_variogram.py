"""Experimental variograms and cross-variograms, and those of the model."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from sklearn.base import BaseEstimator
from sklearn.utils import check_scalar

from skmtgp._data.task_column import locate_columns, locate_task_column
from skmtgp.inspection._drawing import Display, color_of, pyplot
from skmtgp.inspection._models import check_output, model_with

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST = 6  # tasks; more panels cannot be read
ENOUGH = 1500  # places of a pair of tasks; of more some are drawn
PANEL = 2.5, 1.9  # inches
HALF = 0.5  # of the largest distance: beyond, few places make the pairs


class VariogramDisplay(Display):
    r"""Variograms of tasks and cross-variograms of pairs, observed and by the model.

    Parameters
    ----------
    variograms : DataFrame
        A row for each bin of distances of each pair of tasks: columns "task" and
        "other", "distance", the mean of the pairs of places in it, "pairs", their
        number, "observed" and "model".

    Attributes
    ----------
    axes_ : ndarray of Axes of shape (n_tasks, n_tasks)
        The panels; those above the diagonal are off.
    observed_, lines_ : dict of tuple to matplotlib Line2D
        Dots and line of each panel, by its two tasks.
    color : str
        Of the model's lines. `from_estimator` sets that of the model, see
        :func:`color_of`.
    ax_ : matplotlib Axes
        The first panel.
    figure_ : matplotlib Figure
        The figure of the panels.

    See Also
    --------
    variogram_table : Nuggets, sills and ranges as numbers.
    TaskCovarianceDisplay : The sills alone.

    Notes
    -----
    For tasks a and b that were both measured at places i and j,

    .. math:: \gamma_{ab} = \tfrac12
        \operatorname{mean}\,(y^a_i - y^a_j)(y^b_i - y^b_j)

    over the pairs of places in a bin of distances. The line is what the model expects
    of the same pairs, with its noise variance, the nugget. It was fitted to all data by
    likelihood, not to the dots. Of models with a `trend` both are of what that leaves;
    with a `target_transform`, of the transformed targets. Levels of the tasks drop out.
    Noise that is known, `alpha`, is only in the dots. Dots of neighbouring bins are
    correlated, and where few places make many pairs they are all but useless.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from sklearn.gaussian_process.kernels import Matern
    >>> from skmtgp import MultiTaskGPRegressor, stack_tasks
    >>> from skmtgp.datasets import make_soil
    >>> from skmtgp.inspection import VariogramDisplay
    >>> soil = make_soil(random_state=2).drop(columns="nickel")
    >>> X, y = stack_tasks(soil, ["cadmium", "zinc"])
    >>> model = MultiTaskGPRegressor(
    ...     Matern(nu=0.5), rank=1, max_iter=5, target_transform=(np.log, np.exp)
    ... ).fit(X, y)
    >>> VariogramDisplay.from_estimator(model)
    <...>
    >>> plt.show()
    """

    def __init__(self, *, variograms: pd.DataFrame) -> None:
        self.variograms = variograms

    def plot(self, *, ax: Sequence[Sequence[Axes]] | None = None) -> Self:
        """Draw the panels.

        Parameters
        ----------
        ax : array of matplotlib Axes of shape (n_tasks, n_tasks), default=None
            Where to draw. None makes a new figure, with a legend.

        Returns
        -------
        display : VariogramDisplay
            This one.

        Raises
        ------
        ValueError
            If `ax` has another shape.
        """
        tasks = self.variograms["task"].drop_duplicates().tolist()
        self.axes_ = _panels(ax, len(tasks))
        self.ax_, self.figure_ = self.axes_[0, 0], self.axes_[0, 0].figure
        self.observed_, self.lines_ = {}, {}
        for (i, j), panel in np.ndenumerate(self.axes_):
            if j > i:
                panel.set_axis_off()
            else:
                self._draw(panel, tasks[i], tasks[j])
        for panel in self.axes_[-1]:
            panel.set_xlabel("distance")
        for panel in self.axes_[:, 0]:
            panel.set_ylabel("variogram")
        if ax is None:
            handles = [next(iter(of.values())) for of in (self.observed_, self.lines_)]
            style = {"ncols": 2, "frameon": False, "loc": "outside upper center"}
            self.figure_.legend(handles=handles, **style)
        return self

    def _draw(self, ax, task, other):
        """One panel; without any pair of places it stays empty."""
        frame = self.variograms
        found = frame[[a == task for a in frame["task"]]]
        found = found[[b == other for b in found["other"]]]
        x, style = found["distance"], {"ms": 4, "mew": 0, "color": "0.35"}
        dots = ax.plot(x, found["observed"], "o", label="observed", **style)[0]
        line = ax.plot(x, found["model"], color=self.color, label="model")[0]
        self.observed_[task, other], self.lines_[task, other] = dots, line
        ax.axhline(0.0, color="0.6", lw=0.5)
        ax.set_xlim(left=0.0)
        name = str(task) if task == other else f"{task} and {other}"
        ax.set_title(name if len(found) else f"{name}: no places", fontsize="medium")

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        *,
        tasks: Sequence[Any] | None = None,
        features: Sequence[int | str] | None = None,
        n_bins: int = 12,
        max_distance: float | None = None,
        output: int = 0,
        ax: Sequence[Sequence[Axes]] | None = None,
    ) -> Self:
        """Compute the variograms of the rows of `fit` and draw them.

        Parameters
        ----------
        estimator : estimator
            Fitted MultiTaskGPRegressor, IndependentGP or PooledGP, or a Pipeline or
            search that ends with one.
        tasks : sequence, default=None
            Labels of the tasks to draw, in that order. None is all.
        features : sequence of int or str, default=None
            Positions or names of the columns that distances are of, as the model gets
            them. None is all but that of the task.
        n_bins : int, default=12
            Number of bins of distances, of equal width.
        max_distance : float, default=None
            Up to which distance. None is half of the largest one.
        output : int, default=0
            Which of several outputs.
        ax : array of matplotlib Axes of shape (n_tasks, n_tasks), default=None
            Where to draw. None makes a new figure.

        Returns
        -------
        display : VariogramDisplay
            Drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model has no task covariance.
        ValueError
            If there is no such task, feature or output, if there are too many tasks,
            or if the model has not kept its rows.
        """
        instead = (
            "pass a model of all tasks; of a SingleTaskGP one of its estimators_, of a "
            "WideRegressor its estimator_."
        )
        model = model_with("task_covariance_", estimator, instead)
        model._check_rows()
        check_scalar(n_bins, "n_bins", int, min_val=1)
        survey = _Survey.of(model, output, _columns(model, features))
        codes = _codes(model.tasks_, tasks)
        edges = np.linspace(0.0, survey.reach(max_distance), n_bins + 1)
        parts = [
            survey.variogram(a, b, edges).assign(task=label_a, other=label_b)
            for i, (label_a, a) in enumerate(codes.items())
            for label_b, b in list(codes.items())[: i + 1]
        ]
        display = cls(variograms=pd.concat(parts, ignore_index=True))
        display.color = color_of(estimator)
        return display.plot(ax=ax)


class _Survey(NamedTuple):
    """The rows of a fit, and the covariances that were learned of them."""

    X: NDArray[np.float64]
    positions: NDArray[np.float64]
    tasks: NDArray[np.intp]
    y: NDArray[np.float64]
    terms: list  # (k^x, K^rho) of each term, in units of y
    noise: NDArray[np.float64]  # variance, of each task

    @classmethod
    def of(cls, model, output, columns):
        """Those of an output."""
        check_output(output, len(model._likelihoods))
        prior = model._likelihoods[output].prior
        theta = model._thetas()[output]
        n, scale = len(model.tasks_), model._units.scale[output]
        scale = np.broadcast_to(scale, n)
        terms = [
            (k, K * np.multiply.outer(scale, scale)) for k, K in prior.terms_at(theta)
        ]
        noise = np.broadcast_to(prior.values(theta).noise, n) * np.square(scale)
        X, tasks = model.X_train_, model.tasks_train_
        y = model.y_train_.reshape(len(X), -1)[:, output]
        y = y - _trend(model, prior.trend, output)
        return cls(X, X[:, columns], tasks, y, terms, noise)

    def reach(self, max_distance):
        """The largest distance of pairs."""
        if max_distance is None:
            return HALF * float(np.linalg.norm(np.ptp(self.positions, axis=0)))
        if not isinstance(max_distance, Real) or not max_distance > 0.0:
            raise ValueError(f"max_distance={max_distance!r} must be positive.")
        return float(max_distance)

    def places(self, a, b):
        """Rows of task a and of task b at the same places, some of them if many."""
        rows_a, rows_b = (np.flatnonzero(self.tasks == task) for task in (a, b))
        if a != b:
            places = np.unique(self.X, axis=0, return_inverse=True)[1].ravel()
            _, of_a, of_b = np.intersect1d(
                places[rows_a], places[rows_b], return_indices=True
            )
            rows_a, rows_b = rows_a[of_a], rows_b[of_b]
        if len(rows_a) > ENOUGH:
            drawn = np.random.RandomState(0).permutation(len(rows_a))[:ENOUGH]
            rows_a, rows_b = rows_a[drawn], rows_b[drawn]
        return rows_a, rows_b

    def variogram(self, a, b, edges):
        """Means over the pairs of places in each bin; empty bins are left out."""
        rows_a, rows_b = self.places(a, b)
        of_pair = np.triu_indices(len(rows_a), 1)
        apart = [
            np.subtract.outer(y, y)[of_pair] for y in (self.y[rows_a], self.y[rows_b])
        ]
        pairs = pd.DataFrame(
            {
                "distance": pdist(self.positions[rows_a]) if len(rows_a) > 1 else [],
                "observed": 0.5 * apart[0] * apart[1],
                "model": self.expected(a, b, self.X[rows_a])[of_pair],
            }
        )
        bins = pairs.groupby(
            pd.cut(pairs["distance"], edges, include_lowest=True), observed=True
        )
        return bins.mean().assign(pairs=bins.size()).reset_index(drop=True)

    def expected(self, a, b, X):
        """What the model expects of each pair, the noise included."""
        found = np.full((len(X), len(X)), self.noise[a] if a == b else 0.0)
        for kernel, K_rho in self.terms:
            k = kernel(X)
            diagonal = np.diagonal(k)
            found += K_rho[a, b] * (0.5 * np.add.outer(diagonal, diagonal) - k)
        return found


def _trend(model, trend, output):
    """The trend at the rows of fit, in units of y."""
    if trend is None:
        return 0.0
    coef = model.coef_ if model._single_output else model.coef_[output]
    coef = coef[model.tasks_train_] if trend.per_task else coef
    return (trend.columns(model.X_train_) * coef).sum(axis=1)


def _columns(model, features):
    """Positions among the inputs of the kernel."""
    if features is None:
        return slice(None)
    n, names = model.n_features_in_, getattr(model, "feature_names_in_", None)
    position = locate_task_column(model.task_feature, n, names)
    given = [features] if isinstance(features, str) else features
    why = "distances are of the others."
    columns = locate_columns(given, "features", position, n, names, why)
    descriptors = model._descriptors
    if descriptors is None:
        return columns
    left = np.delete(np.arange(n - 1), descriptors.columns)
    return np.searchsorted(left, columns)


def _codes(known, tasks):
    """Position of each task that is drawn, by its label."""
    labels = known.tolist()
    chosen = labels if tasks is None else list(tasks)
    unknown = [label for label in chosen if label not in labels]
    if unknown or not chosen:
        what = f"has {unknown[0]!r}, which the model has not" if unknown else "is empty"
        raise ValueError(f"tasks {what}: choose from {labels}.")
    if len(chosen) > MOST:
        raise ValueError(
            f"There are {len(chosen)} tasks, more panels than can be read. Choose at "
            f"most {MOST}: tasks={chosen[:3]!r} for example."
        )
    return {label: labels.index(label) for label in chosen}


def _panels(ax, n):
    """The axes, as an array of n rows and columns."""
    if ax is None:
        size = PANEL[0] * n + 0.5, PANEL[1] * n + 0.5
        figure = pyplot().figure(figsize=size, layout="constrained")
        return figure.subplots(n, n, sharex=True, squeeze=False)
    axes = np.asarray(ax, dtype=object).reshape(-1, 1) if n == 1 else np.asarray(ax)
    if axes.shape != (n, n):
        raise ValueError(f"ax has shape {axes.shape}, but {n} tasks need {(n, n)}.")
    return axes
