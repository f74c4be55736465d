"""Covariances between rows, and joint draws: their moments, and what they take."""

import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
)
from skmtgp._estimators import predicting
from skmtgp._numerics import memory as _memory
from skmtgp.exceptions import InsufficientMemoryError

rng = np.random.default_rng(0)
X = np.column_stack([rng.uniform(0.0, 6.0, 40), np.arange(40) % 2])
Y = np.sin(X[:, 0]) * (1.0 + 2.0 * X[:, 1]) + 0.1 * rng.standard_normal(40)
QUICK = {"rank": 1, "max_iter": 3}
SAMPLED = {"hyperparameters": "sampled", "n_draws": 4}
SPARSE = {"inference": "sparse", "n_inducing": 8, "n_exact": 20}
MODELS = {
    "dense": MultiTaskGPRegressor("rbf", **QUICK),
    "laplace": MultiTaskGPRegressor("rbf", **QUICK, hyperparameters="laplace"),
    "sampled": MultiTaskGPRegressor("rbf", **QUICK, **SAMPLED),
    "sparse": MultiTaskGPRegressor("rbf", **QUICK, **SPARSE),
    "search": RankSearchIC(MultiTaskGPRegressor("rbf", max_iter=3), ranks=(1, 2)),
    "single": SingleTaskGP("rbf", max_iter=3),
    "linear": BayesianLinearRegression(),
}
pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
]


@pytest.fixture(scope="module", params=MODELS)
def model(request):
    return MODELS[request.param].fit(X, Y)


@pytest.fixture(scope="module")
def dense():
    return MultiTaskGPRegressor("rbf", **QUICK).fit(X, np.column_stack([Y, 5.0 - Y]))


def rows(n):
    return np.column_stack([np.linspace(0.0, 6.0, n), np.arange(n) % 2])


PLACES = {
    "many rows": rows(30),
    "equal rows": np.repeat(rows(5), 3, axis=0),
    "one row": rows(1),
    "far rows": rows(6) + [1e3, 0],
}


@pytest.mark.parametrize("Z", PLACES.values(), ids=PLACES)
def test_draws_have_the_moments_that_are_predicted(dense, Z):
    n_draws = 4000
    mean, covariances = dense.predict(Z, return_cov=True)
    draws = dense.sample_y(Z, n_draws, random_state=1)
    assert draws.shape == (len(Z), 2, n_draws)
    for j in range(2):
        deviations = np.sqrt(np.diagonal(covariances[..., j]))
        error = np.abs(draws[:, j].mean(axis=1) - mean[:, j]) / deviations
        assert error.max() < 5.0 / np.sqrt(n_draws)
        found = np.cov(draws[:, j]).reshape(len(Z), len(Z))
        error = np.abs(found - covariances[..., j]) / np.outer(deviations, deviations)
        assert error.max() < 7.5 / np.sqrt(n_draws)


def test_draws_without_noise_pass_through_the_rows():
    exact = {
        "noise_variance": 1e-9,
        "noise_variance_bounds": "fixed",
        "noise": "shared",
    }
    model = MultiTaskGPRegressor("rbf", rank=1, max_iter=5, **exact)
    model.fit(X, np.sin(X[:, 0]) * (1.0 + X[:, 1]))
    found = model.sample_y(X, 5)
    assert_allclose(found, np.tile(model.y_train_[:, None], 5), atol=1e-3)


def test_covariances_are_those_of_their_parts(model):
    """Symmetric, and with the variances on the diagonal, with and without noise."""
    Z = rows(12)
    for noise in (False, True):
        _, std = model.predict(Z, return_std=True, include_noise=noise)
        _, covariance = model.predict(Z, return_cov=True, include_noise=noise)
        assert_allclose(np.diagonal(covariance), std**2, rtol=1e-9)
        assert_allclose(covariance, covariance.T, rtol=0.0, atol=1e-15)


def test_few_copies_are_made(dense):
    n, peaks = 1000, {}
    for name, of in {"one": MODELS["dense"].fit(X, Y), "two": dense}.items():
        of.predict(rows(3), return_cov=True)
        tracemalloc.start()
        of.predict(rows(n), return_cov=True)
        peaks[name] = tracemalloc.get_traced_memory()[1] / (8.0 * n**2)
        tracemalloc.stop()
    assert peaks["one"] < 3.5  # matrices
    assert peaks["two"] < 4.7


@pytest.mark.parametrize("few", [False, True])
def test_covariances_that_do_not_fit(model, few, monkeypatch):
    """Nothing is computed, unless there are few rows."""
    monkeypatch.setattr(predicting, "MANY", 100 if few else 10)
    monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 30**2)
    if few:
        assert model.predict(rows(30), return_cov=True)[1].shape == (30, 30)
        return
    match = r"^predict\(return_cov=True\) of 30 rows needs about .* GiB of memory, but "
    with pytest.raises(InsufficientMemoryError, match=match + ".*return_std=True"):
        model.predict(rows(30), return_cov=True)
    assert len(model.predict(rows(30), return_std=True)[1]) == 30


@pytest.mark.parametrize("name", ["dense", "sampled", "sparse", "search"])
def test_joint_draws_that_do_not_fit(name, monkeypatch):
    model = MODELS[name].fit(X, Y)
    monkeypatch.setattr(predicting, "MANY", 10)
    monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 30**2)
    with pytest.raises(
        InsufficientMemoryError, match=r"^sample_y of 30 rows needs.*one"
    ):
        model.sample_y(rows(30))


def test_draws_of_single_tasks_and_lines_take_less(monkeypatch):
    """Rows of other tasks are drawn apart, and coefficients without covariances."""
    monkeypatch.setattr(predicting, "MANY", 10)
    single = SingleTaskGP("rbf", max_iter=0).fit(X, Y)
    needed = 8.0 * 15 * (15 * (1 + predicting.BESIDE) + 2 * single._side)
    monkeypatch.setattr(_memory, "available_memory", lambda: needed)
    assert np.isfinite(single.sample_y(rows(30))).all()
    monkeypatch.setattr(_memory, "available_memory", lambda: needed - 1.0)
    with pytest.raises(InsufficientMemoryError, match=r"^sample_y of 15 rows needs"):
        single.sample_y(rows(30))
    assert BayesianLinearRegression().fit(X, Y).sample_y(rows(30)).shape == (30, 1)


def test_draws_that_are_too_many(model, monkeypatch):
    monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 10**6)
    match = r"^sample_y of 2 rows with n_samples=1000000 needs about .*Take fewer draws"
    with pytest.raises(InsufficientMemoryError, match=match):
        model.sample_y(rows(2), 1_000_000)


def test_columns_of_tasks(monkeypatch):
    table = np.column_stack([Y[::2], Y[1::2]])
    model = WideRegressor(SingleTaskGP("rbf", max_iter=0)).fit(X[::2, :1], table)
    monkeypatch.setattr(predicting, "MANY", 10)
    monkeypatch.setattr(_memory, "available_memory", lambda: 8.0)
    with pytest.raises(InsufficientMemoryError, match="sample_y of 20 rows"):
        model.sample_y(X[::2, :1])
