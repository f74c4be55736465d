"""How errors fall with the number of samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from numbers import Integral
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.model_selection import BaseCrossValidator, check_cv, cross_validate

from skmtgp._data.numbers import check_numbers
from skmtgp._data.splitting import TaskStratifiedKFold
from skmtgp._data.task_column import task_labels
from skmtgp.inspection._drawing import Display, check_axes, pyplot, style
from skmtgp.inspection._models import task_column
from skmtgp.metrics import make_normalized_mse_scorer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = "model", "n", "error", "draw"
FEW = 10  # numbers of samples that can all be written on an axis
CLOSE = 1.2  # ratio of neighbours whose names would overlap


class TaskLearningCurveDisplay(Display):
    """Error against the number of training samples, for one or several models.

    Parameters
    ----------
    results : DataFrame or mapping
        A row for each fit, with the columns model, n (number of training samples),
        error (positive) and draw (number of the random subset or fold).

    Attributes
    ----------
    lines_ : dict of str to matplotlib Line2D
        Medians over draws, by model.
    bands_ : dict of str to matplotlib PolyCollection
        Range from the smallest to the largest error of all draws, by model.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    skmtgp.metrics.normalized_mean_squared_error : The paper's error.

    Notes
    -----
    Both axes are logarithmic, as in Figure 4 of Chai, Williams, Klanke and Vijayakumar
    (2008).

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import BayesianLinearRegression, PooledGP
    >>> from skmtgp.inspection import TaskLearningCurveDisplay
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 40), np.tile([0, 1], 20)
    >>> X, y = np.column_stack([x, task]), np.sin(x) + 0.1 * rng.standard_normal(40)
    >>> models = {"linear": BayesianLinearRegression(), "pGP": PooledGP()}
    >>> TaskLearningCurveDisplay.from_estimator(
    ...     models, X, y, train_sizes=[10, 20], cv=2
    ... )
    <...>
    >>> plt.show()

    Errors that were measured elsewhere:

    >>> results = {
    ...     "model": ["mGP", "mGP", "mGP", "mGP"],
    ...     "n": [280, 280, 560, 560],
    ...     "draw": [1, 2, 1, 2],
    ...     "error": [1e-5, 3e-5, 1e-6, 2e-6],
    ... }
    >>> TaskLearningCurveDisplay.from_results(results)
    <...>
    >>> plt.show()
    """

    def __init__(self, *, results: pd.DataFrame | Mapping[str, Any]) -> None:
        self.results = results

    def plot(self, *, ax: Axes | None = None, ylabel: str = "nMSE") -> Self:
        """Draw a line and a band for each model.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        ylabel : str, default="nMSE"
            Name of the errors.

        Returns
        -------
        display : TaskLearningCurveDisplay
            The display itself.

        Raises
        ------
        ValueError
            If a column is missing, if an error is not positive, or if a model has
            several errors for the same n and draw.
        """
        table = _check_results(self.results)
        ax = self._set_axes(ax)
        self.lines_, self.bands_ = {}, {}
        for k, (name, rows) in enumerate(table.groupby("model", sort=False)):
            self.lines_[name], self.bands_[name] = self._draw(name, rows, style(k))
        ax.set(xlabel="training samples", ylabel=ylabel)
        _log_axes(ax, np.unique(table["n"]))
        ax.legend()
        return self

    def _draw(self, name, rows, look):
        """The line and the band of a model."""
        errors = rows.groupby("n")["error"].agg(["min", "median", "max"])
        n, light = errors.index, {"color": look["color"], "alpha": 0.2, "lw": 0}
        (line,) = self.ax_.plot(n, errors["median"], ms=5, label=str(name), **look)
        return line, self.ax_.fill_between(n, errors["min"], errors["max"], **light)

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator | Mapping[str, BaseEstimator],
        X: ArrayLike,
        y: ArrayLike,
        *,
        train_sizes: ArrayLike = (0.1, 0.2, 0.4, 0.7, 1.0),
        cv: int | BaseCrossValidator = 5,
        task_feature: int | str | None = None,
        n_jobs: int | None = None,
        ax: Axes | None = None,
    ) -> Self:
        """Fit models to increasing numbers of samples and draw their errors.

        Parameters
        ----------
        estimator : estimator or mapping of str to estimators
            A model or Pipeline, or several by name. They are cloned.
        X : array-like of shape (n_samples, n_features)
            Inputs as the estimators take them.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets. The errors are averaged over outputs.
        train_sizes : array-like, default=(0.1, 0.2, 0.4, 0.7, 1.0)
            Numbers of training samples, or shares of the largest training set.
        cv : int or cross-validator, default=5
            Number of folds of a :class:`~skmtgp.model_selection.TaskStratifiedKFold`,
            which shuffles always in the same way, or another splitter. Where a fold
            tests one row of a task, errors are divided by the variances of all targets
            of each task, not of those in the fold.
        task_feature : int or str, default=None
            Position or name of the task column of X. None takes that of the estimator,
            of a pipeline's first step, or of its model if X has a column of that name.
        n_jobs : int, default=None
            Number of fits at the same time, see :term:`n_jobs`.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.

        Returns
        -------
        display : TaskLearningCurveDisplay
            The display, drawn. Its `results` have the nMSE of each model, fold and
            number of training samples.

        Raises
        ------
        ValueError
            If the task column is not known, or if the folds cannot be made or have
            fewer samples than `train_sizes` asks for.
        """
        pyplot()  # not after hours of fits
        check_axes(ax)
        models = estimator
        if not isinstance(models, Mapping):
            models = {type(estimator).__name__: estimator}
        results = []
        for name, model in models.items():
            column = task_column(model, X, task_feature)
            errors = _errors(model, X, y, cv, column, train_sizes, n_jobs)
            results.append(errors.assign(model=name))
        return cls(results=pd.concat(results, ignore_index=True)).plot(ax=ax)

    @classmethod
    def from_results(
        cls,
        results: pd.DataFrame | Mapping[str, Sequence],
        *,
        ax: Axes | None = None,
        ylabel: str = "nMSE",
    ) -> Self:
        """Draw errors that were already measured.

        Parameters
        ----------
        results : DataFrame or mapping
            A row for each fit, with the columns model, n (number of training samples),
            error (positive) and draw (number of the random subset or fold).
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        ylabel : str, default="nMSE"
            Name of the errors.

        Returns
        -------
        display : TaskLearningCurveDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If a column is missing, if an error is not positive, or if a model has
            several errors for the same n and draw.
        """
        return cls(results=results).plot(ax=ax, ylabel=ylabel)


def _errors(model, X, y, cv, column, train_sizes, n_jobs):
    """n, draw and error of each fit of one model.

    Training sets are not scored, as `learning_curve` does: small ones may have one row
    of a task, whose error cannot be normalised.
    """
    if isinstance(cv, Integral):
        cv = TaskStratifiedKFold(cv, task_feature=column, shuffle=True, random_state=0)
    folds = list(check_cv(cv).split(X, y))
    sizes = _sizes(train_sizes, min(len(train) for train, _ in folds))
    cut = [(train[:n], test) for n in sizes for train, test in folds]
    scorer = _scorer(X, y, column, [test for _, test in folds])
    scores = cross_validate(model, X, y, cv=cut, scoring=scorer, n_jobs=n_jobs)
    n, draw = np.repeat(sizes, len(folds)), np.tile(np.arange(len(folds)), len(sizes))
    return pd.DataFrame({"n": n, "draw": draw, "error": -scores["test_score"]})


def _scorer(X, y, column, tests):
    """Of the nMSE; by variances of all targets where a fold has one row of a task."""
    tasks = task_labels(X, column).of_rows()
    targets = pd.DataFrame(check_numbers(y, "y").reshape(len(tasks), -1))
    distinct = [targets.iloc[test].groupby(tasks[test]).nunique() for test in tests]
    too_few = any((of < 2).any(axis=None) for of in distinct)
    y_var = targets.groupby(tasks).var(ddof=0) if too_few else None
    return make_normalized_mse_scorer(column, y_var=y_var)


def _sizes(train_sizes, largest):
    """Numbers of training samples, of which shares are made."""
    sizes = np.asarray(train_sizes)
    are_shares = sizes.dtype.kind == "f"
    most = 1 if are_shares else largest
    numbers = sizes.ndim == 1 and sizes.dtype.kind in "iuf" and sizes.size > 0
    if not (numbers and ((sizes > 0) & (sizes <= most)).all()):
        raise ValueError(
            f"train_sizes={train_sizes!r} must be numbers of training samples, from 1 "
            f"to {largest}, or shares of {largest}, above 0 and up to 1."
        )
    if are_shares:
        sizes = np.maximum(1, (sizes * largest).astype(int))
    return np.unique(sizes)


def _check_results(results):
    table = pd.DataFrame(results)
    missing = [name for name in COLUMNS if name not in table.columns]
    if missing:
        raise ValueError(f"results lack {missing}; they need columns {list(COLUMNS)}.")
    if not len(table):
        raise ValueError("results have no rows.")
    if (table["error"] <= 0.0).any():
        raise ValueError(
            f"Errors must be positive for a logarithmic axis; the least is "
            f"{table['error'].min()!s}."
        )
    if table.duplicated(["model", "n", "draw"]).any():
        raise ValueError(
            "results have several errors of one model, n and draw: select one output, "
            "or number the draws."
        )
    return table


def _log_axes(ax, sizes):
    """Logarithmic axes; the numbers of samples are named if they are few."""
    ax.set(xscale="log", yscale="log")
    ax.grid(alpha=0.3)
    if len(sizes) > FEW:
        return
    close = [b for a, b in pairwise(sizes) if b / a < CLOSE]
    ax.set_xticks(sizes, ["" if n in close else f"{n:g}" for n in sizes])
    ax.set_xticks([], minor=True)
