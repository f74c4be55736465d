"""What a compiled predictor calls, made of fitted models."""

from __future__ import annotations

import pickle
from collections import defaultdict
from collections.abc import Mapping
from copy import copy
from operator import is_
from typing import Any, NamedTuple
from weakref import ref

import numpy as np
import pandas as pd
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.labels import check_labels, encode_tasks
from skmtgp._estimators.base import BaseMultiTaskGP
from skmtgp._estimators.compiled import (
    Chain,
    Described,
    Means,
    OfDescribed,
    Transform,
    means_of,
    names_of_state,
)
from skmtgp._support.pipelines import instead_of
from skmtgp.model_selection import RankSearchIC
from skmtgp.robot import RigidBodyRegressor
from skmtgp.single_task import SingleTaskGP

MODELS = BaseMultiTaskGP, RankSearchIC, SingleTaskGP, RigidBodyRegressor


class Plan(NamedTuple):
    """How outputs that need the same features are predicted.

    Attributes
    ----------
    features : callable
        Of a state.
    means : Means or Described
        Of the features.
    k : int or None
        Which of its tasks counts.
    places : ndarray of shape (n_of_these,)
        Which outputs they are.
    backs : list of callable, or None
        From transformed targets to y, where there are any.
    """

    features: Any
    means: Any
    k: int | None
    places: Any
    backs: list | None

    def in_units(self, values):
        """Values of these outputs in the units of y."""
        if self.backs is None:
            return values
        pairs = zip(self.backs, values, strict=True)
        return [
            value if back is None else back(np.array([value]))[0]
            for back, value in pairs
        ]


class Source:
    """A fitted model, its features and its tasks.

    Parameters
    ----------
    steps : list of transformer
        What its inputs pass.
    last : estimator
        The model.
    known : tuple, default=None
        What another Source of this model made of it and of which posteriors, see
        `means`.
    """

    def __init__(self, steps, last, known=None):
        self.steps, self.last, self.known = steps, last, known
        check_is_fitted(self.last)
        self.model = copy(self.last._model())  # as it is now, whatever joins later
        first = [*self.steps, self.last][0]
        self.given = getattr(self.model, "_descriptors", None)
        n_descriptors = 0 if self.given is None else len(self.given.names)
        self.n_features = first.n_features_in_ - 1 - n_descriptors
        self.is_robot = isinstance(self.model, RigidBodyRegressor)
        outputs = "noise_variance_" if self.is_robot else "log_marginal_likelihoods_"
        self.n_outputs = np.size(getattr(self.model, outputs))

    @classmethod
    def of(cls, model):
        """That of a model, which may be the last step of a Pipeline."""
        steps = [("model", model)]
        while isinstance(steps[-1][1], Pipeline):
            steps = [*steps[:-1], *steps[-1][1].steps]
        if not isinstance(steps[-1][1], MODELS):
            raise TypeError(
                "model must be a MultiTaskGPRegressor, IndependentGP, PooledGP, "
                "SingleTaskGP, RankSearchIC or a regressor of skmtgp.robot, a Pipeline "
                "that ends with one of them, "
                f"or several of these, not a {type(steps[-1][1]).__name__}."
                f"{instead_of(steps[-1][1])}"
            )
        *first, last = (step for _, step in steps)
        return cls([step for step in first if step not in (None, "passthrough")], last)

    def names(self):
        """Names of the columns of a state, or None."""
        return names_of_state(self.steps, self.model)

    def code(self, label):
        """The position of a task."""
        options = {
            "can_join": hasattr(self.last, "add_task"),
            "may_share": hasattr(self.model, "shared"),
        }
        if not self.is_robot:
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

    def backs(self):
        """For each output what leads from transformed targets to y, or None."""
        columns = getattr(self.model._target, "columns", [None] * self.n_outputs)
        return [column and column.back for column in columns]

    def means(self, labels):
        """For each label the means of all outputs, and which of their tasks it is."""
        posteriors = getattr(self.model, "_predictive", ())
        if self.known is not None:
            known_labels, refs, means = self.known
            known = [of() for of in refs]
            if known_labels == labels and all(map(is_, known, posteriors)):
                return means
        means = self._means(labels)
        if posteriors:
            self.known = labels, list(map(ref, posteriors)), means
        return means

    def _means(self, labels):
        codes = [self.code(label) for label in labels]
        if isinstance(self.model, SingleTaskGP):
            alone = [means_of(self.model.estimators_[code], [0]) for code in codes]
            return dict(zip(labels, ((means, 0) for means in alone), strict=True))
        means = means_of(self.model, codes)
        return {label: (means, k) for k, label in enumerate(labels)}


