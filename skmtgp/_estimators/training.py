"""Training data as the estimators learn from them: sorted, scaled, one output each."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from skmtgp._data.complete import complete_design
from skmtgp._data.dask import held
from skmtgp._data.data import Data
from skmtgp._data.descriptors import Descriptors
from skmtgp._data.labels import sorted_tasks
from skmtgp._estimators.targets import AS_GIVEN, AsGiven
from skmtgp._estimators.units import Units, count_tasks

AS_THEY_ARE = slice(None)


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

    @cached_property
    def design(self):
        """The row of each input and task, or None where the data are not complete."""
        return complete_design(self.features, self.codes)

    @property
    def n_told(self):
        """How many rows a factor of K^rho has: one for each task, or descriptor."""
        return len(self.tasks) if self.descriptors is None else self.descriptors.n_rows

    @cached_property
    def counts(self):
        """Number of rows of each task."""
        return count_tasks(self.codes, len(self.tasks))

    @property
    def chosen(self):
        """Units and noise, in words."""
        units = "own units for each task" if self.units.per_task else "the same units"
        noises = {
            "shared": "one noise variance for all tasks",
            "per_task": "a noise variance for each task",
        }
        return f"{units}, {noises[self.noise]}"

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
            design = np.argsort(order)[self.design]
        n_tasks = len(self.tasks)
        Q = self.descriptors and self.descriptors.Q
        return [Data(X, tasks, held(y), n_tasks, design, Q=Q) for y in Y.T]

    def with_rows(self, features, codes, Y):
        """The data with more rows of its tasks, which come last.

        Parameters
        ----------
        features : ndarray of shape (n_new, n_features - 1)
            Their inputs.
        codes : ndarray of shape (n_new,)
            Position of the task of each.
        Y : ndarray of shape (n_new, n_outputs)
            Their targets, not transformed.

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
        )

    def part(self, rows):
        """The data of some of the rows, in the same units."""
        parts = {name: getattr(self, name)[rows] for name in ("features", "codes", "Y")}
        return replace(self, **parts)

    def with_task(self, features, label, Y):
        """The data of one more task put below the others'.

        Parameters
        ----------
        features : ndarray of shape (n_new, n_features - 1)
            Columns of its X without the task's.
        label : str, int or bool
            Its label.
        Y : ndarray of shape (n_new, n_outputs)
            Its targets, not transformed.

        Returns
        -------
        training : Training
            In the same units.
        position : int
            Where the task is among the tasks.
        """
        Y = self.target.forward(Y)
        tasks = sorted_tasks([*self.tasks.tolist(), label])
        position = tasks.tolist().index(label)
        codes = self.codes + (self.codes >= position)
        descriptors = self.descriptors
        if descriptors is not None:
            values = features[0, descriptors.columns]
            features = descriptors.inputs(features)
            descriptors = descriptors.with_task(values, position)
        training = replace(
            self,
            features=np.vstack([self.features, features]),
            codes=np.append(codes, np.full(len(features), position)),
            tasks=tasks,
            Y=np.vstack([self.Y, Y]),
            units=self.units.with_task(Y, position),
            descriptors=descriptors,
        )
        return training, position
