"""Which task is it? Identifies the unknown task of samples."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from numbers import Real
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_magnitude
from skmtgp._data.numbers import as_frame, check_numbers, column_names
from skmtgp._estimators.carried import (
    errors_of,
    inflation_of,
    learned_from,
    noise_of,
)
from skmtgp._estimators.estimator import Estimator, public
from skmtgp._estimators.unlabelled import inputs_of_any_task
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.pipelines import end_of
from skmtgp._support.sklearn_compat import Interval, StrOptions
from skmtgp.learning.identifying import Output, follow, identify
from skmtgp.learning.novel import Population
from skmtgp.multitask import MultiTaskGPRegressor

__all__ = ["TaskIdentifier"]

RIDGE = 1e-6  # of the variance of descriptors, in directions in which no tasks differ


class TaskIdentifier(Estimator):
    r"""Identify the task that samples come from, and its descriptors.

    It uses a fitted model with one or several outputs, or one model for each output,
    such as for each joint of a robot. All outputs count together. The task may be one
    that the model knows, or none of them. If tasks have descriptors, the samples also
    determine those of an unknown task, such as the mass of a load that has just been
    picked up.

    Parameters
    ----------
    model : MultiTaskGPRegressor, RankSearchIC or Pipeline, or a list or dict of them
        Fitted. Of a search the best model is used. Several models must know the same
        tasks; the columns of y are their outputs, in the same order. A dict has names
        of the outputs, which find their columns in frames.
    noise : float or array-like of shape (n_outputs,), default=None
        Standard deviation of noise that the samples have in addition to the model's
        noise, in units of y.
    widening : float, default=2.0
        Standard deviation of an unknown task's descriptors around the mean of the known
        tasks', in units of their standard deviation.
    floor : "auto" or float, default="auto"
        Size of the model's own error: each task deviates from the model by an unknown
        function with this standard deviation, relative to that of the targets that the
        model was fitted to. If a task's function is larger than those of the known
        tasks, so is the deviation, and likewise if it is smaller. It does not vanish
        with many or exact samples. "auto" is 1e-4, or for a known task twice the
        deviation that f has at rows of the fit, if they have noise and this is larger.
        It is 0 for an unknown task if ``inflation="auto"`` tells how large the errors
        of the model are.
    inflation : "auto", float or array-like of shape (n_outputs,), default="auto"
        How much larger the variance of an unknown task's function is than the model
        says, apart from noise and `floor`. If tasks have descriptors, "auto" tells it
        for each output from the tasks of the fit, and adds the errors that an unknown
        task has in common with them, see Notes. Without descriptors "auto" is 1.
    switching : float, default=0.02
        Probability that the task switches between two consecutive samples of a stream.

    Attributes
    ----------
    classes_ : ndarray of shape (n_tasks + 1,)
        Labels of the known tasks, followed by None for none of them.
    responsibilities_ : ndarray of shape (n_tasks + 1,)
        Probability of each class after the last sample of `partial_fit`.
    path_ : ndarray of shape (n_samples, n_tasks + 1)
        The same after each sample of the last call.

    See Also
    --------
    MultiTaskGPRegressor.add_task : Adds the task that samples come from to the model.

    Notes
    -----
    Let :math:`f_j` be the task's row of the factor, which is linear in the descriptors
    d. Then the samples of output j are normal with mean :math:`\sum_a f_{ja} \mu_a(x)`.
    Their covariance depends on :math:`f_j`, too, because the latent functions are not
    known exactly. Descriptors have a normal prior: that of the known tasks, widened.
    Fisher scoring with a line search finds their mode, starting from the mean and from
    the likeliest task. Up to five linear steps come first, each with the covariance of
    the step before. The covariance is the inverse of the Fisher information. For "none
    of them", the density of the samples has the descriptors integrated out by Laplace's
    method. Without descriptors the rows of the factor themselves have a normal prior.

    The model's own error is a function with covariance k^x whose variance, relative to
    the prior variance of the task, is the same for all tasks: errors of the latent
    functions are in proportion to :math:`f_j`. For the average task, over the inputs of
    the fit, its deviation is `floor` times that of the targets. The prior variance of
    a model plays no part: it may be hundreds of times that of the targets.

    Most of the error of a model of few tasks is not of this kind: it is large where the
    model is unsure, and for a task whose descriptors are far from those that are known.
    The coefficients of the descriptors were learned from m tasks, and the model treats
    them as exact. The row of an unknown task is a sum of the rows of these tasks with
    shares :math:`w = Q (Q^T Q)^{-1} q`, where Q has the rows [1, descriptors] of the
    tasks, and q is that of the unknown one. So its error is the sum of theirs with
    these shares, beside its own. If all were equally large, its variance would be
    1 + h times as large, where :math:`h = w^T w` is the leverage of a regression. Few
    samples do not tell q, so errors are their mean over what is open of d: at the mode
    alone, which is near the known tasks, the leverage would be too small. Their
    covariance is held while a mode is looked for, and that is done twice.

    How large errors are, each task of the fit tells: it is predicted from the rows of
    the others, with the hyperparameters of all. It has its leverage in these, so the
    variance of its error should be 1 - h of what the model says. What the squares of
    errors are, over what they should be, is the inflation of all these variances, but
    at least 1. Errors of known tasks are not inflated.

    A noise variance that ended at its lower bound says nothing of noise. With
    ``inflation="auto"`` an unknown task has the noise that residuals of the fit show:
    the sum of their squares, over their degrees of freedom. If the covariance of the
    samples is then singular in floating point, they are taken to have 10 or 100 times
    the noise variance, and a JitterWarning says so.

    Responsibilities of a stream are those of a hidden Markov model whose samples are
    independent given the tasks.

    Examples
    --------
    Machines whose response grows with their age:

    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor, TaskIdentifier
    >>> rng = np.random.default_rng(0)
    >>> age, machine = np.array([1.0, 3.0, 6.0, 9.0]), np.repeat([0, 1, 2, 3], 20)
    >>> x = rng.uniform(0, 6, 80)
    >>> y = age[machine] * np.sin(x) + 0.1 * rng.standard_normal(80)
    >>> X = np.column_stack([x, age[machine], machine])
    >>> model = MultiTaskGPRegressor(rank=1, task_descriptors=[1]).fit(X, y)
    >>> identifier = TaskIdentifier(model)
    >>> identifier.predict([[1.0], [2.0]], [5.1, 5.4])
    2
    >>> probabilities = identifier.predict_proba([[1.0], [2.0]], [5.1, 5.4])
    >>> dict(zip(identifier.classes_, probabilities.round(2).tolist()))
    {0: 0.0, 1: 0.0, 2: 0.98, 3: 0.0, None: 0.02}
    >>> mean, covariance = identifier.estimate([[1.0], [2.0]], [3.8, 4.0])
    >>> print(mean.round(1).to_dict())
    {1: 4.3}
    """

    _parameter_constraints = {
        "model": "no_validation",
        "noise": [Interval(Real, 0.0, None, closed="left"), "array-like", None],
        "widening": [Interval(Real, 0.0, None, closed="neither")],
        "floor": [StrOptions({"auto"}), Interval(Real, 0.0, None, closed="left")],
        "inflation": [
            StrOptions({"auto"}),
            Interval(Real, 0.0, None, closed="neither"),
            "array-like",
        ],
        "switching": [Interval(Real, 0.0, 1.0, closed="both")],
    }

    def __init__(
        self,
        model: BaseEstimator | list[BaseEstimator] | dict[str, BaseEstimator],
        *,
        noise: ArrayLike | None = None,
        widening: float = 2.0,
        floor: float | str = "auto",
        inflation: float | str | ArrayLike = "auto",
        switching: float = 0.02,
    ) -> None:
        self.model = model
        self.noise = noise
        self.widening = widening
        self.floor = floor
        self.inflation = inflation
        self.switching = switching

    @public
    def predict_proba(self, X: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Return the probability that all samples come from each of the tasks.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, as the model takes them. Columns of the task and of descriptors are
            ignored, and may be left out.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.

        Returns
        -------
        probabilities : ndarray of shape (n_tasks + 1,)
            Probabilities in the order of `classes_`; the last one is for none of the
            known tasks.

        Raises
        ------
        TypeError
            If the model has no factor of a task covariance, or if transformers in front
            of it move or change the labels of the tasks so that nothing tells which
            column of X has them.
        ValueError
            If X or y cannot be used, or if the models do not know the same tasks.
        """
        outputs, starts = self._outputs(X, y)
        with limit_threads(len(outputs[0].X)):
            found, outputs = identify(outputs, starts)
            known = [
                sum(of.known(task) for of in outputs)
                for task in range(len(self.classes_) - 1)
            ]
        log_density = np.append(known, found.log_evidence)
        weights = np.exp(log_density - log_density.max())
        return weights / weights.sum()

    @public
    def predict(self, X: ArrayLike, y: ArrayLike) -> int | str | None:
        """The most probable task that all samples come from.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, as for `predict_proba`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.

        Returns
        -------
        label : int, str or None
            One of `classes_`; None is none of the known tasks.

        Raises
        ------
        TypeError, ValueError
            As `predict_proba`.
        """
        return self.classes_[self.predict_proba(X, y).argmax()]

    @public
    def estimate(self, X: ArrayLike, y: ArrayLike) -> tuple[pd.Series, pd.DataFrame]:
        """Estimate the descriptors of the task that all samples come from.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, as for `predict_proba`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.

        Returns
        -------
        mean : Series of shape (n_descriptors,)
            Most probable descriptors.
        covariance : DataFrame of shape (n_descriptors, n_descriptors)
            Their covariance.

        Raises
        ------
        ValueError
            If the model was fitted without `task_descriptors`, or for the reasons of
            `predict_proba`.
        """
        descriptors = self._models()[0]._descriptors
        if descriptors is None:
            raise ValueError(
                "estimate needs a model with descriptors of the tasks, and this one "
                "has none. Fit it with task_descriptors, the columns that describe "
                "the tasks."
            )
        outputs, starts = self._outputs(X, y)
        with limit_threads(len(outputs[0].X)):
            found, _ = identify(outputs, starts)
        centre, scale = _population(descriptors, self.widening)
        names = pd.Index(descriptors.names.tolist())
        mean = pd.Series(centre + scale @ found.u, index=names)
        covariance = scale @ found.covariance @ scale.T
        return mean, pd.DataFrame(covariance, index=names, columns=names)

    @public
    def partial_fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Follow a stream of samples whose task may switch at any of them.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, as for `predict_proba`, in the order of time.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.

        Returns
        -------
        self : TaskIdentifier
            Updated, with `responsibilities_` after the last sample. The first call
            begins with equal ones.

        Raises
        ------
        ValueError
            If the model knows other tasks than in the last call; `reset` forgets them.
            Or for the reasons of `predict_proba`.
        """
        outputs, _ = self._outputs(X, y)
        with limit_threads(len(outputs[0].X)):
            log_densities = sum(of.each() for of in outputs)
        n_classes = len(self.classes_)
        usual = np.full(n_classes, 1.0 / n_classes)
        before = getattr(self, "_log_responsibilities", np.log(usual))
        known = self.classes_[:-1].tolist()
        knew = vars(self).setdefault("_known", known)
        if known != knew:
            raise ValueError(
                f"The model knows {_listed(known)}, but knew {_listed(knew)} in the "
                "last call. Call reset() before a stream with another model."
            )
        path = follow(before, log_densities, usual, self.switching)
        self._log_responsibilities, self.path_ = path[-1], np.exp(path)
        self.responsibilities_ = self.path_[-1]
        return self

    def reset(self) -> Self:
        """Forget the stream.

        Returns
        -------
        self : TaskIdentifier
            In the state before the first `partial_fit`.
        """
        for name in ("responsibilities_", "path_", "_log_responsibilities", "_known"):
            vars(self).pop(name, None)
        return self

    @property
    def classes_(self) -> NDArray[np.object_]:
        """Labels of the known tasks, followed by None for none of them."""
        return np.array([*self._models()[0].tasks_.tolist(), None], dtype=object)

    # what the models are asked

    def _models(self):
        """The models at the ends of what was given, checked."""
        models = list(map(_last, _each(self.model)))
        _check_alike(models)
        return models

    def _outputs(self, X, y):
        """The outputs at the samples, and where u of another task may begin."""
        self._validate_params()
        models = self._models()
        population = _population(models[0]._descriptors, self.widening)
        rows = _rows(models, population, self.widening)
        noises, Y = self._noises(len(rows)), _targets(y, self.model, len(rows))
        inflations = self._inflations(models)
        outputs, told = [], self._is_told(models[0]._descriptors)
        for estimator, model in zip(_each(self.model), models, strict=True):
            inputs = inputs_of_any_task(_best(estimator), model, X)
            if len(inputs) != len(Y):
                raise ValueError(f"X has {len(inputs)} rows, but y has {len(Y)}.")
            k = len(outputs)
            columns = slice(k, k + len(model._posteriors))
            of_model = rows[columns], noises[columns], inflations[columns]
            learned = learned_from(model, *population) if told else None
            outputs += _at_samples(
                model, inputs, Y[:, columns], *of_model, self.floor, learned
            )
        return outputs, _starts(models[0], population, rows)

    def _noises(self, n_outputs):
        """Standard deviation of noise of each output, beside the model's."""
        noise = np.atleast_1d(0.0 if self.noise is None else self.noise)
        noise = check_numbers(noise, "noise")
        if noise.size not in (1, n_outputs) or (noise < 0.0).any():
            raise ValueError(
                f"noise={self.noise!r} must be a standard deviation, or one for each "
                f"of the {n_outputs} outputs."
            )
        return np.broadcast_to(noise.ravel(), n_outputs)

    def _inflations(self, models):
        """How much larger the variance of another task is, for each output."""
        pairs = [(model, j) for model in models for j in range(len(model._posteriors))]
        if isinstance(self.inflation, str):
            return [inflation_of(*pair) for pair in pairs]
        found = check_numbers(np.atleast_1d(self.inflation), "inflation").ravel()
        if found.size not in (1, len(pairs)) or (found <= 0.0).any():
            raise ValueError(
                f"inflation={self.inflation!r} must be 'auto', a positive number, or "
                f"one for each of the {len(pairs)} outputs."
            )
        return np.broadcast_to(found, len(pairs))

    def _is_told(self, descriptors):
        """Whether tasks that are left out tell how wrong the model is of another."""
        return descriptors is not None and isinstance(self.inflation, str)


