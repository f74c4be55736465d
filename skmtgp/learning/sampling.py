"""Draws of the hyperparameters from their posterior, likelihood times weak prior.

Four chains of Hamiltonian Monte Carlo move in coordinates in which the posterior is
nearly normal (`Chart`), with the inverse Hessian of a mode for the metric. Few rows
leave several modes. Between those that differ by signs of tasks, or by the direction of
one, chains jump (`Chart.turned`). Between others they seldom move: these are looked for
from the learned one and from draws of the prior, and each chain starts at one of them,
in proportion to the evidence that Laplace's method gives it. A start at the likeliest
mode alone would stay where few rows are explained without noise.

Where the rank of K^rho is open, chains start at modes of several ranks, more of them
where there is more evidence. A factor of a lower rank is one of the highest rank with
columns of zeros.
"""

from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from skmtgp._numerics.hmc import Chain, diagnose, sample
from skmtgp._numerics.parallel import limit_threads, run
from skmtgp.learning.evidence import climb_posterior, log_evidence

N_CHAINS = 4  # as many agree by chance seldom enough
N_WARM = 100  # trajectories of each, half of them for the metric, half with it
THINNED = 5  # trajectories of which one is kept for predictions
# Most of a turn around a normal density. A quarter is enough for that, but not for the
# curved density of few rows: there half a turn had half the effective sample size of
# this, and chains disagreed more often. benchmarks/samplers.py prints both.
LENGTH = 5.0
LEAPS = 20  # steps of a trajectory, about
MOST_STARTS, ENOUGH = 8, 3  # from the prior; so many in a row that find nothing new
NARROWER = 0.5  # deviations of these, of the prior's: its tails lead nowhere
SAME = 0.3  # of logarithms and correlations, between modes that are one
# Laplace's method understates the evidence of higher ranks, whose posterior of few rows
# is less normal: by so many nats for each element of a column of F after the first one,
# so many of a column at most, if tasks have ten rows or fewer (benchmarks/evidence.py).
# Half of the rest is trusted.
UNDERSTATED, MOST_UNDERSTATED, FEW_ROWS, TRUSTED = 0.6, 4.0, 10.0, 0.5
HOPELESS = 15.0  # nats between modes: not worth a chain
FALLEN = 3.0  # log noise variance below the learned one: the mode may be a spike
# A chain starts at most so many nats a parameter, and HOPELESS, below its mode. With
# two tests/learning/test_calibration.py fails.
FALL = 10.0
MOST_PAIRS = 500  # of tasks, whose correlations are looked at


class Sample(NamedTuple):
    """Draws of theta of one output.

    Attributes
    ----------
    theta : ndarray of shape (n_draws, n_theta)
        Those that are kept.
    effective, r_hat : ndarray of shape (n_quantities,)
        Effective sample size and R-hat of the quantities of `quantities`, within modes.
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


def sample_hyperparameters(ranks, *, n_draws, seed, n_jobs=None, tell=None):
    """Draw theta from its posterior.

    Parameters
    ----------
    ranks : sequence of (Likelihood, ndarray of shape (n_theta,))
        Of one output, with the learned mode, for each rank that K^rho may have. Draws
        are in the parameters of the last, the highest.
    n_draws : int
        How many draws are kept. Chains are five times as long, all in all.
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
    highest = ranks[-1][0]
    with limit_threads(highest.side):
        found = [find_peaks(*of, np.random.default_rng(seed)) for of in ranks]
        peaks = [peak for of_rank, _ in found for peak in of_rank]
        scales, weights = _weigh(peaks)
        chosen = _share_out(weights)
        spent = sum(n for _, n in found) + sum(2 * len(peak.x) for peak in peaks)
        ahead = (perf_counter() - begin) / spent * N_CHAINS * (N_WARM + each) * LEAPS
        report = tell(len(set(chosen)), ahead) if tell else None
        for likelihood, _ in ranks:
            likelihood.release()
        jobs = [(peaks[p], scales[p], each, [*seed, k]) for k, p in enumerate(chosen)]
        chains = run(_chain, jobs, n_jobs=n_jobs, report=report)
    densities = [peaks[p].density for p in chosen]
    thetas = [
        [highest.prior.widened(density.theta(x), density.prior) for x in chain.draws]
        for density, chain in zip(densities, chains, strict=True)
    ]
    thetas = np.array(thetas)
    kept = thetas[:, THINNED - 1 :: THINNED].swapaxes(0, 1)  # a turn of all chains
    return Sample(
        kept.reshape(-1, thetas.shape[2])[:n_draws],
        *_diagnose(highest.prior, np.array(chosen), thetas),
        sum(chain.n_divergent for chain in chains),
        spent + sum(chain.n_evaluations for chain in chains),
        len(set(chosen)),
    )


def _diagnose(prior, chosen, thetas):
    """Effective sample size and R-hat of the quantities of all chains.

    Those that start from different modes are not compared: the evidence has shared
    them out. Their effective sizes are added, and the largest R-hat counts.
    """
    of_draws = np.array([[quantities(prior, t) for t in chain] for chain in thetas])
    found = [diagnose(of_draws[chosen == p]) for p in np.unique(chosen)]
    effective, r_hat = map(np.array, zip(*found, strict=True))
    return effective.sum(axis=0), r_hat.max(axis=0)


