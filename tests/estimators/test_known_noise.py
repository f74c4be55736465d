"""`alpha` in fit, and rows that stand for several measurements."""

import pickle
import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    average_repeats,
)
from skmtgp.exceptions import RepeatedRowsWarning
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.engines import Dense
from skmtgp.inspection import TransferDisplay
from skmtgp.model_selection import TaskStratifiedKFold
from skmtgp.single_task import alone_like

pytestmark = [
    pytest.mark.filterwarnings("ignore:The likelihood was still growing"),
    pytest.mark.filterwarnings("ignore:The rows do not tell the noise variance"),
    pytest.mark.usefixtures("certain_theta"),  # variances are those of the textbook
]

RNG = np.random.default_rng(0)
N = 36
TASK = np.arange(N) % 3
X = np.column_stack([RNG.uniform(0, 6, N), TASK])
ALPHA = RNG.uniform(0.01, 0.4, N)
Y = np.sin(X[:, 0]) * (1 + TASK) + TASK + np.sqrt(ALPHA) * RNG.standard_normal(N)
COUNTS = RNG.integers(1, 5, N).astype(float)
SPREAD = np.where(COUNTS > 1, 0.1, 0.0)
ROWS = np.repeat(np.arange(N), COUNTS.astype(int))
Y_ALL = Y[ROWS] + 0.3 * RNG.standard_normal(len(ROWS))
NEW = np.array([[0.5, 0], [2.5, 1], [5.0, 2], [3.0, 0]])
SHARED = {"normalize_y": "shared", "noise": "shared"}


def averaged(y=Y_ALL):
    few = average_repeats(X[ROWS], y)
    return few[:2], {"sample_weight": few[2], "repeat_variance": few[3]}


@pytest.fixture(scope="module")
def model():
    return MultiTaskGPRegressor(rank=1, **SHARED).fit(X, Y, alpha=ALPHA)


@pytest.mark.parametrize("normalize_y", ["shared", "per_task", False])
@pytest.mark.parametrize("noise", ["shared", "per_task"])
def test_predictions_are_those_of_the_textbook(normalize_y, noise):
    """From what is told after fit, in units of y."""
    options = {"normalize_y": normalize_y, "noise": noise, "max_iter": 20}
    model = MultiTaskGPRegressor(rank=1, **options)
    model.fit(X, Y, alpha=ALPHA, sample_weight=COUNTS, repeat_variance=SPREAD)

    def covariance(A, B):
        of_A, of_B = A[:, 1].astype(int), B[:, 1].astype(int)
        K = model.task_covariance_[np.ix_(of_A, of_B)] * model.kernel_(
            A[:, :1], B[:, :1]
        )
        level = np.broadcast_to(model.level_variance_, 3)
        return K + level[of_A][:, None] * np.equal.outer(of_A, of_B)

    learned = np.broadcast_to(model.noise_variance_, 3)[TASK]
    of_row = (learned + ALPHA) / COUNTS
    K, k = covariance(X, X) + np.diag(of_row), covariance(NEW, X)
    mean = np.broadcast_to(model.y_mean_, 3)
    residual = Y - mean[TASK]
    new = NEW[:, 1].astype(int)
    expected = mean[new] + k @ np.linalg.solve(K, residual)
    variance = np.diag(covariance(NEW, NEW) - k @ np.linalg.solve(K, k.T))
    found, std = model.predict(NEW, return_std=True)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    np.testing.assert_allclose(std, np.sqrt(variance), rtol=1e-7)
    P = np.linalg.inv(K)
    left_out = model.loo_predict(include_noise=True)
    np.testing.assert_allclose(
        left_out[0], Y - P @ residual / np.diag(P), rtol=1e-7, atol=1e-9
    )
    np.testing.assert_allclose(left_out[1], 1 / np.sqrt(np.diag(P)), rtol=1e-7)
    value = -0.5 * (
        residual @ P @ residual + np.linalg.slogdet(K)[1] + N * np.log(2 * np.pi)
    )
    v = learned + ALPHA
    more = (COUNTS - 1) * np.log(2 * np.pi * v) + np.log(COUNTS) + COUNTS * SPREAD / v
    value -= 0.5 * more.sum()
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize(
    "options",
    [
        {"noise": "shared"},
        {"noise": "per_task", "diagonal": True},
        {"noise": "per_task", "normalize_y": "per_task"},
        {"task_levels": False, "shared": True, "rank": 0},
        {"kernel": [RBF(2.0), RBF(0.4)]},
    ],
    ids=str,
)
def test_gradients(options):
    options = {"rank": 1, "max_iter": 3, "normalize_y": "shared"} | options
    model = MultiTaskGPRegressor(**options)
    model.fit(X, Y, alpha=ALPHA, sample_weight=COUNTS, repeat_variance=SPREAD)
    theta = model.theta_ + 0.1 * RNG.standard_normal(len(model.theta_))
    gradient = model.log_marginal_likelihood(theta, eval_gradient=True)[1]
    for i, one in enumerate(1e-5 * np.eye(len(theta))):
        up, down = (model.log_marginal_likelihood(theta + s * one) for s in (1, -1))
        assert gradient[i] == pytest.approx((up - down) / 2e-5, rel=2e-5, abs=1e-5)


