"""Laplace's evidence of each rank, held against sequential Monte Carlo.

``python benchmarks/evidence.py`` draws data as intervals.py does, learns ranks 1 to 4
and prints by how many nats Laplace's method understates the log evidence of each, and
how far several weights of the ranks are from those of the true evidence: root mean
squares of the differences of their logarithms, of which those within a data set count.
Draws of a RankSearchIC have the weights "as drawn".

The particles go from draws of the prior to the posterior in steps that leave half of
them effective, and move by differential evolution in between. Their likelihood is a
plain one of many thetas at once, for k^x = "rbf", levels and one noise variance.
"""

import argparse
import warnings
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from intervals import draw
from joblib import Parallel, delayed
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.evidence import log_evidence
from skmtgp.learning.sampling import TRUSTED, _understated, find_peaks
from skmtgp.model.hyperprior import Hyperprior

DEFAULTS = {"kernel": "rbf", "noise": "shared", "normalize_y": "shared"}
ACCEPTED = 0.25  # share of moves that their size is tuned to
SIGNS, FLIPPED = 0.15, 0.3  # how often a move changes signs of tasks, and of how many
LEAPS = 0.1  # how often a move is a whole difference: from mode to mode


class Posterior:
    """Likelihood and prior of many thetas at once, by the book."""

    def __init__(self, model):
        likelihood = model._likelihoods[0]
        self.prior = likelihood.prior
        self.hyperprior = Hyperprior(self.prior)
        self.y, self.tasks = likelihood.y, likelihood.tasks
        self.squares = np.square(np.subtract.outer(*[np.ravel(likelihood.X)] * 2))
        self.same = np.equal.outer(self.tasks, self.tasks)
        self.lower, self.upper = self.prior.bounds()
        self.of_factor = self.prior.of_factor

    def factors(self, thetas):
        """F of each theta."""
        return thetas[:, self.of_factor].reshape(-1, *self.prior.factor_shape)

    def log_likelihoods(self, thetas):
        """Of each theta."""
        length, level, noise = np.exp(thetas[:, [0, -2, -1]]).T[:, :, None, None]
        F = self.factors(thetas)[:, self.tasks]
        K = F @ F.swapaxes(1, 2) * np.exp(-0.5 * self.squares / length**2)
        K += level * self.same
        K += (noise + 1e-10 * level) * np.eye(len(self.y))
        try:
            C = np.linalg.cholesky(K)
        except np.linalg.LinAlgError:
            if len(K) == 1:
                return np.array([-np.inf])
            return np.concatenate([self.log_likelihoods(of[None]) for of in thetas])
        half = np.linalg.solve(
            C, np.broadcast_to(self.y[:, None], (len(K), *K.shape[1:2], 1))
        )
        log_det = 2.0 * np.log(np.diagonal(C, axis1=1, axis2=2)).sum(axis=1)
        constant = len(self.y) * np.log(2.0 * np.pi)
        return -0.5 * (np.square(half).sum(axis=(1, 2)) + log_det + constant)

    def log_priors(self, thetas):
        """Of each theta, of the elements of F; but for a constant."""
        away = thetas - self.hyperprior.centre
        found = -0.5 * np.square(away) @ self.hyperprior.precision
        square = np.square(thetas[:, self.of_factor]).sum(axis=1)
        log_amplitude = 0.5 * np.log(square)
        found -= 0.5 * np.square(log_amplitude - np.log(self.hyperprior.unit))
        found -= self.of_factor.sum() * log_amplitude
        inside = (thetas >= self.lower) & (thetas <= self.upper)
        return np.where(inside.all(axis=1), found, -np.inf)

    def proposed(self, thetas, size, rng):
        """A move of each, and which of them are moves by differences."""
        n, d = thetas.shape
        first, second = thetas[rng.integers(n, size=(2, n))]
        far = np.where(rng.uniform(size=n) < LEAPS, 1.0, size * 2.38 / np.sqrt(2 * d))
        moved = thetas + far[:, None] * (first - second)
        moved += 1e-3 * rng.standard_normal(moved.shape)
        turns = rng.uniform(size=n) < SIGNS
        F = self.factors(thetas)
        F = F * np.where(rng.uniform(size=F.shape[:2]) < FLIPPED, -1.0, 1.0)[:, :, None]
        moved[turns] = thetas[turns]
        moved[np.ix_(turns, self.of_factor)] = F[turns].reshape(-1, F[0].size)
        return moved, ~turns


