"""Hamiltonian Monte Carlo, and how much its chains can be trusted."""

from typing import NamedTuple

import numpy as np

ACCEPTED = 0.8  # share of proposals that the step is tuned to
FIRST_STEP = 0.4  # in deviations
LENGTH = 1.6  # of a trajectory: a quarter of a turn around a normal density
MOST_STEPS = 50  # of a trajectory
DIVERGED = 1000.0  # nats by which the energy may be off
CONSTANT = 1e-9  # relative change of what is taken not to change
SHRINKAGE = 5  # draws that the metric of the start is worth
# Of dual averaging, Hoffman and Gelman (2014), section 3.2.
GAIN, DELAY, FORGETTING = 0.1, 10.0, 0.75


class Chain(NamedTuple):
    """Draws of one chain.

    Attributes
    ----------
    draws : ndarray of shape (n_draws, n_parameters)
        After warming up.
    n_divergent : int
        Trajectories of them that left the region where the density is finite and the
        energy is kept.
    n_evaluations : int
        Of the log density and its gradient, while warming up too.
    """

    draws: np.ndarray
    n_divergent: int
    n_evaluations: int


class Walker:
    """A point that moves by trajectories in whitened coordinates.

    Parameters
    ----------
    log_density : callable
        x -> (value, gradient). A value that is not finite rejects the proposal.
    x : ndarray of shape (n_parameters,)
        Where it starts; the density is finite there.
    scale : ndarray of shape (n_parameters, n_parameters)
        Any square root of about the covariance.
    rng : Generator
        Source of randomness.

    length : float
        Of a trajectory, in deviations.

    Attributes
    ----------
    propose : callable or None
        (x, rng) -> (x, signs): another point, by chances that are the same on the way
        back and that keep volumes, and the signs that coordinates change on the way.
        It is tried after each trajectory, where a density has several modes.
    """

    def __init__(self, log_density, x, scale, rng, length=LENGTH):
        self.log_density, self.rng, self.propose = log_density, rng, None
        self.length = length
        self.x, self.scale, self.n_evaluations = x, scale, 0
        self.n_divergent = self.n_jumps = 0
        self.value, self.gradient = self._evaluate(x)

    def _evaluate(self, x):
        self.n_evaluations += 1
        return self.log_density(x)

    def move(self, step):
        """A trajectory of leapfrog steps, and a jump; with what chance to accept it."""
        turn = self.length * self.rng.uniform(0.5, 1.5)  # no period is missed always
        n_steps = int(np.clip(np.rint(turn / step), 1, MOST_STEPS))
        momentum = self.rng.standard_normal(len(self.x))
        energy = self.value - 0.5 * momentum @ momentum
        x, value, gradient = self.x, self.value, self.gradient
        momentum = momentum + 0.5 * step * (self.scale.T @ gradient)
        for i in range(n_steps):
            x = x + step * (self.scale @ momentum)
            value, gradient = self._evaluate(x)
            if not np.isfinite(value):
                break
            last = 0.5 if i == n_steps - 1 else 1.0
            momentum = momentum + last * step * (self.scale.T @ gradient)
        with np.errstate(over="ignore"):  # far outside
            gain = value - 0.5 * momentum @ momentum - energy
        gain = gain if np.isfinite(gain) else -np.inf
        self.n_divergent += bool(gain < -DIVERGED)
        accepted = float(np.exp(min(0.0, gain)))
        if self.rng.uniform() < accepted:
            self.x, self.value, self.gradient = x, value, gradient
        if self.propose is not None:
            self._jump()
        return accepted

    def _jump(self):
        """A step of Metropolis, by which the metric is mirrored as the point is."""
        x, signs = self.propose(self.x, self.rng)
        value, gradient = self._evaluate(x)
        if self.rng.uniform() < np.exp(min(0.0, value - self.value)):
            self.x, self.value, self.gradient = x, value, gradient
            self.scale = signs[:, None] * self.scale
            self.n_jumps += 1

    def tune(self, n, step):
        """Move n times, by dual averaging of the step; draws and the step found."""
        centre, error, average, draws = np.log(step), 0.0, 0.0, []
        for m in range(1, n + 1):
            error += (ACCEPTED - self.move(step) - error) / (m + DELAY)
            log_step = centre - np.sqrt(m) / GAIN * error
            average += m**-FORGETTING * (log_step - average)
            step = float(np.exp(log_step))
            draws.append(self.x)
        return np.array(draws), float(np.exp(average))

    def learn_scale(self, draws):
        """Take the covariance of draws for the scale, as far as they tell it."""
        away = np.linalg.solve(self.scale, (draws - draws.mean(axis=0)).T)
        prior = SHRINKAGE + len(self.x)
        covariance = away @ away.T + prior * np.eye(len(self.x))
        self.scale = self.scale @ np.linalg.cholesky(covariance / (len(draws) + prior))


