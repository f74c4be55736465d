r"""Draws of the hyperparameters from their posterior, the likelihood times a weak prior.

Four chains of Hamiltonian Monte Carlo move in coordinates in which the posterior is
nearly normal (`Chart`), with the inverse Hessian of a mode for the metric. Few rows
leave several modes, between which no chain moves: modes are looked for from the learned
one and from draws of the prior, and each chain starts at one of them, in proportion to
the evidence that Laplace's method gives it. A start at the likeliest mode alone would
stay where few rows are explained without noise.
"""

from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln

from skmtgp._numerics.bfgs import minimize
from skmtgp._numerics.hmc import Chain, diagnose, sample
from skmtgp._numerics.parallel import limit_threads, run
from skmtgp.model.chart import Chart
from skmtgp.model.hyperprior import Hyperprior

N_CHAINS = 4  # as many agree by chance seldom enough
N_WARM = 100  # trajectories of each, half of them for the metric, half with it
THINNED = 10  # trajectories of which one is kept for predictions
LEAPS = 6  # steps of a trajectory, about
MOST_STARTS, ENOUGH = 8, 3  # from the prior; so many in a row that find nothing new
NARROWER = 0.5  # deviations of these, of the prior's: its tails lead nowhere
SAME, HOPELESS = 0.05, 15.0  # nats between modes: one and the same; not worth a chain
STEP = 1e-4  # of the coordinates, between two gradients
LEAST_CURVATURE = 1.0  # the prior alone has more, but at the edges of the bounds
MOST_PAIRS = 500  # of tasks, whose correlations are looked at


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
        self.likelihood, self.hyperprior, self.chart = likelihood, hyperprior, chart

    def __call__(self, x):
        """The value and its gradient; -inf where the likelihood cannot be computed."""
        with np.errstate(all="ignore"):  # far from the data
            theta = self.chart.theta(x)
            value, gradient = self.likelihood.value_and_grad(theta)
            of_prior, slope = self.hyperprior.log_density(theta)
            value, gradient = self.chart.density(
                x, value + of_prior, gradient + slope
            )
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            return -np.inf, np.zeros(len(x))
        return value, gradient


class Peak(NamedTuple):
    """A mode of the posterior.

    Attributes
    ----------
    density : LogPosterior
        In the coordinates around it.
    x : ndarray of shape (n_coordinates,)
        Where it is.
    value : float
        Log density there.
    n_evaluations : int
        That it took to find it.
    """

    density: LogPosterior
    x: np.ndarray
    value: float
    n_evaluations: int

    def curvature(self):
        """Eigenvalues, positive, and eigenvectors of the Hessian of minus the log."""
        H = np.empty((len(self.x),) * 2)
        for row, step in zip(H, STEP * np.eye(len(self.x)), strict=True):
            row[:] = self.density(self.x - step)[1] - self.density(self.x + step)[1]
        values, vectors = np.linalg.eigh((H + H.T) / (4.0 * STEP))
        return np.maximum(values, LEAST_CURVATURE), vectors


def climb_posterior(likelihood, theta, *, tol=1e-2):
    """The mode of the posterior that a climb from theta leads to.

    Parameters
    ----------
    likelihood : Likelihood
        Of one output.
    theta : ndarray of shape (n_theta,)
        Where the climb begins.
    tol : float, default=1e-2
        Gain in nats under which it ends.

    Returns
    -------
    peak : Peak
    """
    hyperprior = Hyperprior(likelihood.prior)
    density = LogPosterior(likelihood, hyperprior, Chart(hyperprior, theta))
    x = density.chart.coordinates(theta)
    wide = np.full(len(x), np.inf)

    def objective(x):
        value, gradient = density(x)
        return -value, -gradient

    found = minimize(objective, x, -wide, wide, max_iter=500, tol=tol, patience=10)
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
    return float(peak.value + normal + rotations.sum() + constant)


class Sample(NamedTuple):
    """Draws of theta of one output.

    Attributes
    ----------
    theta : ndarray of shape (n_draws, n_theta)
        Those that are kept.
    effective, r_hat : ndarray of shape (n_quantities,)
        Effective sample size and R-hat of the quantities of `quantities`.
    n_divergent : int
        Divergent trajectories.
    n_evaluations : int
        Likelihoods with their gradients, all in all.
    n_modes : int
        Modes that chains started from.
    """

    theta: np.ndarray
    effective: np.ndarray
    r_hat: np.ndarray
    n_divergent: int
    n_evaluations: int
    n_modes: int


