"""Fitted models as functions of one state, for a control loop."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from copy import copy
from threading import RLock
from typing import Self
from weakref import ref

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator

from skmtgp._data.labels import listed
from skmtgp._numerics.parallel import limit_threads
from skmtgp._plans import (
    Source,
    check_sources,
    chosen_of,
    common_tasks,
    described_of,
    deviations_of,
    plain,
    plans_of,
    sources_of,
    table_of,
)
from skmtgp._support.followers import as_it_is
from skmtgp._support.followers import follow as follow_model
from skmtgp._support.followers import leave as leave_models
from skmtgp._support.versions import with_versions, without_versions
from skmtgp._support.warnings import warn

__all__ = ["CompiledPredictor", "compile_predictor"]


def compile_predictor(
    model: BaseEstimator | Sequence[BaseEstimator] | Mapping[Hashable, BaseEstimator],
    task: int | str | None = None,
    outputs: Sequence[Hashable] | None = None,
    *,
    std: bool = False,
    follow: bool = True,
) -> CompiledPredictor:
    """Compile a fitted model into a fast function of one state.

    It is meant for control loops, where predictions are due in time. Features, units
    and the sums over training rows are prepared once. Each call only computes the
    kernel between the state and those rows. It uses no frames and no pipelines, and
    checks only the length of the state, and the names of a Series.

    Parameters
    ----------
    model : estimator, Pipeline, or a sequence or mapping of them
        Fitted model: a MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP,
        RankSearchIC or a regressor of :mod:`skmtgp.robot`, or a Pipeline that ends with
        one. There may be several, such as one for each joint of a robot. They share
        their features if these are the same.
    task : int or str, default=None
        Label of the task to predict. None means that each call gives it.
    outputs : sequence, default=None
        Outputs to predict, in this order: their positions among the outputs of all
        models, or the keys of a mapping. None means all.
    std : bool, default=False
        Whether the predictor can compute the standard deviation. It then keeps the
        whole model.
    follow : bool, default=True
        Whether ``partial_fit`` of a model also refreshes the predictor, in place. If
        not, its method ``refresh`` does.

    Returns
    -------
    predictor : CompiledPredictor
        Function of one state, which can be pickled.

    Raises
    ------
    NotFittedError
        If a model was not fitted.
    TypeError
        If a model is none of these.
    ValueError
        If the task or an output is not known, if it is unclear which column of X has
        the task, or if a transformer was fitted to text.

    Notes
    -----
    Predictions agree with `predict` up to rounding. The predictor keeps a few copies of
    the training inputs and, without `std`, nothing else. Inputs at which several tasks
    were measured are kept once. Rows that do not matter to the task are left out. For
    sparse inference it keeps the inducing inputs instead. Outputs of the
    same rows whose kernels differ only in hyperparameters, and draws of
    hyperparameters, are computed together. This takes far less time than one after
    another. Transformers other than
    :class:`~skmtgp.preprocessing.InverseDynamicsFeatures` are called as they are, and
    then take most of the time.

    A predictor that follows its models is refreshed within ``partial_fit``, at its end.
    Another thread that predicts meanwhile uses the old or the new state, never a
    mixture. Of several models each counts as soon as it has the rows. If
    ``partial_fit`` fails, the predictor stays as it was, too. Models are followed as
    long as they exist. Copies do not follow: those that were pickled, for another
    process say, keep what they know. ``fit`` makes another model, which is not
    followed before `refresh` is called with it.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor, compile_predictor
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat([1, 2], 20)
    >>> y = np.sin(x) * task
    >>> model = MultiTaskGPRegressor(rank=1).fit(np.column_stack([x, task]), y)
    >>> predictor = compile_predictor(model, task=2)
    >>> predictor([1.5]).round(1)
    array([2.])
    >>> bool(np.isclose(predictor([1.5]), model.predict([[1.5, 2]])))
    True
    """
    return CompiledPredictor(model, task, outputs, std=std, follow=follow)


class CompiledPredictor:
    """Fast function of one state, made by :func:`compile_predictor`.

    Parameters
    ----------
    model : estimator, Pipeline, or a sequence or mapping of them
        Fitted model.
    task : int or str, default=None
        Label of the task to predict.
    outputs : sequence, default=None
        Outputs to predict.
    std : bool, default=False
        Whether it can compute the standard deviation.
    follow : bool, default=True
        Whether ``partial_fit`` of a model refreshes it.

    Attributes
    ----------
    task : int, str or None
        The task that is predicted; None if each call gives it.
    outputs : list
        The outputs, in the order in which they are predicted.
    tasks : list
        Labels of the tasks that it can predict.
    n_features_in : int
        Length of a state: the number of columns of X without the task and its
        descriptors.
    descriptors : DataFrame of shape (n_tasks, n_descriptors) or None
        Descriptors of the tasks, if all models have the same `task_descriptors` and
        were compiled for all tasks.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import PooledGP, compile_predictor
    >>> x = np.linspace(0, 6, 30)
    >>> X = np.column_stack([x, np.zeros(30)])
    >>> model = PooledGP().fit(X, np.column_stack([np.sin(x), np.cos(x)]))
    >>> predictor = compile_predictor(model, std=True)
    >>> predictor(np.array([1.5]), task=0).round(2)
    array([1.  , 0.07])
    >>> predictor.std(np.array([1.5]), task=0).shape
    (2,)
    """

    _names = ()  # of predictors that were pickled before they had any

    def __init__(
        self,
        model: BaseEstimator
        | Sequence[BaseEstimator]
        | Mapping[Hashable, BaseEstimator],
        task: int | str | None = None,
        outputs: Sequence[Hashable] | None = None,
        *,
        std: bool = False,
        follow: bool = True,
    ) -> None:
        keys, sources = sources_of(model)
        task = None if task is None else plain(task)
        self._compile(keys, sources, task, outputs, std)
        self._lock, self._followed = RLock(), None
        if follow:
            self._follow(keys, sources)

    def _compile(self, keys, sources, task, outputs, std):
        """Set what is called, for a task or for all."""
        chosen = chosen_of(keys, sources, outputs)
        labels = common_tasks(sources) if task is None else [task]
        self.task, self.tasks = task, labels
        self.outputs, self._asked = list(chosen), outputs
        self.n_features_in = sources[0].n_features
        self._shape = (self.n_features_in,)
        self._names = [names for of in sources if (names := of.names()) is not None]
        self._plans = plans_of(sources, list(chosen.values()), labels)
        self.descriptors, self._described = None, None
        if task is None:
            self._described = described_of(sources, list(chosen.values()), labels[0])
        if self._described is not None:
            self.descriptors = table_of(sources[0], labels)
        self._deviations = None
        if std:
            self._deviations = deviations_of(sources, list(chosen.values()), labels)

    def _follow(self, keys, sources):
        """Be told when one of these models has learned more."""
        self._followed = keys, [(of.steps, ref(of.last), of.known) for of in sources]
        for source in sources:
            follow_model(source.last, self)
            follow_model(source.last._model(), self)  # of a search its best one

    def _catch_up(self):
        """Take over what the models have learned, as one of them has told."""
        with self._lock:
            keys, parts = self._followed or (None, ())
            parts = [(steps, last(), known) for steps, last, known in parts]
            if not parts or any(last is None for _, last, _ in parts):
                return
            try:
                sources = check_sources([Source(*part) for part in parts])
                self._become(keys, sources)
                self._follow(keys, sources)  # a search may have another model now
            except (TypeError, ValueError) as error:
                self._followed = None
                warn(
                    f"{self!r} stays as it is, and follows its models no more, because "
                    f"it cannot take over what they are now: {error}",
                    RuntimeWarning,
                )

    def _become(self, keys, sources):
        """Predict by these models from now on, all at once."""
        other, std = copy(self), self._deviations is not None
        other._compile(keys, sources, self.task, self._asked, std)
        self.__dict__ = vars(other) | {
            "_lock": self._lock,
            "_followed": self._followed,
        }

    def __getstate__(self):  # a copy follows nothing
        return with_versions({**vars(self), "_lock": None, "_followed": None})

    def __setstate__(self, state):
        state = without_versions(state, type(self).__name__)
        vars(self).update(state, _lock=RLock())

    def __repr__(self) -> str:
        tasks = f"task={self.task!r}"
        if self.task is None:
            tasks = f"tasks=[{_shown(self.tasks)}]"
        std = f", std={self._deviations is not None}"
        return f"CompiledPredictor({tasks}, outputs=[{_shown(self.outputs)}]{std})"

    def __call__(
        self,
        x: ArrayLike,
        task: int | str | None = None,
        *,
        descriptors: ArrayLike | None = None,
    ) -> NDArray[np.float64]:
        """Predict the outputs for one state.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            The columns of X in their order, without the task and its descriptors. That
            they are finite is not checked, to save time: NaN gives NaN. A Series must
            have the names of the features of `fit`, if these had names.
        task : int or str, default=None
            Label of the task, if the predictor is not compiled for one task.
        descriptors : array-like of shape (n_descriptors,), default=None
            Descriptors of a task that the model need not know, instead of a label. They
            are in the order of `task_descriptors`. The models must have
            `task_descriptors` and be compiled for all tasks.

        Returns
        -------
        y : ndarray of shape (n_outputs,)
            Predictions as of `predict`, in units of y.

        Raises
        ------
        ValueError
            If `x` has another shape, or is a Series with other names or in another
            order. If the task is not known, or `descriptors` cannot be used.
        """
        now = as_it_is(self)
        x = now._check(x)
        if descriptors is not None:
            return now._predict_described(x, descriptors)
        y = np.empty(len(now.outputs))
        for plan in now._of_task(now._plans, task):
            values = plan.means(plan.features(x))[:, plan.k]
            y[plan.places] = plan.in_units(values)
        return y

    def predict_tasks(self, x: ArrayLike) -> NDArray[np.float64]:
        """Predict the outputs of all tasks for one state, in about the time of one.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            The columns of X in their order, without the task and its descriptors.

        Returns
        -------
        y : ndarray of shape (n_tasks, n_outputs)
            Predictions in the order of `tasks`, in units of y.
        """
        now = as_it_is(self)
        x, found = now._check(x), {}
        y = np.empty((len(now.tasks), len(now.outputs)))
        for row, task in zip(y, now.tasks, strict=True):
            for plan in now._plans[task]:
                key = plan.features, plan.means
                if key not in found:
                    found[key] = plan.means(plan.features(x))
                row[plan.places] = plan.in_units(found[key][:, plan.k])
        return y

    def by_descriptors(
        self, x: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the outputs for one state as a linear function of the descriptors.

        The prediction for a task with descriptors d is ``constants + slopes @ d``. So a
        measured y gives linear equations for d, which
        :class:`~skmtgp.DescriptorTracker` uses.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            The columns of X in their order, without the task and its descriptors.

        Returns
        -------
        constants : ndarray of shape (n_outputs,)
            Constants in units of y.
        slopes : ndarray of shape (n_outputs, n_descriptors)
            Slopes in units of y per unit of each descriptor.

        Raises
        ------
        ValueError
            If the models do not have the same `task_descriptors`, or have a
            `target_transform`, after which predictions are not linear.
        """
        now = as_it_is(self)
        x, plans = now._check(x), now._of_descriptors()[1]
        constants = np.empty(len(now.outputs))
        slopes = np.empty((len(now.outputs), now.descriptors.shape[1]))
        for plan in plans:
            if plan.backs is not None:
                raise ValueError(
                    "by_descriptors needs models without target_transform: through it "
                    "predictions are not linear in the descriptors."
                )
            line = plan.means.line(plan.features(x))
            constants[plan.places], slopes[plan.places] = line
        return constants, slopes

    def _of_descriptors(self):
        """Names of the descriptors, and what gives the outputs of a task with any."""
        if self._described is None:
            raise ValueError(
                "descriptors need models with the same task_descriptors, compiled "
                "without `task`."
            )
        return self._described

    def _predict_described(self, x, descriptors):
        """The outputs of a task with these descriptors."""
        names, plans = self._of_descriptors()
        descriptors, y = (
            np.asarray(descriptors, dtype=float),
            np.empty(len(self.outputs)),
        )
        if descriptors.shape != (len(names),):
            raise ValueError(
                f"descriptors has shape {descriptors.shape}, not ({len(names)},): one "
                f"number for each of {names}."
            )
        for plan in plans:
            values = plan.means(plan.features(x), descriptors)
            y[plan.places] = plan.in_units(values)
        return y

    def std(
        self, x: ArrayLike, task: int | str | None = None, include_noise: bool = False
    ) -> NDArray[np.float64]:
        """Return the standard deviations of the outputs for one state.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            The columns of X in their order, without the task and its descriptors.
        task : int or str, default=None
            Label of the task, if the predictor is not compiled for one task.
        include_noise : bool, default=False
            Whether they are those of a new observation, f plus noise, rather than those
            of f. The noise is the learned one, even if `fit` had an `alpha`: if new
            rows have such noise, too, the deviation is ``np.sqrt(y_std**2 + alpha)``.

        Returns
        -------
        y_std : ndarray of shape (n_outputs,)
            Standard deviations in units of y. Each output takes O(n^2).

        Raises
        ------
        ValueError
            If the predictor was compiled without ``std=True``.
        """
        now = as_it_is(self)
        if now._deviations is None:
            raise ValueError("Standard deviations need compile_predictor(std=True).")
        x = now._check(x)
        variances = np.empty(len(now.outputs))
        for features, model, code, of in now._of_task(now._deviations, task):
            z, target = features(x), model._target
            given = getattr(model, "_descriptors", None)
            z = z if given is None else given.with_inputs(z, given.table[code])
            rows = z[None], np.array([code])
            with limit_threads(model._side):
                found = target.variances(model, *rows, include_noise)[0]
            variances[[place for place, _ in of]] = found[[j for _, j in of]]
        return np.sqrt(variances)

    def refresh(
        self,
        model: BaseEstimator
        | Sequence[BaseEstimator]
        | Mapping[Hashable, BaseEstimator],
    ) -> Self:
        """Take over, in place, what a model has learned since, or another model.

        A predictor that follows its models does the first by itself, and then follows
        those that are given.

        Parameters
        ----------
        model : estimator, Pipeline, or a sequence or mapping of them
            The same model after ``partial_fit``, or another one with these outputs.

        Returns
        -------
        self : CompiledPredictor
            The same predictor. Other threads that predict meanwhile use either the old
            or the new model, never a mixture.
        """
        keys, sources = sources_of(model)
        with self._lock:
            self._become(keys, sources)
            if self._followed is not None:
                leave_models(self)
                self._follow(keys, sources)
        return self

    def _check(self, x):
        if isinstance(x, pd.Series):
            self._check_names(x.index.tolist())
        x = np.asarray(x, dtype=float)
        if x.shape != self._shape:
            raise ValueError(
                f"x has shape {x.shape}, not {self._shape}: it is one state, without "
                "the task and its descriptors."
            )
        return x

    def _check_names(self, found):
        """Raise a ValueError where a state has other names than the features."""
        if not all(isinstance(name, str) for name in found):
            return
        for names in self._names:
            if found != names:
                raise ValueError(
                    f"x has the names {found}, but the features of the model are "
                    f"{names}, in this order, without the task and its descriptors. "
                    "Arrange x like this, or give an array."
                )

    def _of_task(self, plans, task):
        """What is done for a task."""
        try:
            return plans[self.task if task is None else task]
        except KeyError:
            known = _shown(list(plans))
            if task is None:
                raise ValueError(
                    f"Give the task too, predictor(x, task), one of {known}; or "
                    "compile the predictor of one, compile_predictor(model, task=...)."
                ) from None
            raise ValueError(
                f"task={task!r} is not one of the tasks that the predictor was "
                f"compiled for: {known}."
            ) from None


def _shown(values):
    """Some values, the first of them if they are many."""
    return listed(values, more=", ...")
