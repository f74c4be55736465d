"""What hypothesis draws: data of any scale, kernels, models; and what rounding may do.

``MORE_EXAMPLES=10 pytest tests -k properties`` looks ten times as long.
"""

import io
import os
import pickle
from typing import NamedTuple

import building
import hypothesis
import joblib
import numpy as np
import textbook
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    Kernel,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.kernels import ARDLinear, Columns
from skmtgp.model.task_covariance import WithDiagonal, identity, low_rank, ones

WIDE = (1e-40, 1e40)
NOISE = [1e-6, 1e-3, 0.1]
LEVELS = [1e-6, 0.1, 30.0]
FIXED = [IndependentGP, PooledGP, SingleTaskGP]  # K^rho is given
GPS = [MultiTaskGPRegressor, RankSearchIC, *FIXED]
STEP = 1e-3  # of finite differences
DIGITS = 10.0 * np.finfo(float).eps
seeds = st.integers(0, 10_000)


def examples(n):
    """Settings of a test of n examples, the same ones each time."""
    n *= int(os.environ.get("MORE_EXAMPLES", "1"))
    return hypothesis.settings(max_examples=n, deadline=None, derandomize=True)


class Table(NamedTuple):
    """Samples of related tasks, and where they are predicted."""

    F: np.ndarray  # features
    tasks: np.ndarray
    y: np.ndarray
    Z: np.ndarray  # features to predict at
    tasks_of_Z: np.ndarray
    spread: np.ndarray  # scale of each feature
    unit: float  # scale of the targets

    @property
    def X(self):
        return np.column_stack([self.F, self.tasks])

    @property
    def new(self):
        return np.column_stack([self.Z, self.tasks_of_Z])

    def sorted(self):
        """Rows sorted by task, as the engines want them."""
        order = np.argsort(self.tasks, kind="stable")
        return self._replace(F=self.F[order], tasks=self.tasks[order], y=self.y[order])


