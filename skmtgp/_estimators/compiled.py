"""What predictions of one row need of a fitted model, and nothing else."""

import numpy as np
import pandas as pd

from skmtgp._data.checks import locate
from skmtgp._data.labels import check_labels
from skmtgp.model._nodes import compile_kernel, fold


class Chain:
    """Functions of a row, one after another."""

    def __init__(self, functions):
        self.functions = functions

    def __call__(self, x):
        for function in self.functions:
            x = function(x)
        return x


class Transform:
    """Transformers that are called as they are, of a row with its task."""

    def __init__(self, steps, model, label):
        self.steps, self.label = steps, label
        self.position, _ = locate(model)
        n, is_last = steps[0].n_features_in_, self.position + 1 == model.n_features_in_
        self.before = n - 1 if is_last else self.position
        self.names = getattr(steps[0], "feature_names_in_", None)
        if self.names is not None and model.task_feature in self.names:
            self.before = list(self.names).index(model.task_feature)
        self._check(n)

    def _check(self, n):
        """Raise a ValueError where the label does not come out where the task is."""
        found = self._transformed(np.ones(n - 1))[self.position]
        try:
            same = check_labels([found]).tasks[0].item() == self.label
        except (TypeError, ValueError):
            same = False
        if not same:
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


def means_of(model, codes):
    """Functions of the features, each of which gives an output of some tasks.

    Parameters
    ----------
    model : FittedGP
        Fitted.
    codes : list of int
        Positions of the tasks.

    Returns
    -------
    means : list of n_outputs Mean
        Of shape (n_tasks,) for one row of features, in the units of y, or in those of
        transformed targets.
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
            mean.parts.append(OfTrend(*posterior.trend_of(codes)))
    return means


class OfTrend:
    """What a trend adds to the mean, of some tasks, in units of y."""

    def __init__(self, columns, coefficients, constants):
        self.columns, self.coefficients = columns, coefficients
        self.constants = constants

    def __call__(self, z):
        return self.columns(z[None])[0] @ self.coefficients + self.constants


class MeansOfDescribed:
    """The means of a task with any descriptors, which they are linear in.

    Parameters
    ----------
    model : FittedGP
        Fitted with `task_descriptors`.
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

    def along(self, descriptors):
        """What the values of `means` are to be multiplied by and summed."""
        steps = (descriptors - self.centre) / self.scale
        return np.append(1.0 - steps.sum(), steps)

    def line(self, values):
        """The constant and the slopes of what `values` of `means` say."""
        slopes = (values[1:] - values[0]) / self.scale
        return values[0] - slopes @ self.centre, slopes


class Mean:
    """The mean of an output in the units of y, of some tasks."""

    def __init__(self, summands, scale, centre):
        self.parts, self.constant = [], centre.copy()
        for summand in summands:
            self.constant += summand.constants * scale
            inputs, B = _collapsed(summand.inputs, summand.weights.T * scale)
            if len(B):
                kernel = summand.kernel
                bound = compile_kernel(kernel).bind(kernel.theta, inputs)
                self.parts.append(fold(bound, B))

    def __call__(self, z):
        return sum((part(z) for part in self.parts), self.constant)


def _collapsed(inputs, B):
    """Inputs that differ and matter, and the sums of their weights."""
    matter = B.any(axis=1)
    inputs, of_row = np.unique(inputs[matter], axis=0, return_inverse=True)
    sums = np.zeros((len(inputs), B.shape[1]))
    np.add.at(sums, of_row.ravel(), B[matter])
    return inputs, sums
