"""Several ranks learned of the same data, to choose from."""

from dataclasses import replace

import building
import numpy as np
import textbook
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning.climbing import climb
from skmtgp.learning.tuning import Tuning
from skmtgp.model.several import Forms
from skmtgp.model.task_covariance import low_rank

M, KERNEL = 3, RBF(1.0)


def learned():
    """Problems of ranks 1 to 3, of data of rank 1, and their modes."""
    rng = np.random.default_rng(3)
    tasks = np.repeat(np.arange(M), 15)
    X = rng.uniform(0.0, 6.0, (len(tasks), 1))
    K = textbook.covariance(KERNEL, np.ones((M, M)), 0.01, X, tasks)
    y = np.linalg.cholesky(K) @ rng.standard_normal(len(tasks))
    data = building.data(X, tasks, y, M)
    problems = [[building.problem(KERNEL, low_rank(M, r), data)] for r in (1, 2, 3)]
    modes = [[climb(of, of.theta(K_rho=0.1 * np.eye(M) + 1.0))] for [of] in problems]
    return problems, modes


def tuned(problems, **changes):
    """The same problems with other constants."""
    return [[replace(of, tuning=Tuning(**changes))] for [of] in problems]


def without_noise(modes, log_noise=-23.0):
    """The same modes with almost no noise."""
    changed = [mode.theta.copy() for [mode] in modes]
    for theta in changed:
        theta[-1] = log_noise
    pairs = zip(modes, changed, strict=True)
    return [[mode._replace(theta=theta)] for [mode], theta in pairs]


def of_terms():
    """A problem of two terms."""
    problem = building.problem(KERNEL, low_rank(M, 1), None)
    prior = replace(problem.prior, task_covariance=Forms([low_rank(M, 1)] * 2))
    return replace(problem, prior=prior)
