"""Densities of the hyperparameters beside the likelihood."""

import warnings

import building
import numpy as np
import pytest
import textbook
from scipy.stats import norm
from scipy.stats import t as student
from sklearn.gaussian_process.kernels import RBF

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.posing import pose
from skmtgp._estimators.reading import read
from skmtgp.learning.penalised import (
    AlikeNoise,
    Penalised,
    SomeNoise,
    count_equal,
    told,
)
from skmtgp.model.task_covariance import low_rank

M = 4


def likelihood(seed=0):
    rng, tasks = np.random.default_rng(seed), np.repeat(np.arange(M), 6)
    X = rng.uniform(0.0, 5.0, (len(tasks), 1))
    y = np.sin(X[:, 0]) + 0.2 * rng.standard_normal(len(tasks))
    return building.dense(RBF(), low_rank(M, 1), X, tasks, y, n_noise=M)


THETA = np.r_[0.2, 1.0, 0.8, 1.2, 0.9, np.log([0.01, 0.1, 0.02, 0.5])]


def test_density_by_the_book():
    """Normal around a mean of which nothing is known, which is integrated out."""
    density = AlikeNoise(likelihood().prior, 1.5)
    logs = THETA[-M:]
    means = np.linspace(-60.0, 60.0, 200_001)
    by_mean = norm.logpdf(logs[:, None], means, 1.5).sum(axis=0)
    away = THETA.copy()
    away[-1] += 1.3
    other = norm.logpdf(away[-M:][:, None], means, 1.5).sum(axis=0)
    expected = np.log(np.exp(other).sum()) - np.log(np.exp(by_mean).sum())
    found = density.log_density(away)[0] - density.log_density(THETA)[0]
    assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("deviation", [0.3, 0.7, 1.5])
def test_far_away_the_density_falls_exponentially(deviation):
    logs = THETA[-M:]
    away = np.abs(logs - logs.mean()) / deviation
    costs = [a**2 / 2.0 if a < 4.0 else 8.0 + 4.0 * (a - 4.0) for a in away]
    density = AlikeNoise(likelihood().prior, deviation)
    assert density.log_density(THETA)[0] == pytest.approx(-sum(costs), rel=1e-12)


@pytest.mark.parametrize(("known", "rate"), [(0.0, 0.0), (0.02, 0.0), (0.02, 7.0)])
def test_little_noise_by_the_book(known, rate):
    """The tail of Student's t, of the mean of the logarithms; above it is flat."""
    log_little = np.log(0.1)
    density = SomeNoise(likelihood().prior, log_little, known, rate)
    for below in (0.5, 1.2, 3.0):
        noise = 0.1 * np.exp(-below) * np.array([1.0, 0.5, 2.0, 1.0]) - known
        theta = np.r_[THETA[:-M], np.log(np.maximum(noise, 1e-6))]
        away = log_little - np.log(np.exp(theta[-M:]) + known).mean()
        value, gradient = density.log_density(theta)
        expected = student.logpdf(away, 4) - student.logpdf(0.0, 4)
        expected -= rate * (np.sqrt(1.0 + away**2) - 1.0)
        assert value == pytest.approx(expected, rel=1e-12)
        numerical = textbook.derivative(lambda at: density.log_density(at)[0], theta)
        np.testing.assert_allclose(gradient, numerical, rtol=1e-6, atol=1e-8)
    assert density.log_density(THETA + 9.0)[0] == 0.0


def of_shared_noise(constant, n=5, **known):
    """The same tasks, and one of n rows whose targets are all equal; one noise."""
    of, rng = likelihood(), np.random.default_rng(1)
    tasks, y = of.tasks[: 6 * (M - 1)], of.y[: 6 * (M - 1)]
    X = np.vstack([of.X[: len(y)], rng.uniform(0.0, 5.0, (n, 1))])
    y, tasks = np.r_[y, np.full(n, constant)], np.r_[tasks, np.full(n, M - 1)]
    return building.dense(RBF(), low_rank(M, 1), X, tasks, y, n_noise=1, **known)


