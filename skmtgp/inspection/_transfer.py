"""Transfer: which tasks the others help."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.stats import norm, t
from sklearn.base import BaseEstimator, clone
from sklearn.utils import check_consistent_length

from skmtgp._data.labels import rows_by_code
from skmtgp._estimators.relations import evidence_of_relations
from skmtgp._support.warnings import collect_warnings, warn
from skmtgp.exceptions import NarrowIntervalsWarning, UnidentifiedNoiseWarning
from skmtgp.inspection._drawing import (
    COLORS,
    OF_MODELS,
    Display,
    check_option,
    label_positions,
)
from skmtgp.inspection._models import (
    PREDICTED,
    check_output,
    check_tasks,
    check_vector,
    model_of_tasks,
    model_with,
)
from skmtgp.model.several import terms_of
from skmtgp.single_task import alone_like

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOR_OF = {"helped": COLORS[2], "harmed": COLORS[5], "neither": COLORS[6]}
# Nats of a relation before it counts, beside half the logarithm of the number of rows
# for each number that it has learned: odds of 20 to 1. benchmarks/transfer.py has the
# errors of either kind, which 2 and 4 shift from one to the other.
CLEAR = 3.0
# Those that matter: what a task owes to the others, and to what has it alone. A third
# function was found to add hardly anything, were the model of full rank.
MOST_NUMBERS = 2
# Rows for each hyperparameter of a task alone, below which it is learned without the
# rows that it predicts, in so many folds: those that it has seen it predicts too well.
ENOUGH, FOLDS = 6, 10
OF_FEW_ROWS = NarrowIntervalsWarning, UnidentifiedNoiseWarning


class TransferDisplay(Display):
    r"""What each task gains from the others.

    Each sample is predicted twice from other samples: by the multi-task model, and by a
    model of its own task alone.

    Parameters
    ----------
    transfer : DataFrame of n_tasks rows
        The tasks are the index. The columns are

        - rows: number of samples;
        - log_density, log_density_alone: mean log density of a sample, by the
          multi-task model and by the model of the task alone;
        - gain, gain_std: their difference, and its standard error over the samples;
        - error, error_alone: root mean squared error, in units of y, or of the
          transformed targets if the model has a `target_transform`;
        - verdict: "helped" or "harmed" if the 95 % interval of the gain, by Student's
          t, is above or below zero, else "neither";
        - evidence: how many nats likelier the targets are than if the task had no
          relation to the others, at the same hyperparameters;
        - related: whether the evidence is more than the relation costs.

        Only `from_estimator` gives the last two.

    Attributes
    ----------
    bars_ : dict of matplotlib ErrorbarContainer
        Gains of the tasks of each verdict, if these are drawn.
    lines_ : list of two matplotlib Line2D
        Errors by the multi-task model and by the model of the task alone, if these are
        drawn.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    TaskCovarianceDisplay : How the tasks are related.
    skmtgp.SingleTaskGP : The model of each task alone.

    Notes
    -----
    `verdict` and `related` answer different questions. `verdict` compares with another
    model, which has its own hyperparameters. A task may be helped only because the
    others determine the noise and the length-scales. A task with enough rows is
    "neither", however much it has in common with others. `related` cuts the relation of
    one task in the learned model. The task is related if

    .. math::
        \log p(y_m | y_{-m}) - \log p(y_m) > 3 + \tfrac12 \min(r, 2) \log n_m

    Here r is the rank of the task covariance: so many numbers describe the task's
    relation, of which two matter. :math:`n_m` is the number of its rows. If a task is
    harmed, leave it out, learn it alone, or use ``diagonal=True`` or a higher rank. A
    task that is not related gains little. It harms no other task if the rank is high
    enough.

    `related` is reliable with 20 rows a task and related tasks of rank 1. With 12 rows
    or rank 2 it misses more related tasks, and with both more unrelated tasks pass for
    related. See :doc:`/guide/pictures`.

    The hyperparameters of the multi-task model have seen the sample that is left out. A
    task alone with fewer than six rows for each hyperparameter would predict rows that
    it has seen too well: it is learned again without them, in ten folds.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor
    >>> from skmtgp.inspection import TransferDisplay
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 60), np.repeat(["a", "b", "c", "odd"], 15)
    >>> y = np.repeat([1.0, -2.0, 0.5, 0.0], 15) * np.sin(2 * x)
    >>> y += np.where(task == "odd", np.cos(x**2 / 3), 0.0)
    >>> y += 0.2 * rng.standard_normal(60)
    >>> X = np.column_stack([x.astype(object), task])
    >>> model = MultiTaskGPRegressor(rank=2).fit(X, y)
    >>> display = TransferDisplay.from_estimator(model)
    >>> display.transfer["related"].to_dict()
    {'a': True, 'b': True, 'c': True, 'odd': False}
    >>> plt.show()

    The errors of the same:

    >>> display.plot(kind="error")
    <...>
    >>> plt.show()
    """

    def __init__(self, *, transfer: pd.DataFrame) -> None:
        self.transfer = transfer

    def plot(
        self,
        *,
        ax: Axes | None = None,
        kind: Literal["gain", "error"] = "gain",
    ) -> Self:
        """Draw the gains of the tasks, or their errors.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"gain", "error"}, default="gain"
            "gain" draws the gains in log density with their 95 % intervals, in the
            colour of the verdict, and hollow for tasks that are not related to others.
            "error" draws the errors of both models.

        Returns
        -------
        display : TransferDisplay
            The display itself.

        Raises
        ------
        ValueError
            If `kind` is neither.
        """
        check_option("kind", kind, ("gain", "error"))
        ax, table = self._set_axes(ax), self.transfer
        draw = self._draw_gains if kind == "gain" else self._draw_errors
        draw(table, np.arange(len(table)))
        ax.set(xlim=(-0.6, len(table) - 0.4), xlabel="task")
        label_positions(ax.xaxis, [str(task) for task in table.index])
        ax.legend()
        return self

    def _draw_gains(self, table, place):
        self.ax_.axhline(0.0, color="0.5", lw=0.8, zorder=0)
        self.bars_ = {}
        for verdict, color in COLOR_OF.items():
            rows = (table["verdict"] == verdict).to_numpy()
            if not rows.any():
                continue
            some, bars = table[rows], {"fmt": "none", "ecolor": color, "capsize": 3}
            self.bars_[verdict] = self.ax_.errorbar(
                place[rows], some["gain"], _edge(some), label=verdict, **bars
            )
            self._mark(place[rows], some["gain"], some, color)
        self._explain_hollow(table)
        self.ax_.set_ylabel("gain in log density of a sample, nats")

    def _draw_errors(self, table, place):
        names = {"error_alone": "task alone", "error": "multi-task"}
        models = {"error_alone": "SingleTaskGP", "error": "MultiTaskGPRegressor"}
        self.lines_ = []
        for name, label in names.items():
            style = {"color": OF_MODELS[models[name]], "marker": "o", "ls": "none"}
            found = self.ax_.plot(place, table[name], label=label, **style)
            self.lines_ = found + self.lines_
        self.ax_.set_ylim(bottom=0.0)
        self.ax_.set_ylabel("error of a sample left out, in units of y")

    def _mark(self, place, values, table, color):
        related = _related(table)
        for rows, face in ((related, color), (~related, "white")):
            style = {"ls": "none", "marker": "o", "color": color, "mfc": face}
            self.ax_.plot(place[rows], values.to_numpy()[rows], **style)

    def _explain_hollow(self, table):
        if not _related(table).all():
            style = {"ls": "none", "marker": "o", "color": "0.3", "mfc": "white"}
            self.ax_.plot([], [], label="not related", **style)

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        *,
        output: int = 0,
        ax: Axes | None = None,
        kind: Literal["gain", "error"] = "gain",
    ) -> Self:
        """Learn each task alone, and draw the gain of the multi-task model.

        Parameters
        ----------
        estimator : estimator
            Fitted model: MultiTaskGPRegressor, IndependentGP, PooledGP, RankSearchIC,
            or a Pipeline that ends with one. The models of the tasks alone are learned
            from the same rows, with the same kernel, an amplitude and, if the estimator
            has `task_levels`, a level.
        output : int, default=0
            Output to draw, if there are several.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"gain", "error"}, default="gain"
            What to draw, see :meth:`plot`.

        Returns
        -------
        display : TransferDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model learned its tasks separately, or is none of this package.
        ValueError
            If there is no such output or kind, or if the model has not kept its rows,
            as with Dask collections.
        """
        instead = "its tasks are learned alone, so that there is nothing to compare."
        model = model_of_tasks(estimator, PREDICTED)
        model = model_with("task_covariance_", model, instead)
        check_output(output, len(model.log_marginal_likelihoods_))
        check_option("kind", kind, ("gain", "error"))
        of_model = _output(model._leave_out(include_noise=True), output)
        y = model.y_train_.reshape(len(of_model[0]), -1)[:, output]
        tasks = model.tasks_train_
        of_alone = _alone(model, y, output)
        table = _table(y, of_model, of_alone, tasks)
        table.index = pd.Index(model.tasks_, name="task")
        table["evidence"] = evidence_of_relations(model, output)
        table["related"] = table["evidence"] > _cost(model, table["rows"])
        return cls(transfer=table).plot(ax=ax, kind=kind)

    @classmethod
    def from_predictions(
        cls,
        y_true: ArrayLike,
        y_mean: ArrayLike,
        y_std: ArrayLike,
        y_mean_alone: ArrayLike,
        y_std_alone: ArrayLike,
        *,
        tasks: ArrayLike,
        ax: Axes | None = None,
        kind: Literal["gain", "error"] = "gain",
    ) -> Self:
        """Draw the gain of one model's predictions over another's.

        Parameters
        ----------
        y_true : array-like of shape (n_samples,)
            Targets of samples that neither model has seen.
        y_mean, y_std : array-like of shape (n_samples,)
            Predictive means and standard deviations of the targets, noise included, by
            the multi-task model.
        y_mean_alone, y_std_alone : array-like of shape (n_samples,)
            The same by the model of each task alone, or by any other model.
        tasks : array-like of shape (n_samples,)
            Task of each sample.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        kind : {"gain", "error"}, default="gain"
            What to draw, see :meth:`plot`.

        Returns
        -------
        display : TransferDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If there is no such kind, or a standard deviation is not positive.
        """
        given = {
            "y_true": y_true,
            "y_mean": y_mean,
            "y_std": y_std,
            "y_mean_alone": y_mean_alone,
            "y_std_alone": y_std_alone,
        }
        y, *columns = (check_vector(values, name) for name, values in given.items())
        labels = check_tasks(tasks, len(y))
        check_consistent_length(y, *columns, labels.codes)
        for name in ("y_std", "y_std_alone"):
            least = np.min(given[name])
            if not least > 0.0:
                raise ValueError(f"{name} must be positive; its minimum is {least!s}.")
        table = _table(y, columns[:2], columns[2:], labels.codes)
        table.index = pd.Index(labels.tasks, name="task")
        return cls(transfer=table).plot(ax=ax, kind=kind)


def _related(table):
    """Whether each task is, as far as it is known."""
    if "related" not in table:
        return np.ones(len(table), dtype=bool)
    return table["related"].to_numpy()


def _cost(model, n):
    """Nats that a relation must be worth, of tasks of so many rows."""
    form = model._likelihoods[0].prior.task_covariance  # BIC may have chosen to share
    rank = np.sum(getattr(model, "rank_", 0)) + sum(of.shared for of in terms_of(form))
    return CLEAR + 0.5 * min(rank, MOST_NUMBERS) * np.log(n)


def _output(columns, output):
    return [values.reshape(len(values), -1)[:, output] for values in columns]


def _alone(model, y, output):
    """Means and deviations by a model of each task's other rows; NaN without any."""
    if model._trends() is not None:
        raise ValueError(
            "TransferDisplay compares the model with models of each task alone, and "
            "takes no trend. Fit it without one, or give predictions of both to "
            "from_predictions."
        )
    alone = alone_like(model, model._likelihoods[output].prior.kernels)
    alone.set_params(task_feature=-1, target_transform=None)  # y is transformed
    labels = model.tasks_[model.tasks_train_]  # warnings name them
    X = np.column_stack([model.X_train_.astype(object), labels])
    known = None if model._known is None else model._known.output(output)
    with collect_warnings() as collected:
        alone.fit(X, y, *(() if known is None else known.arguments()))
    for category, message in collected:
        if category not in OF_FEW_ROWS:  # others make up for them
            warn(f"Of the models of each task alone: {message}", category)
    found = np.stack(alone.loo_predict(include_noise=True))
    counts = np.bincount(model.tasks_train_)[model.tasks_train_]
    found[:, counts == 1] = np.nan  # their own mean was taken off
    sizes = [of.n_hyperparameters_ for of in alone.estimators_]
    few = counts < ENOUGH * np.array(sizes)[model.tasks_train_]
    for learned, left_out in _folds(model.tasks_train_, few & (counts > 1)):
        found[:, left_out] = _predicted(alone, X, y, known, learned, left_out)
    return found


