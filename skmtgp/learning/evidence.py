r"""The evidence of a model by Laplace's method: its hyperparameters integrated out.

Where the likelihood times a prior is largest, it is taken for a normal density of d
parameters,

.. math::
    \log p(y) \approx \log p(y | \hat\theta) + \log p(\hat\theta)
    + \tfrac d2 \log 2\pi - \tfrac12 \log |H + P|

with the Hessian H of minus the log likelihood and the precision P of the prior. The
prior is weak: normal, of deviation `WIDE` for a logarithm, around what has the size of
the targets, and as wide as that for the factor F of K^rho. It draws near what the rows
do not tell, such as the variance of levels that all but vanish: where the likelihood
alone is largest it may be anywhere, and far out the prior is next to nothing. The noise
stays as it was learned, for so it predicts: noise next to nothing is unlikely.

Rotations of F change neither the likelihood nor the prior. Along them nothing is a
normal density, but the integral is known: the volume of all rotations,

.. math:: \frac{\mathrm{vol}\,O(r)}{\mathrm{vol}\,O(r - q)}
    \prod_{i < j,\, i \le q} \sqrt{s_i^2 + s_j^2}

with the singular values s of F, of which q are more than next to nothing. The
determinant is that of all other directions. Where the likelihood has less curvature
than none, only the prior counts.
"""

import numpy as np
from scipy.linalg import eigvalsh
from scipy.special import gammaln

from skmtgp._numerics.bfgs import minimize
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.climbing import information_or_zero

WIDE = 3.0  # deviation of a logarithm: from a twentieth to twenty times, mostly
STEP = 1e-4  # of the parameters, between two gradients
TOL, MOST_ITER = 1e-3, 100  # of the way from the likelihood's mode to that with a prior
NOTHING = 1e-3  # of the prior's deviation: smaller singular values are as good as zero


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
        parameter, and those on the way to the mode with the prior.
    """
    with limit_threads(likelihood.side):
        value = likelihood.value(theta)
        theta = _mode_with_prior(likelihood, theta)
        gain = likelihood.value(theta) - value
        free = np.flatnonzero(np.not_equal(*likelihood.prior.bounds()))
        H = _hessian(likelihood, theta, free)
    likelihood.release()
    return float(gain + _log_integral(likelihood.prior, theta, free, H))


def _mode_with_prior(likelihood, theta):
    """Where the likelihood times the prior is largest, with this noise."""
    prior = likelihood.prior
    mean, deviation = _weak_prior(prior)

    def objective(x):
        value, gradient = likelihood.value_and_grad(x)
        away = (x - mean) / deviation
        return 0.5 * away @ away - value, away / deviation - gradient

    def metric(x):
        return information_or_zero(likelihood, x) + np.diag(deviation**-2.0)

    lower, upper = np.where(prior.of_noise, theta, prior.bounds())
    options = {"metric": metric, "max_iter": MOST_ITER, "tol": TOL}
    with np.errstate(all="ignore"):
        return minimize(objective, theta, lower, upper, **options).x


def _log_integral(prior, theta, free, H):
    """Log integral of the prior times what the likelihood is of its largest value."""
    mean, deviation = _weak_prior(prior)
    others, log_volume = _beside_rotations(prior, theta, free)
    away, precision = (theta - mean)[free], deviation[free] ** -2.0
    P = others.T @ (precision[:, None] * others)
    curvature = eigvalsh(others.T @ H[np.ix_(free, free)] @ others, P)
    log_det = np.linalg.slogdet(P)[1] + np.log1p(np.maximum(curvature, 0.0)).sum()
    log_prior = 0.5 * (np.log(precision) - precision * away**2).sum()
    n_turns = len(free) - others.shape[1]
    return log_prior - 0.5 * n_turns * np.log(2.0 * np.pi) + log_volume - 0.5 * log_det


def _weak_prior(prior):
    """Mean and deviation of each parameter."""
    M, variance = prior.n_tasks, prior.scale**2
    mean = prior.theta(K_rho=0.5 * variance * (np.eye(M) + 1.0))
    mean[prior.of_factor] = 0.0
    rank = max(1, prior.of_factor.sum() // M)
    wide = np.where(prior.of_factor, np.sqrt(variance / rank), WIDE)
    return mean, wide


def _beside_rotations(prior, theta, free):
    """Directions in which the factor does not turn, and the log volume of rotations.

    Directions are columns, of the free parameters.
    """
    factor = theta[prior.of_factor].reshape(prior.n_tasks, -1)
    rank, told = factor.shape[1], NOTHING * prior.scale / np.sqrt(factor.shape[1] or 1)
    pairs = [(i, j) for i in range(rank) for j in range(i)]
    turns = np.zeros((len(theta), len(pairs)))
    for turn, (i, j) in zip(turns.T, pairs, strict=True):
        turned = np.zeros_like(factor)
        turned[:, i], turned[:, j] = factor[:, j], -factor[:, i]
        turn[prior.of_factor] = turned.ravel()
    # their speeds are the roots of s_i^2 + s_j^2
    directions, speeds, _ = np.linalg.svd(turns[free])
    speeds = speeds[speeds > told]
    q = (np.linalg.svd(factor, compute_uv=False) > told).sum()
    k = np.arange(rank - q + 1, rank + 1)  # spheres: two points, a circle, ...
    spheres = np.log(2.0) + 0.5 * k * np.log(np.pi) - gammaln(0.5 * k)
    return directions[:, len(speeds) :], spheres.sum() + np.log(speeds).sum()


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
