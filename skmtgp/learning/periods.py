"""Periods at which learning begins: the likelihood has a maximum for every multiple.

The likelihood of a period has many maxima, as wide as its square over the width of the
data, and no climb leads from one to the next. So a periodogram of the targets says
which periods there may be, and the likelihood of a small model, which of them it is.
"""

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import ExpSineSquared

from skmtgp._data.dask import is_dask
from skmtgp._data.statistics import shortest_period
from skmtgp._numerics.parallel import limit_threads
from skmtgp._numerics.periodogram import MOST_CYCLES, frequencies, without_waves
from skmtgp._support.progress import say
from skmtgp.kernels import Columns
from skmtgp.learning.summarised import exact_part
from skmtgp.learning.telling import about
from skmtgp.model.remembered import remembered
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


def begun_in_time(problem, told=True):
    """The problem with periods from which learning finds its way.

    Parameters
    ----------
    problem : Problem
        What is to be learned.
    told : bool, default=True
        Whether `verbose` says which.

    Returns
    -------
    problem : Problem
        As it was, unless its kernel has a period, and another one is likelier.
    """
    periods = periods_of(problem.prior.kernels, problem.data.X.shape[1])
    if not periods or not problem.budget.max_iter:
        return problem
    kernel, theta = problem.prior.kernel, problem.prior.kernel.theta
    some = _some(problem)
    most_cycles = [_most_cycles(problem, period) for period in periods]
    pairs = zip(periods, most_cycles, strict=True)
    choices = [_Choice(some, *pair, periods) for pair in pairs if pair[1] >= 1.0]
    with limit_threads(len(some.data)):
        for choice in choices * 2:
            theta = choice.best(theta)
    if (theta == kernel.theta).all():
        return problem
    if told and problem.budget.verbose:
        found = ", ".join(f"{np.exp(theta[of.position]):.4g}" for of in periods)
        say(f"{about(problem)}learning begins at a period of {found}")
    begun = kernel.clone_with_theta(theta)
    return replace(problem, prior=replace(problem.prior, kernel=begun))


def _some(problem):
    """The problem with a few hundred of the rows."""
    exact = exact_part([problem], [problem.prior.task_covariance])[0]
    data, most = exact.data, problem.tuning.coarse
    return exact if data.n_inputs <= most else exact.with_data(data.thinned(most))


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


def _most_cycles(problem, period):
    """Of the shortest period that can be told from a longer one, and is allowed."""
    X, dims = problem.data.X, problem.prior.kernel.bounds.reshape(-1, 2)
    column = X[:, period.column]
    width = float(column.max() - column.min())
    least = np.exp(dims[period.position, 0])
    if not is_dask(X):
        least = max(least, shortest_period(column))
    return width / least if width > 0.0 else 0.0


class _Choice:
    """Which period is the likeliest of those that a periodogram finds.

    Parameters
    ----------
    problem : Problem
        Of some of the rows.
    period : Period
        The one to choose.
    most_cycles : float
        The highest frequency, in cycles in the width of the data.
    periods : list of Period
        All of them: an input may have several.
    """

    def __init__(self, problem, period, most_cycles, periods):
        column = problem.data.X[:, period.column]
        self.problem, self.period = problem, period
        self.most_cycles = min(most_cycles, MOST_CYCLES)
        self.start, self.width = column.min(), np.ptp(column)
        self.forms, self.chosen = self._forms(), None
        self.others = [
            of.position for of in periods if of.column == period.column and of != period
        ]

    def best(self, theta):
        """Theta with another period, if that is likelier.

        It is as it was if it is what was chosen before: no other period has moved.
        """
        if self.width > 0.0 and not np.array_equal(theta, self.chosen):
            self.chosen = theta = self._best(theta)
        return theta

    @cached_property
    def x(self):
        """The input, from 0 to 1."""
        return (self.problem.data.X[:, self.period.column] - self.start) / self.width

    @cached_property
    def found(self):
        """Frequencies of the targets, whatever theta is."""
        return self._frequencies(self.problem.data.y)

    def _frequencies(self, y):
        return frequencies(self.x, self.problem.data.tasks, y, self.most_cycles)

    def _beside(self, theta):
        """Frequencies of targets without what other periods of the input explain."""
        if not self.others:
            return self.found
        data, cycles = self.problem.data, self.width / np.exp(theta[self.others])
        rest = without_waves(self.x, data.tasks, data.y, cycles)
        return np.union1d(self.found, self._frequencies(rest))

    def _best(self, theta):
        tuning, found = self.problem.tuning, self._beside(theta)
        ratios = np.outer(found, [1.0, *tuning.harmonics]).ravel()
        within = (ratios >= 1.0) & (ratios <= self.most_cycles)
        cycles = np.unique([*tuning.slow, *ratios[within]])
        likely = self._likely_form(theta, [*tuning.slow, *found])
        values = [self._value(theta, c, likely) for c in cycles]
        order = np.argsort(-np.array(values), kind="stable")[: tuning.refined]
        _, likeliest = max(
            self._top(theta, cycles[k], values[k], likely) for k in order
        )
        moved = self._moved(theta, likeliest)
        value = max(self._values(moved)) - self._price(moved)
        if value <= self._without(theta) + tuning.repeating:
            return theta
        return moved

    def _without(self, theta):
        """The value of the given period or, if that is likelier, of none at all."""
        flat = self._moved(theta, 1.0 / self.problem.tuning.aperiodic)
        given = max(self._values(theta)) - self._price(theta)
        return max(given, *self._values(flat))

    def _likely_form(self, theta, cycles):
        """The one by which one of some frequencies is likeliest."""
        values = [self._values(self._moved(theta, c)) for c in cycles]
        return self.forms[int(np.argmax(np.max(values, axis=0)))]

    def _top(self, theta, cycles, value, form):
        """The top of a peak near a frequency: its value, and where it is."""
        for step in self.problem.tuning.to_top:
            others = cycles - step, cycles + step
            near = [(self._value(theta, c, form), c) for c in others]
            value, cycles = max((value, cycles), *near)
        return value, cycles

    def _value(self, theta, cycles, form):
        moved = self._moved(theta, cycles)
        return self._values(moved, [form])[0] - self._price(moved)

    def _price(self, theta):
        """There are as many other periods as short."""
        return max(0.0, np.log(self.width) - theta[self.period.position])

    def _moved(self, theta, cycles):
        moved = theta.copy()
        moved[self.period.position] = np.log(self.width / cycles)
        return np.clip(moved, *self.problem.prior.kernel.bounds.reshape(-1, 2).T)

    def _forms(self):
        """Likelihoods of independent tasks and of one function, and noise variances."""
        prior, forms = self.problem.prior, [self.problem.prior.task_covariance]
        if prior.n_terms == 1 and prior.n_tasks > 1:
            forms.append(ones(prior.n_tasks))
        priors, node = map(prior.with_form, forms), remembered(prior.node)
        of_forms = [replace(self.problem, prior=of.with_node(node)) for of in priors]
        noises = np.multiply(self.problem.tuning.noises_of_period, prior.scale**2)
        noises = np.unique(np.clip(np.log(noises), *prior.log_noise_bounds))
        return [(of, of.likelihood(), noise) for of in of_forms for noise in noises]

    def _values(self, theta, forms=None):
        """Their values at theta of k^x."""
        with np.errstate(all="ignore"):
            return [
                likelihood.value(of_form.theta(kernel=theta, log_noise=noise))
                for of_form, likelihood, noise in forms or self.forms
            ]