def _folds(tasks, few):
    """Rows to learn from and rows that are left out, of tasks of few rows alone."""
    rng, fold = np.random.default_rng(0), np.full(len(tasks), -1)
    for rows in rows_by_code(np.where(few, tasks + 1, 0))[1]:
        fold[rows] = rng.permutation(len(rows)) % FOLDS
    for k in range(FOLDS):
        left_out = few & (fold == k)
        if left_out.any():
            yield few & ~left_out, left_out


def _predicted(alone, X, y, known, learned, left_out):
    """Means and deviations of rows that are left out, by models that are learned anew.

    A row may be the mean of several measurements, and have a known noise.
    """
    parts = () if known is None else known.part(learned).arguments()
    with collect_warnings():
        model = clone(alone).fit(X[learned], y[learned], *parts)
    mean, of_y = model.predict(X[left_out], return_std=True, include_noise=True)
    if known is None:
        return mean, of_y
    _, of_f = model.predict(X[left_out], return_std=True)
    noise = known.part(left_out).noise(of_y**2 - of_f**2)
    return mean, np.sqrt(of_f**2 + noise)


def _table(y, of_model, of_alone, codes):
    """The frame without what only the model knows."""
    densities = [norm.logpdf(y, *of) for of in (of_model, of_alone)]
    of_row = {
        "log_density": densities[0],
        "log_density_alone": densities[1],
        "gain": densities[0] - densities[1],
        "error": np.square(y - of_model[0]),
        "error_alone": np.square(y - of_alone[0]),
    }
    by_task = pd.DataFrame(of_row).groupby(codes)
    table, n = by_task.mean(), by_task.size()
    table.insert(0, "rows", n)
    table.insert(4, "gain_std", by_task["gain"].std() / np.sqrt(n))
    errors = ["error", "error_alone"]
    table[errors] = np.sqrt(table[errors])
    edge = _edge(table)
    if len(table) == 1:  # there are no others
        edge = np.inf
    helped, harmed = table["gain"] > edge, table["gain"] < -edge
    table["verdict"] = np.select([helped, harmed], ["helped", "harmed"], "neither")
    return table


def _edge(table):
    """Half the length of the 95 % interval of a gain; NaN with a single row."""
    freedom = np.maximum(table["rows"] - 1, 1)
    return t.ppf(0.975, freedom) * table["gain_std"]
