"""New tasks that join a fitted Gaussian process."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from skmtgp._estimators.arriving import FEW, tell_task, tell_unit
from skmtgp._estimators.online import OnlineGP, grows
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.engine import check_kept
from skmtgp.learning.novel import join_alike, stay_alike

GROWN = 1.5  # times the rows from which a task's relation was learned: learn it anew
ENOUGH = 100  # rows tell it: more take longer, and tell little more


class Joined(NamedTuple):
    """How a task has joined.

    Attributes
    ----------
    informed : bool
        Whether its relation to the others has a prior.
    told : int
        Rows from which it was learned.
    asked : bool
        Whether it was asked if the task is in another unit.
    """

    informed: bool
    told: int
    asked: bool

    def is_outgrown(self, n_rows):
        """Whether the task has so many more rows that they tell the relation better."""
        return self.told < ENOUGH and n_rows >= GROWN * self.told


class JoiningGP(OnlineGP):
    """Gaussian process regressor that new tasks can join."""

    _joined = {}  # a Joined of each task that has joined, by its label

    def _join_task(self, features, label, Y, known=None, prior="tasks"):
        """Become the model with one more task."""
        before = self._training()
        tell_task(before, label, Y, known)
        inputs = features
        if before.descriptors is not None:
            inputs = before.descriptors.inputs(features)
        self._tell_unit(label, inputs, before.target.forward(Y), known)
        expected = self._expected_means(inputs, known)
        training, position = before.with_task(features, label, Y, expected, known)
        training = self._incomplete(training)
        if grows(before, training):
            self._check_room(training)
        self._check_beside(before, training.features[len(before.Y) :])
        informed, engine = prior is not None, self._engine
        origin = np.append(np.arange(len(self.X_train_)), np.full(len(features), -1))
        update = self._updating(training, origin, engine)
        with limit_threads(self._side + len(features)):
            outputs = self._extend(training, position, informed)
            likelihoods, modes = map(list, zip(*outputs, strict=True))
            thetas = [mode.theta for mode in modes]
            outputs = zip(self._posteriors, likelihoods, thetas, strict=True)
            posteriors = [update(*output) for output in outputs]
            draws = self._extend_draws(training, position, informed)
            draws = self._updated_draws(update, likelihoods, draws)
            self._store_learned(training, engine, likelihoods, modes, posteriors)
            self._store_updated_draws(draws)
        joined = Joined(informed, told=len(Y), asked=len(Y) >= FEW)
        self._joined = self._joined | {label: joined}

    def _join_rows(self, features, codes, Y, known=None):
        """Let rows of known tasks join; of those that joined they tell the relation."""
        super()._join_rows(features, codes, Y, known)
        for task in np.unique(codes):
            label = self.tasks_[task].item()
            joined, n_rows = self._joined.get(label), int(self._n_rows[task])
            if joined is None:
                continue
            if n_rows >= FEW and not joined.asked:
                of_task = self._training().part(self.tasks_train_ == task)
                rows = of_task.features, of_task.Y, of_task.known
                self._tell_unit(label, *rows, task)
                joined = joined._replace(asked=True)
            if joined.is_outgrown(n_rows) and self._learns_again(task):
                self._relate_again(task, joined.informed)
                joined = joined._replace(told=min(n_rows, ENOUGH))
            self._joined = self._joined | {label: joined}

    def _has_usual_centre(self):
        """See FittedGP; those of tasks that joined far from the others do not count."""
        units = self._units
        if units.own_scales or not units.own_centres:
            return super()._has_usual_centre()
        others = [task not in self._joined for task in self.tasks_.tolist()]
        return bool((np.ptp(units.centre[:, others], axis=1) == 0.0).all())

    def _expected_means(self, inputs, known=None, task=()):
        """Where the mean of a new task's targets should be, see `Units.with_task`.

        Parameters
        ----------
        inputs : ndarray of shape (n_new, n_inputs)
            Of the new task.
        known : Known, default=None
            What is known of the noise of its rows.
        task : int, default=()
            Its position, if the model has it already; it then tells nothing itself.

        Returns
        -------
        expected : tuple of (mean, deviation), or None without levels
        """
        levelled = self._likelihoods[0].prior.levels and self.normalize_y
        if not levelled or self._units.own_scales:
            return None
        of_f, noise = self._variances_over_tasks(np.mean, inputs, task)
        means = [np.delete(of.levels, task).mean() for of in self._posteriors]
        levels = [of.level for of in self._posteriors]
        scale = self._units.scale[:, 0]
        deviations = scale * np.sqrt(levels + of_f + noise)
        return scale * means, deviations if known is None else known.beside(deviations)

    def _variances_over_tasks(self, of, inputs, task=()):
        """Of f at such inputs and of the noise: the tasks' mean, say, by output.

        In the model's units. A task may be left out.
        """
        of_f, noise = [], []
        for likelihood, posterior in zip(
            self._likelihoods, self._posteriors, strict=True
        ):
            K_rho = np.diagonal(self._covariance_of_tasks(posterior))
            if posterior.K_rho.ndim == 2:
                K_rho = K_rho * posterior.kernel.diag(inputs).mean()
            of_f.append(of(np.delete(K_rho, task)))
            of_tasks = likelihood.prior.values(posterior.theta).noise
            of_tasks = np.broadcast_to(of_tasks, len(K_rho))
            noise.append(of(np.delete(of_tasks, task)))
        return np.array(of_f), np.array(noise)

    def _tell_unit(self, label, inputs, Y, known=None, task=()):
        """Warn of a task in another unit, where the model has one for all."""
        if self._units.own_scales or self._trends() is not None:
            return
        scale = self._units.scale[:, 0]
        largest = sum(self._variances_over_tasks(np.max, inputs, task))
        _, least = self._variances_over_tasks(np.min, inputs, task)
        largest, least = scale * np.sqrt(largest), scale * np.sqrt(least)
        if known is not None:
            largest = known.beside(largest)
            least = least / np.sqrt(known.counts.max())
        tell_unit(label, Y, largest, least)

    def _learns_again(self, task):
        """Whether more rows of a task tell its relation, or its unit, better."""
        if self._engine.uses_design and task not in self._likelihoods[0].novel:
            return False  # its rows are a part of the Kronecker product
        has_unit = self._units.own_centres and self._trends() is None
        return has_unit or self._learns_rows()

    def _learns_rows(self):
        """Whether a relation is learned from the rows of a task that joins."""
        return False

    def _relate_again(self, task, informed):
        """Learn the relation and the unit of a joined task from all of its rows."""
        before, engine, draws = self._training(), self._engine, None
        of_task = before.codes == task
        with limit_threads(self._side):
            rest = self._without_rows(before, of_task)
            rows = before.part(of_task)
            expected = rest._expected_means(rows.features, rows.known, task)
            training = before.with_unit_of(task, expected)
            training = replace(training, looks_for_design=False)
            data = training.data(engine)
            likelihoods = list(map(engine.grown, self._likelihoods, data))
            origin = np.where(of_task, -1, np.cumsum(~of_task) - 1)
            update = rest._updating(training, origin, engine)
            modes = list(rest._modes_with_row(task, data, informed))
            outputs = zip(rest._posteriors, likelihoods, modes, strict=True)
            posteriors = [update(of, by, mode.theta) for of, by, mode in outputs]
            if self._is_sampled():
                draws = rest._draws_with_row(task, data, informed)
                draws = rest._updated_draws(update, likelihoods, draws)
            self._store_learned(training, engine, likelihoods, modes, posteriors)
            self._store_updated_draws(draws)

    def _row_of(self, task, likelihood, data, informed):
        """What learns the relation of a task, at a posterior of the others' rows."""
        return stay_alike

    def _rows_that_relate(self, of_task):
        """Positions of some of a task's rows, evenly taken if there are many."""
        rows = np.flatnonzero(of_task)
        some = np.linspace(0, len(rows) - 1, min(len(rows), ENOUGH)).astype(int)
        return rows[some]

    def _without_rows(self, training, left_out):
        """The model of the other rows, at the same hyperparameters and of all tasks."""
        rest, kept = copy(self), np.flatnonzero(~left_out)
        some = replace(training.part(kept), looks_for_design=False)
        rest._go_on(some, kept, self._engine)
        return rest

    def _modes_with_row(self, task, data, informed):
        """The mode of each output, with a row of the task from these data."""
        models = self._posteriors, self._thetas(), self._leeway
        outputs = zip(self._likelihoods, data, *models, strict=True)
        for *of_data, posterior, theta, leeway in outputs:
            learn = self._row_of(task, *of_data, informed)
            yield learn(posterior, theta, leeway=leeway)

    def _draws_with_row(self, task, data, informed):
        """The draws of each output, with a row of the task for each."""
        rng = np.random.default_rng(task)
        mixtures, draws = self._predictive, self._draws_of_outputs()
        outputs = zip(self._likelihoods, data, mixtures, draws, strict=True)
        for *of_data, mixture, thetas in outputs:
            learn = self._row_of(task, *of_data, informed)
            draws = zip(mixture.parts, thetas, strict=True)
            yield np.array([learn(*draw, rng=rng).theta for draw in draws])

    def _store(self, training, problems, modes, lower=()):
        super()._store(training, problems, modes, lower)
        self._joined = {}

    def _check_room(self, training):
        """Whether memory suffices for the model with a task more."""
        n_before, n_new = (
            len(self._likelihoods[0].inputs),
            len(training.features) - len(self.X_train_),
        )
        demand, tiles = self._demand(training, rank=self._rank_with_task())
        demand = replace(demand, n_missing=self._likelihoods[0].n_missing)
        self._engine.check_joining(demand, tiles, n_before, n_new)

    def _extend(self, training, position, informed):
        """Likelihood and mode of each output with the task at `position` added."""
        outputs = zip(
            self._likelihoods,
            self._posteriors,
            self._thetas(),
            training.data(self._engine),
            training.trends or [None] * len(self._likelihoods),
            self._leeway,
            strict=True,
        )
        for likelihood, posterior, theta, data, trend, leeway in outputs:
            learn = self._border(likelihood, data, training, position, informed, trend)
            prior, mode = learn(posterior, theta, leeway=leeway)
            prior = prior.with_trend(trend)
            more = likelihood, prior, data, position, posterior.kernel
            joined = self._engine.joined(*more)
            check_kept(self._engine, joined, data)
            yield joined, mode

    def _extend_draws(self, training, position, informed):
        """The draws of each output, if any, with a border of the task for each."""
        if not self._is_sampled():
            return
        rng = np.random.default_rng(position)
        outputs = zip(
            self._likelihoods,
            self._predictive,
            self._draws_of_outputs(),
            training.data(self._engine),
            training.trends or [None] * len(self._likelihoods),
            strict=True,
        )
        for likelihood, mixture, thetas, data, trend in outputs:
            learn = self._border(likelihood, data, training, position, informed, trend)
            draws = zip(mixture.parts, thetas, strict=True)
            yield np.array([learn(*draw, rng=rng)[1].theta for draw in draws])

    def _rank_with_task(self):
        """Rank of K^rho after a task has joined."""
        return 1

    def _border(self, likelihood, data, training, position, informed, trend):
        """What makes a model of one more task, at a posterior and its theta."""
        own_noise = training.noise == "per_task"
        return partial(join_alike, likelihood, position, own_noise)
