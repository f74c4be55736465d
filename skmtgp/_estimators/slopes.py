"""A trend at the training rows: whether they tell it, and its part in the units."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from sklearn.base import TransformerMixin

from skmtgp._data.labels import listed
from skmtgp._data.trend import TrendColumns
from skmtgp.model.trend import Basis, Trend

TrendOf = Literal["constant", "linear"] | Sequence[int | str] | TransformerMixin | None
# Where in `Slopes.means` are those that columns are taken off
OF_TASKS, OF_ALL, NOWHERE = range(3)
ALIKE = 1e-6  # how much weights of columns that add up to a constant may differ
OR_SHARED = ", or set trend_per_task=False"
AS_TERM = (
    " A term of the kernel may have them instead, Columns(DotProduct(), [...]) for "
    "example: it shrinks effects that rows do not tell."
)


@dataclass(frozen=True)
class Slopes:
    """Columns of a trend at the training rows, and least squares.

    Coefficients by least squares are taken off the targets before these get their
    units, and before anything is learned: no likelihood changes by that, but starts and
    units are those of what the trend leaves.

    Attributes
    ----------
    columns : TrendColumns
        What the columns are made of.
    features : ndarray of shape (n_samples, n_inputs)
        Inputs.
    codes : ndarray of shape (n_samples,)
        Task of each row.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    per_task : bool
        Whether each task has coefficients of its own.
    centred : bool
        Whether the targets are taken off means: then the columns are, too.
    """

    columns: TrendColumns
    features: np.ndarray
    codes: np.ndarray
    tasks: np.ndarray
    per_task: bool
    centred: bool

    def check(self):
        """Raise a ValueError where the rows do not tell the coefficients."""
        H, names = self.columns(self.features), self.columns.names
        told = Basis(H).rank == len(names)  # by all rows
        otherwise = OR_SHARED * (told and self.per_task)
        instead = "" if told else _without_constant(H, names)
        for task in range(len(self.tasks)) if self.per_task else [None]:
            rows = H if task is None else H[self.codes == task]
            _check_columns(rows, names, _named(self.tasks, task), otherwise, instead)
        if len(H) <= (n := self._plain.n_coefficients):
            raise ValueError(
                f"trend has {n} coefficients, and n_samples={len(H)} leaves nothing to "
                "learn functions and noise from. Give more rows or fewer columns."
            )

    @cached_property
    def _plain(self):
        """The trend as it is, in units of y."""
        n_trend, n_tasks = len(self.columns), len(self.tasks)
        slopes = np.zeros((n_tasks if self.per_task else 1, n_trend))
        none = np.zeros((1, n_trend))
        parts = self.columns, n_tasks, self.per_task, none, np.ones(1), slopes
        return Trend(*parts)

    def _around(self, centre):
        return replace(self._plain, centre=centre)

    def _basis(self, trend):
        return trend.basis(self.features, self.codes)

    @cached_property
    def means(self):
        """Of the columns: those of each task, of all rows, and none."""
        H = self.columns(self.features)
        counts = np.bincount(self.codes, minlength=len(self.tasks))
        sums = [np.bincount(self.codes, h, len(self.tasks)) for h in H.T]
        of_tasks = np.transpose(sums) / np.maximum(counts, 1)[:, None]
        return of_tasks, H.mean(axis=0, keepdims=True), self._plain.centre

    @cached_property
    def ranks(self):
        """How many coefficients the columns tell, off each of these means."""
        return [self._basis(self._around(of)).rank for of in self.means]

    @property
    def has_constants(self):
        """Whether a constant of each task is part of the trend."""
        return self.ranks[NOWHERE] - self.ranks[OF_TASKS] == len(self.tasks)

    def place(self, per_task):
        """Which of the means the columns are taken off, where the targets are.

        Parameters
        ----------
        per_task : bool
            Whether that is off their means in each task.

        Returns
        -------
        place : int or None
            In `means`. The last one where constants are part of the trend; None where
            some are, but not those of each task.
        """
        if not self.centred:
            return NOWHERE
        place = OF_TASKS if per_task else OF_ALL
        n_constants = len(self.tasks) if per_task or self.per_task else 1
        lost = self.ranks[NOWHERE] - self.ranks[place]
        return {0: place, n_constants: NOWHERE}.get(lost)

    def coefficients(self, Y):
        """By least squares, beside means of tasks where these can be told.

        Returns
        -------
        coefficients : list of n_outputs ndarrays of shape (n_sets, n_trend)
        """
        place = int(np.argmax(np.equal(self.ranks, self.ranks[NOWHERE])))
        basis = self._basis(self._around(self.means[place]))
        found = basis.least_squares(Y)
        return [of.reshape(self._plain.slopes.shape) for of in found.T]

    def unexplained(self, Y, place):
        """Targets without what least squares explain of them."""
        trend = self._around(self.means[place])
        fitted = [
            replace(trend, slopes=of).fitted(self.features, self.codes)
            for of in self.coefficients(Y)
        ]
        return Y - np.transpose(fitted)

    def trends(self, Y, units, place):
        """The trend in the units of each output."""
        trend = self._around(self.means[place])
        return [
            replace(trend, scale=scale, slopes=of)
            for scale, of in zip(units.scale, self.coefficients(Y), strict=True)
        ]

    def refuse_means(self, per_task):
        """Raise a ValueError that says which columns means leave nothing of."""
        place = OF_TASKS if per_task else OF_ALL
        n, basis = len(self.columns), self._basis(self._around(self.means[place]))
        names = sorted({self.columns.names[j % n] for j in basis.dependent})
        units, other = ("per_task", "shared") if per_task else ("shared", "False")
        raise ValueError(
            f"normalize_y={units!r} subtracts the means of the targets and of the "
            f"trend's columns{' in each task' * per_task}, which leaves nothing of "
            f"{listed(names)}. Set normalize_y={other!r}, or leave such columns out, "
            "for example by include_bias=False of a PolynomialFeatures. For a constant "
            "of each task set trend='linear' and trend_per_task=True."
        )


def trends_with_task(
    units, trends, position, features, Y, n_tasks, expected=None, known=None
):
    """Units and trends of one more task.

    Parameters
    ----------
    units : Units
        Of the tasks so far.
    trends : list of n_outputs Trend
        Of the same.
    position : int
        Where the task goes among them.
    features : ndarray of shape (n_new, n_inputs)
        Its inputs.
    Y : ndarray of shape (n_new, n_outputs)
        Its targets.
    n_tasks, expected, known
        See :meth:`Units.with_task`; of what the trend leaves.

    Returns
    -------
    units : Units
    trends : list of n_outputs Trend

    Raises
    ------
    ValueError
        If the rows do not tell its own coefficients.
    """
    first = trends[0]
    H, slopes, centre = first.columns(features), [None] * len(trends), None
    if len(first.centre) > 1:  # each task is taken off its own mean
        centre = H.mean(axis=0)
        H = H - centre
    elif first.centre.any():
        H = H - first.centre
    if first.per_task:
        _check_columns(H, first.columns.names, " of the new task", OR_SHARED)
        if len(H) == H.shape[1]:
            raise ValueError(
                f"The new task has {len(H)} rows and {len(H)} coefficients of the "
                "trend, which fit any targets exactly. Give more rows."
            )
        slopes = list(Basis(H).least_squares(Y).T)
    fitted = [
        H @ (of.slopes[0] if own is None else own)
        for of, own in zip(trends, slopes, strict=True)
    ]
    rest = Y - np.transpose(fitted)
    units = units.with_task(rest, position, n_tasks, expected, known)
    scales = units.scale[:, position] if units.own_scales else [None] * len(trends)
    outputs = zip(trends, scales, slopes, strict=True)
    return units, [of.with_task(position, centre, *own) for of, *own in outputs]


def check_alone(columns, features, label):
    """Raise a ValueError where the rows of a task alone do not tell its trend.

    Parameters
    ----------
    columns : TrendColumns
        How the trend's columns are made.
    features : ndarray of shape (n_samples, n_inputs)
        Inputs of the task.
    label : str, int or bool
        The task.
    """
    H, names = columns(features), columns.names
    of, otherwise = f" of task {label!r}", ", or leave the task out"
    _check_columns(H, names, of, otherwise)
    if len(H) == len(names):
        raise ValueError(
            f"n_samples={len(H)}{of} and {len(H)} coefficients of the trend leave "
            "nothing to learn a function and noise from. Give more rows or fewer "
            f"columns{otherwise}."
        )


def _without_constant(H, names):
    """What to do where columns beside a constant add up to one; else nothing."""
    is_constant = np.ptp(H, axis=0) == 0.0
    others, basis = H[:, ~is_constant], Basis(H[:, ~is_constant])
    if basis.rank < others.shape[1] or basis.rank < Basis(H).rank:
        return ""
    weights = basis.least_squares(np.ones((len(H), 1)))[:, 0]
    added = np.abs(weights) > ALIKE * np.abs(weights).max(initial=0.0)
    if added.sum() < 2 or np.ptp(weights[added]) > ALIKE * weights[added].max():
        return ""
    shares = [name for name, of in zip(names, is_constant, strict=True) if not of]
    return (
        "Columns add up to a constant, as shares of a mixture do: leave the constant "
        f"out, by trend=[...] with the others alone ({listed(shares)})."
    )


def _check_columns(H, names, of="", otherwise="", instead=""):
    """Raise a ValueError where columns of some rows are not independent."""
    if len(H) < len(names):
        raise ValueError(
            f"n_samples={len(H)}{of} is too few for the {len(names)} coefficients of "
            f"the trend ({listed(names)}). Give more rows or fewer columns{otherwise}."
        )
    dependent = Basis(H).dependent
    if not dependent.size:
        return
    zero = [names[j] for j in dependent if not H[:, j].any()]
    others = [name for j, name in enumerate(names) if j not in dependent]
    why = (
        "zero everywhere"
        if len(zero) == len(dependent)
        else f"a linear combination of the others ({listed(others)})"
    )
    which = listed([names[j] for j in dependent])
    raise ValueError(
        f"In the rows{of} the trend's {which} is {why}, so its coefficient cannot be "
        f"determined. {instead or f'Leave such columns out of trend{otherwise}.'}"
        f"{AS_TERM * bool(otherwise and not instead)}"
    )


def _named(tasks, task):
    return "" if task is None else f" of task {tasks[task].item()!r}"
