"""Targets that are transformed inside the estimators."""

import pickle

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit, logit
from scipy.stats import norm
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.preprocessing import (
    FunctionTransformer,
    PowerTransformer,
    StandardScaler,
)

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators.targets import Column, fit_target
from skmtgp._numerics.mixtures import moments
from skmtgp.inspection import TransferDisplay
from skmtgp.model_selection import TaskStratifiedKFold

LOG = np.log, np.exp
RNG = np.random.default_rng(0)
TASK = np.repeat([0, 1, 2], 10)
X = np.column_stack([RNG.uniform(0.0, 6.0, 30), TASK])
LOGS = np.sin(X[:, :1] + [0.0, 1.0]) + 0.3 * TASK[:, None]
LOGS += 0.3 * RNG.standard_normal(LOGS.shape)
Y = np.exp(LOGS)
Z = np.column_stack([np.linspace(0.0, 7.0, 6), [0, 1, 2, 0, 1, 2]])
QUICK = {"max_iter": 20, "tol": 0.1}
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, **QUICK),
    "independent": IndependentGP(**QUICK),
    "pooled": PooledGP(**QUICK),
    "single": SingleTaskGP(**QUICK),
}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def negative_log(y):
    return -np.log(y)


def exp_of_negative(z):
    return np.exp(-z)


def of_logs(model, transform=LOG, y=Y):
    """The model of y with a transform, and the same of its logarithms without."""
    own = clone(model).set_params(target_transform=transform).fit(X, y)
    return own, clone(model).fit(X, np.log(y))


@pytest.mark.parametrize("y", [Y, Y[:, 0]], ids=["two outputs", "one"])
@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_log_normal(model, y):
    """Closed forms of the logarithmic normal distribution."""
    own, plain = of_logs(model, y=y)
    m, s = plain.predict(Z, return_std=True, include_noise=True)
    mean, std = own.predict(Z, return_std=True, include_noise=True)
    assert mean.shape == m.shape
    np.testing.assert_allclose(mean, np.exp(m + 0.5 * s**2), rtol=1e-8)
    np.testing.assert_allclose(std, mean * np.sqrt(np.expm1(s**2)), rtol=1e-5)
    np.testing.assert_allclose(own.predict(Z), mean)
    of_f, std = own.predict(Z, return_std=True)
    np.testing.assert_array_equal(of_f, mean)
    s = plain.predict(Z, return_std=True)[1]
    np.testing.assert_allclose(
        std, np.exp(m + 0.5 * s**2) * np.sqrt(np.expm1(s**2)), rtol=1e-5
    )


@pytest.mark.parametrize("include_noise", [False, True])
@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_intervals_and_draws_are_mapped_back(model, include_noise):
    own, plain = of_logs(model)
    noise = {"include_noise": include_noise}
    intervals = [of.predict_interval(Z, 0.9, **noise) for of in (own, plain)]
    np.testing.assert_allclose(intervals[0], np.exp(intervals[1]))
    draws = [of.sample_y(Z, 3, **noise) for of in (own, plain)]
    np.testing.assert_allclose(draws[0], np.exp(draws[1]))


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_leaving_one_out(model):
    own, plain = of_logs(model)
    m, s = plain.loo_predict(include_noise=True)
    mean, std = own.loo_predict(include_noise=True)
    np.testing.assert_allclose(mean, np.exp(m + 0.5 * s**2), rtol=1e-6)
    np.testing.assert_allclose(std, mean * np.sqrt(np.expm1(s**2)), rtol=1e-4)
    of_f, less = own.loo_predict()
    np.testing.assert_array_equal(of_f, mean)
    assert (less < std).all()


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_what_is_learned_is_of_the_transformed(model):
    own, plain = of_logs(model)
    np.testing.assert_array_equal(own.theta_, plain.theta_)
    assert own.log_marginal_likelihood_value_ == plain.log_marginal_likelihood_value_
    value = own.log_marginal_likelihood(own.theta_)
    assert np.isclose(value, own.log_marginal_likelihood_value_)


def test_attributes_and_tables():
    own, plain = of_logs(MODELS["multi-task"], y=Y[:, 0])
    np.testing.assert_array_equal(own.y_train_, plain.y_train_)
    np.testing.assert_array_equal(own.task_level_, plain.task_level_)
    pd.testing.assert_frame_equal(own.summary(), plain.summary())


def test_a_falling_map():
    own = of_logs(MODELS["multi-task"])[0]
    falls = (negative_log, exp_of_negative)
    other = clone(own).set_params(target_transform=falls).fit(X, Y)
    lower, upper = other.predict_interval(Z)
    assert (lower < upper).all()
    np.testing.assert_allclose((lower, upper), own.predict_interval(Z), rtol=1e-6)
    np.testing.assert_allclose(other.predict(Z), own.predict(Z), rtol=1e-6)


