"""Time and memory of predicted means, beside what cannot be avoided.

``python benchmarks/prediction.py`` fits the paper's kernel, 14 tasks, rank 4 and one
output to 2800 samples, without learning, and prints:

- for one state, the time of ``predict`` over that of scikit-learn's own validation of
  the same row (goal: at most 300 microseconds more);
- for one state through the paper's pipeline, with six outputs, the time of ``predict``
  (goal: at most 2 milliseconds);
- for a batch, the time over that of the kernel's two matrix products and its
  exponential, in blocks of the same size (goal: at most 1.5 times);
- the memory that a batch of means takes, over the size of the batch.

Both times of a pair are taken in turns; the best ones count.
"""

import argparse
import tracemalloc
from time import perf_counter

import numpy as np
from settings import PAPER
from sklearn.utils.validation import check_array, validate_data
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp._numerics.parallel import map_threads
from skmtgp.datasets import load_puma560
from skmtgp.inference.tiles import TILE
from skmtgp.kernels import inverse_dynamics_kernel

N_TASKS, RANK = 14, 4


def make_model(n, seed=0):
    """A regressor of random data that has learned nothing, and a batch of rows."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((2 * n, 18))
    tasks = rng.permutation(np.arange(2 * n) % N_TASKS)
    X = np.column_stack([x, np.sign(x[:, 6:12]), tasks])
    kernel = inverse_dynamics_kernel(6)
    model = MultiTaskGPRegressor(kernel, rank=RANK, max_iter=0, **PAPER)
    return model.fit(X[:n], np.sin(x[:n, 0]) + tasks[:n]), X[n:]


def make_pipeline(n=280):
    """The paper's pipeline of six outputs, which has learned nothing, and its rows."""
    puma = load_puma560()
    rows = np.linspace(0, len(puma.data) - 1, n).astype(int)
    pipeline = make_inverse_dynamics_regressor()
    pipeline[-1].set_params(ranks=(RANK,), estimator__max_iter=0)
    return pipeline.fit(puma.data[rows], puma.target[rows]), puma.data[rows]


def validate(model, X):
    """What scikit-learn does to check a table and its numeric columns."""
    validate_data(model, X, reset=False, dtype=None, ensure_all_finite=False)
    check_array(X[:, :-1], dtype=np.float64)


def multiply(X, X_train):
    """The two products of matrices and the exponential, tile by tile."""

    def tile(a, b):
        rows, cols = X[a : a + TILE], X_train[b : b + TILE]
        rows @ cols.T
        e = rows[:, :18] @ cols[:, :18].T
        np.exp(e, out=e)

    edges = range(0, len(X), TILE), range(0, len(X_train), TILE)
    map_threads(tile, [(a, b) for a in edges[0] for b in edges[1]])


def seconds(function, *arguments):
    begin = perf_counter()
    function(*arguments)
    return perf_counter() - begin


def best(repeats, *calls):
    """Best times of several calls, made in turns."""
    return np.min([[seconds(*call) for call in calls] for _ in range(repeats)], axis=0)


def peak_of(function, *arguments):
    """Bytes that a call holds at most."""
    tracemalloc.start()
    function(*arguments)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def main():
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=2800)
    parser.add_argument("--threads", type=int, default=None)
    arguments = parser.parse_args()
    with threadpool_limits(arguments.threads):
        model, X = make_model(arguments.n)
        one = X[:1]
        a, b = 1e6 * best(3000, (validate, model, one), (model.predict, one))
        print(f"one state: {b:.0f} us, validation {a:.0f} us, {b - a:.0f} us over it")
        pipeline, states = make_pipeline()
        a = 1e3 * best(1000, (pipeline.predict, states[:1]))[0]
        print(f"one state, by the pipeline of six outputs: {a:.2f} ms")
        features = np.ascontiguousarray(X[:, :-1])
        floor = multiply, features, model.X_train_
        a, b = 1e3 * best(30, floor, (model.predict, X))
        print(f"{len(X)} states: {b:.1f} ms, products {a:.1f} ms, ratio {b / a:.2f}")
        for size in (len(X) // 4, len(X) // 2, len(X)):
            peak = peak_of(model.predict, X[:size])
            square = 8.0 * size * arguments.n
            print(
                f"memory of {size} means: {peak / 2**20:.1f} MiB, "
                f"{peak / square:.3f} of the cross-covariance"
            )


if __name__ == "__main__":
    main()
