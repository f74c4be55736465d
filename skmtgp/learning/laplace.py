"""What the rows leave open of the hyperparameters around a mode: Laplace's method.

Around the mode of the likelihood the posterior of the hyperparameters is taken to be
normal, in coordinates in which it nearly is (`Chart`). Its precision is the curvature
of the likelihood and of weak priors there. The priors bound what the rows do not tell.
They do not move the mode: where rows are few the posterior has its mode elsewhere, but
without noise, far from what the priors expect, that would be a worse model.
"""

import numpy as np

from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.leeway import OfTheta
from skmtgp.learning.evidence import LogPosterior, Peak
from skmtgp.model.chart import Chart
from skmtgp.model.hyperprior import Hyperprior

FALL = 0.6  # nats from the middle to an end: half a nat if the density is normal
MOST_CUTS, SHORTEST = 5, 0.1  # of an axis that is longer, and how much at a time


def with_leeway(problem, mode):
    """The mode with what is open around it.

    Parameters
    ----------
    problem : Problem
        What was learned, of one term.
    mode : Mode
        The mode of the likelihood.

    Returns
    -------
    mode : Mode
        The same but for its leeway and the evaluations that it took.
    """
    likelihood = problem.likelihood_at(mode)
    hyperprior = Hyperprior(problem.prior)
    chart = Chart(hyperprior, mode.theta)
    if not chart.size:  # all is fixed
        return mode
    x = chart.coordinates(mode.theta)
    with limit_threads(likelihood.side):
        density = LogPosterior(likelihood, hyperprior, chart)
        values, vectors = Peak(density, x, np.nan, 0).curvature()
        found = [_ends(density, x, axis) for axis in (vectors / np.sqrt(values)).T]
    likelihood.release()
    ends = [list(map(chart.theta, pair)) for pair, _ in found]
    n_evaluations = 2 * len(x) + sum(n for _, n in found)
    return mode._replace(
        leeway=(OfTheta(np.array(ends)),),
        n_evaluations=mode.n_evaluations + n_evaluations,
    )


def _ends(density, x, axis):
    """Coordinates of both ends of an axis, and evaluations that they took.

    Where the density falls faster than its curvature says, an end is nearer.
    """
    top, ends, n_evaluations = density.polar(x)[0], [], 1
    for step in (axis, -axis):
        for _ in range(MOST_CUTS):
            fall = top - density.polar(x + step)[0]
            n_evaluations += 1
            if fall <= FALL:
                break
            step = max(SHORTEST, np.sqrt(0.5 / fall)) * step
        ends.append(x + step)
    return ends, n_evaluations
