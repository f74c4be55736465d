"""Time of one fit to many samples: one joint of the Puma 560, 14 loads, one rank.

The goal is 10 minutes on two cores at n = 2800. Run from the repository's root:
``python benchmarks/large_fit.py``.
"""

import argparse
import time
import warnings

from settings import PAPER

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import fetch_puma560
from skmtgp.metrics import normalized_mean_squared_error

LOADS = range(1, 15)


def main():
    """Fit, and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n-per-load", type=int, default=200)
    parser.add_argument("--joint", type=int, default=2)
    parser.add_argument("--rank", type=int, default=4)
    parser.add_argument("--verbose", type=int, default=0)
    arguments = parser.parse_args()
    joint = arguments.joint - 1
    options = {"loads": LOADS, "return_X_y": True, "random_state": 0}
    X, y = fetch_puma560(n_per_load=arguments.n_per_load, **options)
    X_test, y_test = fetch_puma560(subset="extrapolation", n_per_load=1000, **options)
    rank, verbose = arguments.rank, arguments.verbose
    model = MultiTaskGPRegressor(rank=rank, verbose=verbose, **PAPER)
    begin = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        pipeline = make_inverse_dynamics_regressor(model).fit(X, y[:, joint])
    seconds, fitted = time.perf_counter() - begin, pipeline[-1]
    error = normalized_mean_squared_error(
        y_test[:, joint], pipeline.predict(X_test), tasks=X_test[:, -1]
    )
    print(
        f"n = {len(X)}, joint {arguments.joint}, rank {arguments.rank}: "
        f"{seconds:.0f} s (goal: 600 at n = 2800),\n"
        f"{fitted.n_evaluations_} likelihoods, log marginal likelihood "
        f"{fitted.log_marginal_likelihood_value_:.1f}, extrapolation nMSE {error:.1e}"
    )
    for warning in caught:
        print(f"{warning.category.__name__}: {warning.message}")


if __name__ == "__main__":
    main()
