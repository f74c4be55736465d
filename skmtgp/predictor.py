"""Fitted models as functions of one state, for a control loop."""

from __future__ import annotations

import pickle
from collections.abc import Hashable, Mapping, Sequence
from copy import copy
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.labels import check_labels, encode_tasks
from skmtgp._estimators.base import BaseMultiTaskGP
from skmtgp._estimators.compiled import (
    Chain,
    MeansOfDescribed,
    Transform,
    means_of,
)
from skmtgp._numerics.parallel import limit_threads
from skmtgp.model_selection import RankSearchIC
from skmtgp.single_task import SingleTaskGP

__all__ = ["CompiledPredictor", "compile_predictor"]

MODELS = BaseMultiTaskGP, RankSearchIC, SingleTaskGP


def compile_predictor(
    model: BaseEstimator | Sequence[BaseEstimator] | Mapping[Hashable, BaseEstimator],
    task: int | str | None = None,
    outputs: Sequence[Hashable] | None = None,
    *,
    std: bool = False,
) -> CompiledPredictor:
    """Compile a fitted model into a fast function of one state.

    It is meant for control loops, where predictions are due in time. Features, units
    and the sums over training rows are prepared once. Each call only computes the
    kernel between the state and those rows. It uses no frames and no pipelines, and
    checks only the length of the state.

    Parameters
    ----------
    model : estimator, Pipeline, or a sequence or mapping of them
        Fitted model: a MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP or
        RankSearchIC, or a Pipeline that ends with one. There may be several, such as
        one for each joint of a robot. They share their features if these are the same.
    task : int or str, default=None
        Label of the task to predict. None means that each call gives it.
    outputs : sequence, default=None
        Outputs to predict, in this order: their positions among the outputs of all
        models, or the keys of a mapping. None means all.
    std : bool, default=False
        Whether the predictor can compute the standard deviation. It then keeps the
        whole model.

    Returns
    -------
    predictor : CompiledPredictor
        Function of one state, which can be pickled. Later changes of the model reach it
        only through its method ``refresh``.

    Raises
    ------
    NotFittedError
        If a model was not fitted.
    TypeError
        If a model is none of these.
    ValueError
        If the task or an output is not known, or if it is unclear which column of X has
        the task.

    Notes
    -----
    Predictions agree with `predict` up to rounding. The predictor keeps a few copies of
    the training inputs and, without `std`, nothing else. Inputs at which several tasks
    were measured are kept once. Rows that do not matter to the task are left out. For
    sparse inference it keeps the inducing inputs instead. If hyperparameters are
    sampled, the time of a call is multiplied by the number of draws. Transformers other
    than :class:`~skmtgp.preprocessing.InverseDynamicsFeatures` are called as they are,
    and then take most of the time.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor, compile_predictor
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat([1, 2], 20)
    >>> y = np.sin(x) * task
    >>> model = MultiTaskGPRegressor(rank=1).fit(np.column_stack([x, task]), y)
    >>> predictor = compile_predictor(model, task=2)
    >>> predictor([1.5]).round(2)
    array([1.99])
    >>> bool(np.isclose(predictor([1.5]), model.predict([[1.5, 2]])))
    True
    """
    return CompiledPredictor(model, task, outputs, std=std)


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

    def __init__(
        self,
        model: BaseEstimator
        | Sequence[BaseEstimator]
        | Mapping[Hashable, BaseEstimator],
        task: int | str | None = None,
        outputs: Sequence[Hashable] | None = None,
        *,
        std: bool = False,
    ) -> None:
        keys, sources = _sources(model)
        chosen = _chosen(keys, sources, outputs)
        labels = _common_tasks(sources) if task is None else [_plain(task)]
        self.task = None if task is None else labels[0]
        self.tasks, self.outputs, self._asked = labels, list(chosen), outputs
        self.n_features_in = sources[0].n_features
        self._shape = (self.n_features_in,)
        self._plans = _plans(sources, list(chosen.values()), labels)
        self.descriptors, self._described = None, None
        if task is None:
            self._described = _described(sources, list(chosen.values()), labels[0])
        if self._described is not None:
            self.descriptors = _table(sources[0], labels)
        self._deviations = None
        if std:
            self._deviations = _deviations(sources, list(chosen.values()), labels)

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
            The columns of X in their order, without the task and its descriptors.
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
        """
        x = self._check(x)
        if descriptors is not None:
            return self._predict_described(x, descriptors)
        y = np.empty(len(self.outputs))
        for features, heads in self._of_task(self._plans, task):
            z = features(x)
            for place, mean, k, back in heads:
                value = mean(z)[k]
                y[place] = value if back is None else back(np.array([value]))[0]
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
        x, found = self._check(x), {}
        y = np.empty((len(self.tasks), len(self.outputs)))
        for row, task in zip(y, self.tasks, strict=True):
            for features, heads in self._plans[task]:
                if features not in found:
                    found[features] = features(x)
                for place, mean, k, back in heads:
                    key = features, mean
                    if key not in found:
                        found[key] = mean(found[features])
                    value = found[key][k]
                    row[place] = value if back is None else back(np.array([value]))[0]
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
        x, plans = self._check(x), self._of_descriptors()[1]
        constants = np.empty(len(self.outputs))
        slopes = np.empty((len(self.outputs), self.descriptors.shape[1]))
        before = z = None
        for features, of, heads in plans:
            z = z if features is before else features(x)
            before = features
            for place, mean, back in heads:
                if back is not None:
                    raise ValueError(
                        "by_descriptors needs models without target_transform: "
                        "through it predictions are not linear in the descriptors."
                    )
                constants[place], slopes[place] = of.line(mean(z))
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
        before = z = None
        for features, of, heads in plans:
            z = z if features is before else features(x)
            before, along = features, of.along(descriptors)
            for place, mean, back in heads:
                value = mean(z) @ along
                y[place] = value if back is None else back(np.array([value]))[0]
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
            of f.

        Returns
        -------
        y_std : ndarray of shape (n_outputs,)
            Standard deviations in units of y. Each output takes O(n^2).

        Raises
        ------
        ValueError
            If the predictor was compiled without ``std=True``.
        """
        if self._deviations is None:
            raise ValueError("Standard deviations need compile_predictor(std=True).")
        x = self._check(x)
        variances = np.empty(len(self.outputs))
        for features, model, code, of in self._of_task(self._deviations, task):
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
        """Take over, in place, what a model has learned since.

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
        std = self._deviations is not None
        other = CompiledPredictor(model, self.task, self._asked, std=std)
        self.__dict__ = vars(other)
        return self

    def _check(self, x):
        x = np.asarray(x, dtype=float)
        if x.shape != self._shape:
            raise ValueError(
                f"x has shape {x.shape}, not {self._shape}: it is one state, without "
                "the task and its descriptors."
            )
        return x

    def _of_task(self, plans, task):
        """What is done for a task."""
        try:
            return plans[self.task if task is None else task]
        except KeyError:
            known = ", ".join(map(repr, list(plans)[:5]))
            raise ValueError(
                f"task={task!r} is not one of the tasks that the predictor was "
                f"compiled for: {known}{', ...' if len(plans) > 5 else ''}."
            ) from None


class _Source:
    """A fitted model, its features and its tasks."""

    def __init__(self, model):
        steps = [("model", model)]
        while isinstance(steps[-1][1], Pipeline):
            steps = [*steps[:-1], *steps[-1][1].steps]
        if not isinstance(steps[-1][1], MODELS):
            raise TypeError(
                "model must be a MultiTaskGPRegressor, IndependentGP, PooledGP, "
                "SingleTaskGP or RankSearchIC, a Pipeline that ends with one of them, "
                f"or several of these, not a {type(steps[-1][1]).__name__}."
            )
        *first, self.last = (step for _, step in steps)
        self.steps = [step for step in first if step not in (None, "passthrough")]
        check_is_fitted(self.last)
        self.model = copy(self.last._model())  # as it is now, whatever joins later
        first = [*self.steps, self.last][0]
        self.given = getattr(self.model, "_descriptors", None)
        n_descriptors = 0 if self.given is None else len(self.given.names)
        self.n_features = first.n_features_in_ - 1 - n_descriptors
        self.n_outputs = len(self.model.log_marginal_likelihoods_)

    def code(self, label):
        """The position of a task."""
        options = {"can_join": hasattr(self.last, "add_task")}
        options["unseen"] = self.model._knows_unseen()
        return int(encode_tasks(check_labels([label]), self.model.tasks_, **options)[0])

    def features(self, label):
        """The transformers as a function of the columns without the task."""
        if all(hasattr(step, "_compile") for step in self.steps):
            return Chain([step._compile(label) for step in self.steps])
        if self.given is not None:
            raise ValueError(
                "compile_predictor takes a model with task_descriptors alone, or after "
                "an InverseDynamicsFeatures that has them too."
            )
        return Transform(self.steps, self.model, label)

    def heads(self, labels):
        """For each label the functions of all outputs: (mean, k, back).

        What they give has one number for each label, of which the k-th counts.
        """
        codes = [self.code(label) for label in labels]
        columns = getattr(self.model._target, "columns", [None] * self.n_outputs)
        backs = [column and column.back for column in columns]
        if isinstance(self.model, SingleTaskGP):
            alone = [means_of(self.model.estimators_[code], [0]) for code in codes]
            found = [[(mean, 0) for mean in of_task] for of_task in alone]
        else:
            means = means_of(self.model, codes)
            found = [[(mean, k) for mean in means] for k in range(len(codes))]
        return {
            label: [(*head, back) for head, back in zip(heads, backs, strict=True)]
            for label, heads in zip(labels, found, strict=True)
        }


def _sources(model):
    """The keys and the models that were given, checked."""
    if isinstance(model, Mapping):
        keys, models = list(model), model.values()
    else:
        several = isinstance(model, (list, tuple))
        keys, models = None, model if several else [model]
    sources = list(map(_Source, models))
    if not sources:
        raise ValueError("model is empty: give at least one fitted model.")
    lengths = {source.n_features for source in sources}
    if len(lengths) > 1:
        raise ValueError(
            f"The models take states of different lengths, {sorted(lengths)}: compile "
            "those of each length alone."
        )
    return keys, sources


def _chosen(keys, sources, outputs):
    """By their names, which outputs are predicted: model, and position in it."""
    found = {}
    for i, source in enumerate(sources):
        for j in range(source.n_outputs):
            name = len(found) if keys is None else keys[i]
            single = keys is None or source.n_outputs == 1
            found[name if single else (name, j)] = i, j
    if outputs is None:
        return found
    for name in outputs:
        if name not in found:
            raise ValueError(
                f"outputs={outputs!r} has {name!r}, but the outputs are {list(found)}."
            )
    return {name: found[name] for name in outputs}


def _common_tasks(sources):
    """Labels that all models know."""
    known = [source.model.tasks_.tolist() for source in sources]
    labels = [label for label in known[0] if all(label in of for of in known)]
    if not labels:
        raise ValueError("The models have no task in common: name one of them.")
    return labels


def _plans(sources, chosen, labels):
    """For each label what gives the outputs: features, and functions of them."""
    heads = {i: sources[i].heads(labels) for i in dict.fromkeys(i for i, _ in chosen)}
    plans, shared = {}, {}
    for label in labels:
        groups = {}
        for place, (i, j) in enumerate(chosen):
            features = _share(shared, sources[i].features(label))
            group = groups.setdefault(features, [])
            group.append((place, *heads[i][label][j]))
        plans[label] = list(groups.items())
    return plans


def _share(known, features):
    """One that does the same, if it is known already."""
    return known.setdefault(_key(features), features)


def _key(features):
    """Equal for equal features; of what cannot be pickled equal to itself alone."""
    try:
        return pickle.dumps(features)
    except (pickle.PicklingError, AttributeError, TypeError):
        return id(features)


def _table(source, labels):
    """The descriptors of tasks."""
    codes = [source.code(label) for label in labels]
    given = source.given
    return pd.DataFrame(given.table[codes], labels, list(given.names))


def _described(sources, chosen, label):
    """Names of the descriptors, and what gives the outputs of a task with any."""
    used = {i: sources[i] for i in dict.fromkeys(i for i, _ in chosen)}
    told = [source.given for source in used.values()]
    if any(given is None for given in told):
        return None
    names = list(told[0].names)
    if any(list(given.names) != names for given in told):
        return None
    plans, shared = [], {}
    for i, source in used.items():
        columns = getattr(source.model._target, "columns", [None] * source.n_outputs)
        described = MeansOfDescribed(source.model)
        heads = [
            (place, described.means[j], columns[j] and columns[j].back)
            for place, (k, j) in enumerate(chosen)
            if k == i
        ]
        plans.append((_share(shared, source.features(label)), described, heads))
    return names, plans


def _deviations(sources, chosen, labels):
    """For each label features, the model, its task, and which outputs it gives."""
    plans = {}
    for label in labels:
        plans[label] = [
            (
                source.features(label),
                source.model,
                source.code(label),
                [(place, j) for place, (k, j) in enumerate(chosen) if k == i],
            )
            for i, source in enumerate(sources)
            if any(k == i for k, _ in chosen)
        ]
    return plans


def _plain(task):
    """A label as Python's own."""
    return check_labels([task]).tasks[0].item()
