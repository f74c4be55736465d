"""Time of one likelihood and gradient of complete data over one eigh of K^x.

``python benchmarks/kronecker.py`` prints a table for the paper's kernel, 14 tasks, rank
4 and N inputs of each task, n = 14 N samples in all. Both are timed in turns in one
process, with the same threads; the ratio of the best times is what counts (goal: 3 at
N = 2000). The dense likelihood of as many samples is timed up to ``--dense`` samples;
with ``--tasks 2`` it is the hardest to beat. ``--short`` takes half a minute.

``--gaps 0.01`` hides that share of the cells, drawn at random, and times the likelihood
of the others over that of all (goal: 3 with one cell of a hundred at N = 4000).
"""

import argparse

import numpy as np
from likelihood import seconds
from scipy.linalg import eigh
from threadpoolctl import threadpool_limits

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import LowRank

RANK = 4


def make_problem(n_inputs, n_tasks, seed=0):
    """A prior with complete random data, and where to evaluate them."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((n_inputs, 18))
    X = np.tile(np.hstack([x, np.sign(x[:, 6:12])]), (n_tasks, 1))
    tasks, y = np.repeat(np.arange(n_tasks), n_inputs), rng.standard_normal(len(X))
    kernel, form = inverse_dynamics_kernel(6), LowRank(n_tasks, min(RANK, n_tasks))
    theta = [kernel.theta, rng.standard_normal(form.n_parameters), [np.log(1e-2)]]
    return (Prior(kernel, form), X, tasks, y), np.concatenate(theta)


def with_gaps(problem, share, seed=0):
    """The likelihood without some of the cells; None where all are there."""
    prior, *rows = problem
    n = len(rows[-1])
    gone = np.random.default_rng(seed).permutation(n)[: round(share * n)]
    rows = (np.delete(part, gone, axis=0) for part in rows)
    return KroneckerLikelihood(prior, *rows) if len(gone) else None


def measure(n_inputs, n_tasks, most, repeats, share):
    """Best times of eigh, value and gradient, value, the second with gaps and dense."""
    problem, theta = make_problem(n_inputs, n_tasks)
    likelihood = KroneckerLikelihood(*problem)
    K_x = likelihood.prior.kernel_at(theta)(likelihood.inputs)
    dense = DenseLikelihood(*problem) if len(problem[-1]) <= most else None
    gaps = with_gaps(problem, share)
    rows = [
        (
            seconds(eigh, K_x),
            seconds(likelihood.value_and_grad, theta),
            seconds(likelihood.value, theta),
            seconds(gaps.value_and_grad, theta) if gaps else np.nan,
            seconds(dense.value_and_grad, theta) if dense else np.nan,
        )
        for _ in range(repeats)
    ]
    return np.min(rows, axis=0)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, nargs="+", default=[20, 100, 500, 1000, 2000])
    parser.add_argument("--tasks", type=int, default=14)
    parser.add_argument("--dense", type=int, default=4000, help="most samples")
    parser.add_argument("--gaps", type=float, default=0.0, help="share of the cells")
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--short", action="store_true", help="N up to 500 only")
    arguments = parser.parse_args()
    print(
        "    N      n    eigh ms  value+grad ms  ratio  value ms  dense val+grad ms"
        + "  with gaps ms  over all" * (arguments.gaps > 0.0)
    )
    with threadpool_limits(arguments.threads):
        for n in [n for n in arguments.n if n <= 500 or not arguments.short]:
            repeats = int(np.clip(2000 // n, 3, 50))
            sizes = n, arguments.tasks, arguments.dense, repeats, arguments.gaps
            a, b, c, gaps, d = 1e3 * measure(*sizes)
            print(
                f"{n:5d} {n * arguments.tasks:6d} {a:10.2f} {b:14.2f} {b / a:6.2f} "
                f"{c:9.2f} {d:18.2f}"
                + f"{gaps:14.2f} {gaps / b:9.2f}"
                * (arguments.gaps > 0.0),
                flush=True,
            )


if __name__ == "__main__":
    main()
