"""What tests of inference and learning build: the one place that knows how."""

from dataclasses import replace

import numpy as np

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.extended import ExtendedLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.sparse import BLOCK, SparseBound
from skmtgp.learning.problem import Data, Settings


def dense(kernel, form, X, tasks, y, n_noise=1):
    return DenseLikelihood(kernel, form, X, tasks, y, n_noise)


def kronecker(kernel, form, X, tasks, y, n_noise=1):
    return KroneckerLikelihood(kernel, form, X, tasks, y, n_noise)


def extended(kernel, form, X, tasks, y, n_noise, novel):
    return ExtendedLikelihood(kernel, form, X, tasks, y, n_noise, novel)


def sparse(kernel, form, X, tasks, y, Z, n_noise=1, block_size=BLOCK):
    return SparseBound(kernel, form, X, tasks, y, Z, n_noise, block_size)


def parts(likelihood, theta):
    """Of theta, or of a gradient: of k^x, of K^rho, of the noise."""
    return likelihood.split(theta)


def data(X, tasks, y, n_tasks, complete=False):
    return Data(X, tasks, y, n_tasks, complete=complete)


def settings(kernel, scale=1.0, noise=0.1, **changes):
    """With the scale of the targets, and a noise variance in units of its square."""
    variance = scale**2
    found = Settings(
        kernel=kernel,
        scale=scale,
        log_noise=np.log([noise * variance]),
        log_noise_bounds=tuple(np.log([1e-10 * variance, 1e3 * variance])),
        max_iter=200,
        tol=1e-3,
    )
    return replace(found, **changes)