def _listed(labels):
    """Some tasks as an error names them."""
    return f"{len(labels)} tasks, {reprlib.repr(labels)}"


def _each(model):
    """The models, one or more outputs each."""
    if isinstance(model, Mapping):
        model = list(model.values())
    found = list(model) if isinstance(model, (list, tuple)) else [model]
    if not found:
        raise ValueError("model is empty: give a fitted model, or one for each output.")
    return found


def _best(estimator):
    """What a search has found."""
    while hasattr(estimator, "best_estimator_"):
        estimator = estimator.best_estimator_
    return estimator


def _last(estimator):
    """The model at the end of a pipeline, checked."""
    model = end_of(estimator)
    _check_kind(model)
    check_is_fitted(model)
    model._check_rows()
    if isinstance(model.rank_, list):
        raise ValueError(
            f"TaskIdentifier takes models of one kernel, and this one has "
            f"{len(model.rank_)} terms. Fit it with one of them, or with their sum."
        )
    if model._trends() is not None:
        names = ", ".join(map(repr, model.trend_names_.tolist()))
        raise ValueError(
            "TaskIdentifier takes models without a trend, and this one has the columns "
            f"{names}. Fit it with trend=None."
        )
    if model._units.own_scales:
        raise ValueError(
            "The tasks have units of their own, so the unit of an unknown task is not "
            "known. Fit the model with normalize_y='shared'."
        )
    if not model._has_usual_centre():
        raise ValueError(
            "The levels of the tasks are hundreds of deviations apart, so the level of "
            "an unknown task is not known. Subtract the levels, and fit the model with "
            "task_levels=False."
        )
    return model


