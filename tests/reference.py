"""What the public interface gives for fixed hyperparameters, to compare with before.

``python tests/reference.py`` writes `reference.json`. It is written again only where a
change of results is meant, and the commit says why.
"""

import json
import warnings
from itertools import product
from pathlib import Path

import numpy as np
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Matern,
    RationalQuadratic,
)

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp.kernels import ARDLinear, Columns

FILE = Path(__file__).with_name("reference.json")
KERNELS = {
    "default": None,
    "inverse dynamics": ARDLinear([0.5, 0.1], 0.3)
    + ConstantKernel(0.8) * Columns(RBF([1.3]), [0]),
    "Matern": Matern([1.0, 2.0], nu=1.5) + DotProduct(0.5),
    "rational quadratic": ConstantKernel(1.2) * RationalQuadratic(1.5, 0.7),
}
# the model without levels, with units that the tasks share
PAPER = {"task_levels": False, "normalize_y": "shared"}


def draw(complete):
    """Three tasks of some smooth functions, with noise."""
    rng = np.random.default_rng(0)
    X = rng.uniform(-2.0, 2.0, (18, 2))
    X = np.tile(X, (3, 1)) if complete else rng.uniform(-2.0, 2.0, (54, 2))
    task = np.repeat([0, 1, 2], 18)
    y = np.sin(2.0 * X[:, 0]) * (1.0 + task) + 0.5 * X[:, 1] * (task == 1) + task
    return np.column_stack([X, task]), y + 0.1 * rng.standard_normal(54)


def models():
    """Estimators by name, and whether their data are complete."""
    for name, kernel in KERNELS.items():
        for rank, noise in product([1, 2, 3], ["shared", "per_task"]):
            options = {"kernel": kernel, "rank": rank, "noise": noise}
            for inference in ("dense", "kronecker", "sparse"):
                # one start, where others would be as good
                learning = "staged" if (name, rank) == ("Matern", 3) else "annealed"
                model = MultiTaskGPRegressor(
                    **options,
                    **PAPER,
                    inference=inference,
                    n_inducing=9,
                    max_iter=0,
                    learning=learning,
                )
                complete = inference == "kronecker"
                yield f"{name}, rank {rank}, {noise}, {inference}", model, complete
    for normalize in (True, False):
        options = {"normalize_y": normalize, "max_iter": 0}
        no_levels = options | {"task_levels": False}
        diagonal = MultiTaskGPRegressor(rank=1, diagonal=True, **no_levels)
        yield f"diagonal, {normalize}", diagonal, False
        yield f"IndependentGP, {normalize}", IndependentGP(**no_levels), False
        for cls in (PooledGP, SingleTaskGP):
            yield f"{cls.__name__}, {normalize}", cls(**options), False


def results_of(model, complete):
    """Likelihood and gradient near the start, predictions at the start."""
    X, y = draw(complete)
    model.fit(X, y)
    new, _ = draw(False)
    mean, std = model.predict(new[::5], return_std=True, include_noise=True)
    found = {
        "count": [float(model.n_hyperparameters_)],
        "mean": mean.tolist(),
        "std": std.tolist(),
        "covariance": np.ravel(model.predict(new[::20], return_cov=True)[1]).tolist(),
        "left out": np.concatenate(model.loo_predict()).tolist(),
    }
    rng = np.random.default_rng(1)
    theta = model.theta_ + rng.uniform(-0.3, 0.3, len(model.theta_))
    value, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
    return found | {"likelihood": [float(value)], "gradient": gradient.tolist()}


def write():
    """Keep the results of all models."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = {name: results_of(*of) for name, *of in models()}
    lines = [f'"{name}": {json.dumps(of)}' for name, of in found.items()]
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    write()
