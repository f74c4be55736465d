"""Log densities of new observations, against the quantiles of the same models."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm, t
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.preprocessing import (
    PowerTransformer,
    QuantileTransformer,
    StandardScaler,
)
from waves import draw

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
)
from skmtgp._estimators.targets import Column, fit_target

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
]
QUICK = {"max_iter": 5}
SAMPLED = {"hyperparameters": "sampled", "n_draws": 8, **QUICK}
ARCSINH = {"target_transform": (np.arcsinh, np.sinh)}
FALLING = {"target_transform": (np.negative, np.negative)}
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, **QUICK),
    "laplace": MultiTaskGPRegressor(rank=1, hyperparameters="laplace", **QUICK),
    "independent": IndependentGP(**SAMPLED),
    "pooled": PooledGP(**ARCSINH, **QUICK),
    "falling": PooledGP(**FALLING, **SAMPLED),
    "single": SingleTaskGP(**ARCSINH, **SAMPLED),
    "search": RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2)),
    "linear": BayesianLinearRegression(),
}
X, y = draw(rows=5)
Z = np.column_stack([np.linspace(-3.0, 9.0, 9), np.arange(9) % 3])
TAIL = 1e-5


@pytest.mark.parametrize("name", MODELS)
def test_it_is_the_derivative_of_the_distribution(name):
    """Of the quantiles' inverse: dp/dy."""
    model = clone(MODELS[name]).fit(X, y)
    for p in (0.01, 0.2, 0.45):
        within, beyond = (
            model.predict_interval(Z, 1.0 - 2.0 * (p + d)) for d in (TAIL * p, 0.0)
        )
        for inner, outer in zip(within, beyond, strict=True):
            found = model.log_predictive_density(Z, 0.5 * (inner + outer))
            expected = np.log(TAIL * p / np.abs(inner - outer))
            np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("name", ["pooled", "single", "linear", "falling"])
def test_it_integrates_to_one(name):
    model = clone(MODELS[name]).fit(X, y)
    for row in Z[:3]:
        lower, upper = (of[0] for of in model.predict_interval([row], 1.0 - 1e-4))
        grid = np.linspace(lower, upper, 4001)
        density = np.exp(model.log_predictive_density(np.tile(row, (4001, 1)), grid))
        assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=5e-4)


def test_of_several_outputs():
    targets = np.column_stack([y, y**3])
    model = MultiTaskGPRegressor(rank=1, **QUICK).fit(X, targets)
    mean, std = model.predict(Z, return_std=True, include_noise=True)
    values = mean + std * np.linspace(-3.0, 3.0, 9)[:, None]
    found = model.log_predictive_density(Z, values)
    np.testing.assert_allclose(found, norm.logpdf(values, mean, std), rtol=1e-12)


def test_of_the_linear_model_it_is_student_t():
    model = BayesianLinearRegression().fit(X, y)
    mean, std = model.predict(Z, return_std=True, include_noise=True)
    degrees = model.degrees_of_freedom_[Z[:, -1].astype(int)]
    scale = std * np.sqrt(1.0 - 2.0 / degrees)
    found = model.log_predictive_density(Z, mean + 2.0)
    np.testing.assert_allclose(found, t.logpdf(2.0, degrees, 0.0, scale), rtol=1e-12)


def test_impossible_values_have_no_density():
    model = PooledGP(target_transform=(np.log, np.exp), **QUICK).fit(X, np.exp(y))
    found = model.log_predictive_density(X[:3], [0.0, -1.0, 1.0])
    assert found[:2].tolist() == [-np.inf, -np.inf]
    assert np.isfinite(found[2])


