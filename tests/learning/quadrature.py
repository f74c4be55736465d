"""Moments of a posterior of a few logarithms, by sums over a grid."""

import numpy as np

from skmtgp.model.hyperprior import Hyperprior

OUTSIDE = 17.0  # nats below the top, where a grid ends


class Grid:
    """Log likelihoods and log posteriors on a grid of the logarithms.

    Its ends are where the posterior is next to nothing. Coarse grids find them, the
    first one within the bounds and five deviations of the prior.
    """

    def __init__(self, likelihood, n, ends=None):
        self.hyperprior = Hyperprior(likelihood.prior)
        self.lower, self.upper = ends or self.find_ends(likelihood)
        self.step = (self.upper - self.lower) / (n - 1)
        axes = np.linspace(self.lower, self.upper, n, axis=1)
        self.points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        flat = self.points.reshape(-1, len(axes))
        self.values = np.array([likelihood.value(t) for t in flat])
        self.logs = [self.hyperprior.log_density(t)[0] for t in flat] + self.values

    def find_ends(self, likelihood):
        ends, deviation = likelihood.prior.bounds(), self.hyperprior.precision**-0.5
        lower = np.maximum(ends[0], self.hyperprior.centre - 5.0 * deviation)
        upper = np.minimum(ends[1], self.hyperprior.centre + 5.0 * deviation)
        for _ in range(3):
            coarse = Grid(likelihood, 17, (lower, upper))
            inside = coarse.logs > coarse.logs.max() - OUTSIDE
            found = coarse.points.reshape(-1, len(lower))[inside]
            lower = np.maximum(lower, found.min(axis=0) - coarse.step)
            upper = np.minimum(upper, found.max(axis=0) + coarse.step)
        return lower, upper

    def moments(self):
        """Means and variances. Sums do: at the ends is next to nothing."""
        weights = np.exp(self.logs - self.logs.max())
        weights /= weights.sum()
        points = self.points.reshape(len(weights), -1)
        mean = weights @ points
        return mean, weights @ np.square(points - mean)
