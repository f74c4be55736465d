"""What relations are worth: by densities of some tasks given the others."""

import numpy as np
import pytest
import textbook
from samples import draw
from sklearn.base import clone

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP
from skmtgp._estimators.relations import evidence_of_relations

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
QUICK = {"max_iter": 3}
STAGED = {"learning": "staged", **QUICK}
MODELS = {
    "low rank": MultiTaskGPRegressor(rank=1, **QUICK),
    "full rank": MultiTaskGPRegressor(rank=3, **STAGED),
    "diagonal": MultiTaskGPRegressor(rank=1, diagonal=True, **STAGED),
    "shared": MultiTaskGPRegressor(rank=1, shared=True, noise="per_task", **STAGED),
    "own units": MultiTaskGPRegressor(rank=2, normalize_y="per_task", **STAGED),
    "no levels": MultiTaskGPRegressor(rank=2, task_levels=False, **STAGED),
    "pooled": PooledGP(**QUICK),
}


def complete(n_tasks=3, n_outputs=None):
    X, y = draw(n_tasks=n_tasks, n_outputs=n_outputs)
    n = len(X) // n_tasks
    inputs = np.tile(X[:n, :2], (n_tasks, 1))
    return np.column_stack([inputs, np.repeat(np.arange(n_tasks), n)]), y


def by_the_book(model, output):
    """Densities of each task's targets given the others, less those without them."""
    x, tasks, M = model.X_train_, model.tasks_train_, len(model.tasks_)
    single = model.y_train_.ndim == 1
    names = "task_covariance_", "noise_variance_", "level_variance_", "y_mean_"
    values = (np.asarray(getattr(model, name, 0.0)) for name in names)
    K_rho, noise, level, centre = (
        of if single or of.ndim == 0 else of[output] for of in values
    )
    kernel = model.kernel_ if single else model.kernel_[output]
    y = model.y_train_.reshape(len(x), -1)[:, output] - textbook.of_rows(centre, tasks)

    def density(rows):
        K = textbook.covariance(kernel, K_rho, noise, x[rows], tasks[rows], level)
        return textbook.log_marginal_likelihood(K, y[rows])

    whole = np.ones(len(x), dtype=bool)
    return [
        density(whole) - density(tasks != m) - density(tasks == m) for m in range(M)
    ]


@pytest.mark.parametrize("n_outputs", [None, 2])
@pytest.mark.parametrize("inference", ["dense", "kronecker"])
@pytest.mark.parametrize("name", MODELS)
def test_is_that_of_the_textbook(name, inference, n_outputs):
    X, y = complete(n_outputs=n_outputs)
    model = clone(MODELS[name]).set_params(inference=inference).fit(X, y)
    for output in range(n_outputs or 1):
        found = evidence_of_relations(model, output)
        np.testing.assert_allclose(found, by_the_book(model, output), atol=1e-6)


@pytest.mark.parametrize("name", ["low rank", "diagonal", "shared", "pooled"])
def test_sparse_inference(name):
    """With all inputs as inducing inputs, and noise, the bound is exact."""
    X, y = complete()
    model = clone(MODELS[name]).set_params(
        inference="sparse", noise_variance_bounds=(1e-2, 1.0)
    )
    model.fit(X, y)
    found = evidence_of_relations(model, 0)
    np.testing.assert_allclose(found, by_the_book(model, 0), atol=1e-3)


@pytest.mark.parametrize("inference", ["auto", "sparse"])
def test_a_task_that_joined(inference):
    X, y = complete(n_tasks=4)
    old = X[:, -1] < 3
    model = MultiTaskGPRegressor(
        rank=1, inference=inference, noise_variance_bounds=(1e-2, 1.0), **STAGED
    ).fit(X[old], y[old])
    new = np.flatnonzero(~old)[:4]
    extended = model.add_task(X[new], y[new])
    found = evidence_of_relations(extended, 0)
    np.testing.assert_allclose(found, by_the_book(extended, 0), atol=1e-3)


def test_none_without_relations():
    model = IndependentGP(**QUICK).fit(*draw())
    np.testing.assert_allclose(evidence_of_relations(model, 0), 0.0, atol=1e-9)
