r"""Whether noise is correlated between neighbouring rows, in the order that was given.

Residuals of the fitted model do not tell: what is correlated along time it takes for a
function of the inputs, as far as it can, and white noise is left. What it cannot take
up is tested as in :mod:`skmtgp.learning.hidden`. If noise that is correlated along the
rows, of a task each, were added to the model, would that gain? The derivative of the
log likelihood by its variance is, if the model is right, random with mean zero and
known moments, in whatever order the rows are.
"""

import numpy as np
from scipy.stats import chi2

from skmtgp._numerics.parallel import limit_threads

LEAST, MOST = 30, 600  # rows that are asked
RUN = 50  # neighbouring rows, of which as many as are asked are made up
CORRELATION = 0.8  # of what is added, between neighbours
BY_CHANCE = 1e-3  # how often a right model is accused, before it is fitted
LARGE = 0.3  # of the noise variance, that matters


def correlated_share(problem, mode):
    r"""How much of the noise variance is correlated between neighbouring rows.

    Parameters
    ----------
    problem : Problem
        Of all rows, in memory.
    mode : Mode
        Its mode.

    Returns
    -------
    share : float
        0 where there is nothing beyond chance, or little. Otherwise what a step along
        the derivative finds, relative to the noise variance: not exact.

    Notes
    -----
    With :math:`W = K^{-1}` and the covariance A of what is added, which falls with the
    distance of the rows, the derivative is
    :math:`\tfrac12 (y^T W A W y - \mathrm{tr}\,WA)`. Of normal targets its variance is
    :math:`\tfrac12 \mathrm{tr}\,(WA)^2` and its third moment
    :math:`\mathrm{tr}\,(WA)^3`; a chi-squared variable with these says what is chance.
    """
    data = problem.data
    if len(data) < LEAST or not problem.is_noisy(mode):
        return 0.0
    rows, places = _neighbours(data.tasks)
    X, tasks, y, noise, K = problem.some(mode, rows)
    A = np.sqrt(np.outer(noise, noise)) * _along(tasks, places)
    if not A.any():  # no task has more than two rows
        return 0.0
    with limit_threads(len(rows)):
        W = problem.prior.precision(K, X, tasks)
        alpha, WA = W @ y, W @ A
        slope = 0.5 * (alpha @ A @ alpha - np.trace(WA))
        variance, third = 0.5 * np.vdot(WA, WA.T), np.vdot(WA @ WA, WA.T)
    share = slope / variance
    return float(share) if share > LARGE and _is_rare(slope, variance, third) else 0.0


def _neighbours(tasks):
    """Rows, and where they are among those sorted by task: all of them, or runs."""
    order = np.argsort(tasks, kind="stable")
    places = np.arange(len(order))
    if len(order) > MOST:
        starts = np.linspace(0, len(order) - RUN, MOST // RUN).astype(int)
        places = np.add.outer(starts, np.arange(RUN)).ravel()
    return order[places], places


def _along(tasks, places):
    """The correlations of what is added, zero in the mean of all pairs of a task.

    So a misfit that has nothing to do with the order, such as a level, adds nothing.
    """
    C = CORRELATION ** np.abs(np.subtract.outer(places, places))
    pairs = np.equal.outer(tasks, tasks) & ~np.eye(len(tasks), dtype=bool)
    of_task = np.eye(tasks.max() + 1)[tasks]
    sums, counts = (of_task.T @ of @ of_task for of in (C * pairs, 1.0 * pairs))
    means = np.diagonal(sums) / np.maximum(np.diagonal(counts), 1.0)
    return (C - means[tasks]) * pairs


def _is_rare(value, variance, third):
    """Whether so large a value is rare, of given moments and mean zero."""
    if not variance > 0.0:  # rounding has left nothing
        return False
    skewness = max(third / variance**1.5, 1e-3)
    freedom = 8.0 / skewness**2
    standard = value / np.sqrt(variance)
    return chi2.sf(freedom + standard * np.sqrt(2.0 * freedom), freedom) < BY_CHANCE
