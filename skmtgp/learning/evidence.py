r"""The evidence of a model by Laplace's method: its hyperparameters integrated out.

At a mode the likelihood times a prior is taken for a normal density of d parameters,

.. math::
    \log p(y) \approx \log p(y | \hat\theta) + \log p(\hat\theta)
    + \tfrac d2 \log 2\pi - \tfrac12 \log |H + P|

with the Hessian H of minus the log likelihood and the precision P of the prior. The
prior is weak: normal, of deviation `WIDE` for a logarithm, around what has the size of
the targets, and as wide as that for the factor F of K^rho.

Rotations of F do not change the likelihood. Along them nothing is a normal density, but
the integral is known: the volume of all rotations,

.. math:: \mathrm{vol}\,O(r) \prod_{i < j} \sqrt{s_i^2 + s_j^2}

with the singular values s of F. The determinant is that of all other directions. Where
the likelihood has less curvature than none, as at a bound, only the prior counts.
"""

import numpy as np
from scipy.linalg import eigvalsh, null_space
from scipy.special import gammaln

from skmtgp._numerics.parallel import limit_threads

WIDE = 3.0  # deviation of a logarithm: from a twentieth to twenty times, mostly
STEP = 1e-4  # of the parameters, between two gradients


def beside_likelihood(likelihood, theta):
    """What Laplace's method adds to the log likelihood of a mode.

    Parameters
    ----------
    likelihood : Likelihood
        What was maximised.
    theta : ndarray of shape (n_theta,)
        Its mode.

    Returns
    -------
    beside : float
        The log evidence less the log likelihood. It takes two gradients for each
        parameter.
    """
    prior = likelihood.prior
    free = np.not_equal(*prior.bounds())
    mean, deviation = _weak_prior(prior)
    turns, log_volume = _rotations(prior, theta)
    others = np.eye(len(theta))[:, free]
    if turns.shape[1]:
        others = others @ null_space(turns[free].T)
    with limit_threads(likelihood.side):
        H = _hessian(likelihood, theta, np.flatnonzero(free))
    likelihood.release()
    away, precision = (theta - mean)[free], deviation[free] ** -2.0
    P = others.T @ (deviation[:, None] ** -2.0 * others)
    curvature = np.maximum(eigvalsh(others.T @ H @ others, P), 0.0)
    log_det = np.linalg.slogdet(P)[1] + np.log1p(curvature).sum()
    log_prior = 0.5 * (np.log(precision) - precision * away**2).sum()
    n_turns = free.sum() - others.shape[1]
    return float(
        log_prior - 0.5 * n_turns * np.log(2.0 * np.pi) + log_volume - 0.5 * log_det
    )


def _weak_prior(prior):
    """Mean and deviation of each parameter."""
    M, variance = prior.n_tasks, prior.scale**2
    mean = prior.theta(K_rho=0.5 * variance * (np.eye(M) + 1.0))
    mean[prior.of_factor] = 0.0
    rank = max(1, prior.of_factor.sum() // M)
    wide = np.where(prior.of_factor, np.sqrt(variance / rank), WIDE)
    return mean, wide


def _rotations(prior, theta):
    """Directions in which the factor turns, as columns, and the log volume of all."""
    factor = theta[prior.of_factor].reshape(prior.n_tasks, -1)
    rank, sizes = factor.shape[1], np.linalg.svd(factor, compute_uv=False)
    pairs = [(i, j) for i in range(rank) for j in range(i)]
    turns = np.zeros((len(theta), len(pairs)))
    for turn, (i, j) in zip(turns.T, pairs, strict=True):
        turned = np.zeros_like(factor)
        turned[:, i], turned[:, j] = factor[:, j], -factor[:, i]
        turn[prior.of_factor] = turned.ravel()
    speeds = [np.hypot(sizes[i], sizes[j]) for i, j in pairs]
    k = np.arange(1, rank + 1)  # O(r) is made of spheres: two points, a circle, ...
    spheres = np.log(2.0) + 0.5 * k * np.log(np.pi) - gammaln(0.5 * k)
    smallest = np.finfo(np.float64).tiny
    return turns, spheres.sum() + np.log(np.maximum(speeds, smallest)).sum()


def _hessian(likelihood, theta, free):
    """Of minus the log likelihood by the free parameters, from gradients."""
    H = np.zeros((len(theta), len(theta)))
    for i in free:
        step = np.zeros_like(theta)
        step[i] = STEP
        with np.errstate(all="ignore"):
            pair = [likelihood.value_and_grad(theta + s * step)[1] for s in (-1, 1)]
        H[i] = (pair[0] - pair[1]) / (2.0 * STEP)
    H = np.nan_to_num(0.5 * (H + H.T), posinf=0.0, neginf=0.0)
    return H
