"""Models of several terms, as their users see them."""

import pickle

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, Matern
from sklearn.model_selection import GridSearchCV, KFold
from textbook import log_marginal_likelihood

from skmtgp import MultiTaskGPRegressor
from skmtgp.inspection import (
    KernelRelevanceDisplay,
    TaskCovarianceDisplay,
    TransferDisplay,
)

M = 3
SLOW, FAST = RBF(2.0, (0.1, 100.0)), RBF(0.3, (0.01, 10.0))
QUICK = {"normalize_y": "shared", "noise": "shared"}


def draw(seed=0, n=90, levels=0.0):
    """A slow function and a fast one, each of all tasks with a sign and a size."""
    rng = np.random.default_rng(seed)
    x, task = rng.uniform(0.0, 10.0, n), np.tile(np.arange(M), n // M)
    slow = np.array([1.0, -2.0, 0.5])[task] * np.sin(0.6 * x)
    fast = np.array([0.6, 0.4, -0.7])[task] * np.sin(5.0 * x + 1.0)
    y = slow + fast + levels * task + 0.05 * rng.standard_normal(n)
    return np.column_stack([x, task]), y, slow, fast


@pytest.fixture(scope="module")
def data():
    return draw()


@pytest.fixture(scope="module")
def fitted(data, certain_theta):
    return MultiTaskGPRegressor([SLOW, FAST], rank=1, **QUICK).fit(*data[:2])


def by_the_book(model, X, Z, *, output=None):
    """Mean and covariance of f(Z), from the fitted attributes alone."""

    def of(name):
        value = getattr(model, name)
        return value if output is None else value[output]

    def between(A, B):
        x, t, z, u = A[:, :1], A[:, 1].astype(int), B[:, :1], B[:, 1].astype(int)
        total = of("level_variance_") * np.equal.outer(t, u)
        pairs = zip(of("kernel_"), of("task_covariance_"), strict=True)
        return total + sum(K[np.ix_(t, u)] * k(x, z) for k, K in pairs)

    y = model.y_train_ if output is None else model.y_train_[:, output]
    K = between(X, X) + of("noise_variance_") * np.eye(len(X))
    weights = np.linalg.solve(K, between(X, Z))
    mean = of("y_mean_") + weights.T @ (y - of("y_mean_"))
    return mean, between(Z, Z) - weights.T @ between(X, Z)


NEW = np.array([[0.3, 0], [4.0, 1], [7.7, 2], [11.0, 2]])


def test_predictions_follow_from_the_attributes(data, fitted):
    mean, covariance = by_the_book(fitted, data[0], NEW)
    found, std = fitted.predict(NEW, return_std=True)
    np.testing.assert_allclose(found, mean, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(std**2, np.diagonal(covariance), rtol=1e-5, atol=1e-7)
    found = fitted.predict(NEW, return_cov=True)[1]
    np.testing.assert_allclose(found, covariance, rtol=1e-5, atol=1e-7)


def test_one_entry_a_term(fitted):
    assert [type(kernel) for kernel in fitted.kernel_] == [RBF, RBF]
    assert fitted.task_covariance_.shape == (2, M, M)
    assert [factor.shape for factor in fitted.task_factor_] == [(M, 1), (M, 1)]
    for K, L in zip(fitted.task_covariance_, fitted.task_factor_, strict=True):
        np.testing.assert_allclose(L @ L.T, K, rtol=1e-9)
    assert fitted.rank_ == [1, 1]
    assert fitted.diagonal_ == [False, False]
    assert fitted.inference_ == "dense"
    correlation = fitted.task_correlation_
    assert correlation.index.names == ["term", "task"]
    signs = np.sign(correlation.loc[0].to_numpy())
    np.testing.assert_array_equal(signs, [[1, -1, 1], [-1, 1, -1], [1, -1, 1]])
    # 1 of each kernel, M of each factor, levels, noise
    assert fitted.n_hyperparameters_ == 2 * (1 + M) + 2
    assert len(fitted.theta_) == fitted.n_hyperparameters_


def test_likelihood_and_its_gradient(fitted):
    value, gradient = fitted.log_marginal_likelihood(fitted.theta_, eval_gradient=True)
    assert value == pytest.approx(fitted.log_marginal_likelihood_value_, abs=1e-8)
    step = 1e-4 * np.eye(len(gradient))
    at = fitted.theta_ + 0.1
    expected = [
        (
            fitted.log_marginal_likelihood(at + e)
            - fitted.log_marginal_likelihood(at - e)
        )
        / 2e-4
        for e in step
    ]
    found = fitted.log_marginal_likelihood(at, eval_gradient=True)[1]
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


def test_left_out_rows(data, fitted):
    X, y = data[:2]
    mean, std = fitted.loo_predict()
    others = np.arange(len(y)) != 7
    rest = pickle.loads(pickle.dumps(fitted))
    rest.y_train_ = y[others]
    expected, covariance = by_the_book(rest, X[others], X[7:8])
    np.testing.assert_allclose(mean[7], expected[0], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(std[7] ** 2, covariance[0, 0], rtol=1e-5, atol=1e-8)


def test_draws(fitted):
    draws = fitted.sample_y(NEW, 4000, random_state=0)
    mean, std = fitted.predict(NEW, return_std=True)
    np.testing.assert_allclose(draws.mean(axis=1), mean, atol=5 * std.max() / 60)
    np.testing.assert_allclose(draws.std(axis=1), std, rtol=0.1, atol=1e-6)


def test_terms_of_a_prediction(data, fitted):
    X, _, slow, fast = data
    terms = fitted.predict_terms(X)
    assert terms.shape == (len(X), 3)
    np.testing.assert_allclose(terms.sum(axis=1), fitted.predict(X), rtol=1e-9)
    np.testing.assert_allclose(terms[:, 2], fitted.task_level_[X[:, 1].astype(int)])
    for k, truth in enumerate([slow, fast]):
        assert np.corrcoef(terms[:, k], truth)[0, 1] > 0.98


@pytest.mark.parametrize(
    ("normalize_y", "task_levels"),
    [("shared", True), ("per_task", False), (False, True)],
)
def test_terms_sum_to_the_prediction(normalize_y, task_levels):
    X, y, *_ = draw(levels=5.0)
    options = {"normalize_y": normalize_y, "task_levels": task_levels, "max_iter": 5}
    model = MultiTaskGPRegressor([SLOW, FAST], rank=[2, 1], tol=1.0, **options)
    with pytest.warns(UserWarning, match="still growing"):
        model.fit(X, np.column_stack([y, y**2]))
    terms = model.predict_terms(NEW)
    assert terms.shape == (4, 2, 3)
    np.testing.assert_allclose(terms.sum(axis=-1), model.predict(NEW), rtol=1e-9)
    assert model.task_covariance_.shape == (2, 2, M, M)
    assert len(model.kernel_) == 2
    assert [len(kernels) for kernels in model.kernel_] == [2, 2]
    assert model.task_factor_[1][0].shape == (M, 2)
    assert model.task_correlation_.loc[(1, 0)].shape == (M, M)


def test_a_model_of_one_term_has_terms_too(data):
    X, y, *_ = data
    for inference in ("dense", "sparse"):
        model = MultiTaskGPRegressor(SLOW, rank=1, inference=inference, **QUICK)
        model.set_params(n_inducing=20, max_iter=20, tol=5.0).fit(X, y)
        terms = model.predict_terms(NEW)
        assert terms.shape == (4, 2)
        np.testing.assert_allclose(terms.sum(axis=1), model.predict(NEW), rtol=1e-9)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning")
@pytest.mark.parametrize("params", [{}, {"rank": [1]}, {"shared": [True], "rank": 1}])
def test_a_list_of_one_is_no_list(data, params):
    X, y, *_ = data
    plain = {
        name: getattr(of, "__getitem__", lambda _, of=of: of)(0)
        for name, of in params.items()
    }
    listed = MultiTaskGPRegressor([FAST], **params, **QUICK).fit(X, y)
    single = MultiTaskGPRegressor(FAST, **plain, **QUICK).fit(X, y)
    np.testing.assert_array_equal(listed.theta_, single.theta_)
    np.testing.assert_array_equal(listed.predict(X), single.predict(X))
    assert listed.kernel_ == single.kernel_
    assert listed.task_covariance_.shape == (M, M)
    assert listed.rank_ == single.rank_


def test_two_terms_explain_more_than_one(data, fitted):
    X, y, *_ = data
    Z, _, slow, fast = draw(seed=1, n=300)
    one = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, y)
    gain = fitted.log_marginal_likelihood_value_ - one.log_marginal_likelihood_value_
    assert gain > 10.0
    error = [np.square(m.predict(Z) - slow - fast).mean() for m in (fitted, one)]
    assert error[0] < error[1]


def test_default_kernels(data, fitted):
    """Kernels that all begin alike are told apart as they join."""
    model = MultiTaskGPRegressor([None, None], rank=1, **QUICK).fit(*data[:2])
    scales = sorted(kernel.length_scale for kernel in model.kernel_)
    assert scales[1] > 3.0 * scales[0]
    expected = fitted.log_marginal_likelihood_value_
    assert abs(model.log_marginal_likelihood_value_ - expected) < 1.0


def test_the_order_of_kernels_does_not_matter(data, fitted):
    other = MultiTaskGPRegressor([FAST, SLOW], rank=1, **QUICK).fit(*data[:2])
    for name in ("task_covariance_",):
        found, expected = getattr(other, name), getattr(fitted, name)
        np.testing.assert_allclose(found[::-1], expected, rtol=1e-6, atol=1e-6)
    assert [kernel.bounds.tolist() for kernel in other.kernel_] == [
        of.bounds.tolist() for of in (FAST, SLOW)
    ]
    np.testing.assert_allclose(other.predict(NEW), fitted.predict(NEW), rtol=1e-5)


def test_unseen_tasks_by_the_shared_term():
    X, y, *_ = draw(levels=1.0)
    model = MultiTaskGPRegressor(
        [SLOW, FAST], rank=[0, 1], shared=[True, False], **QUICK
    )
    model.fit(X, y)
    unseen = np.column_stack([NEW[:, 0], np.full(4, 9.0)])
    terms = model.predict_terms(unseen)
    of_task = [np.column_stack([NEW[:, 0], np.full(4, m)]) for m in model.tasks_]
    known = np.mean([model.predict_terms(of) for of in of_task], axis=0)
    np.testing.assert_allclose(terms[:, :2], known[:, :2])
    np.testing.assert_allclose(terms[:, 2], model.y_mean_)
    variance = model.predict(unseen, return_std=True)[1] ** 2
    assert (variance > model.level_variance_).all()


def test_persistence_and_clones(data, fitted):
    again = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(again.predict(NEW), fitted.predict(NEW))
    other = clone(fitted)
    assert repr(other) == repr(fitted)
    assert "kernel=[RBF(length_scale=2), RBF(length_scale=0.3)]" in repr(other)
    fitted.kernel[0].set_params(length_scale=3.0)  # that of the parameter alone
    try:
        assert fitted.kernel_[0].length_scale != 3.0
        np.testing.assert_array_equal(again.predict(NEW), fitted.predict(NEW))
    finally:
        fitted.kernel[0].set_params(length_scale=2.0)


def test_frames_and_labels(data):
    X, y, *_ = data
    names = np.array(["a", "b", "c"])[X[:, 1].astype(int)]
    frame = pd.DataFrame({"well": names, "x": X[:, 0]})
    model = MultiTaskGPRegressor([SLOW, FAST], rank=1, task_feature="well", **QUICK)
    model.fit(frame, y)
    assert model.predict_terms(frame[:5]).shape == (5, 3)
    assert list(model.task_correlation_.loc[1].columns) == ["a", "b", "c"]
    assert model.summary().loc["a", "closest"] == "b"


@pytest.mark.long
def test_lists_of_kernels_in_a_grid(data):
    X, y, *_ = data
    grid = [
        {"kernel": [SLOW, [SLOW, FAST]], "rank": [1]},
        {"kernel": [[SLOW, FAST]], "rank": [[1, 0]], "shared": [[False, True]]},
    ]
    model = MultiTaskGPRegressor(**QUICK, tol=1.0)
    folds = KFold(2, shuffle=True, random_state=0)
    search = GridSearchCV(model, grid, cv=folds).fit(X, y)
    assert search.best_params_ == {"kernel": [SLOW, FAST], "rank": 1}


def test_the_posterior_mode(data):
    X, y, *_ = data
    model = MultiTaskGPRegressor([SLOW, FAST], rank=1, hyperparameters="map", **QUICK)
    model.fit(X, y)
    assert model.hyperparameters_ == "map"
    assert abs(model.score(X, y) - 1.0) < 0.01


def test_complete_data_are_dense():
    x = np.linspace(0.0, 8.0, 15)
    X = np.column_stack([np.tile(x, M), np.repeat(np.arange(M), 15)])
    y = np.sin(X[:, 0]) * (1.0 + X[:, 1]) + 0.3 * np.sin(6.0 * X[:, 0])
    model = MultiTaskGPRegressor([SLOW, FAST], rank=1, max_iter=0).fit(X, y)
    assert model.complete_
    assert model.inference_ == "dense"


class TestRefusals:
    @pytest.mark.parametrize(
        ("params", "match"),
        [
            ({"kernel": []}, r"kernel=\[\] has no kernel"),
            ({"kernel": [SLOW, 2]}, r"has 2\. It must have kernels of scikit-learn's"),
            (
                {"rank": [1, 2]},
                r"rank=\[1, 2\] has a value for each term.*is a single one",
            ),
            ({"kernel": [SLOW] * 2, "rank": [1]}, r"rank=\[1\] has 1 values, but .* 2"),
            (
                {"kernel": [SLOW] * 2, "rank": [1, -1]},
                "has -1, but must have an integer of 0",
            ),
            ({"kernel": [SLOW] * 2, "rank": [1, True]}, "has True, but .* an integer"),
            ({"kernel": [SLOW] * 2, "rank": [1, 4]}, "rank=4 is above the number of"),
            ({"kernel": [SLOW] * 2, "rank": [1, 0]}, "rank=0 leaves tasks nothing"),
            (
                {"kernel": [SLOW] * 2, "shared": [1, 0]},
                "has 1, but must have True or F",
            ),
            ({"kernel": [SLOW] * 2, "diagonal": ["own"] * 2}, "'equal' for each"),
            (
                {"kernel": [SLOW] * 2, "learning": "staged"},
                "learning='staged' is for one kernel",
            ),
            (
                {"kernel": [SLOW] * 2, "inference": "kronecker"},
                "inference='kronecker' takes one term.*'dense' or 'auto'.*'sparse'",
            ),
            (
                {"kernel": [SLOW] * 2, "hyperparameters": "sampled"},
                "hyperparameters='sampled' takes one term.*'map' or 'mode'",
            ),
        ],
    )
    def test_bad_parameters(self, data, params, match):
        with pytest.raises(ValueError, match=match):
            MultiTaskGPRegressor(**params).fit(*data[:2])

    def test_a_kernel_that_is_no_covariance(self, data):
        bad = Matern(1.0, nu=0.1)
        with pytest.raises(ValueError, match="nu"):
            MultiTaskGPRegressor([SLOW, bad]).fit(*data[:2])


def test_a_task_that_joins(data, fitted):
    Z, _, slow, fast = draw(seed=2)
    of_first = Z[:, 1] == 0
    slow, fast = -0.5 * slow[of_first], 1.5 * fast[of_first]  # of signs of its own
    new = np.column_stack([Z[of_first, 0], np.full(of_first.sum(), 7)])
    extended = fitted.add_task(new[:12], (slow + fast)[:12])
    assert extended.tasks_.tolist() == [0, 1, 2, 7]
    assert extended.task_covariance_.shape == (2, 4, 4)
    error = extended.predict(new[12:]) - (slow + fast)[12:]
    assert np.square(error).mean() < 0.05 * np.var(slow + fast)
    terms = extended.predict_terms(new)
    assert np.corrcoef(terms[:, 1], fast)[0, 1] > 0.95
    # the others stay, and so does this model
    np.testing.assert_allclose(
        extended.task_covariance_[:, :3, :3], fitted.task_covariance_, rtol=1e-9
    )
    assert fitted.tasks_.tolist() == [0, 1, 2]


def test_what_is_printed(data, told):
    X, y, *_ = data
    model = MultiTaskGPRegressor([SLOW, FAST], rank=1, verbose=1, max_iter=3, **QUICK)
    with pytest.warns(UserWarning, match="still growing"):
        model.fit(X, y)
    lines = told()
    for kernel in ("kernel 1 alone", "kernel 2 alone"):
        assert any(line.startswith(f"{kernel}, rank 1: log lik") for line in lines)
    value = model.log_marginal_likelihood_value_
    assert lines[-1] == f"rank 1 + rank 1: log likelihood {value:.1f} (90 rows)"


def test_what_relations_are_worth(data, fitted):
    pytest.importorskip("matplotlib")
    transfer = TransferDisplay.from_estimator(fitted).transfer
    # alone, a task knows nothing of the others: K without what is between it and them
    X, y, *_ = data
    x, task, first = X[:, :1], X[:, 1].astype(int), X[:, 1] == 0
    K = fitted.level_variance_ * np.equal.outer(task, task)
    for k, K_rho in zip(fitted.kernel_, fitted.task_covariance_, strict=True):
        K = K + K_rho[np.ix_(task, task)] * k(x)
    K += fitted.noise_variance_ * np.eye(len(y))
    apart = np.where(np.equal.outer(first, first), K, 0.0)
    z = y - fitted.y_mean_
    expected = log_marginal_likelihood(K, z) - log_marginal_likelihood(apart, z)
    np.testing.assert_allclose(transfer["evidence"][0], expected, rtol=1e-6)
    assert transfer["related"].all()


def test_all_cores(data, fitted):
    X, y, *_ = data
    model = clone(fitted).set_params(n_jobs=2, tol=0.1, max_iter=20)
    found = model.fit(X, np.column_stack([y, -y]))
    np.testing.assert_allclose(*found.predict(NEW).T * [[1.0], [-1.0]], rtol=1e-6)


class TestPictures:
    def test_task_covariance_of_a_term(self, fitted):
        pytest.importorskip("matplotlib")
        display = TaskCovarianceDisplay.from_estimator(fitted, term=1)
        found = display.task_covariance
        np.testing.assert_array_equal(found, fitted.task_covariance_[1])
        with pytest.raises(ValueError, match=r"term=2 .* from 0 to 1, as .* 2 terms"):
            TaskCovarianceDisplay.from_estimator(fitted, term=2)

    def test_relevances_of_all_terms(self, fitted):
        pytest.importorskip("matplotlib")
        display = KernelRelevanceDisplay.from_estimator(fitted)
        assert [part[:6] for part in display.parts] == ["term 0", "term 1"]