def sample(
    log_density,
    x,
    scale,
    rng,
    *,
    n_warm,
    n_draws,
    length=LENGTH,
    propose=None,
    report=None,
):
    """Draws of one chain, warmed up in two halves: for the metric and with it.

    Parameters
    ----------
    log_density, x, scale, rng
        See Walker.
    n_warm : int
        Trajectories to warm up with; they are not kept.
    n_draws : int
        Trajectories that are.
    length : float, default=1.6
        See Walker. Where the metric is poor, longer ones are worth more than they cost.
    propose : callable, default=None
        See Walker. Not used for the metric, which is that of one mode, nor for draws
        where none of its points was accepted while warming up.
    report : callable, default=None
        Called with the number of trajectories so far.

    Returns
    -------
    chain : Chain
    """
    walker, draws = Walker(log_density, x, scale, rng, length), []
    warm, step = walker.tune(n_warm // 2, FIRST_STEP)
    walker.learn_scale(warm)
    walker.propose = propose
    _, step = walker.tune(n_warm - n_warm // 2, step)
    walker.propose = propose if walker.n_jumps else None
    walker.n_divergent = 0
    for i in range(n_draws):
        walker.move(step * rng.uniform(0.8, 1.2))
        draws.append(walker.x)
        if report is not None:
            report(i + 1)
    return Chain(np.array(draws), walker.n_divergent, walker.n_evaluations)


def diagnose(chains):
    """Effective sample size and R-hat of each quantity.

    Parameters
    ----------
    chains : ndarray of shape (n_chains, n_draws, n_quantities)
        Four draws or more of each chain.

    Returns
    -------
    effective : ndarray of shape (n_quantities,)
        Number of independent draws that would be worth as much. At most the number of
        draws times its common logarithm, where draws alternate.
    r_hat : ndarray of shape (n_quantities,)
        Deviation over all chains by that within halves of chains: 1 where they agree.

    Notes
    -----
    Gelman et al., Bayesian Data Analysis (2013), section 11.4, with Geyer's initial
    monotone sequence. A quantity that never changes has neither; both are nan.
    """
    half = chains.shape[1] // 2
    chains = np.concatenate([chains[:, :half], chains[:, -half:]])
    n_chains, n, _ = chains.shape
    within = chains.var(axis=1, ddof=1).mean(axis=0)
    total = within * (n - 1) / n + chains.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        r_hat = np.sqrt(total / within)
        correlation = 1.0 - (within - _autocovariance(chains)) / total
    correlation[0] = 1.0
    pairs = correlation[: n // 2 * 2].reshape(n // 2, 2, -1).sum(axis=1)
    pairs = np.minimum.accumulate(pairs, axis=0)
    pairs = np.where(np.minimum.accumulate(pairs > 0.0, axis=0), pairs, 0.0)
    length = np.maximum(2.0 * pairs.sum(axis=0) - 1.0, 1.0 / np.log10(n_chains * n))
    changes = np.ptp(chains, axis=(0, 1)) > CONSTANT * (1.0 + np.abs(chains[0, 0]))
    effective = np.where(changes, n_chains * n / length, np.nan)
    return effective, np.where(changes, r_hat, np.nan)


def _autocovariance(chains):
    """Of each lag, averaged over the chains, (n_draws, n_quantities)."""
    n = chains.shape[1]
    away = chains - chains.mean(axis=1, keepdims=True)
    spectrum = np.fft.rfft(away, 2 * n, axis=1)
    found = np.fft.irfft(np.abs(spectrum) ** 2, 2 * n, axis=1)[:, :n]
    return found.mean(axis=0) / (n - 1)
