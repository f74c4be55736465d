"""Kernels and bounds that are not to be used: errors say what to do."""

import numpy as np
import pytest
from hard_data import X, Y, assert_sound, each_gp, fitted
from sklearn.gaussian_process.kernels import (
    RBF,
    CompoundKernel,
    ConstantKernel,
    ExpSineSquared,
    Matern,
    WhiteKernel,
)

from skmtgp import PooledGP
from skmtgp.kernels import ARDLinear, Columns

pytestmark = pytest.mark.usefixtures("nothing_is_printed")

HYPERPARAMETERS = "must be positive and lie between its bounds"
BAD_KERNELS = {
    "reversed bounds": (RBF(1.0, (10.0, 0.1)), rf"length_scale=1.0 {HYPERPARAMETERS}"),
    "outside": (RBF(1.0, (10.0, 100.0)), rf"{HYPERPARAMETERS}, \[\[10.0, 100.0\]\]"),
    "negative": (RBF(-1.0), HYPERPARAMETERS),
    "zero": (RBF(0.0), HYPERPARAMETERS),
    "NaN": (2.0 * RBF(np.nan), r"kernel's k2__length_scale=nan must be positive"),
    "infinite": (RBF(np.inf), HYPERPARAMETERS),
    "text": (RBF("a"), HYPERPARAMETERS),
    "negative bound": (RBF(1.0, (-1.0, 1.0)), HYPERPARAMETERS),
    "bounds of text": (RBF(1.0, "fix"), "must be positive and ascending, or 'fixed'"),
    "one of several": (ARDLinear([1.0, -1.0]), r"kernel's weights=\[1.0, -1.0\] must"),
    "fixed NaN": (
        2.0 * RBF([1.0, np.nan], "fixed"),
        r"kernel's k2__length_scale=\[1.0, nan\] must be a number",
    ),
    "fixed text": (RBF("a", "fixed"), "kernel's length_scale='a' must be"),
    "fixed infinity": (
        ConstantKernel(np.inf, "fixed") * RBF(),
        r"is inf between \[.*\] and \[.*\], which are rows of X; a covariance is fin",
    ),
    "fixed below zero": (
        WhiteKernel(-1.0, "fixed") + RBF(),
        "is not positive semi-definite, as a covariance is: the smallest eigenvalue",
    ),
    "no kernel": (
        RBF() + Columns(None, [0]),
        "has 2 features beside the task column: Columns needs a kernel, but got None",
    ),
    **{
        f"columns {columns}": (
            Columns(RBF(), columns),
            r"columns=.* must be a list of indices \(int\) of features, the task",
        )
        for columns in ([], 0, "x", [0.0], [True, False], [0, True], [[0]])
    },
    "columns by name": (Columns(RBF(), ["x"]), "'x' names a column, but X has no col"),
    "columns that are not there": (
        Columns(RBF(), [0, -3]),
        r"columns=\[0, -3\] name column -3, but X has 2 features",
    ),
    **{
        f"nu {nu}": (
            2.0 * Columns(Matern(nu=nu), [0]),
            r"nu must be 0\.5, 1\.5, 2\.5, inf, or from 0\.3 to 15",
        )
        for nu in (50, 15.1, 0.29, 0.0, -1.5, np.nan, "a", None)
    },
    "several kernels": (
        CompoundKernel([RBF(), RBF()]),
        r"CompoundKernel gives an array of shape \(\d+, \d+, 2\)",
    ),
}


@pytest.mark.parametrize(("kernel", "match"), BAD_KERNELS.values(), ids=BAD_KERNELS)
@each_gp
def test_bad_kernels(model, kernel, match):
    with pytest.raises(ValueError, match=match):
        fitted(model, X, Y, kernel=kernel)


def test_learned_kernel_at_its_bound_starts_another_fit():
    kernel = ConstantKernel(0.3, (0.1, 1.0)) * RBF(1.0, (0.7, 1.3))
    first = PooledGP(kernel).fit(X, 100.0 * Y)
    again = PooledGP(first.kernel_, max_iter=0).fit(X, 100.0 * Y)
    assert str(again.kernel_) == str(first.kernel_)


@each_gp
def test_what_is_no_covariance(model):
    """Periodic in a distance is positive definite in one dimension only."""
    match = r"ExpSineSquared is positive semi-definite on one feature, not on 2\. Give"
    for kernel in (RBF() + ExpSineSquared(), ExpSineSquared() ** 2):
        with pytest.raises(ValueError, match=match):
            fitted(model, X, Y, kernel=kernel)
    kernel = ExpSineSquared() * Columns(ExpSineSquared(), [0])
    assert_sound(
        fitted(model, np.delete(X, 1, axis=1), Y, kernel=kernel, max_iter=0),
        X[:, [0, 2]],
    )


@pytest.mark.parametrize("noise_variance", [1e-3, 2.0])
@each_gp
def test_noise_variance_outside_its_bounds(model, noise_variance):
    match = rf"noise_variance={noise_variance}.* noise_variance_bounds=\(0.01, 1.0\)"
    params = {"noise_variance": noise_variance, "noise_variance_bounds": (0.01, 1.0)}
    with pytest.raises(ValueError, match=match):
        fitted(model, X, Y, max_iter=0, **params)
