"""The border of a novel task where there is a trend, by the book."""

from dataclasses import replace

import numpy as np
import pytest
import textbook
from borders import check_pairs
from sklearn.gaussian_process.kernels import RBF
from trend_models import M, by_hand, columns, make, make_trend

from skmtgp.inference.border import BorderLikelihood
from skmtgp.model.task_covariance import low_rank

LEVEL, NOISE, OWN = 0.3, 0.05, 0.2
Z = np.array([[0.3, -0.4], [1.1, 0.6], [-2.0, 0.9], [0.7, -1.4], [2.0, 0.1]])


class Case:
    """A model of three tasks and five rows of another, whose own function is known."""

    def __init__(self, per_task):
        self.per_task = per_task
        self.trend = make_trend(per_task)
        terms = [(RBF([0.9, 1.3]), low_rank(M, 2))]
        self.likelihood, self.theta = make(terms, trend=self.trend)
        self.theta[-2:] = np.log([LEVEL, NOISE])
        prior = self.likelihood.prior
        self.posterior = self.likelihood.posterior(self.theta)
        self.F = prior.task_covariance.columns(prior.values(self.theta).rho)
        self.k = prior.kernel_at(self.theta)
        self.z = np.sin(Z[:, 0]) + Z[:, 1]

    def border(self):
        T = columns(Z) - self.trend.centre
        return BorderLikelihood(
            self.posterior, self.F, Z, self.z, NOISE, False, LEVEL, None, OWN, T
        )

    def grown(self):
        """The columns of all rows."""
        X, tasks = self.likelihood.X, self.likelihood.tasks
        if not self.per_task:
            T = columns(Z) - self.trend.centre
            return np.vstack([by_hand(self.trend, X, tasks), T])
        slopes = np.zeros((M + 1, 2))
        trend = replace(self.trend, n_tasks=M + 1, slopes=slopes)
        return trend.rows(np.vstack([X, Z]), np.append(tasks, np.full(len(Z), M)))

    def value(self, row):
        """log p(new | old): the restricted likelihood of all less that of the old."""
        X, tasks, y = self.likelihood.X, self.likelihood.tasks, self.likelihood.y
        F = np.vstack([self.F, row])
        K_rho = F @ F.T
        K_rho[M, M] += OWN
        both = np.vstack([X, Z]), np.append(tasks, np.full(len(Z), M))
        K = textbook.covariance(self.k, K_rho, NOISE, *both, LEVEL)
        n, H = len(y), self.grown()
        old = np.flatnonzero(H[:n].any(axis=0))
        values = [
            textbook.restricted_likelihood(K, H, np.append(y, self.z)),
            textbook.restricted_likelihood(K[:n, :n], H[:n, old], y),
        ]
        volumes = [np.linalg.slogdet(of.T @ of)[1] for of in (H, H[:n, old])]
        if self.per_task:  # of the new task's own contrasts
            return values[0] - values[1]
        return values[0] - values[1] - 0.5 * (volumes[0] - volumes[1])


@pytest.mark.parametrize("per_task", [False, True])
def test_value_and_gradient(per_task):
    case, row = Case(per_task), np.array([0.8, -0.6])
    border = case.border()
    value, gradient = border.value_and_grad(row)
    np.testing.assert_allclose(value, case.value(row), rtol=1e-9)
    expected = textbook.derivative(case.value, row)
    np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("per_task", [False, True])
def test_fisher_information_is_the_spread_of_the_score(per_task):
    case, row = Case(per_task), np.array([0.8, -0.6])
    border = case.border()
    information, rng = border.fisher_information(row), np.random.default_rng(0)
    S, _ = border._covariance(row)
    mean = row @ border.means
    draws = rng.multivariate_normal(mean, S, 4000)
    scores = []
    for border.y in draws:
        scores.append(border.value_and_grad(row)[1])
    np.testing.assert_allclose(np.cov(np.transpose(scores)), information, rtol=0.15)


@pytest.mark.parametrize("per_task", [False, True])
def test_all_borders_at_once(per_task):
    check_pairs(Case(per_task).border(), np.array([0.8, -0.6]))
