"""Every engine with levels of the tasks, and what they should say, by the book.

cov(y_i, y_j) = v [m_i = m_j] + K^rho k^x + noise and cov(y_i, c_m) = v [m_i = m]. With
fewer inducing inputs than rows, Q = k(X, Z) k(Z, Z)^-1 k(Z, X) takes the place of k^x.
"""

from typing import NamedTuple

import building
import numpy as np
import textbook
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel

from skmtgp.model.task_covariance import identity, low_rank, ones

M, N, D = 3, 6, 2
KERNEL = ConstantKernel(0.8) * RBF([1.0, 2.0])
FORMS = {
    "identity": identity(M),
    "ones": ones(M),
    "rank 1": low_rank(M, 1),
    "rank 2, diagonal": low_rank(M, 2, diagonal=True),
}
NEW = np.array([[0.3, -0.4], [1.1, 0.6], [-0.8, 0.9], [0.3, -0.4], [0.2, 1.7]])
OF_NEW = np.array([0, 2, 1, 1, 0])


class Rows(NamedTuple):
    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray

    def some(self, chosen):
        return Rows(*(part[chosen] for part in self))


def complete():
    """Every task at the same inputs, each in another order, around its own level."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-2.0, 2.0, (N, D))
    X = np.vstack([x[rng.permutation(N)] for _ in range(M)])
    tasks = np.repeat(np.arange(M), N)
    y = np.sin(X[:, 0]) * (1.0 + tasks) + 3.0 * tasks
    return Rows(X, tasks, y + 0.1 * rng.standard_normal(len(X)))


def scattered():
    """Every row at an input of its own."""
    rows = complete()
    return rows._replace(X=np.random.default_rng(5).uniform(-2.0, 2.0, rows.X.shape))


def dense(rows, *model, **options):
    return building.dense(*model, *rows, **options)


def kronecker(rows, *model, **options):
    return building.kronecker(*model, *rows, **options)


def extended(rows, *model, **options):
    """Task 1 joined later, with some of the rows and two inputs of its own."""
    rows = rows.some((rows.tasks != 1) | (np.arange(len(rows.y)) % N < 4))
    X = rows.X + (rows.tasks == 1)[:, None] * np.eye(len(rows.X), D, -N) * 0.3
    return building.extended(*model, X, *rows[1:], novel=[1], **options)


def sparse(rows, *model, n_inducing=None, **options):
    """Rows in no order, and as inducing inputs all of them, or the first few."""
    order = np.random.default_rng(1).permutation(len(rows.y))
    rows, Z = rows.some(order), rows.X[order][:n_inducing]
    return building.sparse(*model, *rows, Z, block_size=7, **options)


def few(rows, *model, **options):
    return sparse(rows, *model, n_inducing=5, **options)


ENGINES = {
    "dense": (dense, scattered),
    "kronecker": (kronecker, complete),
    "extended": (extended, complete),
    "sparse": (sparse, scattered),
    "sparse, few": (few, scattered),
}


def make(engine, form, n_noise=1, variance=0.7, kernel=KERNEL, rows=None):
    """A likelihood and parameters; without levels where `variance` is None."""
    build, draw = ENGINES[engine]
    levels, rng = variance is not None, np.random.default_rng(0)
    rows = draw() if rows is None else rows
    likelihood = build(rows, kernel, form, n_noise=n_noise, levels=levels)
    rho = rng.standard_normal(form.n_parameters)
    noise = np.log(0.05 + 0.1 * rng.random(n_noise))
    level = [np.log(variance)] if levels else []
    return likelihood, np.concatenate([kernel.theta + 0.1, rho, level, noise])


class Book(NamedTuple):
    """What the model should say, with n x n matrices."""

    kernel: Kernel
    K_rho: np.ndarray
    noise: np.ndarray
    level: float
    rows: Rows
    Z: np.ndarray | None = None  # inducing inputs

    def k(self, X, Y=None):
        """k^x, or what inducing inputs explain of it."""
        if self.Z is None:
            return self.kernel(X, Y)
        right = self.kernel(self.Z, X if Y is None else Y)
        return self.kernel(X, self.Z) @ np.linalg.solve(self.kernel(self.Z), right)

    @property
    def model(self):
        return self.k, self.K_rho, self.noise

    @property
    def K(self):
        return textbook.covariance(*self.model, *self.rows[:2], self.level)

    def unexplained(self, X, tasks):
        """What inducing inputs leave of the covariance of f."""
        K_rho = self.K_rho[np.ix_(tasks, tasks)]
        return K_rho * (self.kernel(X) - self.k(X))

    def value(self):
        """Titsias (2009), eq. 9; the log marginal likelihood where Z is None."""
        X, tasks, y = self.rows
        rest = np.diagonal(self.unexplained(X, tasks))
        lost = (rest / textbook.of_rows(self.noise, tasks)).sum()
        return textbook.log_marginal_likelihood(self.K, y) - 0.5 * lost

    def posterior(self, Z, tasks):
        """Mean and covariance of f(Z)."""
        mean, cov = textbook.posterior(*self.model, *self.rows, Z, tasks, self.level)
        return mean, cov + self.unexplained(Z, tasks)

    def levels(self):
        """Mean and variance of the level of each task."""
        tasks = np.arange(len(self.K_rho))
        with_y = self.level * np.equal.outer(self.rows.tasks, tasks)
        weights = np.linalg.solve(self.K, with_y)
        told = (weights * with_y).sum(axis=0)
        return weights.T @ self.rows.y, self.level - told

    def left_out(self):
        """Residuals and variances of f, each row left out."""
        inverse = np.linalg.inv(self.K)
        variance = 1.0 / np.diagonal(inverse)
        noise = textbook.of_rows(self.noise, self.rows.tasks)
        rest = np.diagonal(self.unexplained(*self.rows[:2]))
        return inverse @ self.rows.y * variance, variance - noise + rest

    def latent(self, Z, F):
        """Means of the latent functions, and what is told of their covariance."""
        cross = F[self.rows.tasks].T[..., None] * self.k(self.rows.X, Z)
        solved = np.linalg.solve(self.K, cross)
        means = np.einsum("ait,i->at", solved, self.rows.y)
        return means, np.einsum("ait,biu->abtu", cross, solved)


def book(likelihood, theta):
    """The book of a likelihood's prior and data."""
    prior = likelihood.prior
    sizes = prior.kernel.n_dims, prior.task_covariance.n_parameters, int(prior.levels)
    kernel, rho, level, noise = np.split(theta, np.cumsum(sizes))
    Z = getattr(likelihood, "Z", None)
    if Z is not None and len(Z) == len(likelihood.y):
        Z = None  # they explain everything
    return Book(
        prior.kernel.clone_with_theta(kernel),
        prior.task_covariance.matrix(rho),
        np.exp(noise),
        np.exp(level).sum(),
        Rows(likelihood.X, likelihood.tasks, likelihood.y),
        Z,
    )
