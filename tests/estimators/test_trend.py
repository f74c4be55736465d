"""A trend in the estimators: units, coefficients, predictions, refusals."""

import pickle

import numpy as np
import pandas as pd
import pytest
import textbook
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.compose import ColumnTransformer
from sklearn.gaussian_process.kernels import RBF
from sklearn.model_selection import GridSearchCV
from sklearn.preprocessing import PolynomialFeatures, SplineTransformer
from strategies import examples, seeds

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC
from skmtgp.identification import TaskIdentifier
from skmtgp.inference.engines import Dense
from skmtgp.inspection import TransferDisplay
from skmtgp.model_selection import TaskStratifiedKFold
from skmtgp.predictor import compile_predictor

STEPS = np.array([1.0, -2.0, 0.5])
BETA = np.array([3.0, -40.0])


def draw(seed=0, n=48, slope=0.0):
    """Rows of three tasks of two features, and new ones, some far away."""
    rng = np.random.default_rng(seed)
    F, tasks = rng.uniform(0, 6, (n, 2)), np.arange(n) % 3
    y = STEPS[tasks] * np.sin(F[:, 0]) + 2.0 * tasks + slope * F[:, 1]
    y += 0.1 * rng.standard_normal(n)
    Z = np.array([[1.0, 2.0, 0], [5.0, 30.0, 1], [-3.0, 4.0, 2], [2.0, 2.0, 2]])
    return np.column_stack([F, tasks]), y, Z


def model(trend=(0, 1), **options):
    options = {"rank": 1, "learning": "staged", "noise": "shared"} | options
    trend = list(trend) if isinstance(trend, tuple) else trend
    return MultiTaskGPRegressor(RBF([1.0, 9.0]), trend=trend, **options)


def told(fitted, Z):
    mean, std = fitted.predict(Z, return_std=True)
    return mean, std, fitted.predict(Z, return_cov=True)[1]


