"""Moments of long runs of the sampler, within a percent of sums over a grid.

The relative error of a variance is the root of (kurtosis - 1) / (effective size of the
squares). A percent is three standard errors of it where that size is 200 thousand, of
about twice as many trajectories. With the package's likelihood these would take five
minutes and more. So it is interpolated (`Splined`). The prior, the coordinates and the
steps are the package's.
"""

import building
import numpy as np
import pytest
from quadrature import Grid
from rarely import rarely
from scipy.ndimage import spline_filter
from sklearn.gaussian_process.kernels import RBF

from skmtgp._numerics.hmc import diagnose, sample
from skmtgp.learning.evidence import climb_posterior
from skmtgp.learning.sampling import quantities, sample_hyperparameters
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.task_covariance import low_rank, ones

N_CHAINS = 4
# A cubic B-spline between two knots: powers of the share of the way, by four weights.
CUBIC = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0


def two_parameters():
    """A length-scale and noise, of 40 rows."""
    rng, tasks = np.random.default_rng(0), np.arange(40) // 20
    X = np.sort(rng.uniform(0.0, 8.0, (40, 1)), axis=0)
    y = np.sin(X[:, 0]) * (1 - 2 * tasks) + 0.3 * rng.standard_normal(40)
    return building.dense(RBF(1.0), ones(2), X, tasks, y)


def three_parameters():
    """Two length-scales and noise, of 40 rows."""
    rng, tasks = np.random.default_rng(0), np.zeros(40, dtype=int)
    X = rng.uniform(0.0, 4.0, (40, 2))
    y = np.sin(2.0 * X[:, 0]) + np.cos(1.5 * X[:, 1]) + 0.3 * rng.standard_normal(40)
    return building.dense(RBF([1.0, 1.0]), ones(1), X, tasks, y)


def of_a_factor(n_noise):
    """A length-scale, a factor of rank 1 of two tasks, and noise, of 12 rows."""
    rng, tasks = np.random.default_rng(0), np.arange(12) // 6
    X = rng.uniform(0.0, 5.0, (12, 1))
    y = np.sin(X[:, 0]) * (1.0 - 0.5 * tasks) + 0.3 * rng.standard_normal(12)
    return building.dense(RBF(1.0), low_rank(2, 1), X, tasks, y, n_noise)


class Splined:
    """A likelihood interpolated between the points of a grid; as it was outside."""

    def __init__(self, likelihood, grid):
        self.likelihood, self.prior, self.grid = likelihood, likelihood.prior, grid
        shape = grid.points.shape[:-1]
        self.last = shape[0] - 3
        self.knots = spline_filter(grid.values.reshape(shape))

    def value_and_grad(self, theta):
        place = (theta - self.grid.lower) / self.grid.step
        first = [int(p) for p in place]
        if min(first) < 1 or max(first) > self.last or place.min() < 0.0:
            return self.likelihood.value_and_grad(theta)
        found = self.knots[tuple(slice(k - 1, k + 3) for k in first)]
        for share in (place - first).tolist():
            powers = (
                [1.0, share, share**2, share**3],
                [0.0, 1.0, 2 * share, 3 * share**2],
            )
            found = found.reshape(4, -1).T @ (powers @ CUBIC).T  # axes take turns
        found = found.ravel()
        slopes = found[2 ** np.arange(len(theta))[::-1]]
        return float(found[0]), slopes / self.grid.step

    def __getattr__(self, name):
        return getattr(self.likelihood, name)


# How to build it, grids, and trajectories of all chains: a few percent more than a
# percent of variance takes as three standard errors.
PROBLEMS = {
    "two": (two_parameters, (61, 121), 500_000),
    "three": (three_parameters, (27, 39), 620_000),
}


@pytest.fixture(scope="module", params=PROBLEMS)
def problem(request):
    """A likelihood on a coarse and on a fine grid, interpolated on that."""
    build, sizes, n_draws = PROBLEMS[request.param]
    likelihood = build()
    coarse, fine = (Grid(likelihood, n) for n in sizes)
    return coarse, fine, Splined(likelihood, fine), n_draws


# Three parameters take long
EACH = pytest.mark.parametrize(
    "problem",
    [pytest.param("two", marks=pytest.mark.long), *rarely("three")],
    indirect=True,
)


