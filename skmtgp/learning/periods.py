"""Periods at which learning begins: the likelihood has a maximum for every multiple.

The likelihood of a period has many maxima, as wide as its square over the width of the
data, and no climb leads from one to the next. So a periodogram of the targets says
which periods there may be, and the likelihood of a small model, which of them it is.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import ExpSineSquared

from skmtgp._data.dask import is_dask
from skmtgp._data.statistics import least_gap
from skmtgp._numerics.parallel import limit_threads
from skmtgp._numerics.periodogram import frequencies
from skmtgp._support.progress import say
from skmtgp.kernels import Columns
from skmtgp.learning.summarised import exact_part
from skmtgp.learning.telling import about
from skmtgp.model.task_covariance import ones


class Period(NamedTuple):
    """A period that is learned.

    Attributes
    ----------
    position : int
        Of its logarithm in theta of k^x.
    column : int
        Of the inputs.
    """

    position: int
    column: int


def begun_in_time(problem):
    """The problem with periods from which learning finds its way.

    Parameters
    ----------
    problem : Problem
        What is to be learned.

    Returns
    -------
    problem : Problem
        As it was, unless its kernel has a period, and another one is likelier.
    """
    periods = periods_of(problem.prior.kernels, problem.data.X.shape[1])
    if not periods or not problem.budget.max_iter:
        return problem
    kernel, theta = problem.prior.kernel, problem.prior.kernel.theta
    coarse = exact_part([problem], [problem.prior.task_covariance])[0]
    coarse = coarse.coarse_to_fine()[0]
    with limit_threads(len(coarse.data)):
        for period in periods * (2 if len(periods) > 1 else 1):
            theta = _likeliest(problem, coarse, theta, period)
    if (theta == kernel.theta).all():
        return problem
    if problem.budget.verbose:
        found = ", ".join(f"{np.exp(theta[of.position]):.4g}" for of in periods)
        say(f"{about(problem)}learning begins at a period of {found}")
    begun = kernel.clone_with_theta(theta)
    return replace(problem, prior=replace(problem.prior, kernel=begun))


def periods_of(kernels, n_features):
    """The periods of the terms' kernels that are not fixed, in the order of theta.

    Parameters
    ----------
    kernels : sequence of Kernel
        k^x of each term.
    n_features : int
        Number of inputs.

    Returns
    -------
    periods : list of Period
    """
    found, position = [], 0
    for kernel in kernels:
        for part in kernel.hyperparameters:
            if part.fixed:
                continue
            column = _column(kernel, part.name, np.arange(n_features))
            if column is not None:
                found.append(Period(position, column))
            position += part.n_elements
    return found


def _column(kernel, name, columns):
    """The column that a hyperparameter is the period of; None if it is none."""
    *path, last = name.split("__")
    for step in path:
        if isinstance(kernel, Columns):
            columns = kernel.select(columns[None])[0]
        kernel = getattr(kernel, step, None)
    is_period = isinstance(kernel, ExpSineSquared) and last == "periodicity"
    return int(columns[0]) if is_period and len(columns) == 1 else None


def _likeliest(problem, coarse, theta, period):
    """Theta with another period, if that is likelier."""
    column = coarse.data.X[:, period.column]
    start, width = column.min(), np.ptp(column)
    most_cycles = _most_cycles(problem, period, width)
    if most_cycles < 1.0:
        return theta
    data, tuning = coarse.data, coarse.tuning
    cycles = frequencies((column - start) / width, data.tasks, data.y, most_cycles)
    thetas = [theta]
    for log_period in np.log(width / cycles):
        moved = theta.copy()
        moved[period.position] = log_period
        thetas.append(np.clip(moved, *problem.prior.kernel.bounds.reshape(-1, 2).T))
    values = []
    for tried in thetas:
        price = max(0.0, np.log(width) - tried[period.position])
        values.append(_best_value(coarse, tried) - price)
    best = int(np.argmax(values))
    return thetas[best] if values[best] > values[0] + tuning.doubt else theta


def _most_cycles(problem, period, width):
    """Of the shortest period that can be told from a longer one, and is allowed."""
    if width <= 0.0:
        return 0.0
    lower = np.exp(problem.prior.kernel.bounds.reshape(-1, 2)[period.position, 0])
    X = problem.data.X
    gap = 0.0 if is_dask(X) else least_gap(X[:, period.column])
    return width / max(lower, 2.0 * gap, width * np.finfo(float).eps)


def _best_value(problem, theta):
    """The best likelihood of independent tasks and of one function, by the noise."""
    prior, forms = problem.prior, [problem.prior.task_covariance]
    if prior.n_terms == 1 and prior.n_tasks > 1:
        forms.append(ones(prior.n_tasks))
    values = []
    for form in forms:
        of_form = problem.with_form(form)
        likelihood = of_form.likelihood()
        for noise in problem.tuning.noises_of_period:
            log_noise = np.clip(np.log(noise * prior.scale**2), *prior.log_noise_bounds)
            start = of_form.theta(kernel=theta, log_noise=log_noise)
            with np.errstate(all="ignore"):
                values.append(likelihood.value(start))
    return max(values)
