"""The problems: data, scaling and the common starting point, and the test sets."""

from typing import NamedTuple

import numpy as np
from problem import FACTOR, N_X, NOISE, Parameters, Problem

from skmtgp._data.data import Data
from skmtgp.datasets import fetch_puma560
from skmtgp.inference.engines import Dense
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.learning import problem as learning
from skmtgp.learning.stages import first_stage, second_stage
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import identity, low_rank, ones
from skmtgp.preprocessing import InverseDynamicsFeatures

LOADS, N_TASKS, RANK, START_NOISE = range(1, 15), 14, 4, 1e-2
SMALL, SHORT_CLIMB, CLIMB = 500, 300, 2000
TEST_ROWS = 2000  # of each load, at random


class Rows(NamedTuple):
    """Features, tasks 0 to 13 and scaled torques of one joint."""

    u: np.ndarray
    tasks: np.ndarray
    y: np.ndarray


class Case(NamedTuple):
    """One output of one draw: training rows and the two test sets."""

    train: Rows
    interpolation: Rows
    extrapolation: Rows


def load_case(n_per_load, joint, draw, test_rows=TEST_ROWS):
    """Data of a joint, 1 to 6, scaled as in training; all test rows if None."""

    def fetch(subset, n):
        return fetch_puma560(
            subset=subset, n_per_load=n, loads=LOADS, random_state=draw, return_X_y=True
        )

    X, tau = fetch("train", n_per_load)
    features = InverseDynamicsFeatures(N_X // 3).fit(X)
    mean, scale = tau[:, joint - 1].mean(), tau[:, joint - 1].std()

    def rows(X, tau):
        table = features.transform(X)
        order = np.argsort(table[:, -1], kind="stable")
        tasks = table[order, -1].astype(int) - 1
        return Rows(table[order, :-1], tasks, (tau[order, joint - 1] - mean) / scale)

    tests = (rows(*fetch(s, test_rows)) for s in ("interpolation", "extrapolation"))
    return Case(rows(X, tau), *tests)


def make_problem(train):
    """Training data with the start from which this package's best mode comes."""
    form = low_rank(N_TASKS, RANK)
    forms = [fixed(N_TASKS) for fixed in (identity, ones)]
    starts = [first_stage(to_learn(train, fixed)) for fixed in forms]
    problem = to_learn(train, form, CLIMB if len(train.y) < SMALL else SHORT_CLIMB)
    jobs = [([problem], [start]) for start in starts]
    modes = second_stage(jobs, shakes=1)
    best = starts[int(np.argmax([mode.value for mode in modes]))]
    F = np.clip(form.parameters(best.K_rho), *FACTOR).reshape(N_TASKS, RANK)
    return Problem(*train, F, to_parameters(best.kernel_theta, F))


def to_learn(train, form, max_iter=CLIMB, engine=None):
    """What this package learns: the paper's model of the scaled targets.

    Parameters
    ----------
    train : Rows
        Training data.
    form : FixedTaskCovariance or LowRank
        Form of K^rho.
    max_iter : int, default=CLIMB
        Most iterations of each climb.
    engine : Engine, default=None
        How the likelihood is computed. None is dense.
    """
    prior = Prior(
        inverse_dynamics_kernel(N_X // 3),
        form,
        log_noise=float(np.log(START_NOISE)),
        log_noise_bounds=tuple(np.log(NOISE)),
    )
    budget = learning.Budget(max_iter, tol=1e-2)
    data = Data(*train, N_TASKS)
    return learning.Problem(prior, data, engine or Dense(), budget)


def to_parameters(theta, F, noise=START_NOISE):
    """The comparison's parameters from theta of k^x; None is where that starts."""
    kernel = inverse_dynamics_kernel(N_X // 3)
    kernel = kernel if theta is None else kernel.clone_with_theta(theta)
    linear, smooth = kernel.k1, kernel.k2
    return Parameters(
        smooth.k2.kernel.length_scale,
        linear.weights,
        linear.bias,
        smooth.k1.constant_value,
        noise,
        F @ F.T,
    ).as_float64()


def random_problem(n, seed=0):
    """Random data for timings, as in benchmarks/likelihood.py."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((n, N_X))
    u = np.hstack([x, np.sign(x[:, 6:12])])
    tasks = np.sort(np.arange(n) % N_TASKS)
    y, F = rng.standard_normal(n), rng.standard_normal((N_TASKS, RANK))
    return Problem(u, tasks, y, F, to_parameters(None, F))
