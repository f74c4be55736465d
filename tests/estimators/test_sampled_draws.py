"""Draws by draws of the hyperparameters: their quantiles, seeds and advice."""

import numpy as np
import pytest
from sklearn.base import clone
from waves import draw

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.exceptions import SamplingWarning

pytestmark = pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
SAMPLED = {"hyperparameters": "sampled", "n_draws": 8}
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, **SAMPLED),
    "independent": IndependentGP(**SAMPLED),
    "pooled": PooledGP(**SAMPLED),
    "single": SingleTaskGP(**SAMPLED),
    "transformed": SingleTaskGP(target_transform=(np.arcsinh, np.sinh), **SAMPLED),
}
X, y = draw(rows=4)
Z = np.column_stack([np.linspace(-3.0, 9.0, 9), np.arange(9) % 3])


@pytest.mark.parametrize("name", MODELS)
def test_draws_have_the_quantiles_of_the_intervals(name):
    """They are those of a mixture, not of one normal distribution."""
    model = clone(MODELS[name]).fit(X, y)
    for noise in (False, True):
        draws = model.sample_y(Z, 8000, random_state=0, include_noise=noise)
        for level in (0.5, 0.95):
            lower, upper = model.predict_interval(Z, level, include_noise=noise)
            inside = (lower[:, None] < draws) & (draws < upper[:, None])
            np.testing.assert_allclose(inside.mean(axis=1), level, atol=0.025)


def test_draws_of_tasks_alone_are_independent():
    model = SingleTaskGP().fit(X, y)
    mean, cov = model.predict(Z, return_cov=True)
    draws = model.sample_y(Z, 8000, random_state=0)
    np.testing.assert_allclose(draws.mean(axis=1), mean, atol=0.1)
    np.testing.assert_allclose(np.cov(draws), cov, atol=0.06 * cov.max())
    assert model.hyperparameters_.tolist() == ["mode"] * 3


@pytest.mark.parametrize("name", ["independent", "pooled", "single"])
def test_other_seeds_are_other_chains(name):
    found = [
        clone(MODELS[name]).set_params(random_state=seed).fit(X, y).predict(Z)
        for seed in (None, None, 1)
    ]
    np.testing.assert_array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


@pytest.mark.parametrize("model", [IndependentGP(max_iter=0), PooledGP(max_iter=0)])
def test_models_whose_correlations_are_fixed_ask_for_another(model):
    match = "Fit a MultiTaskGPRegressor with rank=2 or more, or diagonal=True, with hyp"
    with pytest.raises(ValueError, match=match):
        model.fit(X, y).task_correlation_interval()


def test_rank_two_asks_for_draws():
    model = MultiTaskGPRegressor(rank=2, max_iter=0).fit(X, y)
    with pytest.raises(ValueError, match="Fit this MultiTaskGPRegressor with hyperp"):
        model.task_correlation_interval()


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_few_rows_of_sparse_inference_are_told_of_exact_inference():
    options = {"inference": "sparse", "n_inducing": 6, "n_draws": 4, "max_iter": 2}
    model = MultiTaskGPRegressor(rank=1, hyperparameters="sampled", **options)
    with pytest.warns(SamplingWarning, match="helps: inference='dense', which so few"):
        model.fit(X, y)


def test_theta_of_integers():
    model = RankSearchIC(MultiTaskGPRegressor(max_iter=0), ranks=[1]).fit(X, y)
    theta = [1] * len(model.best_estimator_.theta_)
    value, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
    expected = model.log_marginal_likelihood(np.ones(len(theta)), eval_gradient=True)
    assert value == expected[0]
    np.testing.assert_array_equal(gradient, expected[1])
