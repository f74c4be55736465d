"""The posterior of the hyperparameters as a normal density around its mode.

The posterior is the likelihood times weak priors, in coordinates in which it is nearly
normal (`Chart`). Its mode is near that of the likelihood, and its curvature there says
what the rows leave open of theta: Laplace's method.
"""

from dataclasses import replace

import numpy as np

from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.leeway import OfTheta
from skmtgp.learning.evidence import FAR, climb_posterior
from skmtgp.model.hyperprior import Hyperprior


def approximated(problem, mode):
    """The mode of the posterior, and what is open around it.

    Variances that are next to nothing are raised before the climb, for there it would
    not see where to go.

    Parameters
    ----------
    problem : Problem
        What was learned, of one term.
    mode : Mode
        The mode of the likelihood.

    Returns
    -------
    mode : Mode
        Theta is that of the posterior's mode, the value is its likelihood.
    """
    data = replace(problem.data, Z=mode.Z)  # by its inducing inputs, if it has any
    likelihood = problem.engine.likelihood(problem.prior, data)
    every = np.ones(len(mode.theta), dtype=bool)
    start = Hyperprior(problem.prior).near(mode.theta, FAR, every)
    with limit_threads(likelihood.side):
        peak = climb_posterior(likelihood, start)
        values, vectors = peak.curvature()
        theta = peak.density.chart.theta(peak.x)
        value = likelihood.value(theta)
    steps = (vectors / np.sqrt(values)).T
    ends = [[peak.density.chart.theta(peak.x + s * c) for s in (1, -1)] for c in steps]
    ends = np.reshape(ends, (len(steps), 2, len(theta)))
    n_evaluations = peak.n_evaluations + 2 * len(steps)
    likelihood.release()
    return mode._replace(
        theta=theta,
        value=value,
        n_evaluations=mode.n_evaluations + n_evaluations,
        leeway=(OfTheta(ends),),
    )
