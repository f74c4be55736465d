"""Bounds of several terms, and the bound by the book."""

from typing import NamedTuple

import building
import numpy as np
import textbook
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

from skmtgp.kernels import ARDLinear
from skmtgp.model.several import Forms, Kernels
from skmtgp.model.task_covariance import low_rank

M, D = 3, 2
SLOW, FAST = RBF([2.0, 3.0]), ConstantKernel(0.5) * Matern([0.3, 0.4], nu=1.5)
LINEAR = ARDLinear([0.4, 0.8], 0.3), low_rank(M, 1)  # K_ZZ is singular
TERMS = {
    "two of rank 1": [(SLOW, low_rank(M, 1)), (FAST, low_rank(M, 1))],
    "a shared one": [(SLOW, low_rank(M, 0, shared=True)), (FAST, low_rank(M, 2))],
    "a diagonal": [(FAST, low_rank(M, 1, diagonal=True)), (SLOW, low_rank(M, 2))],
    "diagonals": [
        (Matern(1.2, nu=2.5), low_rank(M, 1, diagonal=True)),
        (RBF(0.4, "fixed"), low_rank(M, 0, "equal")),
    ],
    "three": [
        (SLOW, low_rank(M, 2, diagonal=True)),
        (FAST, low_rank(M, 1, "equal", shared=True)),
        (Matern([0.6, 0.9], nu=0.5), low_rank(M, 1, shared=True)),
    ],
}
NEW = np.array([[0.3, -0.4], [1.1, 0.6], [-0.8, 0.9], [0.3, -0.4]])
OF_NEW = np.array([0, 2, 1, 1])


class Rows(NamedTuple):
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray


def draw(seed=0, n=22):
    """Rows sorted by task, as dense inference takes them."""
    rng = np.random.default_rng(seed)
    tasks = np.sort(np.r_[0, 1, 2, rng.integers(0, M, n - M)])
    return Rows(rng.standard_normal((n, D)), tasks, rng.standard_normal(n))


def inducing(m=6, seed=1):
    return np.random.default_rng(seed).standard_normal((m, D))


def model(terms):
    kernels, forms = zip(*terms, strict=True)
    return Kernels(kernels), Forms(forms)


def make(terms, n_noise=1, levels=False, Z=None, rows=None, seed=0, block_size=7):
    """The bound, and parameters near where learning starts."""
    rows, Z = rows or draw(), inducing() if Z is None else Z
    bound = building.sparse(*model(terms), *rows, Z, n_noise, block_size, levels=levels)
    theta = bound.prior.theta(K_rho=np.eye(M) + 0.5)
    noise = 0.3 * np.random.default_rng(seed).standard_normal(len(theta))
    return bound, theta + noise


def dense(terms, n_noise=1, levels=False, rows=None):
    return building.dense(*model(terms), *(rows or draw()), n_noise, levels=levels)


class Book(NamedTuple):
    """What a bound should say, with n x n matrices."""

    terms: list  # of k^x and K^rho as they are at theta
    level: float
    noise: np.ndarray  # of each row
    rows: Rows
    Z: np.ndarray

    def prior(self, X, tasks, Y, of_Y):
        """Of f."""
        between = np.ix_(tasks, of_Y)
        found = sum(K_rho[between] * k(X, Y) for k, K_rho in self.terms)
        return found + self.level * np.equal.outer(tasks, of_Y)

    def explained(self, X, tasks, Y, of_Y):
        """The same by way of the inducing inputs."""
        total, between = 0.0, np.ix_(tasks, of_Y)
        for k, K_rho in self.terms:
            of_term = k(X, self.Z) @ np.linalg.solve(k(self.Z), k(self.Z, Y))
            total = total + K_rho[between] * of_term
        return total + self.level * np.equal.outer(tasks, of_Y)

    @property
    def K(self):
        rows = self.rows[:2]
        return self.explained(*rows, *rows) + np.diag(self.noise)

    def left(self, X, tasks):
        """What the inducing inputs leave of the covariance of f."""
        return self.prior(X, tasks, X, tasks) - self.explained(X, tasks, X, tasks)

    def value(self):
        """Titsias (2009), eq. 9."""
        left = np.diagonal(self.left(*self.rows[:2]))
        value = textbook.log_marginal_likelihood(self.K, self.rows.y)
        return value - 0.5 * (left / self.noise).sum()

    def posterior(self, X, tasks):
        """Mean and covariance of f(X)."""
        cross = self.explained(*self.rows[:2], X, tasks)
        told = cross.T @ np.linalg.solve(self.K, cross)
        mean = cross.T @ np.linalg.solve(self.K, self.rows.y)
        return mean, self.prior(X, tasks, X, tasks) - told


def book(bound, theta, Z=None):
    """The book of a bound, with theta taken apart by hand."""
    prior, at, terms = bound.prior, 0, []
    for kernel, form in prior.terms:
        terms.append([kernel.clone_with_theta(theta[at : at + kernel.n_dims]), form])
        at += kernel.n_dims
    for term in terms:
        end = at + term[1].n_parameters
        term[1], at = term[1].matrix(theta[at:end]), end
    level = np.exp(theta[at]) if prior.levels else 0.0
    noise = np.broadcast_to(np.exp(theta[-prior.n_noise :]), prior.n_tasks)
    rows = Rows(bound.X, bound.tasks, bound.y)
    return Book(terms, level, noise[rows.tasks], rows, bound.Z if Z is None else Z)
