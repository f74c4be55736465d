"""Nuggets, sills and practical ranges of a fitted model, as a table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import brentq
from sklearn.base import BaseEstimator
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    Exponentiation,
    ExpSineSquared,
    Kernel,
    Matern,
    Product,
    RationalQuadratic,
    Sum,
    WhiteKernel,
)

from skmtgp.inspection._kernel_relevance import _feature_names
from skmtgp.inspection._models import check_output, model_of_tasks
from skmtgp.kernels import Columns, Spherical
from skmtgp.single_task import SingleTaskGP

REACHED = 0.95  # of the sill: there a variogram that never ends has its range
ZERO = 1e-9  # of the variance: slow kernels have so much left far away
NAMES = {  # subclasses before their bases
    Spherical: "spherical",
    Matern: "Matern",
    RBF: "Gaussian",
    RationalQuadratic: "rational quadratic",
    ExpSineSquared: "periodic",
}
# Distances at which a kernel is looked at, in spreads of the places; and far from all,
# with ratios that are no multiples of any period.
DISTANCES = np.concatenate([[0.0], np.geomspace(1e-9, 1e9, 18 * 64 + 1)])
FAR = 1e100 * np.array([1.0, np.sqrt(2.0), np.e, np.pi])


def variogram_table(estimator: BaseEstimator, *, output: int = 0) -> pd.DataFrame:
    r"""Nugget, sills and ranges of each task and pair of tasks.

    Parameters
    ----------
    estimator : estimator
        Fitted MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP or
        WideRegressor, or a Pipeline or search that ends with one.
    output : int, default=0
        Which of several outputs.

    Returns
    -------
    table : DataFrame
        Its index has two levels, "task" and "other": a task with itself or, for the
        cross-variogram, one before it. Of a SingleTaskGP there are no pairs. Each has a
        row for the nugget and one for each structure, in the order of the kernels. The
        columns are

        - structure: "nugget", or the kind of kernel;
        - sill: that of this structure alone, in squared units of y. In a
          cross-variogram it may be negative;
        - range_east, range_north, ...: the practical range along each feature, in its
          unit. It is the distance at which the structure reaches 95 % of its sill. If
          the covariance ends, as the spherical one does, it is where it ends. It is
          infinite for a feature along which the structure does not come so far.

        Sill and ranges are NaN for kernels without a sill: those that are not
        stationary, and periodic ones.

    Raises
    ------
    NotFittedError
        If the estimator was not fitted.
    TypeError
        If the model is no Gaussian process.
    ValueError
        If there is no such output.

    See Also
    --------
    VariogramDisplay : The variograms that have these sills and ranges.

    Notes
    -----
    The variogram of tasks a and b is

    .. math:: \gamma_{ab}(h) = [a = b, h > 0]\, \sigma_a^2
        + \sum_q K^\rho_{q, ab}\, (k_q(0) - k_q(h))

    Structure q has the sill :math:`K^\rho_{q, ab} (k_q(0) - k_q(\infty))`. A kernel
    that is a sum counts as several structures with the same :math:`K^\rho`. A
    WhiteKernel in it is part of the nugget. With a `target_transform` all is of the
    transformed targets. Levels, a trend and noise that is known are no part of it.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.gaussian_process.kernels import Matern
    >>> from skmtgp import MultiTaskGPRegressor, stack_tasks
    >>> from skmtgp.datasets import make_soil
    >>> from skmtgp.inspection import variogram_table
    >>> soil = make_soil(random_state=2).drop(columns="nickel")
    >>> X, y = stack_tasks(soil, ["cadmium", "zinc"])
    >>> logs = {"target_transform": (np.log, np.exp)}
    >>> model = MultiTaskGPRegressor(Matern(nu=0.5), rank=1, **logs).fit(X, y)
    >>> table = variogram_table(model)
    >>> table.columns.tolist()
    ['structure', 'sill', 'range_east', 'range_north']
    >>> table.loc[("zinc", "cadmium"), "structure"].tolist()
    ['nugget', 'exponential']
    >>> ratio = table["range_east"].iloc[1] / model.kernel_.length_scale
    >>> print(f"{ratio:.3f}, {np.log(20.0):.3f}")
    2.996, 2.996
    """
    model = model_of_tasks(estimator)
    names = [f"range_{name}" for name in _feature_names(estimator, model)]
    if isinstance(model, SingleTaskGP):
        check_output(output, model._n_outputs)
        alone = zip(model.tasks_.tolist(), model.estimators_, strict=True)
        rows = [row for task, of in alone for row in _rows(of, [task], output, names)]
    elif hasattr(model, "task_covariance_"):
        check_output(output, len(model._likelihoods))
        rows = _rows(model, model.tasks_.tolist(), output, names)
    else:
        raise TypeError(
            f"{type(model).__name__} has no variogram: pass a Gaussian process."
        )
    return pd.DataFrame(rows).set_index(["task", "other"])


def _rows(model, tasks, output, names):
    """What the table has of one model, whose tasks are called so."""
    prior = model._likelihoods[output].prior
    theta = model._thetas()[output]
    scale = np.broadcast_to(model._units.scale[output], len(tasks))
    noise = np.broadcast_to(prior.values(theta).noise, len(tasks)) * scale**2
    spreads = _spreads(model, len(names))
    terms = [
        ([_Structure.of(part, spreads) for part in _parts(kernel)], K_rho)
        for kernel, K_rho in prior.terms_at(theta)
    ]
    for a, b in zip(*np.tril_indices(len(tasks)), strict=True):
        pair = {"task": tasks[a], "other": tasks[b]}
        sills = [(of, K[a, b] * scale[a] * scale[b]) for ofs, K in terms for of in ofs]
        own = sum(K_ab * of.jump for of, K_ab in sills) if a == b else 0.0
        nugget = noise[a] + own if a == b else 0.0
        none = dict.fromkeys(names, 0.0)
        yield {**pair, "structure": "nugget", "sill": nugget, **none}
        for of, K_ab in sills:
            if of.name:
                sill = {"structure": of.name, "sill": K_ab * of.sill}
                yield {**pair, **sill, **dict(zip(names, of.ranges, strict=True))}


def _spreads(model, n_features):
    """How far apart places are along each feature; 1 where that is not known."""
    if not hasattr(model, "X_train_"):
        return np.ones(n_features)
    spreads = np.ptp(model.X_train_, axis=0)
    return np.where(spreads > 0.0, spreads, 1.0)


def _parts(kernel: Kernel):
    """The summands of a kernel."""
    if isinstance(kernel, Sum):
        return [*_parts(kernel.k1), *_parts(kernel.k2)]
    return [kernel]


class _Structure(NamedTuple):
    """A part of k^x, as a variogram shows it.

    Attributes
    ----------
    name : str
        Its kind; empty if it has no other part than a jump at zero.
    jump : float
        How far the variogram jumps at the distance zero.
    sill : float
        What it gains beyond.
    ranges : ndarray of shape (n_features,)
        Along each feature.
    """

    name: str
    jump: float
    sill: float
    ranges: np.ndarray

    @classmethod
    def of(cls, kernel, spreads):
        """That of a kernel, whose inputs have such spreads."""
        name, nothing = _name(kernel), np.full(len(spreads), np.nan)
        if not kernel.is_stationary():
            return cls(name, 0.0, np.nan, nothing)
        at = _Profile(kernel, len(spreads))
        here, far = at(np.zeros(1), spreads)[0], at(FAR, spreads)
        jump = float(kernel.diag(np.zeros((1, len(spreads))))[0] - here)
        sill = float(here - far[0])
        if np.ptp(far) > ZERO * abs(here):
            return cls(name, jump, np.nan, nothing)
        if sill <= ZERO * abs(here):  # a constant, or white noise
            return cls("", jump, 0.0, nothing)
        left = [
            lambda h, along=along: (at(h, along) - far[0]) / sill
            for along in np.diag(spreads)
        ]
        return cls(name, jump, sill, np.array([_range(f) for f in left]) * spreads)


class _Profile(NamedTuple):
    """A stationary kernel as a function of the distance."""

    kernel: Kernel
    n_features: int

    def __call__(self, h, along):
        """Its values at the distances h, in multiples of a vector."""
        origin = np.zeros((1, self.n_features))
        return self.kernel(origin, np.multiply.outer(h, along))[0]


def _range(left):
    """Where a variogram has its range, from the share of the sill that is left."""
    below = left(DISTANCES) <= 1.0 - REACHED
    if not below.any():
        return np.inf
    k = int(below.argmax())
    low, high = DISTANCES[k - 1], DISTANCES[k]
    reached = brentq(
        lambda h: left(np.array([h]))[0] - (1.0 - REACHED), low, high, rtol=1e-12
    )
    return _end(left, reached)


def _end(left, reached):
    """Where the covariance ends, if it does, soon after it has nearly vanished."""
    low, high = reached, 3.0 * reached  # there others still have a millionth and more
    if left(np.array([high]))[0] != 0.0:
        return reached
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        ended = left(np.array([middle]))[0] <= 0.0
        low, high = (low, middle) if ended else (middle, high)
    return high


def _name(kernel):
    """The kind of a part of a kernel, as geostatisticians call it."""
    if isinstance(kernel, Columns):
        return _name(kernel.kernel)
    if isinstance(kernel, Product):
        return " x ".join(filter(None, map(_name, (kernel.k1, kernel.k2))))
    if isinstance(kernel, (ConstantKernel, WhiteKernel)):
        return ""
    if isinstance(kernel, Exponentiation):
        return f"{_name(kernel.kernel)} ** {kernel.exponent:g}"
    if isinstance(kernel, Matern):
        return "exponential" if kernel.nu == 0.5 else f"Matern {kernel.nu:g}"
    found = (name for kind, name in NAMES.items() if isinstance(kernel, kind))
    return next(found, type(kernel).__name__)
