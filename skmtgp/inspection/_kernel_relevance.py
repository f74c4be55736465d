"""Relevance of features: which of them the kernel uses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.gaussian_process.kernels import (
    RBF,
    Exponentiation,
    Kernel,
    KernelOperator,
    Matern,
)
from sklearn.pipeline import Pipeline
from sklearn.utils import check_array

from skmtgp._data.task_column import locate_task_column
from skmtgp.inspection._drawing import Display, label_positions, style
from skmtgp.inspection._models import check_output, model_of_tasks, model_with
from skmtgp.kernels import ARDLinear, Columns, Spherical

NAMES = {Matern: "Matern", Spherical: "spherical"}

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class KernelRelevanceDisplay(Display):
    r"""Relevance of each feature in the parts of a kernel (ARD).

    Parameters
    ----------
    relevances : array-like of shape (n_parts, n_features)
        Relevance of each feature in each part of the kernel, NaN if a part does not use
        the feature. The axis is logarithmic, so values that are not positive are left
        out.
    parts : sequence of n_parts str
        Names of the parts.
    feature_names : sequence of n_features str
        Names of the features.

    Attributes
    ----------
    lines_ : list of n_parts matplotlib Line2D
        Relevances of each part, as dots.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    skmtgp.kernels.ARDLinear : Linear kernel with a weight for each feature.

    Notes
    -----
    The relevance of a feature in a squared exponential or Matérn kernel is :math:`1 /
    \ell_d`, one over its length-scale, in units of 1 / feature. In an ARDLinear kernel
    it is the weight :math:`w_d`, in units of 1 / feature^2. Relevances compare features
    of the same scale, such as standardised ones, within one part of the kernel. This is
    automatic relevance determination, Rasmussen and Williams (2006), section 5.1. A
    relevance at its lower bound means that the part does not need the feature.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skmtgp import MultiTaskGPRegressor
    >>> from skmtgp.inspection import KernelRelevanceDisplay
    >>> rng = np.random.default_rng(0)
    >>> X = pd.DataFrame(rng.uniform(0, 3, (60, 2)), columns=["warm", "wet"])
    >>> X["site"] = ["a", "b"] * 30
    >>> y = np.sin(2 * X["warm"]) + 0.1 * X["wet"] + 0.1 * rng.standard_normal(60)
    >>> model = MultiTaskGPRegressor(rank=1, task_feature="site").fit(X, y)
    >>> display = KernelRelevanceDisplay.from_estimator(model)
    >>> list(display.feature_names)
    ['warm', 'wet']
    >>> plt.show()

    Relevances that are known already:

    >>> display = KernelRelevanceDisplay(
    ...     relevances=[[2.0, 0.01]],
    ...     parts=["squared exponential: 1 / length_scale"],
    ...     feature_names=["temperature", "moisture"],
    ... )
    >>> display.plot()
    <...>
    >>> plt.show()
    """

    def __init__(
        self,
        *,
        relevances: ArrayLike,
        parts: Sequence[str],
        feature_names: Sequence[str],
    ) -> None:
        self.relevances = relevances
        self.parts = parts
        self.feature_names = feature_names

    def plot(self, *, ax: Axes | None = None) -> Self:
        """Draw a row of dots for each feature, on a logarithmic axis.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.

        Returns
        -------
        display : KernelRelevanceDisplay
            The display itself.

        Raises
        ------
        ValueError
            If the relevances do not fit the parts and features, or if none is positive.
        """
        relevances, names = self._checked()
        ax = self._set_axes(ax, figsize=(6.4, min(10.0, 1.6 + 0.22 * len(names))))
        rows = np.arange(len(names))
        self.lines_ = [
            ax.plot(values, rows, ls="", ms=6, label=part, **style(k))[0]
            for k, (part, values) in enumerate(zip(self.parts, relevances, strict=True))
        ]
        ax.set(xscale="log", ylim=(len(names) - 0.5, -0.5), xlabel="relevance")
        ax.set_xlim(_decades(relevances))
        ax.grid(alpha=0.3)
        ax.set_axisbelow(True)
        label_positions(ax.yaxis, names)
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
        return self

    def _checked(self):
        """Relevances that fit the parts, and the names of the features."""
        relevances = check_array(self.relevances, ensure_all_finite="allow-nan")
        names = self.feature_names
        if isinstance(names, str) or not np.iterable(names):
            raise TypeError(
                f"feature_names={names!r} must be a list of {relevances.shape[1]} "
                "names, one for each feature."
            )
        names = [str(name) for name in names]
        if relevances.shape != (len(self.parts), len(names)):
            raise ValueError(
                f"relevances has shape {relevances.shape}, but there are "
                f"{len(self.parts)} parts and {len(names)} feature_names."
            )
        if not (relevances > 0.0).any():
            raise ValueError("No relevance is positive, so there is nothing to draw.")
        return relevances, names

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        *,
        output: int = 0,
        feature_names: Sequence[str] | None = None,
        ax: Axes | None = None,
    ) -> Self:
        """Draw the relevances in the kernel that a model has learned.

        Parameters
        ----------
        estimator : estimator
            Fitted model: MultiTaskGPRegressor, IndependentGP, PooledGP, RankSearchIC,
            or a Pipeline that ends with one.
        output : int, default=0
            Output to draw, if there are several.
        feature_names : sequence of str, default=None
            Names of the features that the kernel uses: those of the model's X without
            the task column. None takes those that the model saw in `fit` or, in a
            Pipeline, those that the earlier steps give, else x0, x1, ...
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.

        Returns
        -------
        display : KernelRelevanceDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the estimator was not fitted.
        TypeError
            If the model has no kernel, or a kernel for each task, or is none of this
            package.
        ValueError
            If there is no such output, if the kernel has no part with relevances, or if
            there are too many or too few names.
        """
        instead = "pass a Gaussian process; of a SingleTaskGP one of its estimators_."
        model = model_with("kernel_", model_of_tasks(estimator), instead)
        n_outputs = len(model.log_marginal_likelihoods_)
        kernels = [model.kernel_] if model._single_output else model.kernel_
        check_output(output, n_outputs)
        names = feature_names
        if names is None:
            names = list(_feature_names(estimator, model))
        n_inputs = model.n_features_in_ - 1 - len(_descriptors(model))
        parts, relevances = _relevances(kernels[output], n_inputs)
        display = cls(relevances=relevances, parts=parts, feature_names=names)
        return display.plot(ax=ax)


def _decades(values):
    """Limits that are powers of ten, with a margin: a small difference stays small."""
    logarithms = np.log10(values[values > 0.0])
    return 10.0 ** np.array(
        [np.floor(logarithms.min()) - 0.1, np.ceil(logarithms.max()) + 0.1]
    )


class Part(NamedTuple):
    """A part of a kernel, and the relevances of the columns that it sees."""

    name: str
    relevances: ArrayLike
    columns: NDArray[np.intp]


def _relevances(kernel, n_features):
    """Names of the parts, and an array of a row for each."""
    parts = list(_of_terms(kernel, np.arange(n_features)))
    if not parts:
        raise ValueError(
            f"{kernel} has no part with relevances: RBF, Matern or ARDLinear."
        )
    found = np.full((len(parts), n_features), np.nan)
    for row, part in zip(found, parts, strict=True):
        row[part.columns] = part.relevances
    return [part.name for part in parts], found


def _of_terms(kernel, columns: NDArray[np.intp]) -> Iterator[Part]:
    """The parts of a kernel, or of the kernels of several terms."""
    if not isinstance(kernel, list):
        yield from _walk(kernel, columns)
        return
    for q, of_term in enumerate(kernel):
        for part in _walk(of_term, columns):
            yield part._replace(name=f"term {q}, {part.name}")


def _walk(kernel: Kernel, columns: NDArray[np.intp]) -> Iterator[Part]:
    """The parts of a kernel of some columns that have relevances."""
    if isinstance(kernel, KernelOperator):
        yield from _walk(kernel.k1, columns)
        yield from _walk(kernel.k2, columns)
    elif isinstance(kernel, Exponentiation):
        yield from _walk(kernel.kernel, columns)
    elif isinstance(kernel, Columns):
        yield from _walk(kernel.kernel, columns[np.asarray(kernel.columns, dtype=int)])
    elif isinstance(kernel, RBF):  # Matern and Spherical are subclasses of it
        found = (name for kind, name in NAMES.items() if isinstance(kernel, kind))
        name = next(found, "squared exponential")
        relevances = 1.0 / np.asarray(kernel.length_scale)
        yield Part(f"{name}: 1 / length_scale", relevances, columns)
    elif isinstance(kernel, ARDLinear):
        yield Part("linear: weight", kernel.weights, columns)


def _feature_names(estimator, model):
    """Names of the kernel's inputs, without the task column and the descriptors."""
    names = getattr(model, "feature_names_in_", None)
    if names is None and isinstance(estimator, Pipeline):
        names = _names_of_steps(estimator)
    if names is None:
        names = [f"x{k}" for k in range(model.n_features_in_)]
    task = locate_task_column(model.task_feature, model.n_features_in_, names)
    names = np.delete(np.asarray(names, dtype=object), task)
    return np.delete(names, _descriptors(model))


def _descriptors(model):
    """Where descriptors of the tasks are among the columns without the task's."""
    descriptors = getattr(model, "_descriptors", None)
    return np.array([], dtype=int) if descriptors is None else descriptors.columns


def _names_of_steps(pipeline):
    """Names of the columns that the last step gets, if the steps before it tell."""
    try:
        return pipeline[:-1].get_feature_names_out()
    except (AttributeError, ValueError):
        return None