def _check_kind(model):
    """Raise a TypeError where a model has no factor."""
    if isinstance(model, MultiTaskGPRegressor):
        return
    advice = (
        " Of a robot with a description, add_task(X, y).load_parameters_ tells the "
        "load of samples whose task has a new label."
    )
    raise TypeError(
        "model must be a MultiTaskGPRegressor, or a RankSearchIC or Pipeline that ends "
        f"with one, or a list or dict of these, not a {type(model).__name__}."
        + advice
        * hasattr(model, "load_parameters_")
    )


def _check_alike(models):
    """Raise a ValueError where models know other tasks, or other descriptors."""
    first = models[0]
    for model in models[1:]:
        if model.tasks_.tolist() != first.tasks_.tolist():
            raise ValueError(
                f"The models know different tasks: {first.tasks_.tolist()} and "
                f"{model.tasks_.tolist()}. Fit them to the same tasks."
            )
        tables = [getattr(of, "task_descriptors_", None) for of in (first, model)]
        same = [
            None if table is None else table.to_numpy().tolist() for table in tables
        ]
        if same[0] != same[1]:
            raise ValueError(
                "The models have different descriptors of the tasks, or some have "
                "none. Fit them with the same task_descriptors."
            )


def _at_samples(model, inputs, Y, rows, noises, inflations, floor, learned):
    """The outputs of a model at samples, in its own units."""
    units = model._units
    unseen = np.array([len(model.tasks_)])
    centre, scale = (units.of_rows(of, unseen) for of in units)
    scaled = (model._target.forward(Y) - centre) / scale
    return [
        Output(
            model._posteriors[j],
            inputs,
            y,
            noise_of(model, j, noises[j], learned is not None),
            errors_of(model, j, floor, learned is not None),
            _factor(model, j),
            rows[j],
            inflations[j],
            None if learned is None else learned[j],
        )
        for j, y in enumerate(scaled.T)
    ]


