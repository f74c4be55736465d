r"""Modes of the posterior of the hyperparameters, and the evidence around them.

The posterior is the likelihood times the weak prior of `Hyperprior`, in the coordinates
of a `Chart`, in which it is nearly normal. By Laplace's method the integral around a
mode is that of the normal density with its value and curvature.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import gammaln

from skmtgp._numerics.bfgs import minimize
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.climbing import information_or_zero
from skmtgp.learning.penalised import may_vanish, told
from skmtgp.learning.tuning import TUNING
from skmtgp.learning.vanishing import price_of_choice, vanished
from skmtgp.model.chart import Chart
from skmtgp.model.hyperprior import Hyperprior

FAR = 3.0  # deviations of the prior, at which a climb begins if it is beyond
STEP = 1e-4  # of the coordinates, from a mode to a gradient on either side
ONE_STEP = 1e-6  # on one side alone: the error grows with it, not with its square
LEAST_CURVATURE = 0.5  # of a coordinate that nothing tells but the bounds


class LogPosterior:
    """Log posterior density of a chart's coordinates, but for a constant.

    Parameters
    ----------
    likelihood : Likelihood
        Of one output.
    hyperprior : Hyperprior
        Of its prior.
    chart : Chart
        The coordinates.
    """

    def __init__(self, likelihood, hyperprior, chart):
        self.prior, self.theta = likelihood.prior, chart.theta
        self.likelihood = told(likelihood) if may_vanish(self.prior) else likelihood
        self.hyperprior, self.chart = hyperprior, chart

    def __call__(self, x):
        """The value and its gradient; -inf where the likelihood cannot be computed."""
        value, gradient = self.polar(x)
        if np.isfinite(value):
            log_spread, slope = self.chart.log_spread(x)
            value, gradient = value + log_spread, gradient + slope
        return value, gradient

    def polar(self, x):
        """The same with respect to the length and direction of the factor."""
        with np.errstate(all="ignore"):  # far from the data
            theta = self.chart.theta(x)
            value, gradient = self.likelihood.value_and_grad(theta)
            of_prior, slope = self.hyperprior.log_density(theta)
            value, gradient = self.chart.polar_density(
                x, value + of_prior, gradient + slope
            )
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            return -np.inf, np.zeros(len(x))
        return value, gradient

    def metric(self, x):
        """A guess of minus the Hessian of `polar`, positive definite."""
        theta, J = self.chart.theta(x), self.chart.jacobian(x)
        told = information_or_zero(self.likelihood, theta)
        told = told + self.hyperprior.information()
        return J.T @ told @ J + np.eye(len(x))


class Peak(NamedTuple):
    """A mode of the posterior.

    Attributes
    ----------
    density : LogPosterior
        In the coordinates around it.
    x : ndarray of shape (n_coordinates,)
        Where it is.
    value : float
        Log density there, of the length and direction of the factor.
    n_evaluations : int
        That it took to find it.
    """

    density: LogPosterior
    x: np.ndarray
    value: float
    n_evaluations: int

    def curvature(self, *, one_sided=False):
        """Eigenvalues, positive, and eigenvectors of the Hessian of minus the log.

        Across the direction of the factor it is that of the density of x, for that
        direction ends somewhere. Differences on one side take half the gradients, and
        are enough for the evidence.
        """
        x, slope, H = self.x, self._slope, np.empty((len(self.x),) * 2)
        if one_sided:
            h, here = ONE_STEP, slope(x)
            for row, step in zip(H, h * np.eye(len(x)), strict=True):
                row[:] = here - slope(x + step)
        else:
            h = 2.0 * STEP
            for row, step in zip(H, STEP * np.eye(len(x)), strict=True):
                row[:] = slope(x - step) - slope(x + step)
        H = (H + H.T) / (2.0 * h)
        n = self.density.chart.n_factor
        if n > 1:
            g = self.x[:n]
            length = np.linalg.norm(g)
            H[:n, :n] += (n - 1) / length**2 * (np.eye(n) - np.outer(g, g) / length**2)
        values, vectors = np.linalg.eigh(H)
        return np.maximum(values, LEAST_CURVATURE), vectors

    def _slope(self, x):
        return self.density.polar(x)[1]


def climb_posterior(
    likelihood, theta, *, held=False, noise_is_held=False, tol=1e-2, guided=False
):
    """The mode of the posterior that a climb from theta leads to.

    Parameters
    ----------
    likelihood : Likelihood
        Of one output.
    theta : ndarray of shape (n_theta,)
        Where the climb begins.
    held : ndarray of bool of shape (n_theta,), default=False
        Which logarithms stay where they are, and are no coordinates.
    noise_is_held : bool, default=False
        Whether the noise variances stay where they are.
    tol : float, default=1e-2
        Gain in nats under which it ends.
    guided : bool, default=False
        Whether it begins with the Fisher information, which pays near the mode.

    Returns
    -------
    peak : Peak
    """
    hyperprior = Hyperprior(likelihood.prior, held)
    density = LogPosterior(likelihood, hyperprior, Chart(hyperprior, theta))
    x = density.chart.coordinates(theta)
    held = noise_is_held & density.chart.among_logs(likelihood.prior.of_noise)
    lower, upper = np.where(held, x, -np.inf), np.where(held, x, np.inf)

    def objective(x):
        value, gradient = density.polar(x)
        return -value, -gradient

    options = {"max_iter": 500, "tol": tol, "patience": 10}
    if guided:
        options["metric"] = density.metric
    found = minimize(objective, x, lower, upper, **options)
    return Peak(density, found.x, -found.value, found.n_evaluations)


def log_evidence(peak, eigenvalues):
    r"""Log of the integral around a peak, by Laplace's method.

    .. math::
        \log p(y | \hat\theta) + \log p(\hat x) + \tfrac d2 \log 2\pi
        - \tfrac12 \log |H|

    with the volume of all rotations of F, which the d coordinates leave out.

    Parameters
    ----------
    peak : Peak
        The mode.
    eigenvalues : ndarray of shape (d,)
        Of the Hessian H there.

    Returns
    -------
    log_evidence : float
    """
    k = np.arange(1, peak.density.chart.shape[1] + 1)  # O(r): spheres of k - 1 dims
    rotations = np.log(2.0) + 0.5 * k * np.log(np.pi) - gammaln(0.5 * k)
    normal = 0.5 * np.log(2.0 * np.pi / eigenvalues).sum()
    constant = peak.density.hyperprior.log_constant
    value = peak.value + peak.density.chart.log_spread(peak.x)[0]
    return float(value + normal + rotations.sum() + constant)


def evidence_around(likelihood, theta):
    """The log evidence of the mode of the posterior that a climb from theta leads to.

    The noise stays as it was learned, for so the model predicts: noise next to nothing
    is unlikely, and a climb would leave it. Other variances that are next to nothing
    are raised, for there the climb would not see where to go. Those of a diagonal that
    have vanished are no parameters, but which of them they are is chosen.

    Parameters
    ----------
    likelihood : Likelihood
        Of one output.
    theta : ndarray of shape (n_theta,)
        The mode that was learned.

    Returns
    -------
    log_evidence : float
    """
    prior = likelihood.prior
    held = vanished(prior, theta, TUNING.vanishing)
    start = Hyperprior(prior, held).near(theta, FAR, ~prior.of_noise)
    with limit_threads(likelihood.side):
        fixed = {"held": held, "noise_is_held": True}
        peak = climb_posterior(likelihood, start, **fixed, guided=True)
        found = log_evidence(peak, peak.curvature(one_sided=True)[0])
    likelihood.release()
    return found - price_of_choice(prior, held.sum())