UNITS = ["shared", "per_task", False]
SETS = [False, True]


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("per_task", SETS)
@pytest.mark.parametrize("trend", [(0, 1), "linear"])
def test_a_trend_in_y_is_added_to_the_predictions_and_changes_nothing_else(
    trend, per_task, units
):
    if trend == "linear" and units == "per_task" and not per_task:
        pytest.skip("is refused")
    X, y, Z = draw()
    fitted = model(trend, normalize_y=units, trend_per_task=per_task).fit(X, y)
    moved = clone(fitted).fit(X, y + X[:, :2] @ BETA)
    change = moved.theta_ - fitted.theta_
    assert np.abs(change).max() < 1e-3  # rounding may end a climb elsewhere
    start, steep = clone(fitted).set_params(max_iter=0), X[:, :2] @ BETA
    fixed = [clone(start).fit(X, of) for of in (y, y + steep)]
    before, after = (told(of, Z) for of in fixed)
    close = {"rtol": 1e-8, "atol": 1e-8}
    np.testing.assert_allclose(after[0] - before[0], Z[:, :2] @ BETA, **close)
    for old, new in zip(before[1:], after[1:], strict=True):
        np.testing.assert_allclose(new, old, **close)
    values = [of.log_marginal_likelihood_value_ for of in fixed]
    np.testing.assert_allclose(*values, **close)
    moved = (fixed[1].coef_ - fixed[0].coef_)[..., -2:]
    np.testing.assert_allclose(moved, np.broadcast_to(BETA, moved.shape))


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("per_task", SETS)
def test_anyone_can_recompute_it(per_task, units):
    X, y, Z = draw(slope=2.0)
    fitted = model(normalize_y=units, trend_per_task=per_task).fit(X, y)
    tasks, of_Z = X[:, 2].astype(int), Z[:, 2].astype(int)

    def of_rows(value, rows):
        return np.broadcast_to(value, 3)[rows]

    def columns(F, rows):
        H = F - (
            fitted.trend_mean_[rows] if units == "per_task" else fitted.trend_mean_
        )
        wide = np.zeros((len(F), 3, 2))
        wide[np.arange(len(F)), rows] = H
        return wide.reshape(len(F), 6) if per_task else H

    K = fitted.task_covariance_
    level = of_rows(fitted.level_variance_, np.arange(3))
    given = fitted.kernel_, K, X[:, :2], tasks
    covariance = textbook.covariance(
        *given[:2], fitted.noise_variance_, *given[2:], level
    )
    cross = textbook.cross_covariance(*given, Z[:, :2], of_Z, level)
    prior = textbook.prior_covariance(*given[:2], Z[:, :2], of_Z, level)
    H, H_star = columns(X[:, :2], tasks), columns(Z[:, :2], of_Z)
    target = y - of_rows(fitted.y_mean_, tasks)
    mean, spread, beta, of_beta = textbook.universal_kriging(
        covariance, H, target, cross, H_star, prior
    )
    found = fitted.predict(Z, return_cov=True)
    np.testing.assert_allclose(
        found[0], mean + of_rows(fitted.y_mean_, of_Z), rtol=1e-6
    )
    np.testing.assert_allclose(found[1], spread, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(fitted.coef_.ravel(), beta, rtol=1e-6)
    deviation = np.sqrt(np.diagonal(of_beta))
    np.testing.assert_allclose(fitted.coef_std_.ravel(), deviation, rtol=1e-6)
    value = textbook.restricted_likelihood(covariance, H, target)
    np.testing.assert_allclose(fitted.log_marginal_likelihood_value_, value, rtol=1e-7)


def test_extrapolation_follows_a_steep_trend():
    X, y, _ = draw(slope=50.0)
    far = np.array([[3.0, 900.0, 0], [3.0, 900.0, 1]])
    truth = STEPS[[0, 1]] * np.sin(3.0) + [0.0, 2.0] + 50.0 * 900.0
    with_trend, without = model([1]).fit(X, y), model(None).fit(X, y)
    mean, std = with_trend.predict(far, return_std=True)
    assert (np.abs(mean - truth) < 3.0 * std + 0.1).all()
    assert (std < 300.0).all()
    assert (np.abs(without.predict(far) - truth) > 30_000.0).all()
    assert abs(with_trend.coef_[0] - 50.0) < 3.0 * with_trend.coef_std_[0]


@pytest.mark.parametrize("per_task", SETS)
def test_terms_sum_to_the_prediction(per_task):
    X, y, Z = draw(slope=2.0)
    fitted = model(trend_per_task=per_task, normalize_y="shared").fit(X, y)
    terms = fitted.predict_terms(Z)
    assert terms.shape == (4, 3)
    np.testing.assert_allclose(terms.sum(axis=1), fitted.predict(Z), rtol=1e-12)
    H, tasks = Z[:, :2] - fitted.trend_mean_, Z[:, 2].astype(int)
    of_rows = fitted.coef_[tasks] if per_task else fitted.coef_
    np.testing.assert_allclose(terms[:, 1], (H * of_rows).sum(axis=1))
    np.testing.assert_allclose(terms[:, 2], fitted.task_level_[tasks])


def test_own_constants_take_the_place_of_levels():
    X, y, _ = draw(slope=2.0)
    fitted = model("linear", trend_per_task=True).fit(X, y)
    assert fitted.coef_.shape == fitted.coef_std_.shape == (3, 3)
    assert fitted.trend_names_.tolist() == ["1", "x0", "x1"]
    assert fitted.level_variance_ == 0.0
    assert not np.any(fitted.task_level_)
    assert not np.any(fitted.y_mean_)
    level = fitted.coef_[:, 0] + fitted.coef_[:, 1:] @ [3.0, 3.0]
    np.testing.assert_allclose(np.diff(level), [2.0, 2.0], atol=2.0)


def test_the_constant_of_a_single_task_takes_the_place_of_its_level():
    X, y, _ = draw()
    X[:, 2] = 0.0
    fitted = model("constant").fit(X, y)
    assert fitted.level_variance_ == 0.0
    assert abs(fitted.coef_[0] - y.mean()) < 3.0 * fitted.coef_std_[0]


def test_a_constant_is_an_intercept():
    X, y, Z = draw(slope=2.0)
    bias = PolynomialFeatures(1)
    found = [model(trend).fit(X, y) for trend in ("linear", bias)]
    predicted = [of.predict(Z, return_std=True) for of in found]
    np.testing.assert_allclose(*predicted, rtol=1e-10)
    assert [of.trend_names_.tolist() for of in found] == [
        ["1", "x0", "x1"],
        ["1", "x0", "x1"],
    ]
    assert found[0].y_mean_ == 0.0
    assert not found[0].trend_mean_.any()
    ordinary = model("constant").fit(X, y)
    assert ordinary.coef_.shape == (1,)


@pytest.mark.parametrize("trend", ["constant", (1,)])
def test_columns_that_are_the_same_within_tasks(trend):
    # which the small model behind "auto", without means of tasks, knows nothing of
    X, y, _ = draw()
    X[:, 1] = np.array([3.0, -1.0, 7.0])[X[:, 2].astype(int)]
    y += (X[:, 2] == 1) * np.random.default_rng(1).standard_normal(48)
    fitted = model(trend, noise="auto").fit(X, y + 2.0 * X[:, 1])
    assert fitted.normalize_y_ == "shared"
    assert fitted.noise_ == "per_task"
    assert np.isfinite(fitted.coef_std_).all()


def test_columns_by_name_and_transformers_of_frames():
    X, y, _ = draw(slope=2.0)
    frame = pd.DataFrame(X, columns=["east", "north", "metal"])
    frame["metal"] = np.array(["zn", "cd", "ni"])[X[:, 2].astype(int)]
    by_name = model(["north"]).fit(frame, y)
    assert by_name.trend_names_.tolist() == ["north"]
    chosen = ColumnTransformer([("north", "passthrough", ["north"])])
    by_transformer = model(chosen).fit(frame, y)
    assert by_transformer.trend_names_.tolist() == ["north__north"]
    predictions = [of.predict(frame) for of in (by_name, by_transformer)]
    np.testing.assert_allclose(*predictions, rtol=1e-8)
    assert not hasattr(chosen, "transformers_")  # it was cloned
    splines = model(SplineTransformer(3, include_bias=False)).fit(frame, y)
    assert splines.coef_.shape == (8,)


def test_several_outputs():
    X, y, Z = draw(slope=2.0)
    Y = np.column_stack([y, 10.0 - 3.0 * y])
    fitted = model(trend_per_task=True, normalize_y="shared").fit(X, Y)
    assert fitted.coef_.shape == fitted.coef_std_.shape == (2, 3, 2)
    alone = clone(fitted).fit(X, Y[:, 1])
    np.testing.assert_allclose(fitted.coef_[1], alone.coef_)
    np.testing.assert_allclose(fitted.coef_[1], -3.0 * fitted.coef_[0], atol=1e-2)
    assert fitted.predict_terms(Z).shape == (4, 2, 3)


@pytest.mark.parametrize("units", ["shared", "per_task"])
@pytest.mark.parametrize("per_task", SETS)
def test_add_task_is_the_model_of_all(per_task, units):
    X, y, Z = draw(slope=2.0)
    options = {"trend_per_task": per_task, "normalize_y": units, "noise": "per_task"}
    new = X[:, 2] == 2
    some = model(**options).fit(X[~new], y[~new])
    joined = some.add_task(X[new], y[new])
    assert joined.coef_.shape == ((3, 2) if per_task else (2,))
    error = joined.predict(X[new]) - y[new]
    assert np.sqrt(np.square(error).mean()) < 0.5
    if per_task:  # a slope of its own, which the others know nothing of
        about = some.trend_mean_[..., 1].mean()
        steep = some.add_task(X[new], y[new] + 10.0 * (X[new, 1] - about))
        np.testing.assert_allclose(steep.coef_[2] - joined.coef_[2], [0, 10], atol=1e-3)
        np.testing.assert_allclose(steep.predict(Z[:2]), joined.predict(Z[:2]))
    value = joined.log_marginal_likelihood(joined.theta_)
    np.testing.assert_allclose(joined.log_marginal_likelihood(), value)


def test_add_task_needs_rows_for_its_own_coefficients():
    X, y, _ = draw()
    new = np.flatnonzero(X[:, 2] == 2)
    some = model(trend_per_task=True).fit(X[X[:, 2] < 2], y[X[:, 2] < 2])
    with pytest.raises(ValueError, match="n_samples=1 of the new task is too few for"):
        some.add_task(X[new[:1]], y[new[:1]])
    with pytest.raises(ValueError, match="new task has 2 rows and 2 coeff"):
        some.add_task(X[new[:2]], y[new[:2]])


@pytest.mark.parametrize("per_task", SETS)
def test_partial_fit_is_the_model_of_all_rows(per_task):
    X, y, Z = draw(slope=2.0)
    options = {"trend_per_task": per_task, "normalize_y": "shared"}
    grown = model(**options).fit(X[:40], y[:40]).partial_fit(X[40:], y[40:])
    theta = grown.theta_
    likelihood = grown._likelihoods[0]
    expected = likelihood.posterior(theta)
    F, tasks = Z[:, :2], Z[:, 2].astype(int)
    means = expected.mean(F, tasks) * grown.y_scale_ + grown.y_mean_
    np.testing.assert_allclose(grown.predict(Z), means, rtol=1e-9)
    found = expected.coefficients_in_units()[0]
    np.testing.assert_allclose(grown.coef_, found if per_task else found[0])
    assert len(likelihood.y) == 48


def test_rows_that_go_must_leave_the_trend():
    X, y, _ = draw(slope=2.0)
    fitted = model(trend_per_task=True).fit(X, y)
    with pytest.raises(ValueError, match=r"3 rows that are kept tell . of the 6"):
        fitted.partial_fit(X[:1] + 0.1 * np.array([1, 1, 0]), y[:1], max_rows=3)
    kept = fitted.partial_fit(X[:1] + 0.1 * np.array([1, 1, 0]), y[:1], max_rows=30)
    assert len(kept.y_train_) == 30


@pytest.mark.parametrize("per_task", SETS)
def test_compiled_predictions(per_task):
    X, y, Z = draw(slope=2.0)
    for units in ("shared", "per_task"):
        fitted = model(trend_per_task=per_task, normalize_y=units).fit(X, y)
        compiled = compile_predictor(fitted, task=1)
        found = [compiled(z) for z in Z[:, :2]]
        expected = fitted.predict(np.column_stack([Z[:, :2], np.ones(4)]))
        np.testing.assert_allclose(np.ravel(found), expected, rtol=1e-10)


def test_compiled_transformers():
    X, y, Z = draw(slope=2.0)
    fitted = model(PolynomialFeatures(2, include_bias=False)).fit(X, y)
    compiled = compile_predictor(fitted, task=0)
    Z[:, 2] = 0
    found = np.ravel([compiled(z) for z in Z[:, :2]])
    np.testing.assert_allclose(found, fitted.predict(Z), rtol=1e-9)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
def test_hyperparameters_of_the_posterior():
    X, y, Z = draw(n=24, slope=2.0)
    for asked in ("map", "sampled"):
        fitted = model(hyperparameters=asked, n_draws=4).fit(X, y)
        assert fitted.hyperparameters_ == asked
        assert (fitted.coef_std_ > 0.0).all()
        mean, std = fitted.predict(Z, return_std=True)
        assert np.isfinite(mean).all()
        assert (std > 0.0).all()
        assert abs(fitted.coef_[1] - 2.0) < 4.0 * fitted.coef_std_[1]
    parts = [part.coefficients_in_units()[0][0] for part in fitted._predictive[0].parts]
    np.testing.assert_allclose(fitted.coef_, np.mean(parts, axis=0))
    compiled = compile_predictor(fitted, task=0)
    row = np.array([[1.0, 2.0, 0.0]])
    np.testing.assert_allclose(compiled(row[0, :2]), fitted.predict(row), rtol=1e-9)


@pytest.mark.parametrize("criterion", ["bic", "loo", "laplace"])
def test_rank_search(criterion):
    X, y, Z = draw(slope=2.0)
    search = RankSearchIC(model(), ranks=(1, 2), criterion=criterion).fit(X, y)
    assert search.best_estimator_.coef_.shape == (2,)
    assert np.isfinite(search.predict(Z)).all()


def test_grid_search_over_trends_and_persistence():
    X, y, Z = draw(slope=20.0)
    grid = {"trend": [None, [1], "linear"]}
    folds = TaskStratifiedKFold(3, task_feature=-1)
    search = GridSearchCV(model(None, max_iter=20, tol=1.0), grid, cv=folds).fit(X, y)
    assert search.best_params_["trend"] is not None
    best = search.best_estimator_
    again = pickle.loads(pickle.dumps(best))
    np.testing.assert_array_equal(again.predict(Z), best.predict(Z))
    forgotten = clone(best).set_params(trend=[0]).fit(X, y).set_params(trend=None)
    assert not hasattr(forgotten.fit(X, y), "coef_")


def test_skops(tmp_path):
    io = pytest.importorskip("skops.io")
    X, y, Z = draw(slope=2.0)
    fitted, file = model("linear", trend_per_task=True).fit(X, y), tmp_path / "a.skops"
    io.dump(fitted, file)
    found = io.get_untrusted_types(file=file)
    own = {"model.trend.Trend", "model.trend.Basis", "_data.trend.TrendColumns"}
    own |= {"inference.flat.Coefficients", "inference.flat.Flat"}
    assert {f"skmtgp.{name}" for name in own} <= set(found)
    again = io.load(file, trusted=found)
    np.testing.assert_array_equal(told(again, Z)[0], told(fitted, Z)[0])
    np.testing.assert_array_equal(again.coef_, fitted.coef_)


def test_the_other_models():
    X, y, _ = draw(slope=2.0)
    independent = IndependentGP(trend=[1], trend_per_task=True).fit(X, y)
    assert independent.coef_.shape == (3, 1)
    pooled = PooledGP(trend=[1]).fit(X, y)
    assert abs(pooled.coef_[0] - 2.0) < 1.0
    far = np.array([[1.0, 100.0, 9.0]])  # a task that was never seen
    np.testing.assert_allclose(pooled.predict(far), 200.0, atol=60.0)


def test_tasks_that_were_never_seen():
    X, y, _ = draw(slope=2.0)
    new = np.array([[1.0, 100.0, 9.0]])
    shared = model(shared=True, normalize_y="shared").fit(X, y)
    assert abs(shared.predict(new)[0] - 200.0) < 60.0
    own = model(shared=True, normalize_y="shared", trend_per_task=True).fit(X, y)
    with pytest.raises(ValueError, match="trend_per_task=True a task needs rows"):
        own.predict(new)


def test_draws_have_the_spread_of_the_coefficients():
    X, y, Z = draw(slope=2.0)
    fitted = model().fit(X, y)
    mean, std = fitted.predict(Z, return_std=True)
    draws = fitted.sample_y(Z, 2000)
    np.testing.assert_allclose(draws.mean(axis=1), mean, atol=0.15 * std.max())
    np.testing.assert_allclose(draws.std(axis=1), std, rtol=0.1)


def test_complete_data_are_dense():
    x = np.linspace(0, 6, 12)
    X = np.column_stack([np.tile(x, 2), np.repeat([0, 1], 12)])
    y = np.sin(X[:, 0]) * (1 + X[:, 1]) + X[:, 0]
    y += 0.1 * np.random.default_rng(0).standard_normal(24)
    fitted = MultiTaskGPRegressor(rank=1, trend=[0]).fit(X, y)
    assert fitted.complete_
    assert fitted.inference_ == "dense"


class Own(Dense):
    name, takes_trend = "own", False


REFUSED = {
    "kronecker": (
        {"inference": "kronecker"},
        "'kronecker' takes no trend, and trend has 2 .* no Kronecker .* 'sparse' where",
    ),
    "own engine": ({"inference": Own()}, "'own' takes no trend.* knows nothing of tr"),
    "no column": ({"trend": [7]}, "element of trend=7 is out of range"),
    "no name": ({"trend": ["z"]}, "element of trend='z' names a column, but X has no"),
    "the task": ({"trend": [0, 2]}, r"trend=\[0, 2\] has the task column, 2: a label"),
    "twice": ({"trend": [0, 0]}, r"trend=\[0, 0\] names a column twice"),
    "none": ({"trend": []}, "trend is empty"),
    "a word": ({"trend": "quadratic"}, "'trend' parameter .*PolynomialFeatures"),
    "a float": ({"trend": [0.5]}, "element of trend=0.5 must be the position"),
    "no trend": ({"trend": None, "trend_per_task": True}, "needs a trend"),
    "own means": (
        {"trend": "linear", "normalize_y": "per_task"},
        "subtracts the means .* in each task, which leaves nothing of '1'",
    ),
    "a transformer": (
        {"trend": PolynomialFeatures(60)},
        "n_samples=48 is too few for the 1891 coefficients .*'x0 x1', ... .1891 in all",
    ),
    "descriptor": (
        {"trend": [1], "task_descriptors": [1]},
        r"trend=\[1\] has 1, which is one of the task_descriptors",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case):
    options, message = REFUSED[case]
    X, y, _ = draw()
    X[:, 1] = X[:, 1] if case != "descriptor" else X[:, 2]
    error = TypeError if case == "a float" else ValueError
    with pytest.raises(error, match=message):
        MultiTaskGPRegressor(**{"trend": [0, 1], "rank": 1} | options).fit(X, y)


def test_columns_that_cannot_be_told():
    X, y, _ = draw()
    X = np.column_stack([X[:, 0], 3.0 * X[:, 0] - 1.0, np.ones(48), X])
    with pytest.raises(ValueError, match=r"'(x.)' is .* the others \((?!.*'\1')"):
        MultiTaskGPRegressor(trend=[0, 1, 2]).fit(X, y)
    with pytest.raises(ValueError, match="'x2' is zero everywhere"):
        MultiTaskGPRegressor(trend=[0, 2]).fit(X * [1, 1, 0, 1, 1, 1], y)
    few = (X[:, -1] < 2) | (np.arange(48) < 3)
    own = MultiTaskGPRegressor(trend=[0, 4], trend_per_task=True)
    with pytest.raises(ValueError, match="n_samples=1 of task 2 is too few for the"):
        own.fit(X[few], y[few])
    same = X.copy()
    same[same[:, -1] == 1, 3] = 2.0
    own.set_params(trend="linear")
    with pytest.raises(ValueError, match=r"of task 1 .* linear comb.*DotProduct"):
        own.fit(same[:, 3:], y)
    with pytest.raises(ValueError, match="n_samples=2 leaves nothing to learn"):
        MultiTaskGPRegressor(trend=[0, 2]).fit(X[:2], y[:2])


def test_tools_that_take_no_trend():
    X, y, _ = draw(slope=2.0)
    fitted = model(normalize_y="shared").fit(X, y)
    with pytest.raises(ValueError, match=r"without a trend, .* columns 'x0', 'x1'"):
        TaskIdentifier(fitted).predict_proba(X[:3, :2], y[:3])
    with pytest.raises(ValueError, match=r"TransferDisplay compares .* no trend"):
        TransferDisplay.from_estimator(fitted)


@examples(12)
@given(seeds, st.sampled_from(UNITS), st.booleans(), st.sampled_from([1e-6, 7.0, 1e6]))
def test_units_orders_and_names_of_tasks_do_not_matter(seed, units, per_task, unit):
    X, y, Z = draw(seed, n=24, slope=2.0)
    fitted = model(normalize_y=units, trend_per_task=per_task, max_iter=0).fit(X, y)
    mean, std = fitted.predict(Z, return_std=True)
    # another unit of a column; the kernel follows
    factor = np.array([1.0, unit, 1.0])
    kernel = RBF([1.0, 9.0 * unit], (1e-9, 1e9))
    rescaled = clone(fitted).set_params(kernel=kernel).fit(X * factor, y)
    close = {"rtol": 1e-7, "atol": 1e-7}
    np.testing.assert_allclose(rescaled.predict(Z * factor), mean, **close)
    np.testing.assert_allclose(rescaled.coef_ * factor[:2], fitted.coef_, **close)
    values = [of.log_marginal_likelihood_value_ for of in (fitted, rescaled)]
    np.testing.assert_allclose(*values, **close)
    # another order of the rows
    order = np.random.default_rng(seed).permutation(24)
    other = clone(fitted).fit(X[order], y[order])
    np.testing.assert_allclose(other.predict(Z, return_std=True), (mean, std), **close)
    # other names of the tasks, which are alike before anything is learned
    names = np.array([5.0, 4.0, 9.0])
    named = [np.column_stack([of[:, :2], names[of[:, 2].astype(int)]]) for of in (X, Z)]
    alike = clone(fitted).set_params(rank=0, shared=True)
    before, after = clone(alike).fit(X, y), alike.fit(named[0], y)
    told = [
        before.predict(Z, return_std=True),
        after.predict(named[1], return_std=True),
    ]
    np.testing.assert_allclose(*told, **close)
    found = after.coef_[[1, 0, 2]] if per_task else after.coef_
    np.testing.assert_allclose(found, before.coef_, **close)
