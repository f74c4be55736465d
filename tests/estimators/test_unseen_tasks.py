"""Tasks that were never seen, as draws from the population of those that were."""

import numpy as np
import pytest
from multitask_models import PAPER
from sklearn.base import clone

from skmtgp import MultiTaskGPRegressor, compile_predictor

N_TASKS, N, NEW = 12, 8, 99
QUICK = {"normalize_y": "shared", "noise": "shared", "learning": "staged"}
SHARED = MultiTaskGPRegressor("rbf", rank=1, shared=True, **QUICK)
MODELS = {
    "dense": clone(SHARED).set_params(inference="dense"),
    "Kronecker": SHARED,
    "sparse": clone(SHARED).set_params(inference="sparse", n_inducing=N),
    "diagonal": clone(SHARED).set_params(diagonal=True),
    "laplace": clone(SHARED).set_params(hyperparameters="laplace"),
    "no levels": clone(SHARED).set_params(task_levels=False, rank=2),
}
T = np.linspace(0.0, 6.0, N)


def draw(mean=3.0, seed=0):
    """Functions a + b sin(t), with b of a population, of tasks at the same inputs."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(50.0, 0.5, N_TASKS), mean + rng.normal(0.0, 1.0, N_TASKS)
    X = np.column_stack([np.tile(T, N_TASKS), np.repeat(np.arange(N_TASKS), N)])
    y = np.repeat(a, N) + np.repeat(b, N) * np.sin(X[:, 0])
    return X, y + 0.1 * rng.standard_normal(len(X)), b


def of_task(t, task=NEW):
    return np.column_stack([t, np.full(len(t), float(task))])


X, Y, AMOUNTS = draw()
Z = of_task(np.array([0.3, 1.6, 4.5]))


@pytest.fixture(scope="module")
def fitted():
    return clone(SHARED).fit(X, Y)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_the_mean_and_the_spread_of_the_population(model):
    model = clone(model).fit(X, Y)
    mean, std = model.predict(Z, return_std=True)
    np.testing.assert_allclose(mean, 50.0 + 3.0 * np.sin(Z[:, 0]), atol=1.0)
    truth = np.hypot(0.5, AMOUNTS.std() * np.sin(Z[:, 0]))
    assert (std < 2.0 * truth + 0.3).all()
    assert (std > 0.8 * truth).all()
    known = [model.predict(of_task(Z[:, 0], m)) for m in range(N_TASKS)]
    np.testing.assert_allclose(mean, np.mean(known, axis=0), atol=0.2)


def test_loadings_around_zero():
    X, y, amounts = draw(mean=0.0, seed=2)
    mean, std = clone(SHARED).fit(X, y).predict(Z, return_std=True)
    truth = np.hypot(0.5, np.sqrt(np.mean(amounts**2)) * np.sin(Z[:, 0]))
    np.testing.assert_allclose(mean, 50.0, atol=1.0)
    np.testing.assert_allclose(std, truth, rtol=0.5)


def test_as_a_task_that_joins_with_a_row_that_tells_nothing(fitted):
    joined = fitted.add_task(of_task([3.1415]), [Y.mean()])
    mean, std = fitted.predict(Z, return_std=True)
    of_joined, less = joined.predict(Z, return_std=True)
    np.testing.assert_allclose(mean, of_joined, atol=0.5)
    assert (less < std).all()


def test_all_that_predicts_agrees(fitted):
    mean, std = fitted.predict(Z, return_std=True)
    cov = fitted.predict(Z, return_cov=True)[1]
    np.testing.assert_allclose(np.diagonal(cov), std**2, rtol=1e-6)
    low, high = fitted.predict_interval(Z, include_noise=False)
    np.testing.assert_allclose(
        [low, high], mean + 1.96 * np.outer([-1, 1], std), rtol=1e-4
    )
    draws = fitted.sample_y(Z, 4000)
    np.testing.assert_allclose(np.cov(draws), cov, atol=0.15 * cov.max())
    np.testing.assert_allclose(fitted.predict_terms(Z).sum(axis=1), mean)
    compiled = compile_predictor(fitted, NEW)
    np.testing.assert_allclose(compiled(Z[0, :1]), mean[0])


def test_two_tasks_are_two_draws(fitted):
    both = np.vstack([Z, of_task(Z[:, 0], 77)])
    cov = fitted.predict(both, return_cov=True)[1]
    one = fitted.predict(Z, return_cov=True)[1]
    np.testing.assert_allclose(cov[:3, :3], one, rtol=1e-9)
    np.testing.assert_allclose(cov[3:, 3:], one, rtol=1e-9)
    assert (np.diagonal(cov[:3, 3:]) < 0.1 * np.diagonal(one)).all()


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
def test_draws_of_hyperparameters():
    model = clone(SHARED).set_params(
        hyperparameters="sampled", n_draws=8, max_iter=5, random_state=0
    )
    model.fit(X, Y)
    mean, std = model.predict(Z, return_std=True)
    known = [model.predict(of_task(Z[:, 0], m)) for m in range(N_TASKS)]
    np.testing.assert_allclose(mean, np.mean(known, axis=0), atol=0.3)
    assert std.argmin() == 0  # where the sine is near zero
    low, high = model.predict_interval(Z, include_noise=False)
    np.testing.assert_allclose(high - low, 3.92 * std, rtol=0.2)


def test_several_outputs(fitted):
    both = clone(SHARED).fit(X, np.column_stack([Y, -2.0 * Y]))
    mean, std = both.predict(Z, return_std=True)
    np.testing.assert_allclose(mean[:, 1], -2.0 * mean[:, 0], rtol=1e-3)
    np.testing.assert_allclose(
        std[:, 0], fitted.predict(Z, return_std=True)[1], rtol=1e-3
    )


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.NarrowIntervalsWarning")
def test_several_kernels():
    options = {"rank": [0, 1], "shared": [True, False], "learning": "annealed"}
    model = MultiTaskGPRegressor(["rbf", "rbf"], **QUICK | options, max_iter=20)
    model.fit(X, Y)
    mean, std = model.predict(Z, return_std=True)
    known = [model.predict(of_task(Z[:, 0], m)) for m in range(N_TASKS)]
    np.testing.assert_allclose(mean, np.mean(known, axis=0), atol=0.3)
    assert std.argmin() == 0


@pytest.mark.parametrize("name", ["dense", "Kronecker", "sparse"])
def test_after_others_have_joined(name):
    t = np.array([0.5, 1.5, 4.6, 5.5])
    model = clone(MODELS[name]).fit(X, Y)
    before, std = model.predict(Z, return_std=True)
    more = model.add_task(of_task(t, 50), 50.0 + 20.0 * np.sin(t))
    change = more.predict(Z) - before
    np.testing.assert_allclose(change, 17.0 / 13.0 * np.sin(Z[:, 0]), atol=0.3)
    assert (more.predict(Z, return_std=True)[1][1:] > 2.0 * std[1:]).all()
    more.partial_fit(of_task(t + 0.3, 50), 50.0 + 20.0 * np.sin(t + 0.3))
    change = more.predict(Z) - before
    np.testing.assert_allclose(change, 17.0 / 13.0 * np.sin(Z[:, 0]), atol=0.3)


def test_the_error_says_what_to_set():
    model = MultiTaskGPRegressor(**PAPER, rank=1, max_iter=0).fit(X, Y)
    match = "set the parameter shared=True, or task_descriptors, before fit"
    with pytest.raises(ValueError, match=match):
        model.predict(Z)
