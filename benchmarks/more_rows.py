"""Whether more rows lower the errors, where the parameters stay as they are.

``python benchmarks/more_rows.py`` learns the torques of a few joints from 56,000 exact
samples by inducing inputs, and prints the errors of that posterior; then those of exact
inference from some of the samples, at the same parameters. The whole interpolation and
extrapolation sets are predicted. A joint takes some five minutes.
"""

import argparse
from copy import copy

import numpy as np
from settings import PAPER
from sklearn.pipeline import make_pipeline

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import fetch_puma560
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.metrics import normalized_mean_squared_error

LOADS = range(1, 15)
TEST_SETS = "interpolation", "extrapolation"
HEAD = "joint  inference       n  nMSE interpolation  extrapolation"


def rows(subset, joint, n_per_load=None):
    """Inputs with the load, and the torque of the joint."""
    options = {"loads": LOADS, "random_state": 0, "return_X_y": True}
    X, torque = fetch_puma560(subset=subset, n_per_load=n_per_load, **options)
    return X, torque[:, joint - 1]


def exact(model, size):
    """The model with the same parameters, and the exact posterior of some rows."""
    [bound], other = model._likelihoods, copy(model)
    chosen = np.random.default_rng(0).permutation(len(bound.y))[:size]
    chosen = chosen[np.argsort(bound.tasks[chosen], kind="stable")]
    data = (part[chosen] for part in (bound.X, bound.tasks, bound.y))
    likelihood = DenseLikelihood(bound.prior, *data)
    other._posteriors = [likelihood.posterior(model.theta_)]
    return other


def report(joint, kind, n, pipeline):
    """Print the errors, averaged over loads."""
    errors = []
    for subset in TEST_SETS:
        X, y = rows(subset, joint)
        blocks = np.array_split(X, len(LOADS))
        mean = np.concatenate([pipeline.predict(block) for block in blocks])
        errors.append(normalized_mean_squared_error(y, mean, tasks=X[:, -1]))
    line = "{:5}  {:9} {:7} {:19.2e} {:14.2e}"
    print(line.format(joint, kind, n, *errors), flush=True)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--joints", nargs="+", type=int, default=[2, 5, 6])
    add("--n-per-load", type=int, default=4000)
    add("--sizes", nargs="+", type=int, default=[1400, 2800, 5600, 8400])
    add("--max-iter", type=int, default=2000)
    arguments = parser.parse_args()
    print(HEAD)
    for joint in arguments.joints:
        X, y = rows("train", joint, arguments.n_per_load)
        options = PAPER | {"inference": "sparse", "max_iter": arguments.max_iter}
        model = MultiTaskGPRegressor(rank=5, **options)
        features, model = make_inverse_dynamics_regressor(model).fit(X, y)
        for size in arguments.sizes:
            some = make_pipeline(features, exact(model, size))
            report(joint, "exact", size, some)
        report(joint, "sparse", len(y), make_pipeline(features, model))


if __name__ == "__main__":
    main()
