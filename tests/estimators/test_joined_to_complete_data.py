"""Rows of tasks that join complete data: what is decomposed stays decomposed."""

from copy import copy

import numpy as np
import pytest
from multitask_models import PAPER
from sklearn.base import clone
from streams import close, fresh, refitted, told

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP
from skmtgp.inference.engines import Dense
from skmtgp.inference.extended import ExtendedPosterior

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
]
QUICK = {"max_iter": 5, "learning": "staged"}
N_INPUTS, NEW, OTHER = 12, 7, 1  # the labels of tasks that join; 1 is among the others
LOG = np.log, np.exp
MODELS = {
    "defaults": MultiTaskGPRegressor(noise="shared", **QUICK),
    "paper": MultiTaskGPRegressor(rank=2, **PAPER, **QUICK),
    "diagonal": MultiTaskGPRegressor(rank=1, diagonal=True, **QUICK),
    "shared": MultiTaskGPRegressor(rank=1, shared=True, **QUICK),
    "noise of each": MultiTaskGPRegressor(rank=1, noise="per_task", **QUICK),
    "units of each": MultiTaskGPRegressor(rank=2, normalize_y="per_task", **QUICK),
    "transformed": MultiTaskGPRegressor(rank=1, target_transform=LOG, **QUICK),
    "sampled": MultiTaskGPRegressor(
        rank=1, hyperparameters="sampled", n_draws=4, max_iter=2
    ),
    "iGP": IndependentGP(max_iter=5),
    "pGP": PooledGP(max_iter=5),
}
RNG = np.random.default_rng(3)
INPUTS = RNG.uniform(-2.0, 2.0, (N_INPUTS, 2))


def rows(x, task):
    """Rows of a task at some inputs."""
    y = 5.0 + np.sin(x[:, 0]) * (1.0 + 0.3 * task) + 0.1 * task * x[:, 1]
    noise = 0.05 * np.random.default_rng(len(x)).standard_normal(len(x))
    return np.column_stack([x, np.full(len(x), task)]), y + noise


def complete(missing=0):
    """Rows of three tasks at the same inputs, but for a few that are missing."""
    parts = [rows(INPUTS, task) for task in (0, 2, 4)]
    X, y = (np.concatenate(of) for of in zip(*parts, strict=True))
    return X[missing:], y[missing:]


def elsewhere(n, seed=0):
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (n, 2))


Z = np.vstack([rows(elsewhere(2, 9), task)[0] for task in (0, 4, NEW)])


def dense(model):
    """The same model with a covariance of all rows, decomposed anew."""
    other, n_rows = copy(model), len(model.y_train_)
    other._go_on(other._training(), np.arange(n_rows), Dense())
    return other


def joined(name, missing=0):
    """A model and the same with a task that has joined."""
    model = clone(MODELS[name]).fit(*complete(missing))
    assert model.inference_ == "kronecker"
    grown = fresh(model).partial_fit(*rows(elsewhere(3), NEW))
    return model, grown


@pytest.mark.parametrize(
    ("name", "missing"),
    [*((name, 0) for name in MODELS), ("paper", 2), ("noise of each", 2), ("pGP", 2)],
)
def test_it_is_what_dense_inference_says(name, missing):
    _, model = joined(name, missing)
    for seed in (1, 2):
        x = elsewhere(2, seed)
        x[0] = INPUTS[seed]  # where the others were observed
        model.partial_fit(*rows(x, NEW))
        assert model.inference_ == "kronecker"
        assert not model.complete_
        close(told(model, Z), told(refitted(model), Z))
        close(told(model, Z), told(dense(model), Z), digits=6)


@pytest.mark.parametrize("name", ["paper", "noise of each", "sampled"])
def test_nothing_is_decomposed_again(name):
    model = clone(MODELS[name]).fit(*complete())
    before = model._posteriors[0].eigen
    for task in (NEW, OTHER):  # the second lies between the others
        model.partial_fit(*rows(elsewhere(2, task), task))
        assert isinstance(model._posteriors[0], ExtendedPosterior)
        assert model._posteriors[0].base.eigen is before
    for n, task in ((1, OTHER), (2, NEW)):
        model.partial_fit(*rows(elsewhere(n, 5), task))
        assert model._posteriors[0].base.eigen is before
    close(told(model, Z), told(refitted(model), Z))
    close(told(model, Z), told(dense(model), Z), digits=6)


def test_the_model_before_stays():
    model, _ = joined("paper")
    before = told(model, Z[:4])
    model.add_task(*rows(elsewhere(3), NEW)).partial_fit(*rows(elsewhere(1, 1), NEW))
    for found, expected in zip(told(model, Z[:4]), before, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_many_rows_go_on_densely():
    _, model = joined("paper")
    model.partial_fit(*rows(elsewhere(N_INPUTS - 3, 1), NEW))
    assert model.inference_ == "kronecker"
    model.partial_fit(*rows(elsewhere(1, 2), NEW))
    assert model.inference_ == "dense"
    close(told(model, Z), told(refitted(model), Z))


def test_rows_of_the_other_tasks_are_looked_at_anew():
    _, model = joined("paper")
    model.partial_fit(*rows(elsewhere(4, 1), 2))
    assert model.inference_ == "dense"
    close(told(model, Z), told(refitted(model), Z))


def test_a_task_that_is_observed_everywhere_makes_data_complete():
    model = clone(MODELS["paper"]).fit(*complete())
    for part in np.split(INPUTS, 4):
        model.partial_fit(*rows(part, NEW))
    assert (model.inference_, model.complete_) == ("kronecker", True)
    assert not isinstance(model._posteriors[0], ExtendedPosterior)
    close(told(model, Z), told(dense(model), Z), digits=6)