class TestSlopes:
    """The logarithm of |dz/dy|, with which a density of z is one of y."""

    VALUES = np.random.default_rng(0).lognormal(3.0, 1.0, 40)

    @pytest.mark.parametrize(
        ("transform", "slope"),
        [
            ((np.log, np.exp), lambda y: 1.0 / y),
            ((np.sqrt, np.square), lambda y: 0.5 / np.sqrt(y)),
            ((np.reciprocal, np.reciprocal), lambda y: y**-2.0),
            ((lambda y: 1e9 * y, lambda z: 1e-9 * z), lambda y: 1e9 + 0.0 * y),
        ],
        ids=["log", "root", "reciprocal", "unit"],
    )
    def test_known_ones(self, transform, slope):
        target = fit_target(transform, self.VALUES[:, None])
        new = np.quantile(self.VALUES, [0.0, 0.123, 0.5, 0.9, 1.0])[:, None]
        found = target.with_slopes(new)
        np.testing.assert_array_equal(found[0], transform[0](new))
        np.testing.assert_allclose(np.exp(found[1]), slope(new), rtol=1e-6)

    @pytest.mark.parametrize("method", ["box-cox", "yeo-johnson"])
    def test_power(self, method):
        column = Column(PowerTransformer(method), self.VALUES)
        [power] = column.transformer.lambdas_
        deviation = column.transformer._scaler.scale_[0]
        shifted = self.VALUES + (method == "yeo-johnson")
        expected = shifted ** (power - 1.0) / deviation
        found = np.exp(column.with_slopes(self.VALUES)[1])
        np.testing.assert_allclose(found, expected, rtol=1e-6)

    def test_beyond_the_values_of_fit_quantiles_end(self):
        transformer = QuantileTransformer(
            n_quantiles=40, output_distribution="normal", subsample=None
        )
        column = Column(transformer, self.VALUES)
        low, high = self.VALUES.min(), self.VALUES.max()
        z, slopes = column.with_slopes(np.array([0.5 * low, low, 20.0, high, 2 * high]))
        assert np.isfinite(z).all()
        assert slopes[[0, 1, 3, 4]].tolist() == [-np.inf, np.inf, np.inf, -np.inf]
        assert np.isfinite(slopes[2])

    @pytest.mark.parametrize("with_zero", [False, True])
    def test_a_value_in_which_the_inverse_ends_has_a_probability(self, with_zero):
        values = np.r_[self.VALUES, 0.0] if with_zero else self.VALUES
        [column] = fit_target((np.sqrt, np.square), values[:, None]).columns
        slopes = column.with_slopes(np.array([-1.0, 0.0, 1.0]))[1]
        np.testing.assert_allclose(slopes, [-np.inf, np.inf, np.log(0.5)], rtol=1e-6)


@pytest.mark.parametrize(
    ("value", "error", "match"),
    [
        (y[:4], ValueError, "inconsistent numbers of samples"),
        (np.column_stack([y, y]), ValueError, r"y has shape \(15, 2\); the model was"),
        (np.where(y == y[0], np.nan, y), ValueError, "NaN"),
        (None, ValueError, "requires y to be passed"),
    ],
)
def test_what_are_no_observations(value, error, match):
    model = PooledGP(max_iter=0).fit(X, y)
    with pytest.raises(error, match=match):
        model.log_predictive_density(X, value)


def test_rows_in_another_order_are_refused():
    frame = pd.DataFrame(X, columns=["x", "task"])
    model = PooledGP(max_iter=0).fit(frame, y)
    with pytest.raises(ValueError, match="order"):
        model.log_predictive_density(frame, pd.Series(y)[::-1])
    with pytest.raises(NotFittedError):
        PooledGP().log_predictive_density(frame, y)


class TestTables:
    x = np.linspace(0.0, 6.0, 12)
    Y = pd.DataFrame({"u": np.exp(np.sin(x)), "v": np.exp(np.cos(x))})

    def test_gaps_have_none(self):
        gaps = self.Y.mask(np.eye(12, 2, dtype=bool))
        model = PooledGP(target_transform=(np.log, np.exp), **QUICK)
        wide = WideRegressor(model).fit(self.x[:, None], self.Y)
        found = wide.log_predictive_density(self.x[:, None], gaps)
        rows = np.column_stack([self.x[1:].astype(object), ["u"] * 11])
        expected = wide.estimator_.log_predictive_density(rows, self.Y["u"][1:])
        np.testing.assert_allclose(found[1:, 0], expected, rtol=1e-10)
        np.testing.assert_array_equal(np.isnan(found), gaps.isna())

    def test_of_one_output_it_is_one_dimensional(self):
        y = self.Y["u"].to_numpy()
        wide = WideRegressor(PooledGP(**QUICK)).fit(self.x[:, None], y)
        assert wide.log_predictive_density(self.x[:, None], y).shape == (12,)
        with pytest.raises(ValueError, match="inconsistent numbers"):
            wide.log_predictive_density(self.x[:5, None], y)


@pytest.mark.parametrize("value", [1e3, 1e9, 1e12, 1e36])
def test_absurd_values_are_unlikely_on_any_linear_scale(value):
    """As likely as without a transform."""
    plain, scaled = (
        PooledGP("rbf", **QUICK),
        PooledGP("rbf", target_transform=StandardScaler(), **QUICK),
    )
    found, expected = (
        of.fit(X, y).log_predictive_density(X[:1], [value]) for of in (scaled, plain)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-2)


@pytest.mark.parametrize("level", [1e3, 1e6, 1e9])
def test_slopes_far_from_zero(level):
    values = level + np.linspace(0.0, 1.0, 9)
    [column] = fit_target((np.log, np.exp), values[:, None]).columns
    np.testing.assert_allclose(
        column.with_slopes(values)[1], -np.log(values), atol=1e-4
    )


def test_values_that_a_transformer_refuses_are_impossible():
    transform = PowerTransformer("box-cox")
    model = PooledGP(target_transform=transform, **QUICK).fit(X, np.exp(y))
    found = model.log_predictive_density(X[:2], [0.0, 1.0])
    assert found[0] == -np.inf
    assert np.isfinite(found[1])
