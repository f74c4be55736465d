"""Models with a trend, for the tests of dense and of sparse inference."""

from functools import partial

import building
import numpy as np
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

from skmtgp.model.several import Forms, Kernels
from skmtgp.model.task_covariance import low_rank
from skmtgp.model.trend import Trend

M, D = 3, 2
NEW = np.array([[0.3, -0.4], [1.1, 0.6], [-4.0, 0.9], [0.3, -0.4]])
OF_NEW = np.array([0, 2, 1, 1])
ONE = np.ones(1)
TERMS = {
    "one": [(ConstantKernel(0.5) * RBF([0.9, 1.3]), low_rank(M, 2))],
    "diagonal": [(Matern([0.5, 0.8], nu=2.5), low_rank(M, 1, diagonal=True))],
    "two": [
        (RBF([2.0, 3.0]), low_rank(M, 1, shared=True)),
        (Matern(0.4, nu=1.5), low_rank(M, 1)),
    ],
    "two diagonals": [
        (RBF([2.0, 3.0]), low_rank(M, 1, diagonal=True)),
        (Matern(0.4, nu=1.5), low_rank(M, 1, diagonal=True)),
    ],
}


def draw(seed=0, n=24):
    rng = np.random.default_rng(seed)
    tasks = np.sort(np.r_[np.repeat(range(M), 4), rng.integers(0, M, n - 4 * M)])
    return rng.standard_normal((n, D)), tasks, rng.standard_normal(n)


def columns(X):
    return np.column_stack([X[:, 0], X[:, 1] ** 2])


def make_trend(per_task=False, units=ONE, of=columns, slopes=0.0):
    n_trend = of(np.zeros((1, D))).shape[1]
    slopes = np.full((M if per_task else 1, n_trend), slopes)
    centre = 0.3 + np.arange(n_trend)[None] * np.ones((len(units), 1))
    return Trend(of, M, per_task, centre, units, slopes)


def by_hand(trend, X, tasks):
    """The columns, one row after another."""
    units, centre = trend.scale, trend.centre
    rows = []
    for x, m in zip(X, tasks, strict=True):
        h = (trend.columns(x[None])[0] - centre[m % len(centre)]) / units[
            m % len(units)
        ]
        row = np.zeros((M, len(h)))
        row[m] = h
        rows.append(row.ravel() if trend.per_task else h)
    return np.array(rows)


def make(terms, n_noise=1, levels=True, trend=None, seed=0, rows=None, Z=None):
    """A likelihood, with inducing inputs Z the bound, and parameters."""
    kernels, forms = zip(*terms, strict=True)
    several = len(terms) > 1
    build = building.dense if Z is None else partial(building.sparse, block_size=7)
    likelihood = build(
        Kernels(kernels) if several else kernels[0],
        Forms(forms) if several else forms[0],
        *(rows or draw()),
        *([] if Z is None else [Z]),
        n_noise=n_noise,
        levels=levels,
        trend=trend,
    )
    theta = likelihood.prior.theta()
    return likelihood, theta + 0.2 * np.random.default_rng(seed).standard_normal(
        len(theta)
    )
