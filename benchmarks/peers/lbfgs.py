"""SciPy's L-BFGS-B at its best: what the packages' likelihoods are maximised with.

A long memory, tolerances at the limit of double precision, failed evaluations that
rise away from the best point instead of ending the line search, and new starts from the
best point, at last from near it, until they gain nothing.
"""

import numpy as np
from scipy.optimize import minimize

MEMORY = 100
OPTIONS = {
    "maxcor": MEMORY,
    "maxiter": 10**7,
    "maxfun": 10**7,
    "maxls": 50,
    "ftol": 1e-15,
    "gtol": 1e-9,
}
LEAST_GAIN = 1e-2  # nats between two starts
KICKS = (0.0, 1e-3, 1e-2, 1e-1)  # of a new start from the best point, in parameters


def maximise(value_and_grad, x, recorder, n, bounds=None):
    """Maximise a log likelihood.

    Parameters
    ----------
    value_and_grad : callable
        x -> (log likelihood, gradient), or None where it cannot be computed.
    x : ndarray of shape (n_parameters,)
        Start.
    recorder : Recorder
        Its state becomes the best x.
    n : int
        Number of samples, by which the objective is divided.
    bounds : list of pairs, default=None
        Bounds of x.

    Returns
    -------
    stop : str
        Why it stopped.
    """

    def objective(x):
        found = value_and_grad(x)
        if found is None or not (np.isfinite(found[0]) and np.isfinite(found[1]).all()):
            recorder(-np.inf)
            return _wall(x, recorder, n)
        recorder(found[0], x.copy())
        return -found[0] / n, -found[1] / n

    def climb(x):
        return minimize(
            objective, x, jac=True, method="L-BFGS-B", bounds=bounds, options=OPTIONS
        ).message

    return keep_climbing(climb, x, recorder)


def keep_climbing(climb, x, recorder):
    """Climb from x, then from the best point or near it, until nothing is gained.

    Parameters
    ----------
    climb : callable
        Learns from x and tells the recorder; gives the reason to stop.
    x : ndarray of shape (n_parameters,)
        Start.
    recorder : Recorder
        Keeps the best point.

    Returns
    -------
    stop : str
        Why the last climb stopped.
    """
    rng, stop, kick = np.random.default_rng(0), climb(x), 0
    while recorder.state is not None and kick < len(KICKS):
        before = recorder.best
        away = KICKS[kick] * rng.standard_normal(len(x))
        stop = climb(recorder.state + away)
        kick = 0 if recorder.best - before > LEAST_GAIN else kick + 1
    return stop


def _wall(x, recorder, n):
    """A cone that rises from the best point, for where there is no likelihood."""
    if recorder.state is None:
        return np.inf, np.zeros_like(x)
    away = x - recorder.state
    distance = max(np.linalg.norm(away), 1e-300)
    return -recorder.best / n + 1.0 + 10.0 * distance, 10.0 * away / distance