def sample_hyperparameters(likelihood, theta, *, n_draws, seed, n_jobs=None, tell=None):
    """Draw theta from its posterior.

    Parameters
    ----------
    likelihood : Likelihood
        Of one output.
    theta : ndarray of shape (n_theta,)
        The learned mode.
    n_draws : int
        How many draws are kept. Chains are ten times as long, all in all.
    seed : list of int
        Of the randomness.
    n_jobs : int, default=None
        Number of chains at the same time, see :term:`n_jobs`.
    tell : callable, default=None
        Called before the chains with the number of modes that they start from and the
        seconds that they will take, about. It returns what reports the chains, or None.

    Returns
    -------
    sample : Sample
    """
    begin = perf_counter()
    each = -(-n_draws // N_CHAINS) * THINNED
    with limit_threads(likelihood.side):
        peaks, n_climbing = find_peaks(likelihood, theta, np.random.default_rng(seed))
        scales, weights = _weigh(peaks)
        chosen = _share_out(weights)
        spent = n_climbing + sum(2 * len(peak.x) for peak in peaks)
        ahead = (perf_counter() - begin) / spent * N_CHAINS * (N_WARM + each) * LEAPS
        report = tell(len(set(chosen)), ahead) if tell else None
        likelihood.release()
        jobs = [(peaks[p], scales[p], each, [*seed, k]) for k, p in enumerate(chosen)]
        chains = run(_chain, jobs, n_jobs=n_jobs, report=report)
    thetas = [
        np.array(list(map(peaks[p].density.chart.theta, chain.draws)))
        for p, chain in zip(chosen, chains, strict=True)
    ]
    prior = likelihood.prior
    of_draws = np.array([[quantities(prior, t) for t in chain] for chain in thetas])
    return Sample(
        np.concatenate([of[THINNED - 1 :: THINNED] for of in thetas])[:n_draws],
        *diagnose(of_draws),
        sum(chain.n_divergent for chain in chains),
        spent + sum(chain.n_evaluations for chain in chains),
        len(set(chosen)),
    )


def find_peaks(likelihood, theta, rng):
    """The modes that the learned one and draws of the prior lead to, best first.

    Also the number of evaluations that this took.
    """
    peaks, in_vain = [climb_posterior(likelihood, theta)], 0
    n_evaluations = peaks[0].n_evaluations
    hyperprior = peaks[0].density.hyperprior
    for _ in range(MOST_STARTS):
        start = hyperprior.draw(rng, NARROWER)
        peak = climb_posterior(likelihood, start)
        n_evaluations += peak.n_evaluations
        known = any(abs(peak.value - other.value) < SAME for other in peaks)
        poor = peak.value < max(other.value for other in peaks) - HOPELESS
        in_vain = in_vain + 1 if known or poor else 0
        peaks += [] if known or poor else [peak]
        if in_vain == ENOUGH:
            break
    best = max(peak.value for peak in peaks)
    peaks = [peak for peak in peaks if peak.value > best - HOPELESS]
    return sorted(peaks, key=lambda peak: -peak.value), n_evaluations


def _weigh(peaks):
    """Square roots of the covariances around peaks, and their shares of the evidence."""
    curvatures = [peak.curvature() for peak in peaks]
    scales = [vectors / np.sqrt(values) for values, vectors in curvatures]
    evidence = np.array(
        [log_evidence(peak, values) for peak, (values, _) in zip(peaks, curvatures)]
    )
    weights = np.exp(evidence - evidence.max())
    return scales, weights / weights.sum()


def _share_out(weights):
    """Which peak each chain starts from, in proportion to the weights."""
    ends = np.cumsum(weights)
    ends[-1] = 1.0
    return np.searchsorted(ends, (np.arange(N_CHAINS) + 0.5) / N_CHAINS).tolist()


def _chain(peak, scale, n_draws, seed) -> Chain:
    """A chain from near a peak."""
    rng, density, x = np.random.default_rng(seed), peak.density, peak.x
    away, share = scale @ rng.standard_normal(len(x)), 1.0
    while not np.isfinite(density(x + share * away)[0]):
        share *= 0.5
    chain = sample(
        density, x + share * away, scale, rng, n_warm=N_WARM, n_draws=n_draws
    )
    density.likelihood.release()
    return chain


def quantities(prior, theta):
    """What a rotation of F leaves as it is, for diagnostics.

    Parameters
    ----------
    prior : Prior
        The model.
    theta : ndarray of shape (n_theta,)
        Parameters.

    Returns
    -------
    quantities : ndarray of shape (n_quantities,)
        The logarithms in theta, those of the deviations of the tasks, and correlations
        between tasks, of some hundred pairs at most.
    """
    K_rho = prior.K_rho_at(theta)
    deviations = np.sqrt(np.diagonal(K_rho))
    rows, cols = np.triu_indices(len(K_rho), 1)
    some = np.linspace(0, len(rows) - 1, min(len(rows), MOST_PAIRS)).astype(int)
    rows, cols = rows[some], cols[some]
    correlations = K_rho[rows, cols] / (deviations[rows] * deviations[cols])
    logarithms = theta[~prior.of_factor]
    return np.concatenate([logarithms, np.log(deviations), correlations])
