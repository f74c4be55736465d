"""The border of a novel task where there are several terms: a row of each."""

import building
import numpy as np
import pytest
import textbook
from borders import check_pairs
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp.inference.border import BorderLikelihood
from skmtgp.learning.novel import learn_novel
from skmtgp.learning.problem import Budget
from skmtgp.model.several import Forms, Kernels
from skmtgp.model.task_covariance import low_rank

M, NEW, LEVEL, NOISE = 3, 5, 0.3, 0.05
KERNELS = RBF(1.5), Matern(0.4, nu=2.5)
FORMS = {
    "ranks 1 and 2": (low_rank(M, 1), low_rank(M, 2)),
    "shared": (low_rank(M, 0, shared=True), low_rank(M, 1)),
    "diagonals": (low_rank(M, 1, diagonal=True), low_rank(M, 1, "equal")),
    "full rank": (low_rank(M, M), low_rank(M, 1)),
}
OWN = {"diagonals": [True, False], "full rank": [True, False]}


class Problem:
    def __init__(self, name):
        rng = np.random.default_rng(0)
        self.forms, self.own = FORMS[name], OWN.get(name, [False, False])
        self.tasks = np.repeat(np.arange(M), 8)
        self.X, self.y = rng.standard_normal((24, 1)), rng.standard_normal(24)
        self.Z, self.z = rng.standard_normal((NEW, 1)), rng.standard_normal(NEW)
        rows = self.X, self.tasks, self.y
        forms = Forms(self.forms)
        self.likelihood = building.dense(Kernels(KERNELS), forms, *rows, levels=True)
        self.theta = self.likelihood.prior.theta()
        self.theta = self.theta + 0.3 * rng.standard_normal(len(self.theta))
        self.theta[-2:] = np.log([LEVEL, NOISE])
        self.posterior = self.likelihood.posterior(self.theta)
        of_terms = self.likelihood.prior.theta_of_terms(self.theta)
        self.rhos = [rho for _, rho in of_terms]
        self.kernels = [
            kernel.clone_with_theta(theta)
            for kernel, (theta, _) in zip(KERNELS, of_terms, strict=True)
        ]
        self.F = [of.columns(r) for of, r in zip(self.forms, self.rhos, strict=True)]

    def border(self):
        shared, equal = [], []
        for form, rho in zip(self.forms, self.rhos, strict=True):
            shared.append(np.exp(0.5 * rho[-1]) if form.shared else None)
            is_equal = getattr(form, "equal", False)
            equal.append(np.exp(rho[-1]) if is_equal else 0.0)
        return BorderLikelihood(
            self.posterior,
            self.F,
            self.Z,
            self.z,
            NOISE,
            self.own,
            LEVEL,
            shared,
            equal,
        )

    def split(self, row):
        """The row of each term, and w of each, by hand."""
        sizes = [F.shape[1] for F in self.F]
        rows, rest = [row[: sizes[0]], row[sizes[0] : sum(sizes)]], row[sum(sizes) :]
        return rows, [rest[0] if has else 0.0 for has in self.own]

    def value(self, row):
        """Log density of all rows less that of the old ones."""
        X, tasks = np.vstack([self.X, self.Z]), np.r_[self.tasks, [M] * NEW]
        y = np.r_[self.y, self.z]
        K = LEVEL * np.equal.outer(tasks, tasks) + NOISE * np.eye(len(X))
        of_terms = self.forms, self.rhos, self.kernels, self.F, *self.split(row)
        for form, rho, kernel, F, own_row, w in zip(*of_terms, strict=True):
            of_old = form.matrix(rho)
            K_rho = np.zeros((M + 1, M + 1))
            K_rho[:M, :M] = of_old
            a = np.exp(rho[-1]) if form.shared else 0.0
            K_rho[:M, M] = K_rho[M, :M] = F @ own_row + a
            equal = np.exp(rho[-1]) if getattr(form, "equal", False) else 0.0
            K_rho[M, M] = own_row @ own_row + w**2 + a + equal
            K += K_rho[np.ix_(tasks, tasks)] * kernel(X)
        old = slice(0, len(self.y))
        together = textbook.log_marginal_likelihood(K, y)
        return together - textbook.log_marginal_likelihood(K[old, old], self.y)


@pytest.fixture(params=FORMS)
def problem(request):
    return Problem(request.param)


def row_of(border):
    return np.random.default_rng(1).standard_normal(border.rank + border.own)


def test_value_and_gradient(problem):
    border = problem.border()
    row = row_of(border)
    value, gradient = border.value_and_grad(row)
    np.testing.assert_allclose(value, problem.value(row), rtol=1e-9)
    expected = textbook.derivative(problem.value, row)
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-6)


def test_fisher_information(problem):
    border = problem.border()
    row = row_of(border)

    def moments(row):
        S, _ = border._covariance(row)
        return S, row[: border.rank] @ border.means

    inverse = np.linalg.inv(moments(row)[0])
    dS = textbook.derivative(lambda r: moments(r)[0], row)
    dmean = textbook.derivative(lambda r: moments(r)[1], row)
    scores = inverse @ dS
    expected = 0.5 * np.einsum("pij,qji->pq", scores, scores)
    expected += dmean @ inverse @ dmean.T
    found = border.fisher_information(row)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("position", [0, 3])
def test_the_model_of_one_more_task(problem, position):
    prior, mode = learn_novel(
        problem.likelihood,
        problem.posterior,
        problem.theta,
        problem.Z,
        problem.z,
        position=position,
        own=problem.own,
        own_noise=False,
        informed=True,
        budget=Budget(max_iter=50, tol=1e-3),
    )
    assert prior.n_tasks == M + 1
    assert len(mode.theta) == prior.n_theta
    old = np.delete(np.arange(M + 1), position)
    K_rho, before = prior.K_rho_at(mode.theta), problem.posterior.K_rho
    np.testing.assert_allclose(K_rho[:, old][:, :, old], before, rtol=1e-12)
    # the likelihood of all rows is what the border adds to that of the old ones
    tasks = np.r_[old[problem.tasks], [position] * NEW]
    order = np.argsort(tasks, kind="stable")
    X, y = np.vstack([problem.X, problem.Z]), np.r_[problem.y, problem.z]
    rows = X[order], tasks[order], y[order]
    together = type(problem.likelihood)(prior, *rows).value(mode.theta)
    added = together - problem.likelihood.value(problem.theta)
    np.testing.assert_allclose(mode.value, added, rtol=1e-8)


def test_all_borders_at_once(problem):
    border = problem.border()
    check_pairs(border, row_of(border))
