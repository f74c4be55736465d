"""Draws of hyperparameters: this package's sampler beside those of other libraries.

``python benchmarks/samplers.py`` draws data as intervals.py does, learns the mode at
the true rank, and draws from the same posterior with

- "skmtgp": Hamiltonian Monte Carlo, 4 chains that start from all modes that are found;
- "nutpie": NUTS, 4 chains, with the log density as a Python function;
- "emcee": an ensemble of walkers, which needs no gradient.

The others move in the same coordinates, divided by the deviations of Laplace's method
at the likeliest mode, and start from draws of its normal density. They are left out
where they are not installed. For each it prints seconds, evaluations of the density,
the effective sample size of the hyperparameter or correlation for which it is least,
the largest R-hat, and the effective size for 1000 evaluations: medians over the draws.
"""

import argparse
import time
import warnings

import numpy as np
import pandas as pd
from intervals import draw
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp._numerics.hmc import diagnose
from skmtgp.learning.evidence import climb_posterior
from skmtgp.learning.sampling import quantities, sample_hyperparameters

CASES = [(3, 5), (3, 20), (8, 10), (8, 20)]  # tasks and rows of each
RANK, CHAINS, TUNE, DRAWS = 2, 4, 300, 250
STEPS = 500  # of each walker, of which the first half is left out


class Whitened:
    """The log posterior, in deviations around its likeliest mode."""

    def __init__(self, likelihood, theta):
        peak = climb_posterior(likelihood, theta)
        self.density, self.middle = peak.density, peak.x
        values, vectors = peak.curvature()
        self.scale = vectors / np.sqrt(values)
        self.size, self.n_evaluations = len(self.middle), 0

    def __call__(self, z):
        """Value and gradient."""
        self.n_evaluations += 1
        value, gradient = self.density(self.middle + self.scale @ z)
        return float(value), self.scale.T @ gradient

    def quantities(self, chains):
        """What is diagnosed, of chains of z."""
        return np.array([[self._of(z) for z in chain] for chain in chains])

    def _of(self, z):
        theta = self.density.theta(self.middle + self.scale @ z)
        return quantities(self.density.prior, theta)


def by_skmtgp(likelihood, theta, seed):
    """Effective sizes, R-hats and evaluations."""
    sample = sample_hyperparameters([(likelihood, theta)], n_draws=100, seed=[seed])
    return sample.effective, sample.r_hat, sample.n_evaluations


def by_nutpie(likelihood, theta, seed):
    """The same by NUTS."""
    import nutpie
    from nutpie.compiled_pyfunc import from_pyfunc

    of = Whitened(likelihood, theta)
    model = from_pyfunc(
        of.size,
        lambda: of,
        lambda *_: lambda z: {"z": z},
        [np.dtype(float)],
        [(of.size,)],
        ["z"],
        make_initial_point_fn=lambda s: np.random.default_rng(s).normal(size=of.size),
    )
    options = {"chains": CHAINS, "cores": 1, "seed": seed, "progress_bar": False}
    trace = nutpie.sample(model, draws=DRAWS, tune=TUNE, **options)
    chains = np.asarray(trace.posterior["z"])
    return *diagnose(of.quantities(chains)), of.n_evaluations


def by_emcee(likelihood, theta, seed):
    """The same by an ensemble."""
    import emcee

    of = Whitened(likelihood, theta)
    n_walkers = 2 * of.size + 2
    sampler = emcee.EnsembleSampler(n_walkers, of.size, lambda z: of(z)[0])
    sampler.random_state = np.random.RandomState(seed).get_state()
    start = np.random.default_rng(seed).standard_normal((n_walkers, of.size))
    sampler.run_mcmc(start, STEPS)
    chains = sampler.get_chain(discard=STEPS // 2).swapaxes(0, 1)
    return *diagnose(of.quantities(chains)), of.n_evaluations


SAMPLERS = {"skmtgp": by_skmtgp, "nutpie": by_nutpie, "emcee": by_emcee}


def measure(name, likelihood, theta, seed):
    """A row of the table."""
    begin = time.process_time()
    effective, r_hat, n_evaluations = SAMPLERS[name](likelihood, theta, seed)
    least = float(np.nanmin(effective))
    return {
        "sampler": name,
        "seconds": time.process_time() - begin,
        "evaluations": n_evaluations,
        "effective": least,
        "R-hat": float(np.nanmax(r_hat)),
        "effective for 1000": 1000.0 * least / n_evaluations,
    }


def main():
    """Draw and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=SAMPLERS, default=list(SAMPLERS))
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows, missing = [], set()
    for n_tasks, n_rows in CASES:
        for seed in range(arguments.seeds):
            X, y, *_ = draw(n_tasks, n_rows, RANK, seed)
            model = MultiTaskGPRegressor(rank=RANK).fit(X, y)
            for name in arguments.only:
                case = {"tasks": n_tasks, "rows a task": n_rows}
                try:
                    found = measure(name, model._likelihoods[0], model.theta_, seed)
                    rows.append(case | found)
                except ImportError:
                    missing.add(name)
    keys = ["tasks", "rows a task", "sampler"]
    table = pd.DataFrame(rows).groupby(keys, sort=False).median()
    print(table.to_string(float_format="{:.3g}".format))
    for name in missing:
        print(f"left out: {name} is not installed")


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