def long_runs(likelihood, n_draws):
    """Chains of theta, (n_chains, n_draws, n_theta), and the peak they start at."""
    peak = climb_posterior(likelihood, likelihood.prior.theta())
    values, vectors = peak.curvature()
    scale, chains = vectors / np.sqrt(values), []
    for seed in range(N_CHAINS):
        rng = np.random.default_rng(seed)
        found = sample(peak.density, peak.x, scale, rng, n_warm=400, n_draws=n_draws)
        chains.append([peak.density.theta(x) for x in found.draws])
    return np.array(chains)


def errors(chains, mean, variance):
    """Relative standard errors of means, in deviations, and of variances."""
    squares = np.square(chains - mean) / variance
    spread = squares.std(axis=(0, 1))
    return diagnose(chains)[0] ** -0.5, spread * diagnose(squares)[0] ** -0.5


@EACH
def test_a_grid_and_its_spline_are_exact(problem):
    coarse, fine, splined, _ = problem
    (mean, variance), (rough, rough_variance) = fine.moments(), coarse.moments()
    np.testing.assert_allclose((rough - mean) / np.sqrt(variance), 0.0, atol=1e-3)
    np.testing.assert_allclose(rough_variance, variance, rtol=1e-3)
    rng = np.random.default_rng(0)
    for _ in range(200):
        theta = mean + np.sqrt(variance) * rng.standard_normal(len(mean))
        value, gradient = splined.likelihood.value_and_grad(theta)
        found, slopes = splined.value_and_grad(theta)
        assert found == pytest.approx(value, abs=0.005)
        np.testing.assert_allclose(
            np.sqrt(variance) * (slopes - gradient), 0, atol=0.02
        )


@pytest.mark.longest
def test_long_runs_agree_within_a_percent(problem):
    _, grid, likelihood, n_draws = problem
    mean, variance = grid.moments()
    chains = long_runs(likelihood, n_draws // N_CHAINS)
    of_mean, of_variance = errors(chains, mean, variance)
    assert 3.0 * max(of_mean.max(), of_variance.max()) <= 0.01
    away = (chains.mean(axis=(0, 1)) - mean) / np.sqrt(variance)
    np.testing.assert_allclose(away, 0.0, atol=0.01)
    np.testing.assert_allclose(chains.var(axis=(0, 1)), variance, rtol=0.01)


@EACH
def test_draws_that_are_kept_agree_within_their_errors(problem):
    """Of `sample_hyperparameters`, with its starts, its metric and its thinning."""
    _, grid, likelihood, _ = problem
    mean, variance = grid.moments()
    start = likelihood.prior.theta()
    drawn = sample_hyperparameters([(likelihood, start)], n_draws=4000, seed=[0]).theta
    chains = drawn.reshape(-1, N_CHAINS, len(mean)).swapaxes(0, 1)
    of_mean, of_variance = errors(chains, mean, variance)
    assert max(of_mean.max(), of_variance.max()) < 0.04
    away = (drawn.mean(axis=0) - mean) / np.sqrt(variance)
    assert np.abs(away / of_mean).max() < 4.0
    assert np.abs((drawn.var(axis=0) / variance - 1.0) / of_variance).max() < 4.0


@pytest.mark.longest
@pytest.mark.parametrize("n_noise", [1, 2])  # four parameters, five
def test_a_factor_agrees_with_weighted_draws_of_the_prior(n_noise):
    likelihood, rng = of_a_factor(n_noise), np.random.default_rng(0)
    prior, hyperprior = likelihood.prior, Hyperprior(likelihood.prior)
    thetas = [hyperprior.draw(rng) for _ in range(30_000)]
    logs = np.array([likelihood.value(theta) for theta in thetas])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    of_prior = np.array([quantities(prior, theta) for theta in thetas])
    mean = weights @ of_prior
    variance = weights @ np.square(of_prior - mean)
    of_weights = np.square(weights) @ np.square(of_prior - mean)
    drawn = sample_hyperparameters([(likelihood, prior.theta())], n_draws=600, seed=[0])
    found = np.array([quantities(prior, theta) for theta in drawn.theta])
    error = np.sqrt(variance / np.minimum(drawn.effective, len(found)) + of_weights)
    assert (error < 0.15 * np.sqrt(variance)).all()
    assert (np.abs(found.mean(axis=0) - mean) < 3.0 * error).all()