@pytest.mark.parametrize("n", [2, 5])
def test_equal_targets_tell_nothing_of_noise(n):
    """Of a task without a function, what the noise says is the same with fewer rows."""
    less, more = of_shared_noise(0.0, 1), of_shared_noise(0.0, n)
    theta = np.r_[0.2, 1.0, 0.8, 1.2, 0.0, np.log(0.01)]  # the last has no function
    assert told(less) is less
    other = theta - 3.0 * (np.arange(len(theta)) == len(theta) - 1)
    gains = [told(of).value(other) - told(of).value(theta) for of in (less, more)]
    assert gains[1] == pytest.approx(gains[0], rel=1e-9)
    assert more.value(other) - more.value(theta) > gains[1] + 1.49 * (n - 1)


def test_gradient_beside_equal_targets():
    of, theta = told(of_shared_noise(0.4)), np.r_[THETA[:-M], np.log(0.05)]
    numerical = textbook.derivative(of.value, theta)
    value, gradient = of.value_and_grad(theta)
    assert value == pytest.approx(of.value(theta), rel=1e-12)
    np.testing.assert_allclose(gradient, numerical, rtol=1e-5, atol=1e-6)
    of.fisher_information(theta)  # is that of the likelihood


def test_which_targets_are_equal():
    tasks = np.array([0, 0, 1, 1, 1, 2, 3, 3])
    y = np.array([1.0, 2.0, 3.0, 3.0, 3.0, 5.0, 0.0, 0.0])
    assert count_equal(tasks, y, 4).tolist() == [0.0, 2.0, 0.0, 1.0]
    order = np.random.default_rng(0).permutation(8)  # as for sparse inference
    found = count_equal(tasks[order], y[order], 5)
    assert found.tolist() == [0.0, 2.0, 0.0, 1.0, 0.0]
    assert not count_equal(tasks[2:], y[2:], 4).any()  # nothing else tells the noise


def test_little_noise_is_added():
    penalised = Penalised(likelihood(), SomeNoise(likelihood().prior, np.log(0.3)))
    value, gradient = penalised.value_and_grad(THETA)
    assert value == pytest.approx(penalised.value(THETA), rel=1e-12)
    assert value < likelihood().value(THETA) - 0.1
    numerical = textbook.derivative(penalised.value, THETA)
    np.testing.assert_allclose(gradient, numerical, rtol=1e-5, atol=1e-6)
    expected = likelihood().fisher_information(THETA)
    np.testing.assert_array_equal(penalised.fisher_information(THETA), expected)


@pytest.mark.parametrize("way", ["mode", "map"])
@pytest.mark.parametrize("search", [False, True])
def test_a_rank_with_few_rows_keeps_noise(way, search):
    """Eight tasks of four rows and rank 2: without noise the likelihood is higher."""
    for seed in (0, 1, 3, 4):
        train, test = drawn_rows(seed)
        model = MultiTaskGPRegressor(rank=2, kernel="rbf", hyperparameters=way)
        model = RankSearchIC(model, ranks=[2]) if search else model
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = model.fit(*train)
        model = getattr(model, "best_estimator_", model)
        assert np.min(model.noise_variance_) > 1e-3
        assert model.log_predictive_density(*test).mean() > -30.0


def drawn_rows(seed, n_rows=4, noise=0.2):
    """Training and test rows of eight tasks of two functions in common."""
    rng, n = np.random.default_rng(seed), 8 * n_rows
    x = np.concatenate([rng.uniform(0.0, 6.0, n), rng.uniform(0.0, 6.0, 160)])
    tasks = np.concatenate([np.tile(np.arange(8), n_rows), np.repeat(np.arange(8), 20)])
    W, K = rng.standard_normal((8, 2)), RBF()(x[:, None]) + 1e-9 * np.eye(len(x))
    F = np.linalg.cholesky(K) @ rng.standard_normal((len(x), 2))
    y = (F * W[tasks]).sum(axis=1) + noise * rng.standard_normal(len(x))
    X = np.column_stack([x, tasks])
    return (X[:n], y[:n]), (X[n:], y[n:])


@pytest.mark.parametrize("start", [1e-6, 1e-2, 1.0])
@pytest.mark.parametrize("offset", [0.0, 50.0])
def test_what_is_little(start, offset):
    """A hundredth of the variance, or where learning starts if that is less."""
    X, y = smooth(30, 0.2)
    options = {"normalize_y": False, "task_levels": False, "max_iter": 0}
    model = MultiTaskGPRegressor(noise_variance=start, **options)
    model.fit(X, y + offset)
    [problem] = pose(model, decide(model, read(model, X, y + offset, (None,) * 3)))
    expected = min(start, 1e-2) * np.var(y)
    in_units_of_y = problem.log_little + 2.0 * problem.log_scales[0]
    assert np.exp(in_units_of_y) == pytest.approx(expected)


