"""Noise variances that the rows do not tell."""

import warnings

import building
import numpy as np
import pytest
import textbook
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
)
from skmtgp.exceptions import UnidentifiedNoiseWarning
from skmtgp.inference.posterior import freedom_of_noise, noise_is_told
from skmtgp.model.task_covariance import low_rank

NOISE = 0.2  # standard deviation
SHARED = MultiTaskGPRegressor(rank=2, noise="shared")
STAGED = clone(SHARED).set_params(learning="staged")  # without a prior of the noise
MESSAGE = "The rows do not tell the noise variance: the model follows them so closely"


def draw(n_tasks, per_task, seed, noise=NOISE, rank=2):
    """X and y drawn from the model, with a signal of variance 1."""
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((n_tasks, rank))
    F /= np.linalg.norm(F, axis=1, keepdims=True)
    x = rng.uniform(0.0, 8.0, (n_tasks * per_task, 1))
    tasks = np.repeat(np.arange(n_tasks), per_task)
    K = textbook.covariance(RBF(1.0), F @ F.T, 1e-10, x, tasks)
    y = np.linalg.cholesky(K) @ rng.standard_normal(len(x))
    return np.column_stack([x, tasks]), y + noise * rng.standard_normal(len(x))


def fitted(model, X, y):
    """The fitted model, and the messages of the warnings of its noise."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = clone(model).fit(X, y)
    kind = UnidentifiedNoiseWarning
    return model, [str(w.message) for w in caught if issubclass(w.category, kind)]


class TestDegreesOfFreedom:
    @pytest.mark.parametrize("likelihood", [building.dense, building.kronecker])
    @pytest.mark.parametrize("n_noise", [1, 3])
    @pytest.mark.parametrize("noise", [1e-8, 1e-4, 1e-2, 1.0])
    def test_by_the_book(self, likelihood, n_noise, noise):
        """n minus the trace of the matrix that maps the targets to their means."""
        x, tasks = np.tile(np.linspace(0, 5, 4), 3)[:, None], np.repeat(range(3), 4)
        y, form = np.sin(x[:, 0]) + tasks, low_rank(3, 3)
        noises = noise * np.array([1.0, 1e3, 1e-3])[:n_noise]
        F = np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [-0.5, 0.5, 0.7]])
        theta = np.concatenate([[0.1], F.ravel(), np.log(noises)])
        objective = likelihood(RBF(), form, x, tasks, y, n_noise)
        found = freedom_of_noise(objective, objective.posterior(theta))
        per_row = noises[tasks] if n_noise > 1 else noises[0]
        K = textbook.covariance(RBF(np.exp(0.1)), F @ F.T, 0.0, x, tasks)
        smoother = np.linalg.solve(K + np.diag(np.broadcast_to(per_row, 12)), K)
        left = 1.0 - np.diagonal(smoother)
        freedom = np.bincount(tasks, left) if n_noise > 1 else [left.sum()]
        # the book's 1 - h has the rounding of 1
        np.testing.assert_allclose(found, freedom, rtol=1e-6, atol=2e-15)

    @pytest.mark.parametrize(("seed", "told"), [(100, True), (106, False)])
    def test_residuals_suffice_where_there_are_some(self, seed, told, monkeypatch):
        model = fitted(STAGED, *draw(3, 5, seed))[0]
        [likelihood], [posterior] = model._likelihoods, model._posteriors
        freedom = freedom_of_noise(likelihood, posterior)
        residuals = model.noise_variance_ * np.square(posterior.alpha / 1.0).sum()
        assert (freedom > 1.0) == told
        assert residuals > 0.0
        calls = []
        inverse_diagonal = posterior.precision
        monkeypatch.setattr(
            posterior, "precision", lambda: calls.append(0) or inverse_diagonal()
        )
        assert noise_is_told(likelihood, posterior) == told
        assert len(calls) == (not told)


FITTED = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=2),
    "MultiTaskGPRegressor, full rank": MultiTaskGPRegressor(),
    "IndependentGP": IndependentGP(),
    "RankSearchIC": RankSearchIC(MultiTaskGPRegressor(), ranks=(1, 2)),
}
each = pytest.mark.parametrize("model", FITTED.values(), ids=FITTED.keys())


class TestWarning:
    @pytest.mark.parametrize("seed", [106, 114])
    def test_noise_of_a_few_rows_that_is_lost(self, seed):
        model, messages = fitted(STAGED, *draw(3, 5, seed))
        assert model.noise_variance_ < 1e-3 * NOISE**2
        assert len(messages) == 1
        assert messages[0].startswith(MESSAGE)
        assert messages[0].endswith("page 'Noise'.")

    @pytest.mark.parametrize(("seed", "is_told"), [(106, False), (114, True)])
    def test_noise_that_only_its_prior_keeps(self, seed, is_told):
        """At 106 it is at its prior's mercy, although the rows leave some freedom."""
        model, messages = fitted(SHARED, *draw(3, 5, seed))
        assert model.noise_variance_ > 0.03 * NOISE**2
        assert noise_is_told(*model._likelihoods, *model._posteriors)
        assert (messages == []) == is_told

    @pytest.mark.parametrize("noise", ["shared", "per_task"])
    def test_shared_noise_is_advised_where_tasks_have_one_each(self, noise):
        X, y = draw(3, 5, 106)
        messages = fitted(clone(STAGED).set_params(noise=noise), X, y)[1]
        advised = "set noise='shared' if all tasks are measured" in messages[0]
        assert advised == (noise == "per_task")

    @pytest.mark.parametrize(
        ("model", "advised"),
        [
            (STAGED, "choose a lower rank, "),
            (clone(STAGED).set_params(rank=1), "choose rank=0 with shared=True, "),
            (clone(STAGED).set_params(rank=0, shared=True), ""),
            (IndependentGP(noise="shared"), ""),
        ],
        ids=["rank 2", "rank 1", "rank 0", "independent"],
    )
    def test_a_lower_rank_is_advised_where_there_is_one(self, model, advised):
        X, y = draw(3, 3, 1)
        messages = fitted(clone(model).set_params(noise_variance=1e-6), X, y)[1]
        assert f"Give more rows, {advised}raise the lower bound" in messages[0]

    @each
    @pytest.mark.parametrize("per_task", [5, 20])
    def test_noise_that_is_found(self, model, per_task):
        X, y = draw(3, per_task, 101)
        assert fitted(model, X, y)[1] == []
