"""New tasks join models that learn no relations, by partial_fit."""

import numpy as np
import pytest
from samples import draw
from sklearn.base import clone
from streams import close, parts, refitted, told

from skmtgp import IndependentGP, PooledGP

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
]
ALONE = {"max_iter": 5}


def cube(z):
    return z**3


MODELS = {
    "iGP": IndependentGP(**ALONE),
    "iGP, diagonal": IndependentGP(diagonal=True, noise="per_task", **ALONE),
    "pGP": PooledGP(**ALONE),
    "sampled": IndependentGP(hyperparameters="sampled", n_draws=4, max_iter=2),
    "transformed": PooledGP(target_transform=(np.cbrt, cube), **ALONE),
    "units of each": IndependentGP(normalize_y="per_task", **ALONE),
}
NEW = np.array([[0.3, 0.4, 9], [-0.7, 0.1, -4], [1.2, -1.1, 9], [0.1, 0.2, 1]])
TARGETS = np.array([3.0, -8.0, 11.0, 2.0])
Z = draw(per_task=2, seed=1)[0]


def complete():
    x = draw()[0][:10, :2]
    X = np.column_stack([np.tile(x, (3, 1)), np.repeat([0, 1, 2], 10)])
    noise = 0.1 * np.random.default_rng(0).standard_normal(len(X))  # K is definite
    return X, np.sin(X[:, 0]) + X[:, 2] * X[:, 1] + noise


@pytest.mark.parametrize("inference", ["dense", "auto", "sparse"])
@pytest.mark.parametrize("name", MODELS)
def test_models_that_learn_no_relations(name, inference):
    few = {"n_inducing": 12, "n_exact": 20}
    X, y = complete() if inference == "auto" else parts()[0]
    model = clone(MODELS[name]).set_params(inference=inference, **few).fit(X, y)
    assert model.complete_ is (inference == "auto")  # by Kronecker products
    n_own = 2 * ((model.noise_ == "per_task") + model.diagonal)
    theta = model.theta_
    model.partial_fit(NEW, TARGETS)
    assert model.tasks_.tolist() == [-4, 0, 1, 2, 9]
    assert len(model.theta_) == len(theta) + n_own
    close(told(model, NEW), told(refitted(model), NEW))
    model.partial_fit(NEW + [0.1, 0.1, 0.0], TARGETS)
    close(told(model, NEW), told(refitted(model), NEW))


@pytest.mark.parametrize("Model", [IndependentGP, PooledGP])
def test_they_are_what_the_book_says(Model):
    levels = {"task_levels": False} if Model is IndependentGP else {}
    options = {"noise": "shared", "normalize_y": "shared", **levels, **ALONE}
    X, y = parts()[0]
    model = Model(**options).fit(X, y).partial_fit(NEW, TARGETS)
    X, y = np.vstack([X, NEW]), np.append(y, TARGETS)
    if Model is IndependentGP:
        X, y = X[X[:, 2] == 9], y[X[:, 2] == 9]
    kernel, mean = model.kernel_, np.squeeze(model.y_mean_)
    K = kernel(X[:, :2]) * model.task_covariance_[-1, -1]
    cross = kernel(Z[:, :2], X[:, :2]) * model.task_covariance_[-1, -1]
    K += np.squeeze(model.noise_variance_) * np.eye(len(X))
    expected = mean + cross @ np.linalg.solve(K, y - mean)
    found = model.predict(np.column_stack([Z[:, :2], np.full(len(Z), 9)]))
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_one_task_is_joined_by_another():
    X, y = draw()
    first, second = (X[:, 2] == task for task in (0, 1))
    for Model in (IndependentGP, PooledGP):
        model = Model(**ALONE).fit(X[first], y[first])
        K_rho = model.partial_fit(X[second], y[second]).task_covariance_
        assert bool(K_rho[0, 1]) is (Model is PooledGP)
        assert K_rho[0, 0] == K_rho[1, 1]
