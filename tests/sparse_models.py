"""Models that learn by inducing inputs, and data for them."""

import numpy as np

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
STAGED = {"learning": "staged", **SPARSE}  # from one start
GPS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=2, **SPARSE),
    "diagonal": MultiTaskGPRegressor(rank=1, diagonal=True, **STAGED),
    "per task": MultiTaskGPRegressor(rank=2, noise="per_task", **STAGED),
    "k-means": MultiTaskGPRegressor(rank=2, inducing_inputs="k-means", **STAGED),
    "optimised": MultiTaskGPRegressor(rank=2, inducing_inputs="optimised", **STAGED),
    "IndependentGP": IndependentGP(**SPARSE),
    "PooledGP": PooledGP(**SPARSE),
}


def noisy(n=600):
    """What few inducing inputs cannot resolve."""
    rng = np.random.default_rng(0)
    x, tasks = rng.uniform(0.0, 10.0, n), rng.integers(0, M, n)
    y = FACTOR[tasks, 0] * (np.sin(x) + 0.5 * np.sin(4.0 * x))
    return np.column_stack([x, tasks]), y + 0.3 * rng.standard_normal(n)