def find_peaks(likelihood, theta, rng):
    """The modes that the learned one and draws of the prior lead to, best first.

    Also the number of evaluations that this took. Modes with far less noise than was
    learned may be much higher, and so narrow that they have less evidence. So others
    need not come near them.
    """
    peaks, in_vain = [climb_posterior(likelihood, theta)], 0
    n_evaluations = peaks[0].n_evaluations
    hyperprior, prior = peaks[0].density.hyperprior, likelihood.prior
    least = prior.log_noise_at(theta).mean() - FALLEN
    for _ in range(MOST_STARTS):
        start = hyperprior.draw(rng, NARROWER)
        peak = climb_posterior(likelihood, start)
        n_evaluations += peak.n_evaluations
        known = any(_are_alike(peak, other) for other in peaks)
        poor = peak.value < _highest(peaks, least) - HOPELESS
        in_vain = in_vain + 1 if known or poor else 0
        peaks += [] if known or poor else [peak]
        if in_vain == ENOUGH:
            break
    highest = _highest(peaks, least)
    peaks = [peak for peak in peaks if peak.value > highest - HOPELESS]
    return sorted(peaks, key=lambda peak: -peak.value), n_evaluations


def _highest(peaks, least):
    """The highest value of those with the least log noise, or of all if none has."""
    noises = (of.density.prior.log_noise_at(of.density.theta(of.x)) for of in peaks)
    values, noises = np.array([of.value for of in peaks]), np.array([*noises])
    noisy = noises.reshape(len(peaks), -1).mean(axis=1) >= least
    return values[noisy].max() if noisy.any() else values.max()


def _are_alike(peak, other):
    """Whether two peaks are the same, seen in the coordinates of different charts."""
    found = []
    for density, x, *_ in (peak, other):
        found.append(quantities(density.prior, density.theta(x)))
    return bool(np.nanmax(np.abs(np.subtract(*found)), initial=0.0) < SAME)


def _weigh(peaks):
    """Square roots of the covariances around peaks, and weights by their evidence."""
    scales, evidence = [], []
    for peak in peaks:
        values, vectors = peak.curvature()
        scales.append(vectors / np.sqrt(values))
        evidence.append(log_evidence(peak, values))
    likelihood = peaks[0].density.likelihood
    rows = len(likelihood.y) / likelihood.prior.n_tasks
    shapes = [peak.density.prior.factor_shape for peak in peaks]
    log_weights = np.array(evidence) + [_understated(*of, rows) for of in shapes]
    ranks = np.array([rank for _, rank in shapes])
    for rank in np.unique(ranks):
        of_rank = ranks == rank
        log_weights[of_rank] -= (1.0 - TRUSTED) * logsumexp(log_weights[of_rank])
    return scales, softmax(log_weights)


def _understated(n_tasks, rank, n_rows):
    """Nats by which Laplace's method is held to understate the evidence of a rank.

    `n_rows` is the number of rows of a task.
    """
    n_elements = n_tasks - np.arange(1, rank)  # of L: zeros above its diagonal
    of_few = np.minimum(UNDERSTATED * n_elements, MOST_UNDERSTATED).sum()
    return of_few * min(1.0, FEW_ROWS / n_rows)


def _share_out(weights):
    """Which peak each chain starts from, in proportion to the weights."""
    ends = np.cumsum(weights)
    ends[-1] = 1.0
    return np.searchsorted(ends, (np.arange(N_CHAINS) + 0.5) / N_CHAINS).tolist()


def _chain(peak, scale, n_draws, seed) -> Chain:
    """A chain from near a peak."""
    rng, density = np.random.default_rng(seed), peak.density
    x = _start_near(peak, scale, rng)
    of_tasks = density.chart.n_factor > 1
    chain = sample(
        density,
        x,
        scale,
        rng,
        n_warm=N_WARM,
        n_draws=n_draws,
        length=LENGTH,
        propose=density.chart.turned if of_tasks else None,
    )
    density.likelihood.release()
    return chain


def _start_near(peak, scale, rng):
    """A draw of the normal density around a peak, or closer where it is far too poor.

    Along a flat direction it may be far off, where the likelihood has no digits: a
    chain would not come back.
    """
    away, share = scale @ rng.standard_normal(len(peak.x)), 1.0
    least = peak.value - HOPELESS - FALL * len(peak.x)
    while not peak.density(peak.x + share * away)[0] >= least:
        share *= 0.5
    return peak.x + share * away


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
    products, tiny = deviations[rows] * deviations[cols], np.finfo(float).tiny
    correlations = np.divide(
        K_rho[rows, cols], products, out=np.zeros(len(rows)), where=products > tiny
    )  # what does not vary has none
    logarithms = theta[~prior.of_factor]
    deviations = np.log(np.maximum(deviations, tiny))
    return np.concatenate([logarithms, deviations, correlations])