def test_it_is_scikit_learns_where_the_models_coincide():
    task_column = np.zeros((N, 1))
    kernel = ConstantKernel(3.0) * RBF(1.2)
    theirs = GaussianProcessRegressor(kernel, alpha=ALPHA, optimizer=None)
    theirs.fit(X[:, :1], Y)
    ours = PooledGP(
        RBF(1.2, "fixed"),
        noise_variance=0,
        noise_variance_bounds="fixed",
        normalize_y=False,
    ).fit(np.hstack([X[:, :1], task_column]), Y, alpha=ALPHA)
    theirs = theirs.set_params(
        kernel=ConstantKernel(ours.task_covariance_.item()) * RBF(1.2)
    ).fit(X[:, :1], Y)
    assert ours.noise_variance_ == 0.0
    assert ours.log_marginal_likelihood_value_ == pytest.approx(
        theirs.log_marginal_likelihood_value_, rel=1e-9
    )
    at = np.column_stack([NEW[:, 0], np.zeros(4)])
    for found, expected in zip(
        ours.predict(at, return_std=True),
        theirs.predict(NEW[:, :1], return_std=True),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-7)


@pytest.mark.parametrize("estimator", [IndependentGP, PooledGP, MultiTaskGPRegressor])
@pytest.mark.parametrize(
    "noise", ["per_task", pytest.param("shared", marks=pytest.mark.long)]
)
def test_means_of_repeats_are_all_measurements(estimator, noise):
    options = {"noise": noise, "max_iter": 3}
    options |= {} if estimator is PooledGP else {"normalize_y": "per_task"}
    of_all = estimator(**options).fit(X[ROWS], Y_ALL)
    data, known = averaged()
    few = estimator(**options).fit(*data, **known)
    np.testing.assert_allclose(few.y_mean_, of_all.y_mean_, rtol=1e-12)
    np.testing.assert_allclose(few.y_scale_, of_all.y_scale_, rtol=1e-12)
    theta = of_all.theta_
    value, gradient = few.log_marginal_likelihood(theta, eval_gradient=True)
    expected = of_all.log_marginal_likelihood(theta, eval_gradient=True)
    assert value == pytest.approx(expected[0], rel=1e-10)
    np.testing.assert_allclose(gradient, expected[1], rtol=1e-7, atol=1e-7)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    scale=st.floats(0.01, 100),
    normalize_y=st.sampled_from(["shared", "per_task"]),
)
def test_laws(seed, scale, normalize_y):
    """Posteriors of repeats, of other units and of rows in another order are one."""
    rng = np.random.default_rng(seed)
    options = {"max_iter": 0, "normalize_y": normalize_y, "noise": "shared"}
    options["kernel"] = RBF(1.3)  # its default depends on the rows
    y = Y[ROWS] + 0.3 * rng.standard_normal(len(ROWS))
    alpha = rng.uniform(0.0, 0.3, N)
    of_all = IndependentGP(**options).fit(X[ROWS], y, alpha=alpha[ROWS])
    data, known = averaged(y)
    few = IndependentGP(**options).fit(*data, alpha=alpha, **known)
    expected = of_all.predict(NEW, return_std=True)
    np.testing.assert_allclose(few.predict(NEW, return_std=True), expected, rtol=1e-7)
    order = rng.permutation(N)
    known = {name: scale**2 * of[order] for name, of in known.items()}
    known["sample_weight"] = known["sample_weight"] / scale**2
    known["alpha"] = scale**2 * alpha[order]
    other = IndependentGP(**options)
    other.fit(data[0][order], scale * data[1][order], **known)
    mean, std = other.predict(NEW, return_std=True)
    np.testing.assert_allclose(mean / scale, expected[0], rtol=1e-7)
    np.testing.assert_allclose(std / scale, expected[1], rtol=1e-7)


