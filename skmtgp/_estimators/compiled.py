"""What predictions of one row need of a fitted model, and nothing else."""

from collections import defaultdict

import numpy as np
import pandas as pd

from skmtgp._data.labels import check_labels
from skmtgp._data.task_column import locate
from skmtgp.model._nodes import fold, form_of

TOGETHER = 2**14  # values of a kernel at a time, which the cache holds


class Chain:
    """Functions of a row, one after another."""

    def __init__(self, functions):
        self.functions = functions

    def __call__(self, x):
        for function in self.functions:
            x = function(x)
        return x


def place_of_task(first, model):
    """Which column of X has the task, if transformers know no tasks: by name or place.

    Parameters
    ----------
    first : transformer
        Fitted, the first of those in front of the model.
    model : estimator
        Fitted.

    Returns
    -------
    place : int
        A guess: see `are_label` for whether the task comes out where the model has it.
    """
    names = list(getattr(first, "feature_names_in_", []))
    if model.task_feature in names:
        return names.index(model.task_feature)
    position, _ = locate(model)
    is_last = position + 1 == model.n_features_in_
    return first.n_features_in_ - 1 if is_last else position


def names_of_state(steps, model):
    """Names of the columns of X without the task and its descriptors, if it has any.

    Parameters
    ----------
    steps : list of transformer
        Fitted, what X passes before the model.
    model : estimator
        Fitted.

    Returns
    -------
    names : list of str or None
    """
    first = [*steps, model][0]
    names = getattr(first, "feature_names_in_", None)
    if names is None:
        return None
    knows_tasks = hasattr(first, "task_feature")
    place = locate(first)[0] if knows_tasks else place_of_task(first, model)
    given = getattr(first, "_descriptors", None)
    described = [] if given is None else getattr(given, "columns", given)
    return np.delete(np.delete(names, place), described).tolist()


def are_label(values, label):
    """Whether values of a column are all the label of this task."""
    try:
        return check_labels(values).tasks.tolist() == [label]
    except (TypeError, ValueError):
        return False


class Transform:
    """Transformers that are called as they are, of a row with its task."""

    def __init__(self, steps, model, label):
        self.steps, self.label = steps, label
        self.position, _ = locate(model)
        self.before = place_of_task(steps[0], model)
        self.names = getattr(steps[0], "feature_names_in_", None)
        for step in steps:
            _refuse_text(step, label)
        self._check(steps[0].n_features_in_)

    def _check(self, n):
        """Raise a ValueError where the label does not come out where the task is."""
        found = self._transformed(np.ones(n - 1))[self.position]
        if not are_label([found], self.label):
            names = [type(step).__name__ for step in self.steps]
            raise ValueError(
                "compile_predictor cannot tell which column of X has the task, because "
                f"{', '.join(names)} moves it. Make it the last column of X and of the "
                "transformers' output."
            )

    def __call__(self, x):
        return np.delete(self._transformed(x), self.position).astype(float)

    def _transformed(self, x):
        row = np.insert(x.astype(object), self.before, self.label)[None]
        if self.names is not None:
            row = pd.DataFrame(row, columns=self.names).infer_objects()
        elif not isinstance(self.label, str):
            row = row.astype(float)
        for step in self.steps:
            row = step.transform(row)
        return np.asarray(row, dtype=object)[0]


def _refuse_text(step, label):
    """Raise a ValueError where a step encodes text, which no state of numbers has.

    An encoder of the task gets its label, not a number.
    """
    for encoder in _encoders(step):
        for values in encoder.categories_:
            texts = [value for value in values if isinstance(value, str)]
            if texts and label not in texts:
                within = f" of the {type(step).__name__}" * (encoder is not step)
                raise ValueError(
                    "compile_predictor takes states of numbers, but the "
                    f"{type(encoder).__name__}{within} was fitted to text such as "
                    f"{texts[0]!r}. Encode that column before the pipeline is fitted, "
                    "or leave it out."
                )


def _encoders(step):
    """The parts of a fitted transformer, or itself, that know categories."""
    if hasattr(step, "categories_"):
        yield step
    for name in ("transformers_", "transformer_list", "steps"):
        for _, part, *_ in getattr(step, name, ()):
            yield from _encoders(part)


def means_of(model, codes):
    """What the means of some tasks are made of, for each output.

    Parameters
    ----------
    model : FittedGP
        Fitted.
    codes : list of int
        Positions of the tasks.

    Returns
    -------
    means : list of n_outputs Mean
        In the units of y, or in those of transformed targets.
    """
    codes = np.array(codes)
    return _means(model, model._predictive_for(codes), codes)


def _means(model, posteriors, codes):
    units = model._units
    shape = len(codes), len(posteriors)
    scales, centres = (
        np.broadcast_to(units.of_rows(of, codes), shape)
        for of in (units.scale, units.centre)
    )
    outputs = zip(posteriors, scales.T, centres.T, strict=True)
    means = [
        Mean(posterior.summands(codes), scale, centre)
        for posterior, scale, centre in outputs
    ]
    if model._trends() is not None:
        for mean, posterior in zip(means, posteriors, strict=True):
            mean.trend = OfTrend(*posterior.trend_of(codes))
    return means


