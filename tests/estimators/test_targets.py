"""Targets that are transformed inside the estimators."""

import pickle
from copy import copy
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit, logit
from scipy.stats import norm
from sklearn import config_context
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.metrics import r2_score
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
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
from skmtgp.inspection import CoverageDisplay, TaskResidualsDisplay, TransferDisplay
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
STAGED = {"learning": "staged", **QUICK}
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, **STAGED),
    "independent": IndependentGP(**QUICK),
    "pooled": PooledGP(**QUICK),
    "single": SingleTaskGP(**QUICK),
}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def negative_log(y):
    return -np.log(y)


def exp_of_negative(z):
    return np.exp(-z)


@cache
def of_logs(name, *, outputs=2):
    """A model of y through logarithms, and the same of logarithms without."""
    y = Y if outputs == 2 else Y[:, 0]
    own = clone(MODELS[name]).set_params(target_transform=LOG).fit(X, y)
    return own, clone(MODELS[name]).fit(X, np.log(y))


def deviation_of_exp(m, s):
    """Standard deviation of the logarithmic normal distribution."""
    return np.exp(m + 0.5 * s**2) * np.sqrt(np.expm1(s**2))


@pytest.mark.parametrize("include_noise", [False, True])
@pytest.mark.parametrize("outputs", [1, 2])
@pytest.mark.parametrize("model", MODELS)
def test_logarithmic_normal(model, outputs, include_noise):
    own, plain = of_logs(model, outputs=outputs)
    options = {"return_std": True, "include_noise": include_noise}
    m, s = plain.predict(Z, **options)
    median, std = own.predict(Z, **options)
    np.testing.assert_allclose(median, np.exp(m), rtol=1e-13)
    np.testing.assert_allclose(std, deviation_of_exp(m, s), rtol=1e-5)
    np.testing.assert_array_equal(own.predict(Z), median)
    np.testing.assert_allclose(own.predict_interval(Z, 0.0), [median] * 2, rtol=1e-9)


def test_it_predicts_as_the_meta_estimator_of_scikit_learn():
    own, plain = of_logs("multi-task")
    other = TransformedTargetRegressor(plain, func=np.log, inverse_func=np.exp)
    np.testing.assert_array_equal(own.predict(Z), other.fit(X, Y).predict(Z))
    assert own.score(X, Y) == r2_score(Y, own.predict(X))


@pytest.mark.parametrize(
    "transform", [LOG, FunctionTransformer(*LOG), PowerTransformer(method="box-cox")]
)
def test_columns_are_arrays_whatever_the_configuration(transform):
    """Warnings are errors in tests."""
    [column] = fit_target(transform, Y[:, :1]).columns
    expected = column.forward(Y[:, 0])
    with config_context(transform_output="pandas"):
        [again] = fit_target(transform, Y[:, :1]).columns
        np.testing.assert_array_equal(again.forward(Y[:, 0]), expected)
        np.testing.assert_allclose(again.back(expected), Y[:, 0])


