"""Rows whose noise is known, and a fitted model of them by the book."""

from typing import NamedTuple

import numpy as np
import textbook
from samples import Output, outputs, split

RNG = np.random.default_rng(0)
N = 36
TASK = np.arange(N) % 3
X = np.column_stack([RNG.uniform(0, 6, N), TASK])
ALPHA = RNG.uniform(0.01, 0.4, N)
COUNTS = np.where(np.arange(N) % 2, 1.0, 3.0)
SPREAD = np.where(COUNTS > 1.0, 0.1, 0.0)
Y = np.sin(X[:, 0]) * (1 + TASK) + TASK + np.sqrt(ALPHA) * RNG.standard_normal(N)
NEW = np.array([[0.5, 0], [2.5, 1], [5.0, 2], [3.0, 0]])
FIRST, LATER = slice(0, 24), slice(24, N)


class Noise(NamedTuple):
    """What is known of rows: variances, numbers of measurements, their variances."""

    alpha: np.ndarray
    counts: np.ndarray
    spread: np.ndarray


def noise_of(n, alpha=0.0, counts=1.0, spread=0.0):
    """What is known of n rows."""
    return Noise(*(np.broadcast_to(of, n) for of in (alpha, counts, spread)))


def by_the_book(model, X, y, noise, Z=NEW):
    """Likelihood; f at Z, and rows given the others: means and deviations."""
    return told_of(outputs(model)[0], X, y, noise, Z)


def told_of(output: Output, X, y, noise, Z=NEW):
    """The same of one output."""
    (x, tasks), (z, new), of_f = split(X), split(Z), (*output[:2], output.level)
    kernel, K_rho, level = of_f
    learned = textbook.of_rows(output.noise, tasks)
    K = textbook.prior_covariance(kernel, K_rho, x, tasks, level)
    K = K + np.diag((learned + noise.alpha) / noise.counts)
    K_star = textbook.cross_covariance(kernel, K_rho, x, tasks, z, new, level)
    prior = textbook.prior_covariance(kernel, K_rho, z, new, level)
    P, rest = np.linalg.inv(K), y - textbook.of_rows(output.centre, tasks)
    v, n = learned + noise.alpha, noise.counts
    repeats = (n - 1) * np.log(2 * np.pi * v) + np.log(n) + n * noise.spread / v
    return [
        textbook.log_marginal_likelihood(K, rest) - 0.5 * repeats.sum(),
        textbook.of_rows(output.centre, new) + K_star.T @ P @ rest,
        np.sqrt(np.diag(prior - K_star.T @ P @ K_star)),
        y - P @ rest / np.diag(P),
        1.0 / np.sqrt(np.diag(P)),
    ]


def told(model, Z=NEW):
    """The same as a model tells it."""
    value = model.log_marginal_likelihood_value_
    of_f = model.predict(Z, return_std=True)
    return [value, *of_f, *model.loo_predict(include_noise=True)]


def agree(found, expected, digits=8):
    """Whether numbers agree, relative to the largest of each."""
    for a, b in zip(found, expected, strict=True):
        atol = 10.0**-digits * np.abs(b).max()
        np.testing.assert_allclose(a, b, rtol=0.0, atol=atol)