def _targets(y, model, n_outputs):
    """The columns of y, (n_samples, n_outputs)."""
    if isinstance(y, Mapping):
        y = pd.DataFrame(dict(y))
    if isinstance(model, Mapping) and hasattr(y, "columns"):
        y = as_frame(y)[list(model)]
    if np.ndim(y) == 0:
        raise ValueError(
            f"y={y!r} is one number, but must have one for each row of X: give one "
            "sample as predict_proba([x], [y])."
        )
    Y = check_numbers(y, "y")
    one_row = f" For one sample give y of shape (1, {n_outputs})."
    one_row *= Y.shape == (n_outputs,)
    Y = Y.reshape(len(Y), -1) if n_outputs > 1 or Y.ndim > 1 else Y[:, None]
    if Y.shape[1] != n_outputs:
        raise ValueError(
            f"y has {Y.shape[1]} columns, but the model has {n_outputs} outputs."
            f"{one_row}"
        )
    check_magnitude(Y, "y", column_names(y if hasattr(y, "columns") else Y))
    return Y


def _population(descriptors, widening):
    """Mean of the descriptors of another task, and a factor of their covariance."""
    if descriptors is None:
        return None
    table = descriptors.table
    unit = np.where(table.std(axis=0) > 0.0, table.std(axis=0), 1.0)
    covariance = np.atleast_2d(np.cov((table / unit).T, bias=True))
    covariance.flat[:: len(covariance) + 1] += RIDGE
    scale = widening * unit[:, None] * np.linalg.cholesky(covariance)
    return table.mean(axis=0), scale


