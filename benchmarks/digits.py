"""How many nats of the log likelihood are lost in double precision without noise.

``python benchmarks/digits.py`` compares each method with fifty digits, by the textbook
implementation of the tests, where the prior variance v is 900 and rank one is shared by
two tasks. It prints the worst of a few draws and length scales, in nats and in units of
n eps v / sigma^2: how far below the likelihood, and how far above. Draws that the model
does not fit, which is far from all modes, are left out. The bound has all inputs
inducing, of which every one is there twice, or those that `greedy_variance` finds.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from sklearn.gaussian_process.kernels import RBF

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.inducing import greedy_variance
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.sparse import SparseBound
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from textbook import exact_log_marginal_likelihood

V, N, SEEDS, NOISES = 900.0, (60, 120), range(3), (1e-6, 1e-8, 1e-10)
LENGTHS, DIMENSIONS = (0.5, 1.0, 2.0, 3.0), (1, 2)
HEAD = "   n  sigma^2  draws  method         nats below    above  units below  above"
METHODS = {
    "dense": DenseLikelihood,
    "kronecker": KroneckerLikelihood,
    "sparse, all": lambda *data: SparseBound(*data, data[1]),
    "sparse, found": lambda *data: SparseBound(*data, found(data[1])),
}


def found(X):
    """The inputs that greedy conditional variance finds."""
    return greedy_variance(RBF(), X, len(X))


def errors(n, noise, length, d, seed):
    """Of each method, in nats: its value less that of fifty digits."""
    X = np.random.default_rng(seed).uniform(0.0, 4.0, (n // 2, d))
    X, tasks = np.tile(X, (2, 1)), np.repeat([0, 1], n // 2)
    F = np.sqrt(V) * np.array([[1.0], [0.7]])
    y = F[tasks, 0] * np.sin(X[:, 0]) * np.cos(X[:, -1])
    data, form = (X / length, tasks, y), low_rank(2, 1)
    theta = np.r_[0.0, F.ravel(), np.log(noise)]
    exact = exact_log_marginal_likelihood(F @ F.T, np.exp(theta[-1]), *data)
    if exact < -n / 2:  # the model does not fit: far from what is learned
        return [np.nan] * len(METHODS)
    made = (make(Prior(RBF(), form), *data) for make in METHODS.values())
    return [likelihood.value(theta) - exact for likelihood in made]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="n = 60, one draw")
    arguments = parser.parse_args()
    print(HEAD)
    for n in N[:1] if arguments.short else N:
        for noise in NOISES:
            draws = [
                errors(n, noise, length, d, seed)
                for length in LENGTHS
                for d in DIMENSIONS
                for seed in (SEEDS[:1] if arguments.short else SEEDS)
            ]
            unit = n * np.finfo(float).eps * V / noise
            for method, of in zip(METHODS, np.transpose(draws), strict=True):
                of = of[np.isfinite(of)]
                below, above = max(0.0, -of.min()), max(0.0, of.max())
                print(
                    f"{n:4d} {noise:8.0e} {len(of):6d}  {method:13s} {below:11.1e} "
                    f"{above:8.1e} {below / unit:12.2f} {above / unit:6.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
