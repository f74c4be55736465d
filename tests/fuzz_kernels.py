"""Kernels that the fuzz draws, and those that every fit must refuse."""

import numpy as np
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp.kernels import ARDLinear, Columns


class WrongDiagonal(RBF):
    """A kernel of a user's whose diagonal is not that of its values."""

    def diag(self, X):
        return np.full(len(X), 0.25)


class Parabola(RBF):
    """A function of a user's that is no covariance: 1 - d^2."""

    def __call__(self, X, Y=None, eval_gradient=False):
        X, Z = np.asarray(X), np.asarray(X if Y is None else Y)
        K = 1.0 - np.square((X[:, None] - Z) / self.length_scale).sum(axis=2)
        return (K, 2.0 * (1.0 - K)[:, :, None]) if eval_gradient else K


class NoGradient(RBF):
    """A kernel of a user's whose gradient is not a number."""

    def __call__(self, X, Y=None, eval_gradient=False):
        K = super().__call__(X, Y, eval_gradient)
        return (K[0], K[1] * np.nan) if eval_gradient else K


def wrong_kernels(p):
    """Kernels that every fit must refuse, by the number of features."""
    wrong = [
        WrongDiagonal(),
        ConstantKernel() * WrongDiagonal() + RBF(),
        NoGradient(),
        Matern(nu=50),
        Columns(None, [0]),
        Columns(RBF(), ["x"]),
        RBF(np.nan, "fixed"),
    ]
    return wrong if p == 1 else [*wrong, ExpSineSquared(), ExpSineSquared() + RBF()]


NAMES = ["rbf", "exponential", "matern", "matern52", "periodic", "linear"]


def make_kernel(rng, p):
    kernels = [
        None,
        None,
        NAMES[rng.integers(len(NAMES))],
        RBF(np.ones(p)),
        ConstantKernel() * RBF(),
        ARDLinear(np.ones(p)) + ConstantKernel() * Columns(RBF(), [0]),
        Matern(nu=1.5) + WhiteKernel(),
        RationalQuadratic() * ConstantKernel(2.0, "fixed"),
        DotProduct() + RBF(length_scale_bounds="fixed"),
        Columns(ExpSineSquared(), [0]) * RBF() + RationalQuadratic() ** 2,
        RBF(0.1) + Matern(nu=0.5) + Matern(nu=2.5) * ConstantKernel() + DotProduct(),
    ]
    return kernels[rng.integers(len(kernels))]