@st.composite
def tables(draw, per_task=0, max_tasks=8, max_rows=40):
    """1 to 8 tasks, 1 to 40 rows, 1 to 4 features of any scale, some constant.

    Rows and tasks are in no order, inputs may be the same. Each task has `per_task`
    rows or more; of those that have none, none is predicted.
    """
    M, p = draw(st.integers(1, max_tasks)), draw(st.integers(1, 4))
    n = draw(st.integers(max(1, per_task * M), max_rows))
    rng = np.random.default_rng(draw(seeds))
    tasks = np.tile(np.arange(M), per_task)
    tasks = rng.permutation(np.append(tasks, rng.integers(M, size=n - len(tasks))))
    F = rng.normal(size=(n, p))
    if draw(st.booleans()):
        F = F[rng.integers(max(1, n // 2), size=n)]
    Z = np.vstack([F[:2], rng.normal(size=(8, p))])
    if draw(st.booleans()):
        F[:, -1] = F[0, -1]
    slopes, offsets = rng.normal(size=(2, M))
    y = slopes[tasks] * np.sin(F[:, 0]) + offsets[tasks] * F[:, -1]
    y += 0.1 * rng.standard_normal(n)
    spread = 10.0 ** np.array(draw(st.lists(st.floats(-9, 9), min_size=p, max_size=p)))
    unit = 10.0 ** draw(st.floats(-9, 9))
    offset = draw(st.sampled_from([0.0, 30.0]))
    F, Z = (spread * (values + offset) for values in (F, Z))
    return Table(F, tasks, unit * y, Z, rng.choice(tasks, len(Z)), spread, unit)


class OwnRBF(RBF):
    """A user's kernel, which takes the slow path."""


@st.composite
def kernels(draw, spread):
    """A kernel for features of these scales, with hyperparameters of their units."""
    p = len(spread)
    relative = st.lists(st.floats(0.5, 5.0), min_size=p, max_size=p)
    lengths, weights = spread * draw(relative), draw(relative) / spread**2
    rbf = RBF(lengths, WIDE)
    linear = ARDLinear(weights, 0.5, WIDE, WIDE)
    makers = [
        lambda: rbf,
        lambda: OwnRBF(lengths, WIDE),
        lambda: Matern(lengths, WIDE, nu=0.5),
        lambda: ConstantKernel(2.0) * Matern(lengths, WIDE, nu=1.5),
        lambda: Matern(lengths, WIDE, nu=2.5) + WhiteKernel(0.1),
        lambda: Columns(RationalQuadratic(lengths[0], 0.7, WIDE), [0]) + rbf,
        lambda: linear + ConstantKernel(0.5, "fixed") * rbf,
        lambda: linear * rbf,
    ]
    return draw(st.sampled_from(makers))()


def permuted(kernel, order):
    """The kernel of features in another order."""
    params = kernel.get_params()
    new = {
        name: np.asarray(value)[order]
        for name, value in params.items()
        if name.endswith(("length_scale", "weights")) and np.ndim(value)
    }
    new |= {
        name: [order.index(j) for j in value]
        for name, value in params.items()
        if name.endswith("columns")
    }
    return clone(kernel).set_params(**new)


class Model(NamedTuple):
    """A model at given parameters, and its data sorted by task."""

    table: Table
    kernel: Kernel
    form: object  # of K^rho
    theta: np.ndarray
    n_noise: int
    levels: bool = False

    def likelihood(self, rows=slice(None)):
        """Of some of the rows, or of all."""
        data = (a[rows] for a in (self.table.F, self.table.tasks, self.table.y))
        options = {"n_noise": self.n_noise, "levels": self.levels}
        return building.dense(self.kernel, self.form, *data, **options)

    def posterior(self, rows=slice(None)):
        return self.likelihood(rows).posterior(self.theta)

    @property
    def places(self):
        return self.table.Z, self.table.tasks_of_Z

    def prior_variance(self):
        """Of f."""
        Z, tasks = self.places
        posterior = self.posterior(slice(1))
        of_f = posterior.K_rho[tasks, tasks] * posterior.kernel.diag(Z)
        return of_f + posterior.level


@st.composite
def engines(draw, levels=None):
    """Every form of K^rho, shared noise or not, levels or not, on any data."""
    table = draw(tables()).sorted()
    kernel = ConstantKernel(table.unit**2, WIDE) * draw(kernels(table.spread))
    M = int(table.tasks.max()) + 1
    fixed = st.sampled_from([identity(M), ones(M)])
    form = draw(fixed | st.integers(1, M).map(lambda rank: low_rank(M, rank)))
    form = WithDiagonal(form) if draw(st.booleans()) else form
    rng = np.random.default_rng(draw(seeds))
    n_noise = draw(st.sampled_from([1, M]))
    noise = draw(st.sampled_from(NOISE)) * table.unit**2 * (0.5 + rng.random(n_noise))
    rho = rng.standard_normal(form.n_parameters)
    levels = draw(st.booleans()) if levels is None else levels
    level = [draw(st.sampled_from(LEVELS)) * table.unit**2] * levels
    theta = np.concatenate([kernel.theta, rho, np.log(level), np.log(noise)])
    return Model(table, kernel, form, theta, n_noise, levels)


@st.composite
def gps(draw, spread, kinds):
    """Each kind of Gaussian process, not learned, with its options."""
    kind = draw(st.sampled_from(kinds))
    model = MultiTaskGPRegressor() if kind is RankSearchIC else kind()
    model.set_params(
        kernel=draw(st.none() | kernels(spread)),
        noise_variance=draw(st.sampled_from([1e-4, 1e-2, 1.0])),
        max_iter=0,
    )
    either = st.sampled_from(["shared", "per_task"])
    if kind is not SingleTaskGP:
        model.set_params(noise=draw(either), diagonal=draw(st.booleans()))
    if kind in (MultiTaskGPRegressor, RankSearchIC):
        model.set_params(learning=draw(st.sampled_from(["staged", "annealed"])))
    if hasattr(model, "task_levels"):
        model.set_params(normalize_y=draw(either), task_levels=draw(st.booleans()))
    if kind is MultiTaskGPRegressor:
        model.set_params(rank=draw(st.sampled_from([1, None])))
    return RankSearchIC(model, ranks=(1, 2)) if kind is RankSearchIC else model


@st.composite
def linear_models(draw):
    return BayesianLinearRegression(
        pooled=draw(st.booleans()),
        fit_intercept=draw(st.booleans()),
        weight_variance=draw(st.sampled_from([1e-2, 1.0, 1e8])),
        noise_shape=draw(st.sampled_from([1.0, 5.0])),
    )


@st.composite
def problems(draw, per_task=2, kinds=GPS):
    """Data and a model for them that is not fitted."""
    table = draw(tables(per_task))
    return table, draw(gps(table.spread, kinds))


class Rounding(NamedTuple):
    """Errors of the means, covariances and log likelihood that rounding justifies."""

    mean: float
    cov: float
    value: float


def rounding(K, noise, y, prior, shift=0.0):
    """What errors of K and of y + shift by `DIGITS` of their sizes do to a model.

    Solving with K is as if it were another matrix, n eps trace(K) away or less; K is
    the noise or more. `prior` is the variance of f where it is predicted.
    """
    n, noise, prior = len(K), np.min(noise), np.max(prior)
    fit, size = y @ np.linalg.solve(K, y), np.abs(y).max() + abs(shift)
    relative = DIGITS * (n * np.trace(K) / noise + size * np.sqrt(n / noise))
    mean = relative * np.sqrt(prior * (fit + 1.0)) + DIGITS * size
    return Rounding(mean, relative * prior, relative * (fit + n))


def assert_gradient(found, value, at, lost):
    """Finite differences of a value that rounding makes wrong by `lost`.

    Those of two steps tell how wrong they are.
    """
    coarse, fine = (textbook.derivative(value, at, step) for step in (2 * STEP, STEP))
    error = np.abs(found - fine)
    assert (error <= np.abs(coarse - fine) + 2.0 * lost / STEP).all()


def saved_with_joblib(model):
    file = io.BytesIO()
    joblib.dump(model, file)
    file.seek(0)
    return joblib.load(file)


def saved_with_pickle(model):
    return pickle.loads(pickle.dumps(model))


savers = st.sampled_from([saved_with_joblib, saved_with_pickle])


def assert_same_predictions(found, expected, new):
    """To the last bit."""
    (mean, cov), (other, other_cov) = (
        m.predict(new, return_cov=True) for m in (found, expected)
    )
    np.testing.assert_array_equal(mean, other)
    np.testing.assert_array_equal(cov, other_cov)
