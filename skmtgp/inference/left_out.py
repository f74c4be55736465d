r"""Tasks that are left out: whether the model is as sure of them as it may be.

Let the task m have the rows i. What all other rows say of them follows from the inverse
of the covariance K of all, as in Rasmussen and Williams (2006), section 5.4.2:

.. math:: y_i - \mu_i = S \alpha_i, \quad S = ([K^{-1}]_{ii})^{-1},
    \quad \alpha = K^{-1} y

The hyperparameters stay, although they were learned from the task, too.
"""

import numpy as np
from scipy.optimize import nnls

from skmtgp._numerics.linalg import cholesky_with_jitter
from skmtgp._numerics.parallel import limit_threads

MOST_ROWS = 1000  # a second or less; more rows tell the same
LEAST_FREEDOM = 1  # tasks whose number is that of the coefficients leave none


def inflation(likelihood, theta, n_tasks, n_coefficients):
    r"""How much larger the variance of a new task is than the posterior's.

    Parameters
    ----------
    likelihood : Likelihood
        Without a trend. If there are many rows, some of them count.
    theta : ndarray of shape (n_theta,)
        Parameters.
    n_tasks : int
        Number m of tasks that the coefficients were learned from.
    n_coefficients : int
        Number k of coefficients that were learned for each latent function, by which
        its part in a task is linear in what describes the task.

    Returns
    -------
    inflation : float
        The excess of the tasks that are left out times (m + k) / (m - k), and at
        least 1. In a linear regression with k coefficients the variance of residuals is
        1 - k / m of that of the errors, and that of predictions is 1 + k / m of it:
        Akaike's final prediction error (1969).
    """
    of_residuals = max(n_tasks - n_coefficients, LEAST_FREEDOM) / n_tasks
    of_predictions = 1.0 + n_coefficients / n_tasks
    found = excess(likelihood, theta, of_residuals)
    return max(1.0, of_predictions / of_residuals * found)


def excess(likelihood, theta, expected=1.0):
    r"""How much larger errors of tasks that are left out are than their variances say.

    Parameters
    ----------
    likelihood, theta
        See :func:`inflation`.
    expected : float, default=1.0
        What is expected before, which counts as much as a task.

    Returns
    -------
    excess : float
        a of the least squares fit :math:`z^2 = a w + b (1 - w)` with a, b >= 0. Here z
        is an error divided by its deviation, and w the share that f has in the
        variance, the rest being noise. Each task counts alike.
    """
    tasks = np.asarray(likelihood.tasks)
    rows = some_of_each(tasks, MOST_ROWS)
    tasks, noise = tasks[rows], _noise(likelihood, theta)[rows]
    X = np.asarray(likelihood.X[rows], dtype=float)
    K = likelihood.prior.covariance(theta, X, tasks)
    K.flat[:: len(K) + 1] += noise
    with limit_threads(len(K)):
        errors, variances = _left_out(K, np.asarray(likelihood.y)[rows], tasks)
    of_noise, counts = np.minimum(noise / variances, 1.0), np.bincount(tasks)[tasks]
    design = np.column_stack([1.0 - of_noise, of_noise]) / np.sqrt(counts)[:, None]
    squares = np.square(errors) / variances / np.sqrt(counts)
    found, _ = nnls(np.vstack([design, [1.0, 0.0]]), np.append(squares, expected))
    return float(found[0])


def some_of_each(tasks, most):
    """Ascending positions of at most so many rows; each task has its share of them."""
    order = np.argsort(tasks, kind="stable")
    places = np.linspace(0, len(order) - 1, min(len(order), most)).astype(int)
    return np.sort(order[places])


def _noise(likelihood, theta):
    """Noise variance of each row."""
    return likelihood.noise_of_rows(likelihood.prior.values(theta).noise)


def _left_out(K, y, tasks):
    """Errors of rows whose tasks are left out, and their variances."""
    cholesky = cholesky_with_jitter(lambda: K.copy(order="F"))
    inverse, alpha = cholesky.solve(np.eye(len(K))), cholesky.solve(y)
    errors, variances = np.empty((2, len(y)))
    for task in np.unique(tasks):
        i = np.flatnonzero(tasks == task)
        S = np.linalg.inv(inverse[np.ix_(i, i)])
        errors[i], variances[i] = S @ alpha[i], np.diagonal(S)
    return errors, variances
