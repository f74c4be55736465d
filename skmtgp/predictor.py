"""Fitted models as functions of one state, for a control loop."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator

from skmtgp._numerics.parallel import limit_threads
from skmtgp._plans import (
    chosen_of,
    common_tasks,
    described_of,
    deviations_of,
    plain,
    plans_of,
    sources_of,
    table_of,
)

__all__ = ["CompiledPredictor", "compile_predictor"]


def compile_predictor(
    model: BaseEstimator | Sequence[BaseEstimator] | Mapping[Hashable, BaseEstimator],
    task: int | str | None = None,
    outputs: Sequence[Hashable] | None = None,
    *,
    std: bool = False,
) -> CompiledPredictor:
    """A fitted model as a function of one state, for predictions that are due.

    Features, units and the sums over training rows are prepared once. What is left for
    each call is the kernel between the state and those rows: no frames, no pipelines,
    and no checks but for the length of the state.

    Parameters
    ----------
    model : estimator, Pipeline, or a sequence or mapping of them
        Fitted: a MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP or
        RankSearchIC, or a Pipeline that ends with one. Several, such as one for each
        joint of a robot, share their features where these are the same.
    task : int or str, default=None
        Label of the task that is predicted. None: it comes with each call.
    outputs : sequence, default=None
        Which outputs are predicted, in this order: their positions among those of all
        models, or the keys of a mapping. None is all of them.
    std : bool, default=False
        Whether the standard deviation can be asked for. It needs the whole model.

    Returns
    -------
    predictor : CompiledPredictor
        Can be pickled. It knows the model as it is now; see its method ``refresh``.

    Raises
    ------
    NotFittedError
        If a model was not fitted.
    TypeError
        If a model is none of these.
    ValueError
        If the task or an output is not known, or if it cannot be told which column of
        X has the task.

    Notes
    -----
    Predictions are those of `predict` but for rounding. In memory it is some copies of
    the training inputs, and without `std` nothing else: inputs at which several tasks
    were measured count once, and rows that do not matter to the task are left out. Of
    sparse inference they are the inducing inputs. Outputs of the same rows whose
    kernels differ in hyperparameters alone, and draws of these, are computed together,
    which takes far less time than one after another. Transformers other than
    :class:`~skmtgp.preprocessing.InverseDynamicsFeatures` are called as they are, which
    takes most of the time then.

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
    """What :func:`compile_predictor` makes.

    Parameters
    ----------
    model : estimator, Pipeline, or a sequence or mapping of them
        Fitted.
    task : int or str, default=None
        Label of the task that is predicted.
    outputs : sequence, default=None
        Which outputs are predicted.
    std : bool, default=False
        Whether the standard deviation can be asked for.

    Attributes
    ----------
    task : int, str or None
        The task that is predicted; None where it comes with each call.
    outputs : list
        The outputs, in the order in which they are predicted.
    tasks : list
        Labels that it was compiled for.
    n_features_in : int
        Length of a state: the columns of X without the task and its descriptors.
    descriptors : DataFrame of shape (n_tasks, n_descriptors) or None
        Those of the tasks, where all models have the same `task_descriptors` and it was
        compiled for all tasks.

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
        keys, sources = sources_of(model)
        chosen = chosen_of(keys, sources, outputs)
        labels = common_tasks(sources) if task is None else [plain(task)]
        self.task = None if task is None else labels[0]
        self.tasks, self.outputs, self._asked = labels, list(chosen), outputs
        self.n_features_in = sources[0].n_features
        self._shape = (self.n_features_in,)
        self._plans = plans_of(sources, list(chosen.values()), labels)
        self.descriptors, self._described = None, None
        if task is None:
            self._described = described_of(sources, list(chosen.values()), labels[0])
        if self._described is not None:
            self.descriptors = table_of(sources[0], labels)
        self._deviations = None
        if std:
            self._deviations = deviations_of(sources, list(chosen.values()), labels)

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
            Label of the task, if the predictor is not of one.
        descriptors : array-like of shape (n_descriptors,), default=None
            Those of a task that the model need not know, in place of a label. Only of
            models with `task_descriptors`, in whose order they are, and compiled for
            all tasks.

        Returns
        -------
        y : ndarray of shape (n_outputs,)
            What `predict` says, in the units of y.
        """
        x = self._check(x)
        if descriptors is not None:
            return self._predict_described(x, descriptors)
        y = np.empty(len(self.outputs))
        for plan in self._of_task(self._plans, task):
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
            In the order of `tasks`, in the units of y.
        """
        x, found = self._check(x), {}
        y = np.empty((len(self.tasks), len(self.outputs)))
        for row, task in zip(y, self.tasks, strict=True):
            for plan in self._plans[task]:
                key = plan.features, plan.means
                if key not in found:
                    found[key] = plan.means(plan.features(x))
                row[plan.places] = plan.in_units(found[key][:, plan.k])
        return y

    def by_descriptors(
        self, x: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The outputs for one state, as a linear function of the descriptors.

        What is predicted for a task with descriptors d is ``constants + slopes @ d``.
        A measured y is thus a linear equation for d: see
        :class:`~skmtgp.DescriptorTracker`.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            The columns of X in their order, without the task and its descriptors.

        Returns
        -------
        constants : ndarray of shape (n_outputs,)
            In the units of y.
        slopes : ndarray of shape (n_outputs, n_descriptors)
            In units of y per unit of each descriptor.

        Raises
        ------
        ValueError
            If the models do not have the same `task_descriptors`, or have a
            `target_transform`, through which nothing is linear.
        """
        x, plans = self._check(x), self._of_descriptors()[1]
        constants = np.empty(len(self.outputs))
        slopes = np.empty((len(self.outputs), self.descriptors.shape[1]))
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
        """Standard deviations of the outputs for one state.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            The columns of X in their order, without the task and its descriptors.
        task : int or str, default=None
            Label of the task, if the predictor is not of one.
        include_noise : bool, default=False
            Whether they are those of a new observation, f plus noise, rather than
            those of f.

        Returns
        -------
        y_std : ndarray of shape (n_outputs,)
            In the units of y. It takes O(n^2) for each output.

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
        """Learn, in place, what a model has learned since.

        Parameters
        ----------
        model : estimator, Pipeline, or a sequence or mapping of them
            The same model after ``partial_fit``, or another one with these outputs.

        Returns
        -------
        self : CompiledPredictor
            Another thread that predicts meanwhile has the old or the new model, never
            a part of each.
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
                f"task={task!r} is none that the predictor was compiled for: {known}"
                f"{', ...' if len(plans) > 5 else ''}."
            ) from None