def _factor(model, j):
    """F of an output, without the function that all share."""
    prior, theta = model._posteriors[j].prior, model._posteriors[j].theta
    return prior.task_covariance.columns(prior.values(theta).rho)


def _rows(models, population, widening):
    """Of each output c and A, by which the row of another task is c + A u."""
    pairs = [(model, j) for model in models for j in range(len(model._posteriors))]
    if population is not None:
        return [_described(*pair, *population) for pair in pairs]
    populations = [Population(_factor(*pair), own=False) for pair in pairs]
    ranks = [len(of.mean) for of in populations]
    blocks = np.split(np.eye(sum(ranks)), np.cumsum(ranks)[:-1])
    return [
        (of.mean, widening * of.scale @ block)
        for of, block in zip(populations, blocks, strict=True)
    ]


def _described(model, j, centre, scale):
    """The same of tasks with descriptors, which the outputs share."""
    prior, theta = model._posteriors[j].prior, model._posteriors[j].theta
    tables = np.vstack([centre, centre + scale.T])
    loadings, _ = prior.unseen(theta, model._descriptors.rows(tables))
    c, *others = loadings[:, int(prior.task_covariance.shared) :]
    return c, (np.array(others) - c).T


def _starts(model, population, rows):
    """Where u of another task may begin: at the known tasks, or at 0."""
    if population is None:
        return np.zeros((1, rows[0][1].shape[1]))
    centre, scale = population
    return np.linalg.solve(scale, (model._descriptors.table - centre).T).T
