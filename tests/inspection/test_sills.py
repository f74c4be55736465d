"""Nuggets, sills and ranges: the numbers of the table."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pictured import FRAME, X, Y, y
from scipy.optimize import brentq
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)
from test_variogram import TERMS, survey

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    PooledGP,
    SingleTaskGP,
    WideRegressor,
)
from skmtgp.inspection import VariogramDisplay, variogram_table
from skmtgp.kernels import Columns, Spherical

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
QUICK = {"max_iter": 3, "noise": "per_task"}
RANGES = ["range_east", "range_north"]


@pytest.fixture(scope="module")
def model():
    return MultiTaskGPRegressor(TERMS, rank=1, **QUICK).fit(*survey())


def one(kernel, **options):
    """The rows of a model of one task with a kernel that is not learned."""
    frame, y = survey()
    zinc = (frame["metal"] == "zinc").to_numpy()
    model = MultiTaskGPRegressor(kernel, rank=1, max_iter=0, **options)
    model.fit(frame[zinc], y[zinc])
    return variogram_table(model), model


def test_sills_and_nuggets_are_those_that_were_learned(model):
    table = variogram_table(model)
    pairs = [("lead", "lead"), ("zinc", "lead"), ("zinc", "zinc")]
    assert list(dict.fromkeys(table.index)) == pairs
    for a, b in pairs:
        i, j = (model.tasks_.tolist().index(task) for task in (a, b))
        found = table.loc[(a, b)]
        assert found["structure"].tolist() == ["nugget", "exponential", "Gaussian"]
        nugget = model.noise_variance_[i] if a == b else 0.0
        expected = [nugget, *model.task_covariance_[:, i, j]]
        assert_allclose(found["sill"], expected, rtol=1e-12)
        assert_allclose(found[RANGES].iloc[0], 0.0)


def test_sills_and_ranges_are_those_of_the_line(model):
    """Far away the line is at the sum; at the range of one structure at 95 % of it."""
    table = variogram_table(model)
    far = Spherical(1e-5)  # all other places are beyond its range
    frame, y = survey()
    other = MultiTaskGPRegressor(far, rank=1, max_iter=0).fit(frame, y)
    shown = VariogramDisplay.from_estimator(other, n_bins=1)
    sums = variogram_table(other).groupby(level=[0, 1])["sill"].sum()
    for row in shown.variograms.itertuples():
        pair = (row.task, row.other) if (row.task, row.other) in sums else None
        assert row.model == pytest.approx(sums[pair or (row.other, row.task)])
    for k, kernel in enumerate(model.kernel_, 1):
        ranges = table[RANGES].iloc[k].to_numpy()
        for at in np.diag(ranges):
            left = kernel(np.zeros((1, 2)), at[None]).item()
            assert left == pytest.approx(0.05, rel=1e-9)


KINDS = {
    "exponential": (Matern(2.0, nu=0.5), 2.0 * np.log(20.0)),
    "Gaussian": (RBF(2.0), 2.0 * np.sqrt(2.0 * np.log(20.0))),
    "Matern 1.5": (
        Matern(2.0, nu=1.5),
        2.0 * brentq(lambda h: (1 + 3**0.5 * h) * np.exp(-(3**0.5) * h) - 0.05, 0.1, 9),
    ),
    "rational quadratic": (
        RationalQuadratic(2.0, 0.3),
        2.0 * np.sqrt(0.6 * (20.0 ** (1.0 / 0.3) - 1.0)),
    ),
    "spherical": (Spherical(2.0), 2.0),
    "spherical x spherical": (Spherical(2.0) * Spherical(5.0), 2.0),
    "Gaussian ** 2": (RBF(2.0) ** 2, 2.0 * np.sqrt(np.log(20.0))),
}


@pytest.mark.parametrize("unit", [1e-4, 1.0, 1e4])
@pytest.mark.parametrize("name", KINDS)
def test_practical_ranges(name, unit):
    kernel, expected = KINDS[name]
    frame, y = survey()
    kernel = kernel.clone_with_theta(
        kernel.theta + np.log(unit) * np.char.endswith(_names(kernel), "length_scale")
    )
    frame[["east", "north"]] *= unit
    table = variogram_table(PooledGP(3.0 * kernel, max_iter=0).fit(frame, y))
    assert table["structure"].iloc[1] == name
    assert_allclose(table[RANGES].iloc[1], expected * unit, rtol=1e-7)


def _names(kernel):
    return [hyperparameter.name for hyperparameter in kernel.hyperparameters]


def test_a_range_for_each_feature():
    table, model = one(Spherical([4.0, 0.5]))
    assert_allclose(table[RANGES].iloc[1], model.kernel_.length_scale, rtol=1e-7)
    table, _ = one(Columns(RBF(1.0), ["north"]))
    assert np.isinf(table["range_east"].iloc[1])
    assert_allclose(table["range_north"].iloc[1], np.sqrt(2.0 * np.log(20.0)))


def test_sums_are_several_structures():
    parts = 2.0 * Spherical(1.0) + WhiteKernel(0.5) + ConstantKernel(7.0) + RBF(3.0)
    table, model = one(parts)
    K = model.task_covariance_.item()
    assert table["structure"].tolist() == ["nugget", "spherical", "Gaussian"]
    nugget = model.noise_variance_ + 0.5 * K
    assert_allclose(table["sill"], [nugget, 2.0 * K, K], rtol=1e-9)


@pytest.mark.parametrize("kernel", [DotProduct(), Columns(ExpSineSquared(), [0])])
def test_kernels_without_a_sill(kernel):
    table, _ = one(kernel)
    assert table.iloc[1, 1:].isna().all()
    table, _ = one(Columns(ExpSineSquared(), [0]) * RBF(3.0))  # this one fades
    assert table["structure"].iloc[1] == "periodic x Gaussian"
    assert table["sill"].notna().all()


def test_units_of_tasks():
    """A table of y in another unit has sills in the square of it."""
    frame, y = survey()
    times = np.where(frame["metal"] == "lead", 10.0, 1.0)
    options = {"rank": 1, "max_iter": 0, "normalize_y": "per_task"}
    tables = [
        variogram_table(MultiTaskGPRegressor(**options).fit(frame, of))
        for of in (y, times * y)
    ]
    ratio = (tables[1]["sill"] / tables[0]["sill"]).groupby(level=[0, 1]).max()
    assert_allclose(ratio, [100.0, 10.0, 1.0], rtol=1e-9)


def test_tasks_alone_have_no_pairs():
    frame, y = survey()
    alone = SingleTaskGP(2.0 * Spherical(2.0), max_iter=3).fit(frame, y)
    table = variogram_table(alone)
    assert list(dict.fromkeys(table.index)) == [("lead", "lead"), ("zinc", "zinc")]
    of_zinc = alone.estimators_[1]
    c, k = of_zinc.kernel_.k1.constant_value, of_zinc.kernel_.k2.length_scale
    zinc = table.loc[("zinc", "zinc")]
    sill = c * of_zinc.task_covariance_.item()
    assert_allclose(zinc["sill"], [of_zinc.noise_variance_, sill], rtol=1e-9)
    assert_allclose(zinc[RANGES].iloc[1], k, rtol=1e-7)


@pytest.mark.parametrize("output", [0, 1])
@pytest.mark.parametrize("name", ["MultiTaskGPRegressor", "IndependentGP", "PooledGP"])
def test_models_and_outputs(fitted, name, output):
    table = variogram_table(fitted[name], output=output)
    found = table["sill"].groupby(level=[0, 1]).last()
    k = fitted[name].kernel_[output].diag(X[:1, :-1])[0]
    expected = fitted[name].task_covariance_[output] * k
    assert_allclose(found, expected[np.tril_indices(3)], rtol=1e-9)


def test_pipelines_and_wide_tables(piped):
    assert variogram_table(piped).notna().all(axis=None)
    wide = FRAME[["a", "b"]].assign(u=Y[:, 0], v=Y[:, 1])
    model = WideRegressor(MultiTaskGPRegressor(rank=1, max_iter=0))
    table = variogram_table(model.fit(wide[["a", "b"]], wide[["u", "v"]]))
    assert table.index.get_level_values("task").tolist() == ["u"] * 2 + ["v"] * 4


def test_errors(model):
    with pytest.raises(ValueError, match="output=1 must be 0"):
        variogram_table(model, output=1)
    with pytest.raises(NotFittedError):
        variogram_table(PooledGP())
    linear = BayesianLinearRegression().fit(FRAME[["a", "b", "load"]], y)
    with pytest.raises(TypeError, match="BayesianLinearRegression has no variogram"):
        variogram_table(linear)
