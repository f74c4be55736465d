"""Data of the model itself, and settings to learn them with."""

import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.kernels import ARDLinear
from skmtgp.learning.problem import Mode
from skmtgp.model.task_covariance import identity, low_rank, ones

M = 3
FACTOR = np.array([[1.0, 0.0], [0.6, 0.8], [-0.5, 0.9]])
KERNEL = ARDLinear([1.0, 1.0], 1.0, (1e-6, 1e3)) + ConstantKernel(1.0) * RBF([1.0, 1.0])
TRUTH = np.log([0.5, 0.8, 0.1, 1.5, 0.7, 2.0])  # theta^x of what is drawn
NOISE = 0.01


def draw(K_rho, seed=0, per_task=12, kernel=None, M=M):
    """Data of the model itself."""
    rng = np.random.default_rng(seed)
    tasks = np.repeat(np.arange(M), per_task)
    X = rng.uniform(-2.0, 2.0, (len(tasks), 2))
    X[-5:] = X[:5]  # tasks that share inputs
    kernel = kernel or KERNEL.clone_with_theta(TRUTH)
    C = np.linalg.cholesky(textbook.covariance(kernel, K_rho, NOISE, X, tasks))
    return building.data(X, tasks, C @ rng.standard_normal(len(X)), M)


def pose(data, form=None, **changes):
    """What to learn; K^rho = I where the form is not given, since learners give it."""
    kernel, form = changes.pop("kernel", KERNEL), form or identity(data.n_tasks)
    return building.problem(kernel, form, data, **changes)


def start_of(problem, seed=0):
    form, rng = problem.prior.task_covariance, np.random.default_rng(seed)
    rho = 0.5 * rng.standard_normal(form.n_parameters)
    return problem.prior.with_rho(problem.theta(), rho)


def is_stationary(problem, theta):
    """Whether no step within the bounds gains much, by the Fisher information."""
    likelihood = problem.likelihood()
    gradient = likelihood.value_and_grad(theta)[1]
    lower, upper = problem.prior.bounds()
    free = (lower < theta) & (theta < upper)
    information = likelihood.fisher_information(theta)[np.ix_(free, free)]
    information += 1e-6 * np.eye(free.sum())
    return 0.5 * gradient[free] @ np.linalg.solve(information, gradient[free]) < 0.05


FORMS = [identity(M), ones(M), low_rank(M, 1), low_rank(M, 2, True), low_rank(M, M)]
every_form = pytest.mark.parametrize(
    "form", FORMS, ids=["identity", "ones", "rank 1", "rank 2, diagonal", "full rank"]
)


def mode_at(problem, theta):
    value = problem.likelihood().value(theta)
    return Mode(theta, value, 7, 8, True, False, 0.5, len(problem.data))


RANKS = [low_rank(M, 1), low_rank(M, 2), low_rank(M, 3)]