class Joints:
    """Some joints' torques of a robot that carries one load, of shape (n_of_these, 1).

    Parameters
    ----------
    source : Source
        The robot.
    label : str or int
        The load.
    joints : tuple of int
        Which.
    """

    def __init__(self, source, label, joints):
        self.torques = source.model._compile(source.code(label))
        self.joints = np.array(joints)

    def __call__(self, x):
        return self.torques(x)[self.joints, None]


def sources_of(model):
    """The keys and the models that were given, checked."""
    if isinstance(model, Mapping):
        keys, models = list(model), model.values()
    else:
        several = isinstance(model, (list, tuple))
        keys, models = None, model if several else [model]
    sources = list(map(Source.of, models))
    if not sources:
        raise ValueError("model is empty: give at least one fitted model.")
    return keys, check_sources(sources)


def check_sources(sources):
    """The models, if they take states of the same length."""
    lengths = {source.n_features for source in sources}
    if len(lengths) > 1:
        raise ValueError(
            f"The models take states of different lengths, {sorted(lengths)}: compile "
            "those of each length alone."
        )
    return sources


def chosen_of(keys, sources, outputs):
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


def common_tasks(sources):
    """Labels that all models know."""
    known = [source.model.tasks_.tolist() for source in sources]
    labels = [label for label in known[0] if all(label in of for of in known)]
    if not labels:
        raise ValueError("The models have no task in common: name one of them.")
    return labels


def plans_of(sources, chosen, labels):
    """For each label the plans of all outputs."""
    places = defaultdict(list)
    for place, (i, j) in enumerate(chosen):
        places[sources[i].is_robot].append((place, sources[i], j))
    plans = _of_processes(places[False], labels)
    for label in labels:
        plans[label] += _of_robots(places[True], label)
    return plans


def _of_robots(places, label):
    """Each computes all of its joints at once."""
    joints = defaultdict(list)
    for place, source, j in places:
        joints[source].append((place, j))
    plans = []
    for source, pairs in joints.items():
        of_these, js = zip(*pairs, strict=True)
        means = Joints(source, label, js)
        plans.append(Plan(source.features(label), means, 0, np.array(of_these), None))
    return plans


def _of_processes(places, labels):
    used = dict.fromkeys(source for _, source, _ in places)
    means = {source: source.means(labels) for source in used}
    backs = {source: source.backs() for source in used}
    plans, shared = {}, {}
    for label in labels:
        groups = defaultdict(list)
        for place, source, j in places:
            (of_label, k), features = means[source][label], source.features(label)
            group = _share(shared, features), k, len(of_label[j].constant)
            groups[group].append((place, of_label[j], backs[source][j]))
        plans[label] = [
            _plan(features, k, heads, shared)
            for (features, k, _), heads in groups.items()
        ]
    return plans


def _plan(features, k, heads, shared):
    """That of outputs with the same features; labels share their means."""
    places, means, backs = zip(*heads, strict=True)
    if means not in shared:
        shared[means] = Means(means)
    return Plan(features, shared[means], k, np.array(places), _some(backs))


def _some(backs):
    return list(backs) if any(back is not None for back in backs) else None


def _share(known, features):
    """One that does the same, if it is known already."""
    return known.setdefault(_key(features), features)


def _key(features):
    """Equal for equal features; of what cannot be pickled equal to itself alone."""
    try:
        return pickle.dumps(features)
    except (pickle.PicklingError, AttributeError, TypeError):
        return id(features)


def table_of(source, labels):
    """The descriptors of tasks."""
    codes = [source.code(label) for label in labels]
    given = source.given
    return pd.DataFrame(given.table[codes], labels, list(given.names))


def described_of(sources, chosen, label):
    """Names of the descriptors, and the plans of a task with any; None without."""
    used = {i: sources[i] for i in dict.fromkeys(i for i, _ in chosen)}
    told = [source.given for source in used.values()]
    if any(given is None for given in told):
        return None
    names = list(told[0].names)
    if any(list(given.names) != names for given in told):
        return None
    groups, shared, of = defaultdict(list), {}, {}
    for i, source in used.items():
        of[i] = OfDescribed(source.model), source.backs()
    for place, (i, j) in enumerate(chosen):
        features = _share(shared, used[i].features(label))
        groups[features].append((place, (of[i][0], j), of[i][1][j]))
    return names, [_described(features, heads) for features, heads in groups.items()]


def _described(features, heads):
    places, outputs, backs = zip(*heads, strict=True)
    return Plan(features, Described(outputs), None, np.array(places), _some(backs))


def deviations_of(sources, chosen, labels):
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


def plain(task):
    """A label as Python's own."""
    return check_labels([task]).tasks[0].item()
