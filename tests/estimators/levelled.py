"""Tasks with levels, in units and with noise of their own, and models of them."""

from itertools import product

import numpy as np
from samples import split
from sklearn.gaussian_process.kernels import RBF

KERNEL = RBF([1.0, 1.5])
OPTIONS = {
    f"{'levels' if levels else 'no levels'}, {units} units, {noise} noise": {
        "task_levels": levels,
        "normalize_y": units,
        "noise": noise,
    }
    for levels, units, noise in product(
        (True, False), (False, "shared", "per_task"), ("shared", "per_task")
    )
}
M = 4


def draw(n_inputs=7, n_outputs=None, seed=0, *, complete=False, units=True):
    """Rows in no order, X with the task last; levels far from each other."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-2.0, 2.0, (n_inputs * (1 if complete else M), 2))
    x = np.tile(x, (M, 1)) if complete else x
    tasks = np.repeat(np.arange(M), n_inputs)
    basis = np.column_stack([np.sin(1.5 * x[:, 0]), x[:, 1]])
    weights = rng.normal(size=(n_outputs or 1, M, 2))
    Y = np.einsum("nb,jnb->nj", basis, weights[:, tasks])
    Y += 0.1 * rng.standard_normal(Y.shape) + 5.0 * rng.standard_normal(M)[tasks, None]
    if units:
        Y *= np.array([1.0, 30.0, 0.2, 5.0])[tasks, None]
    order = rng.permutation(len(Y))
    X, Y = np.column_stack([x, tasks])[order], Y[order]
    return X, Y if n_outputs else Y[:, 0]


def levels_by_hand(output, X, y):
    """Mean and covariance of the levels given y, from what was learned of an output."""
    x, tasks = split(X)
    M = len(output.K_rho)
    centre, prior = (np.broadcast_to(np.ravel(of), M) for of in (output[3], output[4]))
    cross = np.equal.outer(np.arange(M), tasks) * prior[:, None]  # cov(level, y)
    solved = np.linalg.solve(output.covariance(x, tasks), cross.T)
    mean = centre + solved.T @ (y - centre[tasks])
    return mean, np.diag(prior) - cross @ solved
