"""Noise of a task that functions have followed: it is learned with its own noise."""

import warnings
from functools import cache

import numpy as np
import pytest
from scipy.stats import norm

from skmtgp import MultiTaskGPRegressor, RankSearchIC, SingleTaskGP
from skmtgp._estimators import revising
from skmtgp.exceptions import BinaryTargetWarning


def drawn(seed):
    """Three tasks of one smooth function of two inputs, the first one very noisy."""
    rng, counts = np.random.default_rng(seed), [12, 15, 30]
    task = np.repeat(np.arange(3), counts)
    sizes, noise = rng.uniform(0.7, 1.5, 3), np.array([0.7, 0.1, 0.1])
    x, x_test = rng.uniform(0.0, 6.0, (2, len(task), 2))
    z = np.vstack([x, x_test]) / [1.5, 2.2]
    K = np.exp(-0.5 * np.square(z[:, None] - z).sum(axis=2)) + 1e-9 * np.eye(len(z))
    f = np.linalg.cholesky(K) @ rng.standard_normal(len(z))
    y = sizes[task] * f[: len(task)] + noise[task] * rng.standard_normal(len(task))
    test = np.column_stack([x_test, task]), sizes[task] * f[len(task) :]
    return np.column_stack([x, task]), y, *test


def simulated(seed):
    """An exact simulation and some measurements of the same, with noise."""
    rng, task = np.random.default_rng(1000 + seed), np.repeat([0, 1], [60, 14])
    a, b = rng.uniform(0.7, 1.3), rng.normal(0.0, 0.5)
    x = rng.uniform(0.0, 6.0, len(task))
    g = np.sin(4.0 * x) + 0.3 * x
    y = np.where(task == 0, g, a * g + b)
    y += np.array([0.0, 0.15])[task] * rng.standard_normal(len(task))
    z = np.linspace(0.0, 6.0, 200)
    test = np.column_stack([z, np.ones(200)]), a * (np.sin(4.0 * z) + 0.3 * z) + b
    return np.column_stack([x, task]), y, *test


@cache
def learned(estimator, seed):
    """What the defaults of an estimator learn of what `drawn` draws."""
    return estimator().fit(*drawn(seed)[:2])


def error(model, X_test, f_test):
    """Mean squared error over the variance."""
    miss = model.predict(X_test) - f_test
    return np.square(miss).mean() / np.square(f_test - f_test.mean()).mean()


@pytest.mark.parametrize("seed", [2, 8, 12, 14])
@pytest.mark.parametrize("estimator", [MultiTaskGPRegressor, RankSearchIC])
def test_rough_functions_give_way_to_noise_of_the_task(estimator, seed):
    model = learned(estimator, seed)
    assert error(model, *drawn(seed)[2:]) < 0.1
    model = getattr(model, "best_estimator_", model)
    assert model.noise_ == "per_task"
    assert model.noise_variance_[0] > 5.0 * model.noise_variance_[1:].max()


def test_what_is_learned_anew_is_what_noise_per_task_learns():
    X, y, *_ = drawn(12)
    auto = learned(MultiTaskGPRegressor, 12)
    asked = MultiTaskGPRegressor(noise="per_task").fit(X, y)
    value = asked.log_marginal_likelihood_value_
    assert auto.log_marginal_likelihood_value_ == pytest.approx(value, abs=1e-2)
    assert auto.rank_ == asked.rank_


def test_verbose_says_so(told):
    X, y, *_ = drawn(12)
    MultiTaskGPRegressor(verbose=1).fit(X, y)
    lines = told()
    [anew] = [k for k, line in enumerate(lines) if "learned anew" in line]
    assert any(line.startswith("chosen: ") for line in lines[:anew])
    assert any(line.startswith("chosen: ") for line in lines[anew:])


def test_some_outputs_may_need_it():
    X, y, X_test, f_test = drawn(12)
    both = np.column_stack([y, 2.0 * y + 1.0])
    model = MultiTaskGPRegressor().fit(X, both)
    assert model.noise_ == "per_task"
    miss = model.predict(X_test) - np.column_stack([f_test, 2.0 * f_test + 1.0])
    assert (np.square(miss).mean(axis=0) < 0.1 * both.var(axis=0)).all()


@pytest.mark.parametrize("seed", [0, 11, 14, 17, 22])
def test_an_exact_task_does_not_make_another_exact(seed):
    """Without any noise both would be followed, and one of them wildly between."""
    X, y, *test = simulated(seed)
    model = MultiTaskGPRegressor().fit(X, y)
    assert error(model, *test) < 0.1
    assert model.noise_ == "per_task"
    assert 0.05**2 < model.noise_variance_[1] < 0.3**2
    assert model.noise_variance_[0] < 1e-6


def test_nothing_is_learned_anew_where_it_gains_nothing(monkeypatch):
    """Tasks of other functions: little is left to the noise, which they share."""
    rng, task = np.random.default_rng(2), np.repeat([0, 1, 2], 10)
    x = rng.uniform(0.0, 6.0, 30)
    y = np.sin(3.0 * x + 2.0 * task) + 0.1 * rng.standard_normal(30)
    X, told = np.column_stack([x, task]), []
    anew = revising._anew
    monkeypatch.setattr(revising, "hides_noise", lambda problem, mode: True)
    monkeypatch.setattr(
        revising, "_anew", lambda *of: told.append(anew(*of)) or told[-1]
    )
    model = MultiTaskGPRegressor().fit(X, y)
    monkeypatch.undo()
    plain = MultiTaskGPRegressor(noise="shared").fit(X, y)
    assert len(told) == 1
    assert model.noise_ == "shared"
    assert model.n_evaluations_ > plain.n_evaluations_  # both count
    value = plain.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, abs=1e-6)


def test_targets_of_two_values_have_one_noise():
    """A task with one step had none of its own, and was certain elsewhere."""
    rng = np.random.default_rng(8)
    x, task = rng.uniform(0.0, 8.0, 450), np.arange(450) % 5
    chance = 1.0 / (1.0 + np.exp(8.0 - task - 2.0 * x))
    X, y = np.column_stack([x, task]), np.float64(rng.random(450) < chance)
    model = MultiTaskGPRegressor()
    with pytest.warns(BinaryTargetWarning, match="^Output has only two values"):
        model.fit(X[:150], y[:150])
    assert model.noise_ == "shared"
    mean, std = model.predict(X[150:], return_std=True, include_noise=True)
    assert norm.logpdf(y[150:], mean, std).mean() > -0.5
    with pytest.warns(BinaryTargetWarning, match=r"^Output \[2\] has only two"):
        model.set_params(max_iter=0).fit(X, np.column_stack([x, x > 4.0]))


@pytest.mark.parametrize("make", [SingleTaskGP, RankSearchIC])
def test_tasks_alone_are_asked_together(make):
    x, task = np.arange(60.0), np.repeat([0, 1, 2], 20)
    X, y = np.column_stack([x, task]), np.float64(np.arange(60) % 4 == 0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make().fit(X, y)
    told = [w.message for w in caught if w.category is BinaryTargetWarning]
    assert [str(of)[:10] for of in told] == ["Output has"]
    SingleTaskGP(max_iter=0).fit(X, y + task)  # the tasks have other values


def test_few_targets_may_have_two_values():
    X = np.column_stack([np.arange(20.0), np.arange(20) % 2])
    MultiTaskGPRegressor(max_iter=0).fit(X, np.arange(20) // 10)
