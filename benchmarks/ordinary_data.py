"""The drawn problems of ordinary.py, and Gaussian processes with their true parameters.

Inputs are uniform on [0, 6], functions are draws from squared exponentials with
deviations of 0.5 to 1.5 in the task's unit, length-scales 0.15 to 0.5 of the range
times the square root of the number of inputs that matter. A class says what else holds,
in `CLASSES`; what it leaves open is `BASE`.
"""

from typing import NamedTuple
from zlib import crc32

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

JITTER = 1e-10  # of the covariance of a smooth function, to draw from it
RANGE = 6.0  # of the inputs
N_TEST = 200  # rows to predict, of all tasks

# A pair is a range: of integers, both included; of numbers, drawn as logarithms.
BASE = {
    "n_tasks": (3, 6),
    "rows": (10, 30),  # of each task
    "small": None,  # rows of a third of the tasks, the last ones, instead
    "n_inputs": (1, 2),
    "irrelevant": 0,  # more inputs, on which nothing depends
    "rank": (1, 2),
    "relation": "factor",  # or "none", "one unrelated", "same", "alike"
    "level": 1.0,  # deviation of the levels, in the task's unit
    "units": 1.0,  # of each task
    "noise": 0.1,  # deviation, in the task's unit
    "own_noise": False,
    "noisy": None,  # noise of the last task, instead
    "two_lengths": False,  # the second function is five times as rough
    "apart": False,  # each task sees its own part of the first input
}
RANKS = {"n_tasks": 8, "rows": (10, 20)}
CLASSES = {
    "ordinary": {},
    "two-tasks": {"n_tasks": 2, "rows": (5, 60)},
    "ten-tasks": {"n_tasks": (8, 12), "rows": (5, 20)},
    "many-tasks": {"n_tasks": (25, 40), "rows": (5, 8)},
    "few-rows": {"n_tasks": (4, 8), "rows": (5, 8)},
    "unequal-rows": {"rows": (5, 60)},
    "small-tasks": {"n_tasks": (4, 9), "rows": (15, 30), "small": (1, 3)},
    "no-levels": {"level": 0.0},
    "levels-50": {"level": 50.0},
    "units": {"units": (1.0, 1000.0)},
    "noise-0.001": {"noise": 1e-3},
    "noise-0.01": {"noise": 1e-2},
    "noise-0.3": {"noise": 0.3},
    "noise-1": {"noise": 1.0},
    "own-noise": {"noise": (0.03, 1.0), "own_noise": True},
    "rank-1": {**RANKS, "rank": 1},
    "rank-2": {**RANKS, "rank": 2},
    "rank-3": {**RANKS, "rank": 3},
    "one-noisy": {"n_inputs": 2, "rank": 1, "noisy": (0.5, 1.0)},
    "no-relation": {"relation": "none"},
    "one-unrelated": {"n_tasks": (4, 7), "rank": 1, "relation": "one unrelated"},
    "one-function": {"relation": "same"},
    "irrelevant-inputs": {"irrelevant": (2, 4)},
    "two-length-scales": {"rank": 2, "two_lengths": True},
    "alike": {"n_tasks": (4, 10), "relation": "alike", "noise": (0.1, 0.3)},
    "apart": {"n_inputs": 1, "apart": True},
    "anything": {
        "n_tasks": (2.0, 40.0),
        "rows": (5, 60),
        "n_inputs": (1, 3),
        "irrelevant": (0, 2),
        "rank": (1, 3),
        "level": (0.02, 50.0),
        "noise": (1e-3, 1.0),
    },
    "115-tasks": {"n_tasks": 115, "n_rows": 300},
    "131-tasks": {"n_tasks": 131, "n_rows": 600},
}
OF_EACH = "rows", "small", "noise", "units"  # drawn for each task
HUNDREDS = "115-tasks", "131-tasks"
MOST_ROWS = 400  # of "anything", on average: many tasks have few each


