"""About how long learning will take, before it begins."""

from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._numerics.parallel import limit_threads

FEW = 1500  # rows: what one model of fewer takes is not worth saying
SAMPLE, TIMED = 500, 2  # rows of the evaluations that are timed, and how many are
# Evaluations that a model takes at the first level, and at others; of noisy data
COARSE, FINE, NOISY = 250, 120, 100
BOUNDS = 60  # of the bound of sparse inference, of each form


class Forecast(NamedTuple):
    """What learning will take, roughly.

    Attributes
    ----------
    rows : list of int
        Of the matrices of each level, from coarse to fine. Empty where they are few.
    n_evaluations : list of int
        Likelihoods with their gradients at each level.
    pace : float
        Seconds that one takes, over the cube of the rows of its matrices.
    """

    rows: list
    n_evaluations: list
    pace: float

    @property
    def seconds(self):
        """In all, on one processor."""
        return sum(
            n * each for n, each in zip(self.n_evaluations, self.each, strict=True)
        )

    @property
    def each(self):
        """Seconds that one evaluation takes, at each level."""
        return [self.pace * n**3 for n in self.rows]

    def __str__(self):
        levels = zip(self.n_evaluations, self.rows, self.each, strict=True)
        return ", ".join(
            f"{n} evaluations of {rows} rows at {seconds:.2g} s each"
            for n, rows, seconds in levels
        )


def are_many(n_rows, n_models=1):
    """Whether learning so many models of so many rows may take long."""
    return n_rows * np.cbrt(n_models) >= FEW


def is_large(problem, n_models=1):
    """Whether likelihoods of so many models take so long that a user should know.

    Exact ones take it with the side of their matrices, bounds with all rows.
    """
    engine, data = problem.engine, problem.data
    n_rows = engine.side(data) if engine.exact else len(data)
    return are_many(n_rows, n_models)


def foresee(problems, n_forms=1):
    """What learning will take about.

    Two evaluations with some of the rows are timed, as one may be held up. Their time
    grows with the cube of the side of the matrices.

    Parameters
    ----------
    problems : list of Problem
        For each output, exact.
    n_forms : int, default=1
        Models of each.

    Returns
    -------
    forecast : Forecast
        Nothing where there are few rows.
    """
    problem, n_models = problems[0], len(problems) * n_forms
    if not is_large(problem, n_models):
        return Forecast([], [], 0.0)
    sides = [problem.engine.side(of.data) for of in problem.coarse_to_fine()]
    fine = NOISY if problem.noisy else FINE
    counts = [COARSE] + [fine] * (len(sides) - 1)
    return Forecast(sides, [n * n_models for n in counts], _pace(problem))


def foresee_bounds(problems, form, n_forms=1):
    """Seconds that learning by the bound of sparse inference takes about, in all.

    One is timed, with the first inducing inputs that come.

    Parameters
    ----------
    problems : list of Problem
        For each output, with an engine that approximates.
    form : LowRank or another
        Form of K^rho, of a usual rank.
    n_forms : int, default=1
        How many are learned.

    Returns
    -------
    seconds : float
        0 where there are few rows, or where they stay in partitions.
    """
    problem = problems[0].with_form(form)
    data, n_inducing = problem.data, problem.engine.n_inducing
    if is_dask(data.X) or not are_many(len(data), len(problems) * n_forms):
        return 0.0
    Z = data.drawn(min(n_inducing, len(data))).X
    likelihood = problem.with_data(replace(data, Z=Z)).likelihood()
    with limit_threads(likelihood.side):
        begin = perf_counter()
        likelihood.value_and_grad(problem.theta())
        each = perf_counter() - begin
    return each * BOUNDS * len(problems) * n_forms


def _pace(problem):
    """Seconds of one evaluation over the cube of the side of its matrices."""
    likelihood = problem.with_data(problem.data.thinned(SAMPLE)).likelihood()
    with limit_threads(likelihood.side):
        theta = problem.theta()
        likelihood.value_and_grad(theta)  # what is done once
        times = [perf_counter()]
        for _ in range(TIMED):
            likelihood.value_and_grad(theta)
            times.append(perf_counter())
        return float(np.diff(times).min()) / likelihood.side**3
