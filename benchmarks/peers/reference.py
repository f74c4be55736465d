"""The model from its textbook formulae: what scores the parameters of every package.

Rasmussen and Williams (2006), algorithm 2.1, with

    K = K^rho[t, t'] (b + sum_d w_d u_d u'_d + a exp(-1/2 sum_d (x_d - x'_d)^2 / l_d^2))

and nothing added to its diagonal but the noise. Neither fast nor shared with anything
that is compared.
"""

import numpy as np
from problem import N_X
from scipy.linalg import LinAlgError, cho_solve, cholesky
from scipy.spatial.distance import cdist


def covariance(parameters, u, tasks, v, tasks_v):
    """Covariance of f at (u, tasks) and (v, tasks_v)."""
    p = parameters
    linear = p.bias + (u * p.weights) @ v.T
    a, b = u[:, :N_X] / p.length_scales, v[:, :N_X] / p.length_scales
    smooth = p.amplitude * np.exp(-0.5 * cdist(a, b, "sqeuclidean"))
    return p.K_rho[np.ix_(tasks, tasks_v)] * (linear + smooth)


def factorise(K, noise):
    """Cholesky factor of K + noise I, and the jitter that it took."""
    jitter = 0.0
    while True:
        try:
            return cholesky(K + (noise + jitter) * np.eye(len(K)), lower=True), jitter
        except LinAlgError:
            if jitter > 1.0:
                raise
            jitter = max(10.0 * jitter, 1e-15 * np.trace(K) / len(K))


class Posterior:
    """The GP at given parameters.

    Attributes
    ----------
    log_marginal_likelihood : float
        Of the targets.
    jitter : float
        What had to be added to the noise variance, 0 as a rule.
    """

    def __init__(self, parameters, problem):
        self.parameters, self.problem = parameters, problem
        u, tasks, y = problem.u, problem.tasks, problem.y
        K = covariance(parameters, u, tasks, u, tasks)
        L, self.jitter = factorise(K, parameters.noise)
        self.alpha = cho_solve((L, True), y)
        log_det = 2.0 * np.log(np.diagonal(L)).sum()
        constant = len(y) * np.log(2.0 * np.pi)
        self.log_marginal_likelihood = -0.5 * (y @ self.alpha + log_det + constant)

    def mean(self, u, tasks, block=5000):
        """Mean of f, of shape (n_samples,)."""
        train = self.problem.u, self.problem.tasks
        return np.concatenate(
            [
                covariance(
                    self.parameters, u[a : a + block], tasks[a : a + block], *train
                )
                @ self.alpha
                for a in range(0, len(u), block)
            ]
        )


def normalized_mean_squared_error(y, mean, tasks):
    """MSE over the variance of the targets, averaged over tasks."""
    return float(
        np.mean(
            [
                np.mean((y - mean)[tasks == m] ** 2) / np.var(y[tasks == m])
                for m in np.unique(tasks)
            ]
        )
    )
