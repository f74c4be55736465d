"""Rows that join a fitted Gaussian process, or leave it, at fixed hyperparameters."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from skmtgp._data.checks import check_more, check_stream
from skmtgp._data.known import read_known, weighed_rows
from skmtgp._estimators.arriving import tell_rows
from skmtgp._estimators.estimator import public
from skmtgp._estimators.fitted import FittedGP
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.followers import tell
from skmtgp.inference.engine import Demand, check_kept, check_known
from skmtgp.inference.engines import Dense, choose, repeats_rows
from skmtgp.inference.memory import TileMemory
from skmtgp.inference.pruning import least_informative
from skmtgp.model.kernel_check import check_covariance, sample_rows

AT_ONCE = 100  # rows for which memory is looked for: that takes as long as a few rows
KNOWN = 20  # rows that the kernel's values with new ones are looked at


class OnlineGP(FittedGP):
    """Gaussian process regressor that learns from a stream of rows."""

    @public
    def partial_fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        alpha: ArrayLike | None = None,
        sample_weight: ArrayLike | None = None,
        repeat_variance: ArrayLike | None = None,
        *,
        max_rows: int | None = None,
    ) -> Self:
        """Add rows: the first call is `fit`, later ones keep the hyperparameters.

        Later calls give the model that a fit to all rows would give with the
        hyperparameters, means and scales of the first call. They do not decompose the
        covariance again. Of a task that has joined, the relation to the others, and the
        unit, are learned again as its rows become more.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`. An unknown label is
            that of a task that joins. A MultiTaskGPRegressor learns how it is related
            to the others, as in ``add_task``. A PooledGP gives it the function of all,
            an IndependentGP one of its own. If tasks have their own noise variances or
            diagonals, it gets their geometric mean.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.
        alpha, sample_weight, repeat_variance : array-like, default=None
            What is known of the noise of these rows, see `fit`. What is known of the
            earlier rows stays, and so does the learned noise variance. A new row has
            the sum of it and `alpha`, divided by its number of measurements. With one
            of the three, ``inference="auto"`` becomes dense.
        max_rows : int, default=None
            Number of rows to keep. If there are more, those are dropped that add least
            to what the others tell about the functions, new rows included. The last row
            of a task stays. None keeps all. Only dense inference can drop rows: "auto"
            becomes dense where it must, and "kronecker" and "sparse" raise an error.

        Returns
        -------
        self : object
            Fitted estimator.

        Raises
        ------
        TypeError
            If X or y is a Dask collection.
        ValueError
            If a new task cannot join. If X, y or what is known of the noise cannot be
            used, or differ in form from those of `fit`. If `max_rows` is below the
            number of tasks, or if the engine cannot take or drop these rows. The
            estimator is then as it was before.

        Warns
        -----
        OutlierWarning
            If a target is 20 times as far from the median of its task as all targets so
            far, of ten or more, and 20 deviations from what the model predicts.
        RepeatedRowsWarning
            If most of five or more rows are there already.
        TaskColumnWarning
            If a new label differs from a known one in spaces or case alone.
        TaskUnitWarning
            If a new task seems to be in another unit than all others.

        Notes
        -----
        With dense inference a row takes O(n^2), because the Cholesky factor only grows
        by one row. Dropping a row takes the same. With sparse inference the time is
        that of one pass over the rows. The inducing inputs stay, and a new task gets
        its own.

        With Kronecker products nothing is decomposed again as long as the new rows are
        of tasks that have joined, and these have no more rows than there are inputs.
        With other rows the covariances of the inputs and of the tasks are
        decomposed anew. Cells may be missing then. If more than a tenth are missing, or
        one is observed again, ``inference="auto"`` decomposes the covariance of all
        rows once and continues with dense inference. "kronecker" raises an error if a
        cell is observed again, or if half of the cells are missing.

        A few rows of a new task tell little of how it is related to the others. So a
        MultiTaskGPRegressor learns its row of the task covariance again each time that
        the task has half as many rows more, from at most a hundred of them and with the
        same prior; not with `trend_per_task`, nor for tasks with descriptors. If tasks
        have units of their own, that of the new task is learned again, too, by all
        estimators; not with a trend. Nothing is learned again where the rows become a
        part of a Kronecker product. It takes O(n^2) for each row of the task, and
        memory for three posteriors.

        Predictors that were compiled from this estimator are refreshed at the end, see
        :func:`~skmtgp.compile_predictor`.

        In the attributes, new rows follow the earlier ones. Rows of new tasks follow
        the other rows of the same call.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import MultiTaskGPRegressor
        >>> rng = np.random.default_rng(0)
        >>> x, task = rng.uniform(0, 6, 60), rng.choice([0, 1, 2], 60)
        >>> X = np.column_stack([x, task])
        >>> y = np.array([1.0, -2.0, 0.5])[task] * np.sin(x)
        >>> model = MultiTaskGPRegressor(rank=1)
        >>> for rows in (slice(0, 40), slice(40, 50), slice(50, 60)):
        ...     model = model.partial_fit(X[rows], y[rows], max_rows=50)
        >>> model.y_train_.shape
        (50,)
        """
        check_stream(X, y, max_rows)
        model, given = copy(self), (alpha, sample_weight, repeat_variance)
        if hasattr(model, "tasks_"):
            model._join_all(X, y, given)
        else:
            model.fit(X, y, *given)
        if max_rows is not None:
            model._drop(max_rows)
        self.__dict__ = vars(model)  # all at once, whatever fails before
        tell(self)
        return self

    def _join_all(self, X, y, given):
        """Let rows of known tasks join, then each new task."""
        self._check_rows()
        plain = all(part is None for part in given)
        X, y, given = self._weighed(X, y, given)
        features, labels, codes, Y = check_more(self, X, y)
        known, old = self._take_known(given, Y.shape), codes < len(self.tasks_)
        if old.any():
            rows = features[old], codes[old], Y[old]
            if plain:
                tell_rows(self, self._training(), *rows)
            self._join_rows(*rows, known and known.part(old))
        for code in np.unique(codes[~old]):
            rows = codes == code
            label = labels.tasks[labels.codes[rows][0]].item()
            of_task = features[rows], label, Y[rows], known and known.part(rows)
            self._join_task(*of_task)

    def _weighed(self, X, y, given):
        """Rows of some weight, as `fit` takes them."""
        return weighed_rows(X, y, given, repeats=repeats_rows(self.inference))

    def _take_known(self, given, shape):
        """What is known of the noise of rows that join, which the engine then takes.

        `shape` is that of their targets.
        """
        known = read_known(*given, shape)
        self._refuse_exact_rows(known)
        if known is None:
            return None
        known.refuse_transform(self.target_transform)
        engine = Dense() if self.inference == "auto" else self._engine
        check_known(engine, self._likelihoods[0].prior, known, self.X_train_)
        if not self._engine.takes_known:
            self._become_dense(self._training())
        return known

    def _refuse_exact_rows(self, known):
        """Raise a ValueError where rows that join would count as exact."""
        told = known is not None and known.variance.min() > 0.0
        if self.noise_variance == 0.0 and not told:
            raise ValueError(
                "noise_variance=0 leaves the noise to alpha, and of rows that join "
                "none is known: they would count as exact. Give an alpha above 0 for "
                "each, or let fit learn a noise variance."
            )

    def _join_rows(self, features, codes, Y, known=None):
        """Let rows of known tasks join."""
        before, n_new = self._training(), len(Y)
        if before.descriptors is not None:
            features = before.descriptors.inputs(features)
        training = before.with_rows(features, codes, Y, known)
        self._check_beside(before, features)
        engine, likelihood = self._engine, self._likelihoods[0]
        if engine.extends(likelihood, codes):
            training = self._incomplete(training)
        elif engine.uses_design:  # of complete data, which may be so no more
            prior = self._likelihoods[0].prior
            engine = choose(self.inference, prior, training, **self._options())
            engine.check(prior, training.data(engine)[0], training.tasks)
        if grows(before, training) or engine is not self._engine:
            engine.check_memory(*self._demand(training))
        origin = np.append(np.arange(len(before.Y)), np.full(n_new, -1))
        self._go_on(training, origin, engine)

    def _incomplete(self, training):
        """The data without a look for their design, where that is known to be none."""
        likelihood, sizes = self._likelihoods[0], (len(training.Y), len(training.tasks))
        if self._engine.lacks_cells(likelihood, *sizes):
            return replace(training, looks_for_design=False)
        return training

    def _check_beside(self, before, features):
        """Raise a ValueError where a kernel is no covariance of new and known rows."""
        known = sample_rows(before.features, KNOWN)
        X = np.vstack([known, sample_rows(features)])
        for posterior in self._posteriors:
            check_covariance(posterior.kernel, X, posterior.prior.node)

    def _drop(self, max_rows):
        """Leave the rows out that tell least."""
        training = self._training()
        n_rows = len(training.Y) - max_rows
        if n_rows <= 0:
            return
        if max_rows < len(self.tasks_):
            raise ValueError(
                f"max_rows={max_rows} is below the number of tasks, "
                f"{len(self.tasks_)}, but each task keeps a row. Give at least "
                f"{len(self.tasks_)}."
            )
        self._go_on_densely(training, max_rows)
        with limit_threads(self._side):
            rows = least_informative(self._posteriors, n_rows)
        rows = np.arange(len(training.Y))[training.order(self._engine)][rows]
        kept = np.delete(np.arange(len(training.Y)), rows)
        self._go_on(training.part(kept), kept, self._engine)

    def _go_on_densely(self, training, max_rows):
        """Go on with an engine that can drop rows."""
        if self._engine.drops:
            return
        if self.inference != "auto":
            raise ValueError(
                f"max_rows={max_rows} drops rows, which {self._engine.name} inference "
                "cannot. Leave max_rows out, or set inference='dense' or 'auto'."
            )
        self._become_dense(training)

    def _become_dense(self, training):
        """Go on with the same rows and dense inference."""
        engine = Dense()
        engine.check_memory(*self._demand(training))
        self._go_on(training, np.arange(len(training.Y)), engine)

    def _go_on(self, training, origin, engine):
        """Store posteriors of other rows, at the same hyperparameters.

        `origin` says which of the rows so far each row is; -1 for new ones.
        """
        before, thetas, data = self._likelihoods, self._thetas(), training.data(engine)
        likelihoods = list(map(engine.grown, before, data))
        for pair in zip(likelihoods, data, strict=True):
            check_kept(engine, *pair)
        _check_trend(likelihoods)
        update = self._updating(training, origin, engine)
        with limit_threads(max(likelihood.side for likelihood in likelihoods)):
            outputs = zip(self._posteriors, likelihoods, thetas, strict=True)
            posteriors = [update(*output) for output in outputs]
            draws = self._draws_of_outputs() if self._is_sampled() else ()
            draws = self._updated_draws(update, likelihoods, draws)
            self._store_posteriors(training, engine, likelihoods, posteriors)
            self._store_levels()
            self._store_updated_draws(draws)

    def _updating(self, training, origin, engine):
        """What makes a posterior of other rows from one of those so far."""
        if engine is not self._engine:
            return lambda posterior, likelihood, theta: likelihood.posterior(theta)
        order = self._training().order(engine)
        position = np.empty(len(self.tasks_train_), dtype=int)
        position[np.arange(len(position))[order]] = np.arange(len(position))
        origin = np.where(origin < 0, -1, position[origin])[training.order(engine)]

        def update(posterior, likelihood, theta):
            likelihood.prior.keep_kernel(theta, posterior.kernel)
            return engine.updated(posterior, likelihood, theta, origin)

        return update

    def _updated_draws(self, update, likelihoods, draws):
        """Draws of theta and the mixtures of each output; nothing without draws."""
        draws = list(draws)
        if not draws:
            return None
        outputs = zip(self._predictive, likelihoods, draws, strict=True)
        mixtures = [mixture.updated(update, *rest) for mixture, *rest in outputs]
        return draws, mixtures, self._chains_told()

    def _store_updated_draws(self, found):
        """Predict by them, if there are any."""
        if found:
            draws, mixtures, told = found
            self._store_draws(draws, mixtures)
            vars(self).update(told)

    def _demand(self, training, rank=None):
        """What the model of these rows asks of memory."""
        n_kept = len(self._likelihoods) * (1 + len(getattr(self, "theta_samples_", ())))
        rank = np.sum(getattr(self, "rank_", 1)) if rank is None else rank
        sizes = len(training.features), len(training.tasks)
        missing = training.n_missing if self._engine.uses_design else 0
        demand = Demand(
            *sizes,
            rank=rank,
            n_kept=n_kept,
            n_missing=missing,
            n_coefficients=self._likelihoods[0].prior.n_coefficients,
        )
        node, x = self._likelihoods[0].prior.node, training.features[:1]
        return demand, TileMemory(self._posteriors[0].kernel, x, node)


def grows(before, training):
    """Whether there are more rows by so many that memory is looked for again."""
    return len(before.Y) // AT_ONCE != len(training.Y) // AT_ONCE


def _check_trend(likelihoods):
    """Raise a ValueError where the rows that are left do not tell a trend."""
    for likelihood in likelihoods:
        trend = likelihood.prior.trend
        if trend is None:
            return
        rank = likelihood.basis.rank
        if rank < trend.n_coefficients:
            raise ValueError(
                f"The {len(likelihood.y)} rows that are kept tell {rank} of the "
                f"{trend.n_coefficients} coefficients of the trend, too few to go on. "
                "Give a larger max_rows."
            )
