"""Training data as the estimators learn from them: sorted, scaled, one output each."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from skmtgp._data.complete import count_missing, design_of
from skmtgp._data.dask import held, is_dask
from skmtgp._data.data import Data
from skmtgp._data.descriptors import Descriptors
from skmtgp._data.known import Known, followed_by
from skmtgp._data.labels import sorted_tasks
from skmtgp._data.oddities import is_binary
from skmtgp._estimators.named_kernels import DEFAULT
from skmtgp._estimators.slopes import NOWHERE, OF_TASKS, Slopes, trends_with_task
from skmtgp._estimators.targets import AS_GIVEN, AsGiven
from skmtgp._estimators.units import Units, count_tasks, units_of_tasks
from skmtgp.model.trend import Trend

AS_THEY_ARE = slice(None)
FEW_ROWS = 5  # of a task: so many may well have the same y


@dataclass(frozen=True)
class Training:
    """Training data, checked.

    The rows may be in Dask arrays.

    Attributes
    ----------
    features : ndarray of shape (n_samples, n_inputs)
        X without the task column and the descriptors.
    codes : ndarray of shape (n_samples,)
        Position in `tasks` of each row's task.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    Y : ndarray of shape (n_samples, n_outputs)
        Targets, transformed.
    single_output : bool
        Whether y was one-dimensional.
    units : Units
        In which the targets are learned.
    noise : {"shared", "per_task"}
        Whether tasks have noise variances of their own.
    target : AsGiven or Transformed
        How Y was transformed.
    descriptors : Descriptors, default=None
        What is known of the tasks.
    slopes : Slopes, default=None
        A trend, as least squares see it.
    trends : list of n_outputs Trend, default=None
        The same in the units of each output.
    known : Known, default=None
        What is known of the noise of each row, in squared units of Y.
    looks_for_design : bool, default=True
        Whether it is not known already that the data are not complete.
    kernel : str
        Name of k^x where the user gives none.
    alike : bool, default=False
        Whether all features have one length-scale where the user gives no k^x.
    least_noise : ndarray of shape (n_outputs,), default=None
        Noise variance that each output has at least, in squared units of Y. None is
        not known.
    noisy : bool, default=False
        Whether all outputs are known to have noise, and functions are no sums.
    foretold : bool, default=False
        Whether it was said how long learning will take.
    """

    features: np.ndarray
    codes: np.ndarray
    tasks: np.ndarray
    Y: np.ndarray
    single_output: bool
    units: Units | None = None
    noise: str = "shared"
    target: AsGiven = AS_GIVEN
    descriptors: Descriptors | None = None
    slopes: Slopes | None = None
    trends: list[Trend] | None = None
    known: Known | None = None
    looks_for_design: bool = True
    kernel: str = DEFAULT
    alike: bool = False
    least_noise: np.ndarray | None = None
    noisy: bool = False
    foretold: bool = False

    @cached_property
    def design(self):
        """The row of each input and task, -1 if missing; None unless most have one."""
        if not self.looks_for_design:
            return None
        return design_of(self.features, self.codes)

    @property
    def n_missing(self):
        """Cells of `design` without a row."""
        return count_missing(self.design)

    @property
    def n_told(self):
        """How many rows a factor of K^rho has: one for each task, or descriptor."""
        return len(self.tasks) if self.descriptors is None else self.descriptors.n_rows

    @cached_property
    def counts(self):
        """Number of rows of each task."""
        return count_tasks(self.codes, len(self.tasks))

    @cached_property
    def constants(self):
        """Whether all rows of a task have the same y, (n_tasks, n_outputs).

        It is not asked of tasks of few rows, of outputs that do not vary at all, nor of
        Dask collections.
        """
        if is_dask(self.Y):
            return np.zeros((len(self.tasks), self.Y.shape[1]), dtype=bool)
        same = equal_in_tasks(self.Y, self.codes, self.counts, self.known)
        return same & (self.counts > FEW_ROWS)[:, None] & (np.ptp(self.Y, axis=0) > 0.0)

    @property
    def constant(self):
        """Which tasks are constant in an output."""
        return self.constants.any(axis=1)

    @cached_property
    def binary(self):
        """Whether each output has two values alone. Dask collections are not asked."""
        if is_dask(self.Y):
            return np.zeros(self.Y.shape[1], dtype=bool)
        return is_binary(self.Y)

    @property
    def measured(self):
        """Number of measurements of each task: a row may stand for several."""
        if self.known is None:
            return self.counts
        return count_tasks(self.codes, len(self.tasks), self.known)

    @property
    def has_constants(self):
        """Whether a trend has a constant of each task, which is then no level."""
        return self.slopes is not None and self.slopes.has_constants

    @property
    def chosen(self):
        """Units, noise and its least variance, and an unusual k^x, in words."""
        units = "own units for each task" if self.units.own_scales else "the same units"
        noises = {
            "shared": "one noise variance for all tasks",
            "per_task": "a noise variance for each task",
        }
        kernel = "" if self.kernel == DEFAULT else f', kernel="{self.kernel}"'
        kernel += ", one length-scale for all features" if self.alike else ""
        least = "" if self.least_noise is None else ", a least noise variance"
        return f"{units}, {noises[self.noise]}{kernel}{least}"

    def unexplained(self, per_task):
        """Targets without what least squares explain by a trend.

        `per_task` is whether each task is taken off its own mean.
        """
        if self.slopes is None:
            return self.Y
        place = self.slopes.place(per_task)
        if place is None:
            self.slopes.refuse_means(per_task)
        return self.slopes.unexplained(self.Y, place)

    def with_units(self, units):
        """The data in other units, those of `unexplained` targets."""
        if self.slopes is None:
            return replace(self, units=units)
        place = self.slopes.place(units.own_centres)
        if self.slopes.centred and place == NOWHERE:  # constants are the trend's
            units = units._replace(centre=np.zeros_like(units.centre))
        trends = self.slopes.trends(self.Y, units, place)
        return replace(self, units=units, trends=trends)

    def without_levels(self):
        """The data, each task taken off its own mean, for small models of them."""
        Y, n_tasks = self.Y, len(self.tasks)
        if self.slopes is not None:
            Y = self.slopes.unexplained(Y, OF_TASKS)
        of_tasks = units_of_tasks(Y, self.codes, n_tasks, self.known)
        scale = np.broadcast_to(self.units.scale, of_tasks.scale.shape)
        units = Units(of_tasks.centre, scale)
        trends = self.slopes and self.slopes.trends(self.Y, units, OF_TASKS)
        return replace(self, units=units, trends=trends)

    def log_jacobian(self):
        """Log density of the targets in units of y less that in these, by output."""
        found = self.units.log_jacobian(self.measured)
        if self.trends is None:
            return found
        rows = self.features, self.codes
        return found + [trend.log_jacobian(*rows) for trend in self.trends]

    def order(self, engine):
        """The rows as the engine takes them: sorted by task, or all as they are."""
        return np.argsort(self.codes, kind="stable") if engine.sorts else AS_THEY_ARE

    def data(self, engine):
        """The data of each output, scaled."""
        order, design = self.order(engine), None
        X, tasks, Y = self.features, self.codes, self.units.scaled(self.Y, self.codes)
        if engine.sorts:  # views of X would be pickled beside it
            X, tasks, Y = X[order], tasks[order], Y[order]
        if engine.uses_design and self.design is not None:
            place = np.append(np.argsort(order), -1)
            design = place[self.design]  # -1 is the last
        n_tasks = len(self.tasks)
        Q = self.descriptors and self.descriptors.Q
        of_outputs = [held(y) for y in Y.T]
        if self.trends is not None:
            pairs = zip(of_outputs, self.trends, strict=True)
            of_outputs = [y - trend.fitted(X, tasks) for y, trend in pairs]
        knowns = self._knowns(order, len(of_outputs))
        return [
            Data(X, tasks, y, n_tasks, design, Q=Q, known=known)
            for y, known in zip(of_outputs, knowns, strict=True)
        ]

    def targets(self, engine):
        """Targets in the units of y, rows and outputs in the order of `data`."""
        return self.Y[self.order(engine)]

    def _knowns(self, order, n_outputs):
        """What is known of the noise of the rows of each output, scaled."""
        if self.known is None:
            return [None] * n_outputs
        scale = self.units.of_rows(self.units.scale, self.codes)
        known = self.known.scaled(scale).part(order)
        return [known.output(j) for j in range(n_outputs)]

    def with_rows(self, features, codes, Y, known=None):
        """The data with more rows of its tasks, which come last.

        Parameters
        ----------
        features : ndarray of shape (n_new, n_features - 1)
            Their inputs.
        codes : ndarray of shape (n_new,)
            Position of the task of each.
        Y : ndarray of shape (n_new, n_outputs)
            Their targets, not transformed.
        known : Known, default=None
            What is known of their noise.

        Returns
        -------
        training : Training
            In the same units.
        """
        return replace(
            self,
            features=np.vstack([self.features, features]),
            codes=np.append(self.codes, codes),
            Y=np.vstack([self.Y, self.target.forward(Y)]),
            known=followed_by(self.known, known, self.Y.shape, Y.shape),
        )

    def with_unit_of(self, task, expected=None):
        """The data with the unit of a task from its rows.

        With a trend they stay in the unit that the task has joined with. For `expected`
        see :meth:`with_task`.
        """
        if self.trends is not None:
            return self
        of_task = self.part(self.codes == task)
        others, more = self.units.without_task(task), (expected, of_task.known)
        units = others.with_task(of_task.Y, task, len(self.tasks) - 1, *more)
        return replace(self, units=units)

    def part(self, rows):
        """The data of some of the rows, in the same units."""
        parts = {name: getattr(self, name)[rows] for name in ("features", "codes", "Y")}
        return replace(self, **parts, known=self.known and self.known.part(rows))

    def with_task(self, features, label, Y, expected=None, known=None):
        """The data of one more task put below the others'.

        Parameters
        ----------
        features : ndarray of shape (n_new, n_features - 1)
            Columns of its X without the task's.
        label : str, int or bool
            Its label.
        Y : ndarray of shape (n_new, n_outputs)
            Its targets, not transformed.
        expected : tuple of (mean, deviation), default=None
            See :meth:`Units.with_task`.
        known : Known, default=None
            What is known of the noise of its rows.

        Returns
        -------
        training : Training
            In the same units; the task may have a centre of its own.
        position : int
            Where the task is among the tasks.
        """
        Y, trends, units = self.target.forward(Y), self.trends, self.units
        tasks = sorted_tasks([*self.tasks.tolist(), label])
        position = tasks.tolist().index(label)
        codes = self.codes + (self.codes >= position)
        descriptors = self.descriptors
        if descriptors is not None:
            values = features[0, descriptors.columns]
            features = descriptors.inputs(features)
            descriptors = descriptors.with_task(values, position)
        if trends is None:
            units = units.with_task(Y, position, len(self.tasks), expected, known)
        else:
            rows = features, Y, len(self.tasks), expected, known
            units, trends = trends_with_task(units, trends, position, *rows)
        training = replace(
            self,
            features=np.vstack([self.features, features]),
            codes=np.append(codes, np.full(len(features), position)),
            tasks=tasks,
            Y=np.vstack([self.Y, Y]),
            units=units,
            descriptors=descriptors,
            known=followed_by(self.known, known, self.Y.shape, Y.shape),
            trends=trends,
        )
        return training, position


def equal_in_tasks(Y, codes, counts, known=None):
    """Whether all rows of a task have the same y, of shape (n_tasks, n_outputs).

    Means of measurements that differ are not the same.
    """
    starts = np.append(0, np.cumsum(counts)[:-1])
    order = np.argsort(codes, kind="stable")
    Y = Y[order]
    same = np.minimum.reduceat(Y, starts) == np.maximum.reduceat(Y, starts)
    if known is not None:
        spread = np.reshape(known.spread, Y.shape)
        same &= ~np.logical_or.reduceat(spread[order] > 0.0, starts)
    return same
