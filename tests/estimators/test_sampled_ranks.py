"""Draws of the hyperparameters where the rank is open."""

import pickle
import warnings

import numpy as np
import pytest
from sklearn.base import clone
from waves import draw

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp.exceptions import SamplingWarning

pytestmark = pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
X, y = draw(rows=6)
ALIKE = np.sin(X[:, 0]) + 0.3 * np.random.default_rng(0).standard_normal(len(X))
Z = np.column_stack([np.linspace(0.0, 7.0, 6), [0, 1, 2, 0, 1, 2]])
MODEL = MultiTaskGPRegressor(
    noise="shared", normalize_y="shared", hyperparameters="sampled", n_draws=12
)


@pytest.fixture(scope="module")
def search():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SamplingWarning)
        return RankSearchIC(MODEL, simpler=False).fit(X, y)


def ranks_of(model):
    """The rank of K^rho in each draw."""
    prior = model._likelihoods[0].prior
    return [np.linalg.matrix_rank(prior.K_rho_at(t)) for t in model.theta_samples_]


def test_draws_have_the_ranks_that_are_likely(search):
    model = search.best_estimator_
    ranks = ranks_of(model)
    assert search.best_rank_ in ranks
    assert search.best_rank_ < model.rank_
    assert min(ranks) < max(ranks)
    assert set(ranks) <= set(range(1, model.rank_ + 1))  # an unlikely one has no chain
    bic = search.results_.set_index("rank")["bic"]
    assert bic[model.rank_] <= bic[search.best_rank_] + 10.0


def test_predictions_are_those_of_the_mixture(search):
    model = search.best_estimator_
    [likelihood] = model._likelihoods
    means = [
        likelihood.posterior(theta).mean(Z[:, :1], Z[:, 1].astype(int))
        for theta in model.theta_samples_
    ]
    expected = model.y_mean_ + model.y_scale_ * np.mean(means, axis=0)
    np.testing.assert_allclose(search.predict(Z), expected, rtol=1e-8)
    again = pickle.loads(pickle.dumps(search))
    np.testing.assert_array_equal(again.predict(Z), search.predict(Z))


def test_a_task_joins(search):
    new = np.column_stack([np.linspace(0.5, 7.5, 5), np.full(5, 3)])
    found = search.add_task(new, 2.0 * np.sin(new[:, 0]))
    mean, std = found.predict(new, return_std=True)
    np.testing.assert_allclose(mean, 2.0 * np.sin(new[:, 0]), atol=1.0)
    assert (std > 0.0).all()
    assert found.best_estimator_.theta_samples_.shape[0] == 12


def test_more_ranks_are_compared_than_of_modes_alone(search):
    mode = RankSearchIC(clone(MODEL).set_params(hyperparameters="mode"), simpler=False)
    mode.fit(X, y)
    assert set(mode.results_["rank"]) < set(search.results_["rank"])
    assert search.results_["rank"].max() == 3


@pytest.mark.parametrize(
    "options", [{"criterion": "aic"}, {"ranks": (1,)}], ids=["aic", "one rank"]
)
def test_otherwise_draws_have_the_chosen_rank(options):
    search = RankSearchIC(MODEL, **{"ranks": (1, 2)} | options).fit(X, y)
    assert search.best_estimator_.rank_ == search.best_rank_
    assert set(ranks_of(search.best_estimator_)) == {search.best_rank_}


@pytest.mark.parametrize("diagonal", [False, True, "equal"])
def test_one_function_of_all_tasks_is_a_rank_too(diagonal):
    """That of rank 0, a column of the factor at higher ones."""
    model = clone(MODEL).set_params(diagonal=diagonal, n_draws=4)
    found = RankSearchIC(model, ranks=(0, 1), simpler=False, criterion="bic")
    found.fit(X, ALIKE)
    assert found.best_rank_ == 0
    best = found.best_estimator_
    assert best.rank_ == 1
    assert np.isfinite(best.predict(Z)).all()


def test_tasks_with_descriptors_are_drawn_at_rank_0_by_itself():
    rows = np.insert(X, 1, X[:, 1] ** 2, axis=1)
    model = clone(MODEL).set_params(task_descriptors=[1], n_draws=4)
    search = RankSearchIC(model, ranks=(0, 1), simpler=False, criterion="bic")
    best = search.fit(rows, ALIKE).best_estimator_
    assert best.rank_ == search.best_rank_ == 0
    for theta in best.theta_samples_:
        K = best._likelihoods[0].prior.K_rho_at(theta)
        np.testing.assert_allclose(K, K[0, 0])
