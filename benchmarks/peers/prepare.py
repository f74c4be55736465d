"""The problems: data, scaling and the common starting point, and the test sets."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from problem import FACTOR, N_X, NOISE, Parameters, Problem

from skmtgp.datasets import fetch_puma560
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.learning.problem import Data, Settings
from skmtgp.learning.stages import first_stage, second_stage
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
    kernel, form = inverse_dynamics_kernel(N_X // 3), low_rank(N_TASKS, RANK)
    data = Data(train.u, train.tasks, train.y, N_TASKS)
    settings = Settings(
        kernel=kernel,
        scale=1.0,
        log_noise=np.log([START_NOISE]),
        log_noise_bounds=tuple(np.log(NOISE)),
        max_iter=CLIMB,
        tol=1e-2,
    )
    starts = [first_stage(data, settings, f(N_TASKS)) for f in (identity, ones)]
    climb = replace(settings, max_iter=CLIMB if len(train.y) < SMALL else SHORT_CLIMB)
    modes = second_stage([(data, climb, form, [start]) for start in starts])
    best = starts[int(np.argmax([mode.value for mode in modes]))]
    F = np.clip(form.parameters(best.K_rho), *FACTOR).reshape(N_TASKS, RANK)
    return Problem(*train, F, to_parameters(kernel, best.kernel_theta, F))


def to_parameters(kernel, theta, F, noise=START_NOISE):
    """The comparison's parameters from the kernel's theta."""
    kernel = kernel.clone_with_theta(theta)
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
    kernel = inverse_dynamics_kernel(N_X // 3)
    return Problem(u, tasks, y, F, to_parameters(kernel, kernel.theta, F))
