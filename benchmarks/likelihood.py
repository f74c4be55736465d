"""Time of one likelihood and gradient over its floor, LAPACK's potrf and potri.

``python benchmarks/likelihood.py`` prints a table for the paper's kernel, 14 tasks and
rank 4, with one thread and with as many as there are. Both are timed in turns in one
process, with the same threads; the ratio of the best times is what counts. The limits
are goals: nothing fails where one is missed. Below a few hundred rows an evaluation is
not spread over threads, which may slow it much if another process is busy; its floor
may be.
``--short`` takes half a minute.
"""

import argparse
import time

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri
from threadpoolctl import threadpool_limits

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import LowRank

N_TASKS, RANK = 14, 4
SIZES = 280, 1400, 2800, 4000
FEW, GOAL_OF_FEW, GOAL = 1000, (1.7, 2.5), 1.15  # the first with one thread


def make_problem(n, seed=0):
    """A likelihood over random data, and parameters at which to evaluate it."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((n, 18))
    X = np.hstack([x, np.sign(x[:, 6:12])])
    tasks = np.sort(np.arange(n) % N_TASKS)
    kernel, form = inverse_dynamics_kernel(6), LowRank(N_TASKS, RANK)
    y = rng.standard_normal(n)
    likelihood = DenseLikelihood(Prior(kernel, form), X, tasks, y)
    F = rng.standard_normal(form.n_parameters)
    return likelihood, np.concatenate([kernel.theta, F, [np.log(1e-2)]])


def floor(K, invert=True):
    """Seconds of potrf and, if asked, potri."""
    K = K.copy(order="F")
    begin = time.perf_counter()
    factor, _ = dpotrf(K, lower=1, clean=0, overwrite_a=1)
    if invert:
        dpotri(factor, lower=1, overwrite_c=1)
    return time.perf_counter() - begin


def seconds(function, *arguments):
    """Seconds of one call."""
    begin = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - begin


def measure(n, repeats):
    """Best times: floor, value and gradient, potrf, value."""
    likelihood, theta = make_problem(n)
    K = likelihood.covariance(theta)
    likelihood.value_and_grad(theta)
    rows = [
        (
            floor(K),
            seconds(likelihood.value_and_grad, theta),
            floor(K, invert=False),
            seconds(likelihood.value, theta),
        )
        for _ in range(repeats)
    ]
    return np.min(rows, axis=0)


def print_table(sizes, n_threads, most):
    """Print a line for each n, of about `most` / n repetitions."""
    print(f"threads: {n_threads or 'all'}")
    print("    n   floor ms  value+grad ms  ratio   goal   potrf ms  value ms  ratio")
    with threadpool_limits(n_threads):
        for n in sizes:
            a, b, c, d = measure(n, max(3, most // n))
            goal = GOAL_OF_FEW[n_threads != 1] if n < FEW else GOAL
            print(
                f"{n:5d} {1e3 * a:10.2f} {1e3 * b:14.2f} {b / a:6.2f} {goal:6.2f} "
                f"{1e3 * c:10.2f} {1e3 * d:9.2f} {d / c:6.2f}",
                flush=True,
            )


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, nargs="+", default=SIZES)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, None])
    parser.add_argument("--short", action="store_true", help="n = 280 and 1400 only")
    arguments = parser.parse_args()
    for n_threads in arguments.threads:
        if arguments.short:
            print_table([280, 1400], n_threads, 20_000)
        else:
            print_table(arguments.n, n_threads, 60_000)


if __name__ == "__main__":
    main()
