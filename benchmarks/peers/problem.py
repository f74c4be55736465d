"""The files between the comparison and the packages compared: problems and fits.

Needs numpy only: every package's own environment can read it.
"""

import json
from typing import NamedTuple

import numpy as np

N_X = 18  # u = (x, sgn(qd)): the squared exponential sees x, the linear kernel u
LENGTH_SCALES = np.exp([-2.0, 8.0])
WEIGHTS = np.exp([-14.0, 5.0])  # bias and amplitude, too
FACTOR = (-10.0, 10.0)
NOISE = (1e-10, 1e3)
KAPPA = float(np.exp(-12.0))  # the peers' diagonal of K^rho, at the start
KAPPA_BOUNDS = (1e-16, 1e3)


class Parameters(NamedTuple):
    """The parameters of the model, the same for all packages.

    Attributes
    ----------
    length_scales : ndarray of shape (18,)
        l_d.
    weights : ndarray of shape (24,)
        w_d.
    bias, amplitude, noise : float
        b, a and sigma^2.
    K_rho : ndarray of shape (n_tasks, n_tasks)
        K^rho, with any diagonal that the package adds.
    """

    length_scales: np.ndarray
    weights: np.ndarray
    bias: float
    amplitude: float
    noise: float
    K_rho: np.ndarray

    def as_float64(self):
        """The same, in double precision."""
        return Parameters(*(np.asarray(p, dtype=np.float64) for p in self))


class Problem(NamedTuple):
    """Training data of one output, and where learning starts.

    Attributes
    ----------
    u : ndarray of shape (n_samples, 24)
        x and sgn(qd).
    tasks : ndarray of shape (n_samples,)
        0 to n_tasks - 1, ascending.
    y : ndarray of shape (n_samples,)
        Targets of mean zero and variance one.
    F : ndarray of shape (n_tasks, rank)
        Factor of K^rho at the start.
    start : Parameters
        Where learning starts.
    Z : ndarray of shape (n_inducing, 24), default=None
        Inducing inputs of sparse models.
    points : ndarray of shape (n_inducing, 25), default=None
        As many inducing points, each an input and a task.
    """

    u: np.ndarray
    tasks: np.ndarray
    y: np.ndarray
    F: np.ndarray
    start: Parameters
    Z: np.ndarray | None = None
    points: np.ndarray | None = None

    @property
    def x(self):
        """The columns of u that the squared exponential sees."""
        return self.u[:, :N_X]

    @property
    def X(self):
        """U with the tasks in the last column."""
        return np.column_stack([self.u, self.tasks])

    def save(self, path):
        """Write an npz file."""
        arrays = {f"start_{k}": v for k, v in self.start._asdict().items()}
        rest = {k: v for k, v in self._asdict().items() if v is not None}
        np.savez(path, **arrays, **{k: v for k, v in rest.items() if k != "start"})


def load_problem(path):
    """Read what Problem.save wrote."""
    with np.load(path) as file:
        start = Parameters(*(file[f"start_{k}"] for k in Parameters._fields))
        arrays = {k: file[k] for k in Problem._fields if k in file}
        return Problem(start=start, **arrays)


def save_result(path, parameters=None, trace=(), **report):
    """Write a package's parameters, its trace and whatever else it reports."""
    arrays = {} if parameters is None else parameters.as_float64()._asdict()
    trace = np.reshape(np.asarray(trace, dtype=np.float64), (-1, 2))
    np.savez(path, trace=trace, report=json.dumps(report), **arrays)


def load_result(path):
    """Parameters (or None), trace of (seconds, likelihood), report."""
    with np.load(path) as file:
        parameters = None
        if "K_rho" in file:
            parameters = Parameters(*(file[k] for k in Parameters._fields))
        return parameters, file["trace"], json.loads(str(file["report"]))