class Truth(NamedTuple):
    """What targets are drawn from: eq. 6 with a kernel of each latent function.

    Attributes
    ----------
    factor : ndarray of shape (n_tasks, n_functions)
        What each task has of each latent function, in units of y.
    length_scales : ndarray of shape (n_functions, n_inputs)
        Infinite where nothing depends on the input.
    level, slope, noise : ndarray of shape (n_tasks,)
        Deviations in units of y: of the level, of the slope by each input, which no
        other task shares, and of the noise.
    """

    factor: np.ndarray
    length_scales: np.ndarray
    level: np.ndarray
    slope: np.ndarray
    noise: np.ndarray

    def covariance(self, X, Z):
        """Of the functions at rows of X and Z, the task in the last column."""
        (x, t), (z, s) = split(X), split(Z)
        K = (t[:, None] == s) * (
            np.outer(self.level[t], self.level[s])
            + np.outer(self.slope[t], self.slope[s]) * (x @ z.T)
        )
        for loading, lengths in zip(self.factor.T, self.length_scales, strict=True):
            squares = cdist(x / lengths, z / lengths, "sqeuclidean")
            K += np.outer(loading[t], loading[s]) * np.exp(-0.5 * squares)
        return K

    def posterior(self, X, y, X_test):
        """Mean and deviation of f at rows of X_test, and the log density of y."""
        K = self.covariance(X, X)
        K[np.diag_indices_from(K)] += np.square(self.noise[split(X)[1]])
        factor, across = cho_factor(K, lower=True), self.covariance(X, X_test)
        alpha, weights = cho_solve(factor, y), cho_solve(factor, across)
        prior = self.variance(X_test)
        variance = prior - np.einsum("ij,ij->j", across, weights)
        value = -0.5 * (y @ alpha + len(y) * np.log(2.0 * np.pi))
        value -= np.log(np.diagonal(factor[0])).sum()
        return across.T @ alpha, np.sqrt(np.maximum(variance, 0.0)), value

    def variance(self, X):
        """Of the functions at rows of X, levels counted."""
        x, t = split(X)
        own = self.level**2 + np.square(self.factor).sum(axis=1)
        return own[t] + np.square(self.slope[t]) * np.square(x).sum(axis=1)

    def size(self, n_inputs):
        """Variance of each task's function, its level not counted."""
        return np.square(self.factor).sum(axis=1) + n_inputs * np.square(self.slope)

    def draw(self, X, rng):
        """Functions at the rows of X."""
        x, t = split(X)
        n_tasks = len(self.level)
        slopes = self.slope[:, None] * rng.standard_normal((n_tasks, x.shape[1]))
        f = (self.level * rng.standard_normal(n_tasks))[t] + (slopes[t] * x).sum(axis=1)
        for loading, lengths in zip(self.factor.T, self.length_scales, strict=True):
            K = np.exp(-0.5 * cdist(x / lengths, x / lengths, "sqeuclidean"))
            # by eigenvectors, for the covariance of close inputs is singular
            values, vectors = np.linalg.eigh(K + JITTER * np.eye(len(x)))
            g = vectors @ (
                np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(x))
            )
            f += loading[t] * g
        return f


class Problem(NamedTuple):
    """Noisy training rows, the functions where they are to be predicted, the truth.

    Attributes
    ----------
    X, y : ndarray of shape (n_samples, n_features), (n_samples,)
        Training rows, with the task in the last column.
    X_test, f_test : ndarray of shape (n_test, n_features), (n_test,)
        Inputs to predict, and the functions there without noise.
    truth : Truth
        The true parameters.
    rank : int
        The true one; 0 where all tasks are one function, but for levels.
    unrelated : int, default=None
        The task that shares nothing with the others, which share something.
    """

    X: np.ndarray
    y: np.ndarray
    X_test: np.ndarray
    f_test: np.ndarray
    truth: Truth
    rank: int
    unrelated: int | None = None


def split(X):
    """Inputs and tasks."""
    return X[:, :-1], X[:, -1].astype(int)


def problem(name, seed):
    """A problem of a class. Other classes do not change it."""
    rng = np.random.default_rng([crc32(name.encode()), seed])
    if name in HUNDREDS:
        return hundreds(rng, **CLASSES[name])
    settings = {
        key: value if key in OF_EACH else _one(value, rng)
        for key, value in {**BASE, **CLASSES[name]}.items()
    }
    if name == "anything":
        settings |= _anything(settings, rng)
    return draw(rng, **settings)


