r"""Tasks or rows left out: their errors, and whether the model is as sure as it may be.

Let the task m have the rows i. What all other rows say of them follows from the inverse
of the covariance K of all, as in Rasmussen and Williams (2006), section 5.4.2:

.. math:: y_i - \mu_i = S \alpha_i, \quad S = ([K^{-1}]_{ii})^{-1},
    \quad \alpha = K^{-1} y

The hyperparameters stay, although they were learned from the task, too. So errors are
smaller than those of new tasks, see :func:`inflation`.
"""

import numpy as np

from skmtgp._numerics.linalg import cholesky_with_jitter
from skmtgp._numerics.parallel import limit_threads

MOST_ROWS = 1000  # a second or less; more rows tell the same


def inflation(likelihood, theta, usual):
    r"""How much larger the variance of a task's function is than the model says.

    Parameters
    ----------
    likelihood : Likelihood
        Without a trend. If there are many rows, some of them count.
    theta : ndarray of shape (n_theta,)
        Parameters.
    usual : ndarray of shape (n_tasks,)
        What the square of an error should be, in units of its variance, if there is no
        noise: 1 - h of a task whose leverage is h among those from which the
        coefficients of descriptors were learned, as of residuals of a regression.

    Returns
    -------
    inflation : float
        What the squares of errors are over what they should be, and at least 1.

    Notes
    -----
    Let z be an error divided by its deviation, w the share that f has in the variance,
    the rest being noise, and v what is usual. Then :math:`z^2` should be
    :math:`v w + 1 - w` on average. Rows count as w: the others tell of the noise. Each
    task counts alike, and what is expected before counts as one task.
    """
    tasks = np.asarray(likelihood.tasks)
    rows = some_of_each(tasks, MOST_ROWS)
    tasks, noise = tasks[rows], _noise(likelihood, theta)[rows]
    X = np.asarray(likelihood.X[rows], dtype=float)
    K = likelihood.prior.covariance(theta, X, tasks)
    K.flat[:: len(K) + 1] += noise
    with limit_threads(len(K)):
        errors, variances = _left_out(K, np.asarray(likelihood.y)[rows], tasks)
    of_noise = np.minimum(noise / variances, 1.0)
    expected = usual[tasks] * (1.0 - of_noise) + of_noise
    weights = (1.0 - of_noise) / np.bincount(tasks)[tasks]
    found = 1.0 + weights @ (np.square(errors) / variances)
    return max(1.0, float(found / (1.0 + weights @ expected)))


def errors_left_out(problem, theta, groups):
    """Errors of observations that are left out together with all of their group.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory, without a trend.
    theta : ndarray of shape (n_theta,)
        Parameters.
    groups : ndarray of shape (n_samples,)
        Which group each observation belongs to.

    Returns
    -------
    errors : ndarray of shape (n_samples,)
        Targets minus what all other groups say.
    """
    data, prior = problem.data, problem.prior
    noise = np.broadcast_to(prior.values(theta).noise, data.n_tasks)
    K = prior.covariance(theta, data.X, data.tasks)
    K.flat[:: len(K) + 1] += noise[data.tasks]
    with limit_threads(len(K)):
        return _left_out(K, data.y, groups)[0]


def some_of_each(tasks, most):
    """Ascending positions of at most so many rows; each task has its share of them."""
    order = np.argsort(tasks, kind="stable")
    places = np.linspace(0, len(order) - 1, min(len(order), most)).astype(int)
    return np.sort(order[places])


def _noise(likelihood, theta):
    """Noise variance of each row."""
    return likelihood.noise_of_rows(likelihood.prior.values(theta).noise)


def _left_out(K, y, tasks):
    """Errors of rows whose tasks, or groups, are left out, and their variances."""
    cholesky = cholesky_with_jitter(lambda: K.copy(order="F"))
    inverse, alpha = cholesky.solve(np.eye(len(K))), cholesky.solve(y)
    errors, variances = np.empty((2, len(y)))
    for task in np.unique(tasks):
        i = np.flatnonzero(tasks == task)
        S = np.linalg.inv(inverse[np.ix_(i, i)])
        errors[i], variances[i] = S @ alpha[i], np.diagonal(S)
    return errors, variances
