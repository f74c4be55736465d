"""Kernels, forms of K^rho and data of the bound, and the bound by the book."""

from typing import NamedTuple

import building
import numpy as np
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Exponentiation,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp.kernels import (
    ARDLinear,
    Columns,
    Spherical,
    geometric_inverse_dynamics_kernel,
    inverse_dynamics_kernel,
)
from skmtgp.model.described import task_covariance
from skmtgp.model.task_covariance import identity, low_rank, ones

M, D = 4, 4
TASKS = (2, 0, 3, 3, 0, 2, 2, 0, 3, 1, 0, 2, 2, 3, 0, 3, 2, 0, 3, 2, 2, 3, 2)
ARD = (0.7, 1.1, 1.9, 0.9)

KERNELS = {
    "paper": inverse_dynamics_kernel(1),
    "geometric": geometric_inverse_dynamics_kernel("P"),
    "rbf": RBF(1.2),
    "fixed": ConstantKernel(1.3, "fixed") * RBF(ARD, "fixed"),
    "matern": ConstantKernel(0.6) * Matern(ARD, nu=1.5) + DotProduct(0.8),
    "spherical": Columns(Spherical((2.7, 2.1)), [0, 2]) + RBF(ARD),
    "columns": Columns(RationalQuadratic(1.2, 0.6), [0, 2]) + RBF(ARD),
    "product": RBF(1.2) * ARDLinear(ARD, 0.4) + ConstantKernel(0.3) * ConstantKernel(2),
    "power": Exponentiation(Columns(RBF((0.8, 1.2)), [1, 1]) + DotProduct(0.8), 2.0),
    "unknown": Columns(ExpSineSquared(1.2, 2.0), [1]) + RBF(ARD),
}
WHITE = {
    "white": RBF(1.2) + WhiteKernel(0.1),
    "unknown, white": Columns(ExpSineSquared(1.2, 2.0), [1]) + WhiteKernel(0.1),
}
FORMS = {
    "identity": identity(M),
    "ones": ones(M),
    "rank 1": low_rank(M, 1),
    "rank 2, diagonal": low_rank(M, 2, diagonal=True),
    "ones, diagonal": ones(M, diagonal=True),
    "full rank": low_rank(M, M),
    "descriptors": task_covariance(M, 2, np.eye(M)[:, ::-1][:, :3] + 0.5, shared=True),
}
EVERY = KERNELS | WHITE


class Sample(NamedTuple):
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray


def draw(seed=0):
    rng, tasks = np.random.default_rng(seed), np.array(TASKS)
    X = rng.standard_normal((len(tasks), D))
    X[-3:] = X[:3]  # tasks that share inputs
    return Sample(X, tasks, np.sin(X.sum(axis=1)) + tasks + rng.standard_normal(len(X)))


def inducing(m=6, seed=1):
    return np.random.default_rng(seed).standard_normal((m, D))


def make(kernel, form, n_noise=1, Z=None, sample=None, block_size=7):
    sample, Z = sample or draw(), inducing() if Z is None else Z
    return building.sparse(kernel, form, *sample, Z, n_noise, block_size)


def dense(kernel, form, n_noise=1, sample=None):
    X, tasks, y = sample or draw()
    order = np.argsort(tasks, kind="stable")
    return building.dense(kernel, form, X[order], tasks[order], y[order], n_noise)


def parameters(kernel, form, n_noise=1, seed=0):
    rng = np.random.default_rng(seed)
    rho = rng.standard_normal(form.n_parameters)
    return np.concatenate([kernel.theta + 0.2, rho, np.log(0.05 + rng.random(n_noise))])


def new_rows():
    rng = np.random.default_rng(5)
    X = rng.standard_normal((9, D))
    X[0], X[1] = draw().X[0], inducing()[0]
    return X, np.array([2, 0, 0, 3, 1, 2, 3, 3, 1])