class OfTrend:
    """What a trend adds to the mean, of some tasks, in units of y."""

    def __init__(self, columns, coefficients, constants):
        self.columns, self.coefficients = columns, coefficients
        self.constants = constants

    def __call__(self, z):
        return self.columns(z[None]) @ self.coefficients + self.constants


class Mean:
    """What the mean of an output is the sum of, of some tasks, in the units of y.

    Attributes
    ----------
    constant : ndarray of shape (n_tasks,)
        What does not depend on the inputs.
    kernels : list of (bound, B, group)
        Each is a kernel bound to rows and their weights for each task. Those whose
        group is equal can be folded together.
    trend : OfTrend or None
        What a trend adds.
    """

    def __init__(self, summands, scale, centre):
        self.constant, self.kernels, self.trend = centre.copy(), [], None
        for summand in summands:
            self.constant += summand.constants * scale
            inputs, B = _collapsed(summand.inputs, summand.weights.T * scale)
            if len(B):
                bound = summand.bind(inputs)
                group = form_of(bound), inputs.shape, inputs.tobytes()
                self.kernels.append((bound, B, group))


def _collapsed(inputs, B):
    """Inputs that differ and matter, and the sums of their weights."""
    matter = B.any(axis=1)
    inputs, B = inputs[matter], B[matter]
    order = np.lexsort(inputs.T[::-1])  # np.unique compares rows, which takes longer
    inputs, differs = inputs[order], np.ones(len(order), dtype=bool)
    differs[1:] = (inputs[1:] != inputs[:-1]).any(axis=1)
    sums = np.zeros((np.count_nonzero(differs), B.shape[1]))
    np.add.at(sums, np.cumsum(differs) - 1, B[order])
    return inputs[differs], sums


class Means:
    """The means of several outputs, of as many tasks each, as a function of a row.

    Parameters
    ----------
    means : list of n_outputs Mean
        Of the same features; of one model or of several.
    """

    def __init__(self, means):
        self.constants, self.parts = np.stack([mean.constant for mean in means]), []
        groups = defaultdict(list)
        for place, mean in enumerate(means):
            for bound, B, group in mean.kernels:
                groups[group].append((place, bound, B))
            if mean.trend is not None:
                self.parts.append(_placed([place], mean.trend, len(means)))
        for group in groups.values():
            most = max(1, TOGETHER // len(group[0][2]))
            for first in range(0, len(group), most):
                places, bounds, B = zip(*group[first : first + most], strict=True)
                folded = fold(list(bounds), np.stack(B))
                self.parts.append(_placed(list(places), folded, len(means)))

    def __call__(self, z):
        return sum((part(z) for part in self.parts), self.constants)


class Placed:
    """Sums of some outputs, of which one may have several, among all of them."""

    def __init__(self, places, inner, n):
        self.inner, self.sums = inner, np.equal.outer(range(n), places).astype(float)

    def __call__(self, z):
        return self.sums @ self.inner(z)


def _placed(places, inner, n):
    return inner if places == list(range(n)) else Placed(places, inner, n)


class OfDescribed:
    """What the means of a task with any descriptors are made of.

    Parameters
    ----------
    model : FittedGP
        Fitted with `task_descriptors`.

    Attributes
    ----------
    means : list of n_outputs Mean
        Of the task in the middle of the known ones, and of those that are a step away
        from it along one descriptor.
    centre, scale : ndarray of shape (n_descriptors,)
        The middle and the steps.
    """

    def __init__(self, model):
        given = model._descriptors
        self.centre = given.centre
        self.scale = np.where(np.isfinite(given.scale), given.scale, 1.0)
        steps = np.vstack([np.zeros(len(self.scale)), np.diag(self.scale)])
        rows = given.rows(self.centre + steps)
        codes = len(model.tasks_) + np.arange(len(rows))
        posteriors = model._predictive_for(codes, rows)
        self.means = _means(model, posteriors, codes)


class Described:
    """Means of several outputs, as a linear function of the task's descriptors.

    Parameters
    ----------
    outputs : list of n_outputs (OfDescribed, int)
        Of the same features, each with its position among the outputs of its model.
    """

    def __init__(self, outputs):
        self.means = Means([of.means[j] for of, j in outputs])
        self.centre = np.stack([of.centre for of, _ in outputs])
        self.scale = np.stack([of.scale for of, _ in outputs])

    def __call__(self, z, descriptors):
        """The means of a task, of shape (n_outputs,)."""
        values, steps = self.means(z), (descriptors - self.centre) / self.scale
        slopes = values[:, 1:] - values[:, :1]
        return values[:, 0] + np.einsum("od,od->o", slopes, steps)

    def line(self, z):
        """Constants, and slopes of shape (n_outputs, n_descriptors)."""
        values = self.means(z)
        slopes = (values[:, 1:] - values[:, :1]) / self.scale
        return values[:, 0] - np.einsum("od,od->o", slopes, self.centre), slopes
