"""Predictions of a fitted model by the book, for the fuzz."""

from typing import NamedTuple

import numpy as np
import textbook

from skmtgp._data.checks import check_test
from skmtgp.inference.leeway import OfAll, OfTheta, times_of


class Expected(NamedTuple):
    """Predictions by the book, and sizes to compare errors with.

    Attributes
    ----------
    mean, variance : ndarray of shape (n_new,)
        At given hyperparameters.
    size, prior : float
        Of means and of variances.
    wide : ndarray of shape (n_new,)
        Whether the variance is larger by what is open of the hyperparameters.
    """

    mean: np.ndarray
    variance: np.ndarray
    size: float
    prior: float
    wide: np.ndarray


class Book(NamedTuple):
    """What a model has learned of one output, in units of y, and its rows.

    Attributes
    ----------
    kernels, K_rhos : lists
        Those of the terms.
    noise : ndarray of shape (n_samples,)
        Its variance at each row, with what is known.
    centre, level : float or ndarray of shape (n_tasks,)
        As `y_mean_` and `level_variance_`.
    columns : callable
        Columns of the trend at features and tasks, or of no trend.
    X, tasks, y : ndarrays
        The rows.
    """

    kernels: list
    K_rhos: list
    noise: np.ndarray
    centre: np.ndarray
    level: np.ndarray
    columns: object
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray

    def cross(self, X, tasks, Z, of_Z):
        """cov(f(X), f(Z)) without the trend."""
        levels = textbook.of_rows(self.level, tasks)[:, None]
        parts = [
            textbook.cross_covariance(kernel, K, X, tasks, Z, of_Z)
            for kernel, K in zip(self.kernels, self.K_rhos, strict=True)
        ]
        return sum(parts) + levels * np.equal.outer(tasks, of_Z)

    def of_f(self, X, tasks):
        """cov(f(X)) without the trend, with what a WhiteKernel adds."""
        parts = [
            textbook.prior_covariance(kernel, K, X, tasks)
            for kernel, K in zip(self.kernels, self.K_rhos, strict=True)
        ]
        levels = textbook.of_rows(self.level, tasks)[:, None]
        return sum(parts) + levels * np.equal.outer(tasks, tasks)


def by_the_book(model, problem, j, new):
    """Means and variances of output j at new rows; None where rounding would count."""
    book, (Z, of_Z) = read_book(model, problem, j), _rows(model, new)
    X, H, of_new = book.X, book.columns(book.X, book.tasks), book.columns(Z, of_Z)
    if all(kernel.is_stationary() for kernel in book.kernels):
        X, Z = X - X[0], Z - X[0]  # scikit-learn divides before it takes differences
    K = book.of_f(X, book.tasks) + np.diag(book.noise)
    size = np.abs(H).max(axis=0, initial=np.finfo(float).tiny)
    H, of_new = H / size, of_new / size
    if not np.isfinite(K).all() or not np.linalg.cond(K) < 1e8:
        return None
    if H.size and not np.linalg.cond(H.T @ np.linalg.solve(K, H)) < 1e6:
        return None
    rest = book.y - textbook.of_rows(book.centre, book.tasks)
    given = book.cross(X, book.tasks, Z, of_Z), of_new, book.of_f(Z, of_Z)
    mean, covariance, beta, _ = textbook.universal_kriging(K, H, rest, *given)
    mean = mean + textbook.of_rows(book.centre, of_Z)
    far = np.abs(of_new @ beta).max(initial=0.0) + np.abs(H @ beta).max(initial=0.0)
    sizes = np.abs(rest).max(), np.abs(book.centre).max(), far, np.finfo(float).tiny
    diagonal = np.diagonal(covariance)
    prior = max(np.diagonal(K).max(), np.diagonal(given[-1]).max(), diagonal.max())
    diagonal = diagonal * times_of(model._leeway[j])
    return Expected(mean, diagonal, sum(sizes), prior, _wide(model._leeway[j], of_Z))


def _wide(leeway, tasks):
    """Rows whose variances count what is open of theta, or of a row of F."""
    wide = np.zeros(len(tasks), dtype=bool)
    for of in leeway:
        if not isinstance(of, OfAll):
            wide |= isinstance(of, OfTheta) or tasks == of.task
    return wide


def _rows(model, new):
    """Inputs of the kernel, and tasks."""
    features, tasks = check_test(model, new)
    described = model._descriptors
    return (features if described is None else described.inputs(features)), tasks


def read_book(model, problem, j):
    """The book of an output."""
    learned = {
        name: getattr(model, name)
        for name in ("kernel_", "task_covariance_", "noise_variance_", "y_mean_")
    }
    several = model.y_train_.ndim == 2
    of_output = {n: of[j] if several else of for n, of in learned.items()}
    level = model.level_variance_[j] if several else model.level_variance_
    kernels, K = of_output["kernel_"], of_output["task_covariance_"]
    terms = (kernels, list(K)) if isinstance(kernels, list) else ([kernels], [K])
    tasks, known = model.tasks_train_, model._known
    noise = textbook.of_rows(of_output["noise_variance_"], tasks)
    if known is not None:
        noise = (noise + known.variance[:, j]) / known.counts
    rows = model.X_train_, tasks, model.y_train_.reshape(len(tasks), -1)[:, j]
    centre = of_output["y_mean_"]
    return Book(*terms, noise, centre, level, _columns(model, problem), *rows)


def _columns(model, problem):
    """What gives the columns of the trend; none without."""
    if getattr(model, "trend", None) is None:
        return lambda X, tasks: np.empty((len(X), 0))
    means, n_tasks = np.atleast_2d(model.trend_mean_), len(model.tasks_)

    def columns(X, tasks):
        H = problem.trend(X) - means[tasks if len(means) > 1 else 0]
        if not getattr(model, "trend_per_task", False):
            return H
        own = np.equal.outer(tasks, np.arange(n_tasks))
        return (own[:, :, None] * H[:, None, :]).reshape(len(X), -1)

    return columns