def test_a_transformer_is_cloned_and_fitted_to_each_output():
    transformer = PowerTransformer()
    model = clone(MODELS["multi-task"]).set_params(target_transform=transformer)
    model.fit(X, Y)
    assert not hasattr(transformer, "lambdas_")
    for j in range(2):
        alone = clone(model).fit(X, Y[:, j])
        np.testing.assert_allclose(
            alone.y_train_, PowerTransformer().fit_transform(Y[:, [j]])[:, 0]
        )
        np.testing.assert_allclose(model.y_train_[:, j], alone.y_train_)


def test_a_linear_map_changes_nothing():
    model = MODELS["multi-task"]
    own, plain = (
        clone(model).set_params(target_transform=of).fit(X, Y)
        for of in (StandardScaler(), None)
    )
    for found, expected in zip(
        own.predict(Z, return_std=True), plain.predict(Z, return_std=True), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
def test_draws_of_hyperparameters():
    options = {"hyperparameters": "sampled", "n_draws": 6, "target_transform": LOG}
    model = MultiTaskGPRegressor(rank=1, **options).fit(X[:20], Y[:20, 0])
    rows = Z[Z[:, 1] < 2]
    parts = model._components(rows[:, :1], rows[:, 1].astype(int), True)
    means, variances = (of[..., 0] for of in parts)
    means_of_parts = np.exp(means + 0.5 * variances)
    mean, std = model.predict(rows, return_std=True, include_noise=True)
    np.testing.assert_allclose(mean, means_of_parts.mean(axis=0), rtol=1e-6)
    second = np.exp(2.0 * means + 2.0 * variances).mean(axis=0)
    np.testing.assert_allclose(std, np.sqrt(second - mean**2), rtol=1e-3)
    lower, upper = np.log(model.predict_interval(rows, 0.8))
    for ends, p in ((lower, 0.1), (upper, 0.9)):
        below = norm.cdf(ends, means, np.sqrt(variances)).mean(axis=0)
        np.testing.assert_allclose(below, p, rtol=1e-6)


def test_add_task():
    own, plain = of_logs(MODELS["multi-task"])
    rows, y = np.array([[1.0, 3], [4.0, 3]]), Y[:2]
    own, plain = own.add_task(rows, y), plain.add_task(rows, np.log(y))
    np.testing.assert_array_equal(own.y_train_, plain.y_train_)
    np.testing.assert_allclose(
        own.predict_interval(rows), np.exp(plain.predict_interval(rows))
    )
    with pytest.raises(ValueError, match=r"makes -inf of y\[1\] = 0\.0"):
        own.add_task([[1.0, 4], [2.0, 4]], [[1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize("simpler", [False, True])
def test_rank_search(simpler):
    """Tasks alone have the same transform, so that likelihoods can be compared."""
    model = MultiTaskGPRegressor(target_transform=PowerTransformer(), **QUICK)
    search = RankSearchIC(model, ranks=(1,), simpler=simpler).fit(X, Y[:, 0])
    logs = PowerTransformer().fit_transform(Y[:, :1])[:, 0]
    plain = RankSearchIC(
        MultiTaskGPRegressor(**QUICK), ranks=(1,), simpler=simpler
    ).fit(X, logs)
    names = ["model", "log_marginal_likelihood", "bic"]
    pd.testing.assert_frame_equal(search.results_[names], plain.results_[names])
    assert search.predict(Z).min() > 0.0
    assert np.isfinite(search.loo_predict()).all()


def test_transfer_is_of_the_transformed():
    plot = pytest.importorskip("matplotlib.pyplot")
    own, plain = of_logs(MODELS["multi-task"], y=Y[:, 0])
    found, expected = (TransferDisplay.from_estimator(of) for of in (own, plain))
    plot.close("all")
    pd.testing.assert_frame_equal(found.transfer, expected.transfer)


def test_persistence_and_parameters():
    model = MultiTaskGPRegressor(
        rank=1, target_transform=FunctionTransformer(*LOG), **QUICK
    )
    assert "target_transform__func" in model.get_params()
    model.fit(X, Y)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(Z), model.predict(Z))
    model.set_params(target_transform=None).fit(X, LOGS)  # nothing is left of it
    np.testing.assert_array_equal(
        model.predict(Z), clone(model).fit(X, LOGS).predict(Z)
    )


def test_a_search_among_transforms():
    search = GridSearchCV(
        MODELS["pooled"],
        {"target_transform": [None, LOG, PowerTransformer()]},
        cv=TaskStratifiedKFold(2),
    )
    search.fit(X, Y[:, 0])
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()


def test_constant_targets():
    model = clone(MODELS["multi-task"]).set_params(target_transform=LOG)
    with pytest.warns(match="constant|same|vary"):
        model.fit(X, np.full(30, 2.0))
    np.testing.assert_allclose(model.predict(Z), 2.0, rtol=1e-4)


def test_unseen_tasks():
    model = MultiTaskGPRegressor(
        rank=1, shared=True, normalize_y="shared", target_transform=LOG, **QUICK
    )
    assert (model.fit(X, Y).predict([[1.0, 7]]) > 0.0).all()


# the maps themselves


def square(z):
    return np.square(z)


def arcsin_of_root(y):
    return np.arcsin(np.sqrt(y))


def square_of_sine(z):
    return np.sin(z) ** 2


UNIT = np.linspace(0.05, 0.95, 20)


@pytest.mark.parametrize(
    ("pair", "y", "z", "expected"),
    [
        ((np.sqrt, square), UNIT, [-0.5, 0.5], [0.0, 0.25]),
        ((arcsin_of_root, square_of_sine), UNIT, [-1.0, 3.0], [0.0, 1.0]),
        ((logit, expit), UNIT, [-50.0, 50.0], [0.0, 1.0]),
        (LOG, UNIT, [-9.0, 9.0], np.exp([-9.0, 9.0])),
        ((np.reciprocal, np.reciprocal), UNIT, [-1.0, 0.0], [18.95, 18.95]),
    ],
    ids=["roots", "arcsines", "logits", "logs", "reciprocals"],
)
def test_inverses_stay_where_they_end(pair, y, z, expected):
    """At 0 of squares; of 1 / z at 20 times the range beyond the targets."""
    [column] = fit_target(pair, y[:, None]).columns
    np.testing.assert_allclose(column.back(np.array(z)), expected, atol=1e-6)


@pytest.mark.parametrize("power", [-1.0, 0.0, 0.5])
@pytest.mark.parametrize("method", ["box-cox", "yeo-johnson"])
def test_power_transformer_far_away(method, power):
    """Its inverse has ends or poles; means and deviations are finite, and rise."""
    y = np.exp(0.4 * np.random.default_rng(0).standard_normal(60))
    y = y if power == 0.0 else (1.0 + y) ** (1.0 / power)
    column = Column(PowerTransformer(method=method), y)
    z = np.linspace(-30.0, 30.0, 200)
    assert (np.diff(column.back(z)) >= 0.0).all()
    assert np.isfinite(moments(z[None], np.full((1, 200), 2.0), column.back)).all()


# what is refused

SIGNED = np.linspace(-1.0, 2.0, 30)


@pytest.mark.parametrize(
    ("transform", "y", "message"),
    [
        (LOG, np.arange(30.0), r"makes -inf of y\[0\] = 0\.0.*log1p"),
        (LOG, SIGNED, r"makes nan of y\[0\] = -1\.0"),
        ((np.square, np.sqrt), SIGNED, r"does not lead back: of y\[0\] = -1\.0"),
        ((np.reciprocal, np.reciprocal), SIGNED - 0.03, "is not monotone: of y = "),
        ((np.log, np.square), 1.0 + np.arange(30.0), "does not lead back"),
        ((np.log, 2), 1.0 + np.arange(30.0), "must be a function and its inverse"),
        ((np.log,), 1.0 + np.arange(30.0), "must be a function and its inverse"),
        ("log", 1.0 + np.arange(30.0), "The 'target_transform' parameter of"),
        (FunctionTransformer, np.arange(30.0), "You should provide an instance"),
    ],
)
@pytest.mark.parametrize("model", [MODELS["multi-task"], MODELS["single"]])
def test_transforms_that_are_refused(model, transform, y, message):
    model = clone(model).set_params(target_transform=transform)
    with pytest.raises((ValueError, TypeError), match=message):
        model.fit(X, y)
    assert not hasattr(model, "tasks_")


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_covariances_are_refused(model):
    own, _ = of_logs(model)
    with pytest.raises(ValueError, match=r"return_cov=True has no.*sample_y"):
        own.predict(Z, return_cov=True)


def test_inverses_that_overflow():
    model = MultiTaskGPRegressor(target_transform=(np.log10, ten_to_the), rank=1)
    y = np.random.default_rng(0).permutation(np.logspace(-60, 60, 30))
    model.set_params(max_iter=0).fit(X, y)
    far = Z + [90.0, 0.0]
    assert np.isfinite(model.predict_interval(far)).all()
    for predict, *arguments in (
        (model.predict, far),
        (model.predict_interval, far, 1.0 - 1e-15),
    ):
        with pytest.raises(ValueError, match="model is so unsure there"):
            predict(*arguments)


def ten_to_the(z):
    return 10.0**z


def test_dask_is_refused():
    array = pytest.importorskip("dask.array")
    model = MultiTaskGPRegressor(inference="sparse", target_transform=LOG)
    with pytest.raises(ValueError, match="target_transform needs the targets in mem"):
        model.fit(array.from_array(X), array.from_array(Y[:, 0]))
