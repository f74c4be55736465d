"""A stream of rows, and what a refit at the same hyperparameters would tell."""

import pickle
from copy import copy

import numpy as np
from samples import draw

from skmtgp.inference.leeway import widened
from skmtgp.inference.mixture import Mixture


def parts(n_outputs=None, n_first=24, n_tasks=3, per_task=14):
    """Rows of a first fit, and two batches that come later; each has all tasks."""
    X, y = draw(per_task=per_task, n_tasks=n_tasks, n_outputs=n_outputs)
    edges = [0, n_first, (n_first + len(y)) // 2, len(y)]
    rows = [slice(*edges[i : i + 2]) for i in range(3)]
    return [(X[of], y[of]) for of in rows]


def fresh(model):
    """A copy that cannot change the model."""
    return pickle.loads(pickle.dumps(model))


def refitted(model):
    """The model with all posteriors made anew, at its own parameters."""
    other = copy(model)
    pairs = zip(model._likelihoods, model._thetas(), strict=True)
    other._posteriors = [likelihood.posterior(theta) for likelihood, theta in pairs]
    outputs = zip(other._posteriors, model._likelihoods, model._leeway, strict=True)
    other._predictive = [widened(*of) for of in outputs]
    if model._is_sampled():
        draws = zip(model._likelihoods, model._draws_of_outputs(), strict=True)
        other._predictive = [Mixture(*of_output) for of_output in draws]
    other._store_levels()
    other._store_likelihoods()
    return other


def told(model, Z):
    """All that a model says of itself and of Z."""
    found = [
        *model.predict(Z, return_std=True),
        *model.predict(Z, return_std=True, include_noise=True),
        *model.predict_interval(Z),
        *model.loo_predict(include_noise=True),
        model.task_level_,
        model.task_level_std_,
        model.log_marginal_likelihoods_,
    ]
    if model.target_transform is None:
        found.append(model.predict(Z, return_cov=True)[1])
    return found


def close(found, expected, digits=8):
    """Whether numbers agree, relative to the largest of each."""
    for a, b in zip(found, expected, strict=True):
        atol = 10.0**-digits * np.abs(b).max()
        np.testing.assert_allclose(a, b, rtol=0.0, atol=atol)
