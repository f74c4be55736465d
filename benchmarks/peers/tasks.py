"""What gpy_tasks.py and gpytorch_tasks.py share: fits of the models of real_data.py.

``python NAME_tasks.py problem.npz result.npz --model icm`` learns from standardised
rows and predicts others. An adapter is a class ``Adapter(problem, shape, rng)``, where
the Shape says which model it is and the generator draws where it starts, with

- ``x``: where its parameters are, a vector;
- ``value_and_grad(x)``: log likelihood and gradient, or None where it fails;
- ``predict(X)``: mean and standard deviation of y there, after ``value_and_grad``.

Models are learned from several starts by SciPy's L-BFGS-B, and BIC chooses the shape.
"""

import argparse
import time
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

STARTS = 3
FEW_TASKS = 12  # the largest number with a noise variance of each, and rank 3
TEST_ROWS = 500  # predicted at a time
OPTIONS = {"maxcor": 30, "maxiter": 2000, "maxfun": 4000}


class Budget(Exception):
    """The time for a climb is over."""


@dataclass
class Shape:
    """Which model.

    Attributes
    ----------
    n_smooth : int
        Squared exponentials, each with a task covariance of its own.
    rank : int
        Of these covariances; each has a diagonal, too.
    levels : bool
        Whether a constant has a task covariance of its own; it has that of the squared
        exponential otherwise.
    own_noise : bool
        Whether each task has a noise variance.
    """

    n_smooth: int
    rank: int
    levels: bool
    own_noise: bool


@dataclass
class Problem:
    """Rows to learn from, and inputs to predict, the task in the last column."""

    X: np.ndarray
    y: np.ndarray
    X_test: np.ndarray
    n_tasks: int
    own_units: bool

    @property
    def n_features(self):
        """Columns without the task."""
        return self.X.shape[1] - 1


def shapes(model, problem):
    """What BIC chooses from."""
    few = problem.n_tasks <= FEW_TASKS
    own_noise = few and problem.own_units
    if model == "lmc":
        return [Shape(n, 1, True, own_noise) for n in (2, 3 if few else 1)]
    ranks = range(1, min(problem.n_tasks, 3 if few else 2) + 1)
    return [Shape(1, rank, False, own_noise) for rank in ranks]


def start(shape, problem, rng, *, drawn):
    """Length-scales of each squared exponential, and factors of task covariances."""
    d, n_tasks = problem.n_features, problem.n_tasks
    scales = np.sqrt(d) * 2.0 ** np.arange(shape.n_smooth)[:, None] * np.ones(d)
    factors = 0.3 * rng.standard_normal(
        (shape.n_smooth + shape.levels, n_tasks, shape.rank)
    )
    factors[:, :, 0] += 0.7
    if drawn:
        scales *= np.exp(0.7 * rng.standard_normal(scales.shape))
        factors = rng.standard_normal(factors.shape) / np.sqrt(shape.rank)
    return scales, factors


def climb(adapter, seconds):
    """The best likelihood on the way, and its parameters."""
    begin, best = time.process_time(), [-np.inf, adapter.x]

    def objective(x):
        if time.process_time() - begin > seconds:
            raise Budget
        found = adapter.value_and_grad(x)
        if found is None or not (np.isfinite(found[0]) and np.isfinite(found[1]).all()):
            return 1e10, np.zeros_like(x)
        if found[0] > best[0]:
            best[:] = found[0], x.copy()
        return -found[0], -found[1]

    try:
        minimize(objective, adapter.x, jac=True, method="L-BFGS-B", options=OPTIONS)
        return *best, False
    except Budget:
        return *best, True


def learn(make, problem, model, budget):
    """The adapter at the best parameters by BIC, and how it went."""
    tried, cut = [], 0
    candidates = shapes(model, problem)
    for shape in candidates:
        for k in range(STARTS):
            rng = np.random.default_rng(k)
            adapter = make(problem, shape, rng, drawn=k > 0)
            share = budget / len(candidates) / STARTS
            value, x, spent = climb(adapter, share)
            cut += spent
            bic = value - 0.5 * len(x) * np.log(len(problem.y))
            tried.append((bic, value, x, shape, adapter))
    bic, value, x, shape, adapter = max(tried, key=lambda row: row[0])
    adapter.value_and_grad(x)
    return adapter, {"likelihood": value, "shape": str(shape), "cut": cut}


def main(make):
    """Run an adapter from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problem")
    parser.add_argument("result")
    parser.add_argument("--model", choices=("icm", "lmc"), default="icm")
    parser.add_argument("--budget", type=float, default=300.0, help="seconds")
    arguments = parser.parse_args()
    with np.load(arguments.problem) as file:
        problem = Problem(
            *(file[name] for name in ("X", "y", "X_test")),
            int(file["n_tasks"]),
            bool(file["own_units"]),
        )
    begin = time.process_time()
    adapter, report = learn(make, problem, arguments.model, arguments.budget)
    parts = np.split(problem.X_test, range(TEST_ROWS, len(problem.X_test), TEST_ROWS))
    predictions = [adapter.predict(part) for part in parts]
    mean, std = np.concatenate(predictions, axis=1)
    seconds = time.process_time() - begin
    np.savez(arguments.result, mean=mean, std=std, seconds=seconds, **report)