@pytest.mark.parametrize("include_noise", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_intervals_and_draws_are_mapped_back(model, include_noise):
    own, plain = of_logs(model)
    noise = {"include_noise": include_noise}
    intervals = [of.predict_interval(Z, 0.9, **noise) for of in (own, plain)]
    np.testing.assert_allclose(intervals[0], np.exp(intervals[1]))
    draws = [of.sample_y(Z, 3, **noise) for of in (own, plain)]
    np.testing.assert_allclose(draws[0], np.exp(draws[1]))


@pytest.mark.parametrize("include_noise", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_leaving_one_out(model, include_noise):
    own, plain = of_logs(model)
    m, s = plain.loo_predict(include_noise)
    median, std = own.loo_predict(include_noise)
    np.testing.assert_allclose(median, np.exp(m), rtol=1e-12)
    np.testing.assert_allclose(std, deviation_of_exp(m, s), rtol=1e-4)


@pytest.mark.parametrize("model", MODELS)
def test_what_is_learned_is_of_the_transformed(model):
    own, plain = of_logs(model)
    np.testing.assert_array_equal(own.theta_, plain.theta_)
    assert own.log_marginal_likelihood_value_ == plain.log_marginal_likelihood_value_
    value = own.log_marginal_likelihood(own.theta_)
    assert np.isclose(value, own.log_marginal_likelihood_value_)


def test_attributes_and_tables():
    own, plain = of_logs("multi-task", outputs=1)
    assert own.target_transformer_.func is np.log
    np.testing.assert_array_equal(own.y_train_, plain.y_train_)
    np.testing.assert_array_equal(own.task_level_, plain.task_level_)
    pd.testing.assert_frame_equal(own.summary(), plain.summary())


def test_a_falling_map():
    own = of_logs("multi-task")[0]
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


@pytest.mark.parametrize("normalize_y", ["shared", "per_task"])
@pytest.mark.parametrize("linear", [StandardScaler(), (np.negative, np.negative)])
def test_a_linear_map_changes_nothing(linear, normalize_y):
    model = clone(MODELS["multi-task"]).set_params(normalize_y=normalize_y)
    own, plain = (
        clone(model).set_params(target_transform=of).fit(X, Y) for of in (linear, None)
    )
    for predict in ("predict", "predict_interval"):
        options = {"return_std": True} if predict == "predict" else {}
        found, expected = (getattr(of, predict)(Z, **options) for of in (own, plain))
        np.testing.assert_allclose(found, expected, rtol=1e-4)


@pytest.mark.parametrize("engine", ["kronecker", "sparse"])
def test_engines(engine):
    complete = np.column_stack([np.tile(np.linspace(0.0, 6.0, 10), 3), TASK])
    model = clone(MODELS["multi-task"]).set_params(inference=engine, n_inducing=8)
    own = clone(model).set_params(target_transform=LOG).fit(complete, Y)
    plain = clone(model).fit(complete, LOGS)
    np.testing.assert_allclose(own.predict(Z), np.exp(plain.predict(Z)))
    found, expected = own.predict_interval(Z), plain.predict_interval(Z)
    np.testing.assert_allclose(found, np.exp(expected))


def deviation_of_mixture(means, variances, weights=1.0):
    """That of exp of a mixture of normals."""
    mean = (weights * np.exp(means + 0.5 * variances)).mean(axis=0)
    second = (weights * np.exp(2.0 * means + 2.0 * variances)).mean(axis=0)
    return np.sqrt(second - mean**2)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
@pytest.mark.parametrize("kind", [MultiTaskGPRegressor, SingleTaskGP])
def test_draws_of_hyperparameters(kind):
    options = {"hyperparameters": "sampled", "n_draws": 6, "target_transform": LOG}
    model = kind(**options).fit(X[:20], Y[:20, 0])
    rows = Z[Z[:, 1] < 2]
    parts = model._components(rows[:, :1], rows[:, 1].astype(int), True)
    means, variances = (of[..., 0] for of in parts)
    median, std = model.predict(rows, return_std=True, include_noise=True)
    np.testing.assert_allclose(median, np.exp(means.mean(axis=0)))
    np.testing.assert_allclose(std, deviation_of_mixture(means, variances), rtol=1e-3)
    lower, upper = np.log(model.predict_interval(rows, 0.8))
    for ends, p in ((lower, 0.1), (upper, 0.9)):
        below = norm.cdf(ends, means, np.sqrt(variances)).mean(axis=0)
        np.testing.assert_allclose(below, p, rtol=1e-6)
    means, variances, weights = (of[..., 0] for of in model._left_out(True))
    assert means.shape == (6, 20)
    median, std = model.loo_predict(include_noise=True)
    np.testing.assert_allclose(median, np.exp((weights * means).mean(axis=0)))
    expected = deviation_of_mixture(means, variances, weights)
    np.testing.assert_allclose(std, expected, rtol=1e-3)


def test_errors_name_one_of_several_outputs():
    Y = np.column_stack([np.ones(30), SIGNED])
    Y[:, 0] += np.arange(30)
    with pytest.raises(ValueError, match=r"^Output 2 of 2: .* nan of y\[0\] = -1\.0"):
        PooledGP(target_transform=LOG).fit(X[:30], Y)


def test_add_task():
    own, plain = of_logs("multi-task")
    rows, y = np.array([[1.0, 3], [4.0, 3]]), Y[:2]
    own, plain = own.add_task(rows, y), plain.add_task(rows, np.log(y))
    np.testing.assert_array_equal(own.y_train_, plain.y_train_)
    np.testing.assert_allclose(
        own.predict_interval(rows), np.exp(plain.predict_interval(rows))
    )
    assert own.predict(rows).min() > 0.0
    with pytest.raises(ValueError, match=r"makes -inf of y\[1\] = 0\.0"):
        own.add_task([[1.0, 4], [2.0, 4]], [[1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize("simpler", [False, True])
def test_rank_search(simpler):
    """Tasks alone have the same transform, so that likelihoods can be compared."""
    model = MultiTaskGPRegressor(target_transform=PowerTransformer(), **STAGED)
    search = RankSearchIC(model, ranks=(1,), simpler=simpler).fit(X, Y[:, 0])
    logs = PowerTransformer().fit_transform(Y[:, :1])[:, 0]
    plain = RankSearchIC(
        MultiTaskGPRegressor(**STAGED), ranks=(1,), simpler=simpler
    ).fit(X, logs)
    names = ["model", "log_marginal_likelihood", "bic"]
    pd.testing.assert_frame_equal(search.results_[names], plain.results_[names])
    assert search.predict(Z).min() > 0.0
    assert np.isfinite(search.loo_predict()).all()


def test_displays_of_the_transformed():
    plot = pytest.importorskip("matplotlib.pyplot")
    own, plain = of_logs("multi-task", outputs=1)
    found, expected = (TransferDisplay.from_estimator(of) for of in (own, plain))
    pd.testing.assert_frame_equal(found.transfer, expected.transfer)
    y, logs = Y[:, 0], np.log(Y[:, 0])
    pipeline, task = make_pipeline("passthrough", own), {"task_feature": -1}
    found = CoverageDisplay.from_estimator(pipeline, X, y, **task)
    expected = CoverageDisplay.from_estimator(plain, X, logs)
    np.testing.assert_array_equal(found.coverages, expected.coverages)
    lower, upper = own.predict_interval(X, 0.5)
    share = np.mean((lower <= y) & (y <= upper))
    assert found.coverages[:, np.isclose(found.levels, 0.5)].mean() == pytest.approx(
        share
    )
    kind = {"kind": "standardized"}
    found = TaskResidualsDisplay.from_estimator(own, X, y, **kind)
    expected = TaskResidualsDisplay.from_estimator(plain, X, logs, **kind)
    np.testing.assert_allclose(found.residuals, expected.residuals)
    found = TaskResidualsDisplay.from_estimator(own, X, y)
    np.testing.assert_allclose(found.residuals, y - own.predict(X))
    plot.close("all")


def test_persistence_and_parameters():
    model = MultiTaskGPRegressor(
        rank=1, target_transform=FunctionTransformer(*LOG), **STAGED
    )
    assert "target_transform__func" in model.get_params()
    model.fit(X, Y)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(Z), model.predict(Z))
    assert len(model.target_transformer_) == 2
    model.set_params(target_transform=None).fit(X, LOGS)
    assert not hasattr(model, "target_transformer_")
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
        rank=1, shared=True, normalize_y="shared", target_transform=LOG, **STAGED
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
        (PowerTransformer("box-cox"), SIGNED, "not take the targets: .* Box-Cox"),
        ((np.mean, np.mean), SIGNED, "not take the targets: .*element by element"),
        (LOG, np.arange(30.0), r"makes -inf of y\[0\] = 0\.0.*log1p"),
        (LOG, SIGNED, r"makes nan of y\[0\] = -1\.0"),
        ((np.square, np.sqrt), SIGNED, r"does not lead back: y\[0\] = -1\.0"),
        ((np.reciprocal, np.reciprocal), SIGNED - 0.03, "is not monotone: of y = "),
        ((np.log, np.square), 1.0 + np.arange(30.0), "does not lead back"),
        ((np.log, 2), 1.0 + np.arange(30.0), "must be a function and its inverse"),
        ((np.log,), 1.0 + np.arange(30.0), "must be a function and its inverse"),
        ("log", 1.0 + np.arange(30.0), "The 'target_transform' parameter of"),
        (FunctionTransformer, np.arange(30.0), "You should provide an instance"),
    ],
)
@pytest.mark.parametrize("model", ["multi-task", "single"])
def test_transforms_that_are_refused(model, transform, y, message):
    model = copy(of_logs(model)[0])
    before = vars(model).copy()
    with pytest.raises((ValueError, TypeError), match=message):
        model.set_params(target_transform=transform).fit(X, y)
    assert vars(model) == {**before, "target_transform": transform}


@pytest.mark.parametrize("model", MODELS)
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
    with pytest.raises(ValueError, match="model is so uncertain there"):
        model.predict(far, return_std=True)
    with pytest.raises(ValueError, match="model is so uncertain there"):
        model.predict_interval(far, 1.0 - 1e-15)


def ten_to_the(z):
    return 10.0**z


def test_dask_is_refused():
    array = pytest.importorskip("dask.array")
    model = MultiTaskGPRegressor(inference="sparse", target_transform=LOG)
    with pytest.raises(ValueError, match="target_transform needs the targets in mem"):
        model.fit(array.from_array(X), array.from_array(Y[:, 0]))


@pytest.mark.parametrize("model", [MultiTaskGPRegressor, SingleTaskGP])
@pytest.mark.parametrize("transform", ["log", np.log])
def test_what_is_no_pair_of_functions(model, transform):
    message = r"'target_transform' parameter of .* its inverse, \(np.log, np.exp\)"
    with pytest.raises(ValueError, match=message):
        model(target_transform=transform).fit(X, np.ones(len(X)))