def test_exact_rows_count_more():
    """The noisier half hardly moves the function; without alpha it does."""
    x, task = np.tile(np.linspace(0, 6, 20), 2), np.zeros(40)
    noisy = np.arange(40) >= 20
    y = np.sin(x) + np.where(noisy, 2.0, 0.02) * RNG.standard_normal(40)
    rows, alpha = np.column_stack([x, task]), np.where(noisy, 4.0, 4e-4)
    known, unknown = PooledGP().fit(rows, y, alpha=alpha), PooledGP().fit(rows, y)
    errors = [np.abs(of.predict(rows) - np.sin(x)).max() for of in (known, unknown)]
    assert errors[0] < 0.1 < errors[1]
    assert known.noise_variance_ < 1e-2


def test_several_outputs():
    Y2 = np.column_stack([Y, -3 * Y])
    alpha = np.column_stack([ALPHA, 9 * ALPHA])
    both = PooledGP(max_iter=10).fit(X, Y2, alpha=alpha)
    one = PooledGP(max_iter=10).fit(X, -3 * Y, alpha=9 * ALPHA)
    np.testing.assert_allclose(both.predict(NEW)[:, 1], one.predict(NEW), rtol=1e-8)


def test_single_tasks():
    model = SingleTaskGP(max_iter=10).fit(X, Y, alpha=ALPHA)
    of_one = TASK == 1
    alone = PooledGP(max_iter=10, noise="shared").fit(
        np.column_stack([X[of_one, 0], np.zeros(of_one.sum())]),
        Y[of_one],
        alpha=ALPHA[of_one],
    )
    np.testing.assert_allclose(
        model.predict(NEW[1:2]), alone.predict([[NEW[1, 0], 0]]), rtol=1e-8
    )


def test_a_search_counts_all_measurements():
    data, known = averaged()
    search = RankSearchIC(MultiTaskGPRegressor(max_iter=5), ranks=(1, 2), simpler=True)
    table = search.fit(*data, **known).results_
    deviance = -2 * table["log_marginal_likelihood"]
    expected = deviance + table["n_hyperparameters"] * np.log(len(ROWS))
    np.testing.assert_allclose(table["bic"], expected, rtol=1e-12)
    assert "single tasks" in table["model"].tolist()


def test_through_pipelines_and_searches(model):
    pipeline = make_pipeline(
        FunctionTransformer(), MultiTaskGPRegressor(rank=1, **SHARED)
    )
    pipeline.fit(X, Y, multitaskgpregressor__alpha=ALPHA)
    np.testing.assert_allclose(pipeline.predict(NEW), model.predict(NEW))
    search = GridSearchCV(
        PooledGP(max_iter=5), {"tol": [1.0, 0.1]}, cv=TaskStratifiedKFold(3)
    )
    assert search.fit(X, Y, alpha=ALPHA).best_estimator_._known.variance.shape == (N, 1)


def test_frames():
    frame = pd.DataFrame(X, columns=["x", "task"])
    alpha = pd.Series(ALPHA, name="variance")
    model = PooledGP(max_iter=5, task_feature="task").fit(frame, Y, alpha=alpha)
    expected = PooledGP(max_iter=5).fit(X, Y, alpha=ALPHA).predict(NEW)
    new = pd.DataFrame(NEW, columns=["x", "task"])
    np.testing.assert_allclose(model.predict(new), expected)


def test_rows_and_tasks_that_join_later(model):
    """Nothing is known of their noise."""
    joined = pickle.loads(pickle.dumps(model)).partial_fit(X[:2] + [[0.05, 0]], Y[:2])
    assert joined._known.variance[-2:].tolist() == [[0.0], [0.0]]
    assert joined._known.variance[:-2, 0].tolist() == ALPHA.tolist()
    again = joined._likelihoods[0].posterior(joined._posteriors[0].theta)
    np.testing.assert_allclose(
        joined._posteriors[0].alpha, again.alpha, rtol=1e-6, atol=1e-8
    )
    with_task = model.add_task([[1.0, 7], [2.0, 7], [4.0, 7]], [1.0, 1.1, -0.6])
    assert with_task._known.counts.shape == (N + 3,)