def test_gradient_and_information():
    penalised = Penalised(likelihood(), AlikeNoise(likelihood().prior, 0.5))
    value, gradient = penalised.value_and_grad(THETA)
    assert value == pytest.approx(penalised.value(THETA), rel=1e-12)
    numerical = textbook.derivative(penalised.value, THETA)
    np.testing.assert_allclose(gradient, numerical, rtol=1e-5, atol=1e-6)
    density = penalised.of_theta
    same = np.where(np.arange(len(THETA)) >= len(THETA) - M, -2.0, THETA)
    slopes = [
        textbook.derivative(lambda t, i=i: density.log_density(t)[1][i], same)
        for i in range(len(THETA))
    ]
    np.testing.assert_allclose(density.information(), -np.array(slopes), atol=1e-6)
    more = penalised.fisher_information(THETA) - likelihood().fisher_information(THETA)
    np.testing.assert_allclose(more, density.information(), atol=1e-9)


def test_a_common_factor_does_not_matter():
    density = AlikeNoise(likelihood().prior, 0.5)
    more = THETA + np.where(np.arange(len(THETA)) >= len(THETA) - M, 3.0, 0.0)
    assert density.log_density(more)[0] == pytest.approx(density.log_density(THETA)[0])
    same = np.where(np.arange(len(THETA)) >= len(THETA) - M, -2.0, THETA)
    assert density.log_density(same)[0] == 0.0


def sensors(seed):
    """Three tasks of many rows and one of four, equally noisy."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(M), [30, 30, 30, 4])
    x = rng.uniform(0.0, 6.0, len(task))
    y = (1.0 + task) * np.sin(x) + 0.2 * rng.standard_normal(len(task))
    return np.column_stack([x, task]), y


@pytest.mark.parametrize("seed", range(4))
def test_few_rows_are_not_fitted_without_noise(seed):
    X, y = sensors(seed)
    model = MultiTaskGPRegressor(rank=1, kernel="rbf", noise="per_task").fit(X, y)
    deviations = np.sqrt(model.noise_variance_)
    assert (deviations > 0.07).all()
    assert (deviations < 0.4).all()
    value = model.log_marginal_likelihood(model.theta_)
    assert model.log_marginal_likelihood_value_ == pytest.approx(value)


def smooth(n, noise, seed=0):
    """Related functions of three tasks, X and y."""
    rng = np.random.default_rng(seed)
    task, x = np.arange(n) % 3, rng.uniform(0.0, 6.0, n)
    y = (1.0 + task) * np.sin(x) + task * np.cos(0.7 * x)
    return np.column_stack([x, task]), y + noise * rng.standard_normal(n)


@pytest.mark.parametrize("n", [21, 90])
def test_smooth_rows_tell_that_there_is_none(n):
    X, y = smooth(n + 60, 0.0)
    model = MultiTaskGPRegressor(normalize_y="shared").fit(X[:n], y[:n])
    assert model.rank_ == 2
    assert model.noise_variance_ < 1e-7 * model.y_scale_**2
    assert np.abs(model.predict(X[n:]) - y[n:]).max() < 0.1
    value = model.log_marginal_likelihood(model.theta_)
    assert model.log_marginal_likelihood_value_ == pytest.approx(value)


def test_known_noise_may_be_all_there_is():
    rng = np.random.default_rng(0)
    X, y = smooth(60, 0.0)
    y = y + 0.3 * rng.standard_normal(60)
    options = {"rank": 2, "kernel": "rbf", "noise": "shared", "normalize_y": "shared"}
    model = MultiTaskGPRegressor(**options)
    learned = model.fit(X, y, alpha=0.5**2)  # more than there is
    assert learned.noise_variance_ < 1e-5


def test_whose_noise_is_alike():
    """Not that of the paper's learning, nor of one function, which leaves misfits."""
    for model, is_some, is_alike in [
        (MultiTaskGPRegressor(), True, True),
        (MultiTaskGPRegressor(learning="staged"), False, False),
        (IndependentGP(), True, True),
        (PooledGP(), False, False),
    ]:
        assert model._some_noise() == is_some
        assert np.isfinite(model._noise_deviation()) == is_alike
