"""Kernels, forms of K^rho and data of every engine without inducing inputs."""

from typing import NamedTuple

import numpy as np
import pytest
import textbook
from pairs import in_pairs
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp.kernels import (
    ARDLinear,
    Columns,
    geometric_inverse_dynamics_kernel,
    inverse_dynamics_kernel,
)
from skmtgp.model.described import task_covariance
from skmtgp.model.task_covariance import identity, low_rank, ones

M, D = 4, 4
COUNTS = (6, 1, 9, 7)  # rows of each task
ARD = (0.7, 1.1, 1.9, 0.9)


class OwnRBF(RBF):
    """A user's kernel, which takes the slow path."""


KERNELS = {
    "paper": inverse_dynamics_kernel(1),
    "geometric": geometric_inverse_dynamics_kernel("P"),
    "rbf": RBF(1.2),
    "fixed": ConstantKernel(1.3, "fixed") * RBF(ARD, "fixed"),
    "matern": ConstantKernel(0.6) * Matern(ARD, nu=1.5) + DotProduct(0.8),
    "columns": Columns(RationalQuadratic(1.2, 0.6), [0, 2]) + WhiteKernel(0.1),
    "unknown": Columns(ExpSineSquared(1.2, 2.0), [1]) + ARDLinear(ARD, 0.4),
    "user's": ConstantKernel(0.6) * OwnRBF(ARD),
}
FORMS = {
    "identity": identity(M),
    "ones": ones(M),
    "rank 1": low_rank(M, 1),
    "rank 2, diagonal": low_rank(M, 2, diagonal=True),
    "full rank": low_rank(M, M),
    "descriptors": task_covariance(M, 2, np.eye(M)[:, ::-1][:, :3] + 0.5, shared=True),
}
every_kernel = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS.keys())
every_noise = pytest.mark.parametrize("n_noise", [1, M], ids=["shared", "per task"])
MODELS = {"kernel": KERNELS, "form": FORMS, "n_noise": {"shared": 1, "per task": M}}
every_model = in_pairs(**MODELS)
every_model_and_tile = in_pairs(
    "tile", **MODELS, tile={"small tiles": 7, "one tile": 288}
)


class Sample(NamedTuple):
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray


def draw(seed=0, counts=COUNTS):
    rng = np.random.default_rng(seed)
    tasks = np.repeat(np.arange(len(counts)), counts)
    X = rng.standard_normal((len(tasks), D))
    X[-3:] = X[:3]  # tasks that share inputs
    return Sample(X, tasks, np.sin(X.sum(axis=1)) + tasks + rng.standard_normal(len(X)))


def parameters(kernel, form, n_noise=1, seed=0):
    rng = np.random.default_rng(seed)
    rho = rng.standard_normal(form.n_parameters)
    return np.concatenate([kernel.theta + 0.2, rho, np.log(0.05 + rng.random(n_noise))])


def parts(likelihood, theta):
    """What theta stands for: the kernel, K^rho and the noise variances."""
    n_kernel = likelihood.prior.kernel.n_dims
    n_rho = likelihood.prior.task_covariance.n_parameters
    kernel = likelihood.prior.kernel.clone_with_theta(theta[:n_kernel])
    K_rho = likelihood.prior.task_covariance.matrix(theta[n_kernel : n_kernel + n_rho])
    return kernel, K_rho, np.exp(theta[n_kernel + n_rho :])


def textbook_covariance(likelihood, theta):
    return textbook.covariance(*parts(likelihood, theta), *draw()[:2])


def textbook_value(likelihood, theta):
    K = textbook_covariance(likelihood, theta)
    return textbook.log_marginal_likelihood(K, likelihood.y)


def new_rows():
    rng = np.random.default_rng(5)
    Z = rng.standard_normal((8, D))
    Z[0] = draw().X[0]
    return Z, np.array([2, 0, 0, 3, 1, 2, 3, 3])