@pytest.mark.parametrize("normalize_y", ["shared", "per_task"])
def test_all_noise_may_be_known(normalize_y):
    """Nothing is learned then, and rows that join would be exact."""
    options = {"noise_variance": 0, "noise_variance_bounds": "fixed", "max_iter": 5}
    model = MultiTaskGPRegressor(rank=1, normalize_y=normalize_y, **options)
    model.fit(X, Y, alpha=ALPHA)
    assert np.all(model.noise_variance_ == 0.0)
    of_f = model.predict(NEW, return_std=True)[1]
    of_y = model.predict(NEW, return_std=True, include_noise=True)[1]
    np.testing.assert_array_equal(of_f, of_y)
    before = model.predict(NEW)
    for join in (model.partial_fit, model.add_task):
        with pytest.raises(ValueError, match="of rows that join none is known"):
            join([[1.0, 7.0]], [0.5])
    np.testing.assert_array_equal(model.predict(NEW), before)
    first = PooledGP(**options)
    with pytest.raises(ValueError, match="noise_variance=0 leaves the noise to alpha"):
        first.partial_fit(X, Y)


def test_drawn_hyperparameters():
    options = {"hyperparameters": "sampled", "n_draws": 8, "random_state": 0}
    model = MultiTaskGPRegressor(rank=1, **SHARED, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # few draws
        model.fit(X, Y, alpha=ALPHA)
    assert np.isfinite(model.predict(NEW, return_std=True)).all()


def test_which_tasks_help(model, monkeypatch):
    """The models of single tasks that it is compared with know the noise, too."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("skmtgp.inspection._transfer.ENOUGH", 0)  # rows: no folds
    display = TransferDisplay.from_estimator(model)
    kernels = model._likelihoods[0].prior.kernels
    alone = alone_like(model, kernels).set_params(task_feature=-1)
    told = alone.fit(X, Y, alpha=ALPHA).loo_predict(include_noise=True)
    density = pd.Series(norm.logpdf(Y, *told)).groupby(TASK).mean()
    found = display.transfer["log_density_alone"]
    np.testing.assert_allclose(found, density, rtol=1e-6)


class Own(Dense):
    name = "own"
    takes_known = False


@pytest.mark.parametrize(
    ("inference", "why"),
    [
        ("kronecker", "is no Kronecker product"),
        ("sparse", "one noise variance for each task"),
        (Own(), "this engine knows nothing of it"),
    ],
)
def test_engines_that_cannot(inference, why):
    rows = np.column_stack([np.repeat(np.arange(12.0), 3), TASK])
    with pytest.raises(ValueError, match=f"takes no alpha, and .*{why}"):
        MultiTaskGPRegressor(rank=1, inference=inference).fit(rows, Y, alpha=ALPHA)
    auto = MultiTaskGPRegressor(rank=1, max_iter=2).fit(rows, Y, alpha=ALPHA)
    assert auto.inference_ == "dense"


def test_refusals():
    with pytest.raises(
        ValueError, match="are in units of y, but with target_transform"
    ):
        PooledGP(target_transform=(np.sinh, np.arcsinh)).fit(X, Y, alpha=0.1)
    with pytest.raises(
        ValueError, match="are in units of y, but with target_transform"
    ):
        SingleTaskGP(target_transform=(np.sinh, np.arcsinh)).fit(X, Y, alpha=0.1)
    for options in ({}, {"noise_variance_bounds": "fixed"}):
        with pytest.raises(
            ValueError, match="noise_variance=0 leaves the noise to alp"
        ):
            PooledGP(noise_variance=0, **options).fit(X, Y)
    model = PooledGP(max_iter=2).fit(X, Y)
    before = model.predict(NEW)
    with pytest.raises(ValueError, match="alpha has -1"):
        model.fit(X, Y, alpha=-1.0)
    np.testing.assert_array_equal(model.predict(NEW), before)


def test_dask_rows():
    array = pytest.importorskip("dask.array")
    rows, y = array.from_array(X, (12, 2)), array.from_array(Y, 12)
    with pytest.raises(ValueError, match="alpha or sample_weight needs the rows in"):
        PooledGP(inference="sparse").fit(rows, y, alpha=0.1)


@pytest.mark.parametrize("options", [{}, {"inference": "sparse", "n_inducing": 8}])
def test_rows_of_zero_weight_are_left_out(options):
    """As by bagging, which counts how often it has drawn a row."""
    weights = np.where(np.arange(N) < 6, 0.0, 1.0)
    options |= {"max_iter": 3}
    found = PooledGP(**options).fit(X, Y, sample_weight=weights).predict(NEW)
    expected = PooledGP(**options).fit(X[6:], Y[6:]).predict(NEW)
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    search = RankSearchIC(MultiTaskGPRegressor(**options), ranks=(1,))
    assert len(search.fit(X, Y, sample_weight=weights).best_estimator_.y_train_) == 30


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.RepeatedRowsWarning")
def test_engines_that_take_no_counts_repeat_rows():
    weights = np.where(np.arange(N) < 6, 3, 1)
    options = {"inference": "sparse", "n_inducing": 8, "max_iter": 3}
    found = PooledGP(**options).fit(X, Y, sample_weight=weights).predict(NEW)
    rows = np.repeat(np.arange(N), weights)
    expected = PooledGP(**options).fit(X[rows], Y[rows]).predict(NEW)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_repeats_of_engines_without_counts_are_told():
    options = {"inference": "sparse", "n_inducing": 8, "max_iter": 3}
    weights = np.where(np.arange(N) < 6, 3, 1)
    with pytest.warns(RepeatedRowsWarning, match="'sparse' has a row for each of them"):
        model = PooledGP(**options).fit(X, Y, sample_weight=weights)
    assert len(model.loo_predict()[0]) == weights.sum()
    PooledGP(**options).fit(X, Y, sample_weight=np.ones(N))  # no row is repeated
    fixed = {"noise_variance_bounds": "fixed", **options}
    PooledGP(**fixed).fit(X, Y, sample_weight=weights)  # no noise is learned
    with pytest.raises(ValueError, match="takes no alpha, and only whole weights"):
        PooledGP(**options).fit(X, Y, sample_weight=weights + 0.5)


def test_complete_data_are_not_repeated():
    """Kronecker inference is told what is wrong: the counts, not that rows repeat."""
    rows = np.column_stack([np.repeat(np.arange(12.0), 3), TASK])
    for model in (MultiTaskGPRegressor(rank=1), IndependentGP()):
        model.set_params(inference="kronecker", max_iter=2)
        with pytest.raises(ValueError, match="takes no alpha, and no sample_weight"):
            model.fit(rows, Y, sample_weight=2)
        found = model.fit(rows, Y, sample_weight=np.arange(N) != 4).predict(NEW)
        kept = np.arange(N) != 4
        expected = model.fit(rows[kept], Y[kept]).predict(NEW)
        np.testing.assert_array_equal(found, expected)


def test_weights_of_one_say_nothing():
    rows = np.column_stack([np.repeat(np.arange(12.0), 3), TASK])
    model = MultiTaskGPRegressor(rank=1, max_iter=2)
    model.fit(rows, Y, sample_weight=np.ones(N))
    assert model.inference_ == "kronecker"


def test_kernels_with_noise_of_their_own_take_no_counts():
    """A mean of repeats has not their white noise, each of which is another."""
    kernel = RBF(1.0) + WhiteKernel(0.1)
    with pytest.raises(
        ValueError, match=r"sample_weight counts repeats, but kernel=.*W"
    ):
        PooledGP(kernel).fit(X, Y, sample_weight=2.0)
    PooledGP(kernel, max_iter=2).fit(X, Y, alpha=0.1)


class Forgetting(Dense):
    name = "forgetting"

    def likelihood(self, prior, data):
        return DenseLikelihood(prior, data.X, data.tasks, data.y)


def test_engines_that_forget_what_is_known():
    with pytest.raises(ValueError, match="'forgetting' makes a likelihood without"):
        PooledGP(inference=Forgetting()).fit(X, Y, alpha=0.1)


def test_a_task_that_joins_leaves_the_known_noise(model):
    joined = model.add_task([[1.0, 7], [2.0, 7], [4.0, 7]], [1.0, 1.1, -0.6])
    noise = joined._posteriors[0].noise * joined.y_scale_**2
    learned = joined.noise_variance_
    expected = (learned + ALPHA)[np.argsort(TASK, kind="stable")]
    np.testing.assert_allclose(noise[:N], expected, rtol=1e-9)
    np.testing.assert_allclose(noise[N:], learned, rtol=1e-9)


@pytest.mark.parametrize(
    ("weights", "match"),
    [(np.full(30, 2.0), "BaggingRegressor"), (np.full(30, 2.5), "alpha=1 / sample_w")],
)
def test_weights_that_are_no_counts_are_told(weights, match):
    """Many give inverse variances, as for least squares."""
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(0.0, 6.0, 30), np.arange(30) % 2])
    with pytest.warns(RepeatedRowsWarning, match=match):
        PooledGP(max_iter=1).fit(X, np.sin(X[:, 0]), sample_weight=weights)
