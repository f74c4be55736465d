"""SciPy's L-BFGS-B at its best: what the packages' likelihoods are maximised with.

A long memory, tolerances at the limit of double precision, failed evaluations that
rise away from the best point instead of ending the line search, and a new start from
the best point whenever it stops while there is still something to gain.
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

    while True:
        before = recorder.best
        result = minimize(
            objective, x, jac=True, method="L-BFGS-B", bounds=bounds, options=OPTIONS
        )
        if recorder.state is None or recorder.best - before < LEAST_GAIN:
            return result.message
        x = recorder.state


def _wall(x, recorder, n):
    """A cone that rises from the best point, for where there is no likelihood."""
    if recorder.state is None:
        return np.inf, np.zeros_like(x)
    away = x - recorder.state
    distance = max(np.linalg.norm(away), 1e-300)
    return -recorder.best / n + 1.0 + 10.0 * distance, 10.0 * away / distance
