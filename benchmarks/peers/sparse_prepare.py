"""The problems of the sparse models: inducing points, and where learning starts."""

from dataclasses import replace

import numpy as np
from inducing import with_tasks
from prepare import CLIMB, N_TASKS, random_problem, to_learn, to_parameters
from problem import NOISE, Problem
from reference import covariance
from sparse_reference import prior_variance

from skmtgp.inference.engines import Sparse
from skmtgp.inference.inducing import greedy_variance
from skmtgp.learning.ranks import learn_ranks
from skmtgp.learning.summarised import begin_at, exact_part
from skmtgp.model.task_covariance import leading_eigenvectors, low_rank

LEAST_NOISE = 2.0 * NOISE[0]  # of a start


class Prior:
    """The covariance of f as a kernel of inputs and tasks."""

    def __init__(self, parameters):
        self.parameters = parameters

    def __call__(self, X, Y):
        """Covariances."""
        return covariance(self.parameters, *split(X), *split(Y))

    def diag(self, X):
        """Variances."""
        return prior_variance(self.parameters, *split(X))


def split(X):
    """Inputs, and the tasks of the last column."""
    return X[:, :-1], X[:, -1].astype(int)


def random_sparse_problem(n, m):
    """Random data for timings, with some of the rows as inducing points."""
    problem = random_problem(n)
    rows = np.linspace(0, n - 1, m).astype(int)  # of all tasks
    return problem._replace(Z=problem.u[rows], points=problem.X[rows])


def whole_problem(problem):
    """The same data with all rows as inducing points: the bound is the likelihood."""
    return problem._replace(Z=problem.u, points=problem.X)


def part_problem(problem, m):
    """The same data with m inducing points, chosen at the start by skmtgp's rule."""
    points = greedy(Prior(problem.start), problem.X, m)
    prior = Prior(problem.start._replace(K_rho=np.ones((1, 1))))  # k^x
    Z = greedy(prior, with_tasks(problem.u, [0]), m)[:, :-1]
    return problem._replace(Z=Z, points=points)


def learned_problem(problem, parameters, m):
    """The same data: what has been learned is the start, and the points are new."""
    F = leading_eigenvectors(parameters.K_rho, problem.F.shape[1])
    start = parameters._replace(noise=np.maximum(parameters.noise, LEAST_NOISE))
    return part_problem(problem._replace(F=F, start=start), m)


def greedy(prior, X, m):
    """Rows with the most variance, given those before."""
    return greedy_variance(prior, X, m, random_state=np.random.RandomState(0))


def start_of(train, m, rank, max_iter=CLIMB):
    """The problem with the start from which skmtgp climbs the bound.

    That is the mode of exact inference on some of the rows, where the inducing inputs
    are chosen, with the noise variance that has the highest bound. It is kept off its
    own lower bound, where the peers' transforms have no gradient.
    """
    form = low_rank(N_TASKS, rank)
    learned = to_learn(train, form, max_iter, Sparse(n_inducing=m))
    (mode,) = learn_ranks(exact_part([learned], [form]), [form])[0]

    def problem_at(theta):
        values = learned.prior.values(theta)
        F = values.rho.reshape(N_TASKS, rank)
        noise = np.maximum(values.noise[0], LEAST_NOISE)
        return Problem(*train, F, to_parameters(values.kernel, F, noise))

    problem = part_problem(problem_at(mode.theta), m)
    theta = begin_at(learned.with_data(replace(learned.data, Z=problem.Z)), mode)
    return problem._replace(start=problem_at(theta).start)
