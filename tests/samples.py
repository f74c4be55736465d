"""Small data of related tasks, and the fitted model written out by hand."""

from typing import NamedTuple

import numpy as np
import textbook
from sklearn.gaussian_process.kernels import Kernel


def draw(per_task=10, n_tasks=3, n_outputs=None, seed=0):
    """X with two features and the task last, in no order, and y of some unit."""
    rng = np.random.default_rng(seed)
    tasks = rng.permutation(np.repeat(np.arange(n_tasks), per_task))
    x = rng.uniform(-2.0, 2.0, (len(tasks), 2))
    basis = np.column_stack([np.sin(1.5 * x[:, 0]), x[:, 1], np.cos(x).prod(axis=1)])
    weights = rng.normal(size=(n_outputs or 1, n_tasks, 3))
    y = np.einsum("nb,jnb->nj", basis, weights[:, tasks])
    y += 0.1 * rng.standard_normal(y.shape)
    y = 5.0 + 20.0 * y * np.arange(1, y.shape[1] + 1)
    return np.column_stack([x, tasks]), y if n_outputs else y[:, 0]


def split(X):
    """Features and tasks."""
    return X[:, :-1], X[:, -1].astype(int)


class Output(NamedTuple):
    """What a model has learned for an output, in units of y.

    The noise, the mean and the variance of the levels are one number, or one for each
    task.
    """

    kernel: Kernel
    K_rho: np.ndarray
    noise: np.ndarray
    centre: np.ndarray
    level: np.ndarray

    def covariance(self, x, tasks):
        """Of the targets."""
        model = self.kernel, self.K_rho, self.noise
        return textbook.covariance(*model, x, tasks, self.level)

    def log_density(self, x, tasks, y):
        rest = y - textbook.of_rows(self.centre, tasks)
        return textbook.log_marginal_likelihood(self.covariance(x, tasks), rest)

    def posterior(self, x, tasks, y, Z, tasks_of_Z):
        """Mean and covariance of f(Z)."""
        rest = y - textbook.of_rows(self.centre, tasks)
        model, given = self[:3], (x, tasks, rest)
        mean, cov = textbook.posterior(*model, *given, Z, tasks_of_Z, self.level)
        return mean + textbook.of_rows(self.centre, tasks_of_Z), cov


LEARNED = "kernel_", "task_covariance_", "noise_variance_", "y_mean_", "level_variance_"


def outputs(model):
    """What it has learned for each output."""
    learned = [getattr(model, name) for name in LEARNED]
    several = isinstance(model.kernel_, list)
    return [
        Output(*of) for of in (zip(*learned, strict=True) if several else [learned])
    ]


def log_densities(model, X, y):
    """log p(y) of each output."""
    return [
        output.log_density(*split(X), t)
        for output, t in zip(outputs(model), y.reshape(len(y), -1).T, strict=True)
    ]


def posteriors(model, X, y, Z):
    """Mean and covariance of f(Z) of each output."""
    return [
        output.posterior(*split(X), t, *split(Z))
        for output, t in zip(outputs(model), y.reshape(len(y), -1).T, strict=True)
    ]


class Listener:
    """Keeps what learning tells of its progress."""

    def __init__(self):
        self.stages, self.lines = [], []

    def __call__(self, stage, n_jobs, describe):
        self.stages.append((stage, n_jobs))
        return lambda i, result: self.lines.append(describe(i, result))
