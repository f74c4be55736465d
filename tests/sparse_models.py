"""Models that learn by inducing inputs, and data for them."""

import numpy as np
from multitask_models import PAPER
from sklearn.gaussian_process.kernels import RBF

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP

M, N, NOISE = 3, 90, 0.05
FACTOR = np.array([[1.0, 0.2], [-0.7, 0.5], [0.4, 1.0]])


def draw(n=N, seed=0, n_outputs=None):
    """Rows in no order of their tasks, the label last."""
    rng = np.random.default_rng(seed)
    x, tasks = rng.uniform(-2.0, 2.0, (n, 2)), rng.integers(0, M, n)
    tasks[:M] = np.arange(M)
    z = np.column_stack([np.sin(2.0 * x[:, 0]), np.cos(x[:, 1] + x[:, 0])])
    y = (FACTOR[tasks] * z).sum(axis=1) + NOISE * rng.standard_normal(n)
    if n_outputs:
        y = y[:, None] * np.linspace(1.0, 2.0, n_outputs) + np.arange(n_outputs)
    return np.column_stack([x, tasks]), y


SPARSE = {"inference": "sparse", "n_inducing": 20, "n_exact": 60, "max_iter": 15}
RANK_2 = {"rank": 2, **PAPER, **SPARSE}
STAGED = RANK_2 | {"learning": "staged"}  # from one start
GPS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(**STAGED),
    "levels": MultiTaskGPRegressor(**STAGED | {"task_levels": True}),
    "diagonal": MultiTaskGPRegressor(**STAGED | {"rank": 1, "diagonal": True}),
    "per task": MultiTaskGPRegressor(**STAGED | {"noise": "per_task"}),
    "several kernels": MultiTaskGPRegressor(
        [RBF(2.0), RBF(0.5)],
        rank=[1, 2],
        diagonal=[True, False],
        **PAPER | SPARSE | {"task_levels": True, "max_iter": 5},
    ),
    "k-means": MultiTaskGPRegressor(inducing_inputs="k-means", **STAGED),
    "optimised": MultiTaskGPRegressor(inducing_inputs="optimised", **STAGED),
    "IndependentGP": IndependentGP(**PAPER, **SPARSE),
    "PooledGP": PooledGP(noise="shared", **SPARSE),
}


def noisy(n=600):
    """What few inducing inputs cannot resolve."""
    rng = np.random.default_rng(0)
    x, tasks = rng.uniform(0.0, 10.0, n), rng.integers(0, M, n)
    y = FACTOR[tasks, 0] * (np.sin(x) + 0.5 * np.sin(4.0 * x))
    return np.column_stack([x, tasks]), y + 0.3 * rng.standard_normal(n)