def _anything(settings, rng):
    """What is drawn at random beside the ranges of the class."""
    n_tasks = round(settings["n_tasks"])
    most = max(8, min(60, 2 * MOST_ROWS // n_tasks - 5))
    own = bool(rng.random() < 0.3)
    noise = settings["noise"]
    return {
        "n_tasks": n_tasks,
        "rows": (5, most),
        "rank": min(settings["rank"], n_tasks),
        "relation": rng.choice(["factor"] * 4 + ["none", "one unrelated", "same"]),
        "level": rng.choice([0.0, _one(settings["level"], rng)], p=[0.2, 0.8]),
        "units": (1.0, 1000.0) if rng.random() < 0.3 else 1.0,
        "noise": noise if own else _one(noise, rng),
        "own_noise": own,
        "two_lengths": bool(rng.random() < 0.2),
    }


def _one(value, rng, size=None):
    """A number of a range, or of each of `size`."""
    if not isinstance(value, tuple):
        return value if size is None else np.full(size, value)
    if isinstance(value[0], int):
        drawn = rng.integers(*value, size, endpoint=True)
        return int(drawn) if size is None else drawn
    return np.exp(rng.uniform(*np.log(value), size))


def draw(rng, *, n_tasks, rows, small, n_inputs, irrelevant, apart, noise, **settings):
    """A problem with the settings of `BASE`."""
    d = n_inputs + irrelevant
    rows = _one(rows, rng, n_tasks)
    if small is not None:
        rows[-(n_tasks // 3) :] = _one(small, rng, n_tasks // 3)
    task = np.repeat(np.arange(n_tasks), rows)
    test = np.repeat(np.arange(n_tasks), max(3, N_TEST // n_tasks))
    x = rng.uniform(0.0, RANGE, (len(task), d))
    if apart:  # a part of the range for each, in any order
        x[:, 0] = (x[:, 0] + RANGE * rng.permutation(n_tasks)[task]) / n_tasks
    X = np.column_stack([x, task])
    X_test = np.column_stack([rng.uniform(0.0, RANGE, (len(test), d)), test])
    unit = _one(settings["units"], rng, n_tasks)
    own = settings["own_noise"]
    noise = _one(noise, rng, n_tasks if own else None) * unit
    if settings["noisy"] is not None:
        noise[-1] = settings["noisy"] * unit[-1]
    factor = _factor(rng, n_tasks, settings["rank"], settings["relation"])
    truth = Truth(
        unit[:, None] * factor,
        _length_scales(rng, factor, n_inputs, irrelevant, settings["two_lengths"]),
        settings["level"] * unit,
        np.zeros(n_tasks),
        noise,
    )
    same = settings["relation"] == "same"
    alone = n_tasks - 1 if settings["relation"] == "one unrelated" else None
    rank = 0 if same else min(factor.shape[1], n_tasks)
    return _observed(rng, truth, X, X_test, rank, alone)


def _factor(rng, n_tasks, rank, relation):
    """Rows of lengths 0.5 to 1.5 in random directions."""
    if relation == "same":
        return np.ones((n_tasks, 1))
    if relation == "alike":  # a function, with amplitudes around one
        return 1.0 + 0.4 * rng.standard_normal((n_tasks, 1))
    size = rng.uniform(0.5, 1.5, n_tasks)[:, None]
    if relation == "none":
        return np.diag(size[:, 0])
    factor = rng.standard_normal((n_tasks, rank))
    factor *= size / np.linalg.norm(factor, axis=1, keepdims=True)
    if relation == "one unrelated":
        factor = np.column_stack([factor, np.zeros(n_tasks)])
        factor[-1] = np.append(np.zeros(rank), size[-1])
    return factor


def _length_scales(rng, factor, n_inputs, irrelevant, two_lengths):
    """The same of all functions, or the first five times as smooth as the others."""
    lengths = RANGE * np.sqrt(n_inputs) * _one((0.15, 0.5), rng, n_inputs)
    lengths = np.append(lengths, np.full(irrelevant, np.inf))
    lengths = np.tile(lengths, (factor.shape[1], 1))
    if two_lengths:
        lengths[:1] *= np.sqrt(5.0)
        lengths[1:] /= np.sqrt(5.0)
    return lengths


def hundreds(rng, *, n_tasks, n_rows):
    """Very many tasks: levels, slopes and one function that all share, much noise.

    Free: four inputs are normal, of variances one is 0.64 noise, 0.2 the function, 0.08
    levels and 0.08 slopes. Each task has a row, the others fall to any.
    """
    more = rng.integers(0, n_tasks, n_rows - n_tasks)
    task = np.sort(np.append(np.arange(n_tasks), more))
    test = np.repeat(np.arange(n_tasks), 5)
    X = np.column_stack([rng.standard_normal((n_rows, 4)), task])
    X_test = np.column_stack([rng.standard_normal((len(test), 4)), test])
    each = np.ones(n_tasks)
    truth = Truth(
        np.sqrt(0.2) * each[:, None],
        np.full((1, 4), 3.0),
        np.sqrt(0.08) * each,
        np.sqrt(0.02) * each,
        0.8 * each,
    )
    return _observed(rng, truth, X, X_test, None, None)


def _observed(rng, truth, X, X_test, rank, unrelated):
    """The problem with functions and noise drawn."""
    f, n = truth.draw(np.vstack([X, X_test]), rng), len(X)
    y = f[:n] + truth.noise[split(X)[1]] * rng.standard_normal(n)
    return Problem(X, y, X_test, f[n:], truth, rank, unrelated)
