"""Rows of F of tasks with few rows of data, learned with what the other tasks are like.

One to three samples do not determine how a task is related to the others: by maximum
likelihood its row of F explains them exactly, however large it must be for that. So
these rows are learned once more, at the hyperparameters of all data, each as the border
of the larger tasks with the prior of their population, as a task that joins later has
it (section 3.3 and :mod:`skmtgp.learning.novel`). The order of tasks does not matter.

By sparse inference this is done of more tasks: of those with fewer than thirty rows of
data for each number of their row of F, if many tasks have more, and most of the rows.
Should the likelihood say that the larger tasks do not speak for them, they stay as they
are.
"""

from dataclasses import replace

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._data.known import noise_of
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.border import BorderLikelihood
from skmtgp.learning.novel import (
    Posed,
    by_terms,
    lacking,
    learn_border,
    shares_of,
)

FEW = 3  # rows of a task that do not determine its row of F
LEAST = 2  # tasks that make a population
# By sparse inference: rows for each number of a row of F that tell it, how many tasks
# with as many, for each number, tell what tasks are like, and nats for each number that
# the rows of F of the others may lose.
EACH, MANY, LOST = 30, 4, 0.25


def settled(problem, mode):
    """The mode with rows of F of tasks of few samples as the other tasks suggest them.

    Parameters
    ----------
    problem : Problem
        What was learned.
    mode : Mode
        What was found.

    Returns
    -------
    mode : Mode
        As it was, unless some tasks have few rows and others do not, and K^rho has a
        factor with a row for each.
    """
    few = few_rows(problem)
    if not few.any():
        return mode
    small = few & (_n_rows(problem.data) <= FEW)
    fewest = _settled(problem, mode, small) if small.any() else mode
    n_more = np.count_nonzero(few & ~small)
    if not n_more:
        return fewest
    found = _settled(problem, mode, few)
    lost = fewest.value - found.value
    return found if lost < LOST * _rank(problem.prior) * n_more else fewest


def _settled(problem, mode, few):
    """The mode with rows of F of some of the tasks as the others suggest them.

    `few` is a mask of these tasks.
    """
    small = _n_rows(problem.data) <= FEW
    prior, theta = problem.prior, mode.theta.copy()
    problem = problem.with_data(replace(problem.data, Z=mode.Z))
    larger = problem.with_data(problem.data.of_tasks(~few)).likelihood()
    with limit_threads(larger.side):
        if prior.n_noise > 1:
            usual = larger.usual_log_noise(theta)
            theta[np.flatnonzero(prior.of_noise)[few & small]] = usual
        posterior = larger.posterior(theta)
        population = np.hstack(shares_of(prior, theta)[0])[~few]
        for task in _fewest_first(problem.data, few):
            border = _border(problem, posterior, theta, task)
            if not len(border.y):  # all that its rows tell is a trend of its own
                continue
            posed = Posed(border, population)
            best = learn_border(posed, problem.budget, informed=True)
            row = by_terms(border, best.x, prior.n_terms)
            theta = prior.with_row(theta, *row, task)
    likelihood = problem.likelihood()
    with limit_threads(likelihood.side):
        value = likelihood.value(theta)
    return mode._replace(theta=theta, value=value, rivals=())


def few_rows(problem):
    """Which tasks have few rows of data, a mask; none where nothing is to be settled.

    A row counts as often as measurements were averaged. The fast algebra of complete
    data needs rows of each task.
    """
    data, prior = problem.data, problem.prior
    few = np.zeros(data.n_tasks, dtype=bool)
    learned = problem.budget.max_iter and has_rows(prior)
    if not learned or is_dask(data.X) or data.design is not None:
        return few
    few = _n_rows(data) <= FEW
    if not problem.engine.exact:
        few |= _are_open(data, _rank(prior))
    return few & (np.count_nonzero(~few) >= LEAST)


def _are_open(data, rank):
    """Which tasks have too few rows for a row of F, if the others tell enough of it.

    Repeats of a row tell the noise alone, so a row counts once.
    """
    n_rows = np.bincount(data.tasks, minlength=data.n_tasks)
    is_open = n_rows < EACH * rank
    many = np.count_nonzero(~is_open) >= MANY * rank
    return is_open & (many and 2 * n_rows[~is_open].sum() > len(data))


def _n_rows(data):
    """Measurements of each task."""
    return np.bincount(data.tasks, data.counts, data.n_tasks)


def _rank(prior):
    """How many numbers the rows of F of all terms have for a task."""
    return sum(getattr(form, "rank", 0) for _, form in prior.terms)


def _fewest_first(data, few):
    """Positions of some tasks: those with the fewest rows first."""
    order = np.argsort(_n_rows(data), kind="stable")
    return order[few[order]]


def has_rows(prior):
    """Whether each task has a row of F to learn, in each term that has an F."""
    forms = [form for _, form in prior.terms]
    return any(getattr(form, "rank", 0) for form in forms) and not any(
        lacking(form, ["columns", "with_row"])[1] for form in forms
    )


def _border(problem, posterior, theta, task):
    """The likelihood of a task's row by the larger tasks, those of the posterior."""
    prior, data = problem.prior, problem.data
    X, _, y, known = data.some(np.flatnonzero(data.tasks == task))
    values, trend = prior.values(theta), prior.trend
    noise = np.broadcast_to(values.noise, data.n_tasks)[task]
    factors, shared, equal = shares_of(prior, theta)
    return BorderLikelihood(
        posterior,
        factors,
        X,
        y,
        noise_of(known, np.full(len(y), noise)),
        [form.n_own > 1 for _, form in prior.terms],  # one number is that of all
        level=values.level,
        shared=shared,
        equal=equal,
        trend=None if trend is None else trend.rows_of(task, X),
    )
