"""New tasks that join a fitted Gaussian process."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from skmtgp._estimators.online import OnlineGP, grows
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.novel import join_alike


class JoiningGP(OnlineGP):
    """Gaussian process regressor that new tasks can join."""

    def _join_task(self, features, label, Y, prior="tasks"):
        """Become the model with one more task."""
        before = self._training()
        training, position = before.with_task(features, label, Y)
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
            yield self._engine.joined(*more), mode

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