def sampled_evidence(posterior, rng, n_particles, n_moves):
    """Log evidence by sequential Monte Carlo."""
    random = np.random.RandomState(rng.integers(2**31))
    thetas = np.array([posterior.hyperprior.draw(random) for _ in range(n_particles)])
    values, priors = posterior.log_likelihoods(thetas), posterior.log_priors(thetas)
    power, found, size = 0.0, 0.0, 1.0
    while power < 1.0:
        step = _step(values, 1.0 - power)
        log_weights = step * values
        found += logsumexp(log_weights) - np.log(n_particles)
        power = min(1.0, power + step)
        ends = np.cumsum(np.exp(log_weights - logsumexp(log_weights)))
        places = (np.arange(n_particles) + rng.uniform()) / n_particles
        kept = np.searchsorted(ends / ends[-1], places).clip(0, n_particles - 1)
        thetas, values, priors = thetas[kept], values[kept], priors[kept]
        for _ in range(n_moves):
            moved, differ = posterior.proposed(thetas, size, rng)
            new, of_prior = np.full(n_particles, -np.inf), posterior.log_priors(moved)
            inside = np.isfinite(of_prior)
            new[inside] = posterior.log_likelihoods(moved[inside])
            gain = power * (new - values) + of_prior - priors
            taken = np.log(rng.uniform(size=n_particles)) < gain
            thetas[taken], values[taken] = moved[taken], new[taken]
            priors[taken] = of_prior[taken]
            size *= np.exp(taken[differ].mean() - ACCEPTED)
    return found


def _step(values, most):
    """The power by which weights leave half of the particles effective."""

    def effective(step):
        weights = np.exp(step * (values - values.max()))
        return weights.sum() ** 2 / np.square(weights).sum()

    if effective(most) >= 0.5 * len(values):
        return most
    least = 0.0
    for _ in range(40):
        middle = 0.5 * (least + most)
        least, most = (
            (least, middle) if effective(middle) < 0.5 * len(values) else (middle, most)
        )
    return least


def measured(n_particles, n_moves, job):
    """Log evidences of the ranks of one data set, both ways."""
    n_tasks, n_rows, rank, seed = job
    X, y, *_ = draw(*job)
    rng, rows = np.random.default_rng(seed), []
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for of in range(1, min(n_tasks, 4) + 1):
            model = MultiTaskGPRegressor(rank=of, **DEFAULTS).fit(X, y)
            likelihood = model._likelihoods[0]
            with limit_threads(likelihood.side):
                peaks, _ = find_peaks(likelihood, model.theta_, rng)
                laplace = [log_evidence(peak, peak.curvature()[0]) for peak in peaks]
            posterior, start = Posterior(model), likelihood.prior.theta()
            np.testing.assert_allclose(
                posterior.log_likelihoods(start[None]),
                likelihood.value(start),
                rtol=1e-6,
            )
            true = sampled_evidence(posterior, rng, n_particles, n_moves)
            cell = {"tasks": n_tasks, "rows": n_rows, "true rank": rank, "seed": seed}
            rows.append(
                {**cell, "rank": of, "true": true, "laplace": logsumexp(laplace)}
            )
    return rows


def report(rows):
    """Print what Laplace's method lacks, and how far the weights are off."""
    lacks = rows.assign(nats=rows["true"] - rows["laplace"])
    cells = lacks.groupby(["tasks", "rows", "rank"])["nats"]
    print("True log evidence less Laplace's\n")
    print(
        cells.agg(["mean", "std"])
        .unstack()
        .swaplevel(axis=1)
        .sort_index(axis=1)
        .round(1)
    )
    sizes = rows[["tasks", "rank", "rows"]].to_numpy()
    understated = [_understated(*of) for of in sizes]
    weights = {
        "equal": 0.0,
        "laplace": rows["laplace"],
        "half": TRUSTED * rows["laplace"],
        "as drawn": TRUSTED * (rows["laplace"] + understated),
    }
    same = [rows[name] for name in ("tasks", "rows", "true rank", "seed")]
    off = {}
    for name, weight in weights.items():
        away = rows["true"] - weight
        off[name] = np.square(away - away.groupby(same).transform("mean"))
    off = pd.DataFrame(off).groupby([rows["tasks"], rows["rows"]]).mean() ** 0.5
    print("\nRoot mean squares of what log weights are off\n")
    print(off.round(2))


def main():
    """Run the cells and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", type=int, nargs="+", default=[3, 8])
    parser.add_argument("--rows", type=int, nargs="+", default=[5, 10])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--seeds", type=int, default=10, help="draws of each cell")
    parser.add_argument("--particles", type=int, default=700)
    parser.add_argument("--moves", type=int, default=10, help="after each step")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    jobs = list(product(args.tasks, args.rows, args.ranks, range(args.seeds)))
    one = partial(measured, args.particles, args.moves)
    found = Parallel(n_jobs=args.jobs)(delayed(one)(job) for job in jobs)
    report(pd.DataFrame([row for of in found for row in of]))


if __name__ == "__main__":
    main()
