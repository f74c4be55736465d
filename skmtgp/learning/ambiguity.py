"""Modes that are nearly as likely as the chosen one, and predict differently."""

from typing import NamedTuple

import numpy as np

from skmtgp._numerics.parallel import limit_threads

LEAST = 30  # rows: fewer never tell modes apart
REACH = 2.0  # nats
MOST = 5  # modes within reach that are kept
POINTS, LEAST_INPUTS = 1000, 10  # at which predictions are compared
APART = 0.2  # difference of predictions, of the deviation in a task, that matters,
UNSURE = 2.0  # and in standard deviations of theirs


class Rival(NamedTuple):
    """A mode that was not chosen.

    Attributes
    ----------
    theta : ndarray of shape (n_theta,)
        Parameters.
    value : float
        Log marginal likelihood.
    """

    theta: np.ndarray
    value: float


class Doubt(NamedTuple):
    """How a rival differs from the mode that was chosen.

    Attributes
    ----------
    nats : float
        By which it is less likely. Below zero where it gained too little to be chosen.
    apart : float
        Root mean square of the difference of their predictions, in deviations of the
        targets within tasks.
    """

    nats: float
    apart: float


def rivals_of(best, modes):
    """The likeliest rivals of a mode: modes, and their rivals, within its reach.

    Parameters
    ----------
    best : Mode
        The chosen one.
    modes : sequence of Mode
        Of the same model, among them the chosen one.

    Returns
    -------
    rivals : tuple of Rival
    """
    ended = [of for of in modes if of is not best and of.converged]
    rivals = [Rival(of.theta, of.value) for of in ended]
    rivals += [rival for of in modes for rival in of.rivals]
    rivals = [of for of in rivals if np.isfinite(of.value)]  # of failed climbs not
    near = [of for of in rivals if abs(best.value - of.value) < REACH]
    return tuple(sorted(near, key=lambda of: -of.value)[:MOST])


def doubt_about(problem, mode):
    """The rival that predicts the most differently, by more than it is sure of.

    Parameters
    ----------
    problem : Problem
        Exact.
    mode : Mode
        The chosen one.

    Returns
    -------
    doubt : Doubt or None
        None where no rival's predictions, of all tasks at some of the inputs, differ
        by more than twice their standard deviation and a part of the targets'.
    """
    if len(problem.data) < LEAST or not (mode.rivals and problem.is_noisy(mode)):
        return None
    likelihood, deviation = problem.likelihood(), _deviation_in_tasks(problem.data)
    with limit_threads(likelihood.side):
        mean, variance = _predicted(problem, likelihood, mode.theta)
        doubts = []
        for rival in mode.rivals:
            other, of_other = _predicted(problem, likelihood, rival.theta)
            apart = np.sqrt(np.square(mean - other).mean())
            spread = np.sqrt(np.maximum(variance, of_other).mean())
            if apart > max(UNSURE * spread, APART * deviation):
                nats = float(mode.value - rival.value)
                doubts.append(Doubt(nats, float(apart / deviation)))
    likelihood.release()
    return max(doubts, key=lambda of: of.apart, default=None)


def _deviation_in_tasks(data):
    """Standard deviation of the targets, each off the mean of its task."""
    counts = np.maximum(np.bincount(data.tasks, minlength=data.n_tasks), 1)
    means = np.bincount(data.tasks, data.y, data.n_tasks) / counts
    return (data.y - means[data.tasks]).std() or 1.0


def _predicted(problem, likelihood, theta):
    """Means and variances of all tasks at some of the inputs."""
    data, posterior = problem.data, likelihood.posterior(theta)
    n_inputs = max(LEAST_INPUTS, POINTS // data.n_tasks)
    rows = np.linspace(0, len(data) - 1, min(len(data), n_inputs)).astype(int)
    X = np.repeat(data.X[rows], data.n_tasks, axis=0)
    tasks = np.tile(np.arange(data.n_tasks), len(rows))
    return posterior.mean(X, tasks), posterior.variance(X, tasks)
