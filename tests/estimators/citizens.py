"""All estimators, and small tables, for what scikit-learn does with them."""

import numpy as np
import pandas as pd
import pytest
from samples import draw
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.model_selection import TaskStratifiedKFold

QUICK = {"max_iter": 1}
STAGED = {"learning": "staged", **QUICK}  # from one start
SHARED = {"noise": "shared", "normalize_y": "shared"}  # PooledGP decides itself
ESTIMATORS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=2, **STAGED),
    "sparse": MultiTaskGPRegressor(inference="sparse", n_inducing=10, **STAGED),
    "IndependentGP": IndependentGP(**SHARED, **QUICK),
    "PooledGP": PooledGP(**QUICK),
    "SingleTaskGP": SingleTaskGP(**QUICK),
    "BayesianLinearRegression": BayesianLinearRegression(),
    "RankSearchIC": RankSearchIC(
        MultiTaskGPRegressor(**SHARED, **STAGED), ranks=(1, 2)
    ),
}


def each_twice(argument, values):
    """Parametrize a test: each estimator with two of the values, all values used.

    They meet in code that all estimators share.
    """
    values = list(values)
    cases = [
        pytest.param(model, values[(2 * i + k) % len(values)], id=f"{name}-{k}")
        for i, (name, model) in enumerate(ESTIMATORS.items())
        for k in range(2)
    ]
    return pytest.mark.parametrize(
        ("estimator", argument), cases, indirect=["estimator"]
    )


X, Y = draw(per_task=8, n_outputs=2)
BY_TASK = np.argsort(X[:, -1], kind="stable")
X, Y = X[BY_TASK], Y[BY_TASK]  # as data are recorded: task after task
y = Y[:, 0]
TASKS = X[:, -1].astype(int)
CV = TaskStratifiedKFold(2)


def frame(labels=("u", "v", "w"), dtype=None):
    table = pd.DataFrame(X[:, :2], columns=["a", "b"])
    return table.assign(load=pd.Series(np.array(labels)[TASKS], dtype=dtype))


FRAME = frame()


def contained(container):
    """The same table in a container; an array has no place for names of tasks."""
    if container == "array":
        return X
    if container == "polars":
        return pytest.importorskip("polars").DataFrame(FRAME.to_dict("list"))
    return FRAME if container == "pandas" else FRAME.to_numpy()


def tasks_of(model):
    """The tasks that a fitted regressor knows."""
    return getattr(model, "best_estimator_", model).tasks_.tolist()


def spreads(model, table=X):
    """Everything that is predicted of a table."""
    mean, std = model.predict(table, return_std=True)
    cov = model.predict(table, return_cov=True)[1]
    return mean, std, cov.diagonal()


def assert_same_bits(found, expected):
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def scaled(estimator, columns=("a", "b"), **options):
    """Features are scaled; the task is passed through and ends up last."""
    scaler = ColumnTransformer([("scale", StandardScaler(), list(columns))], **options)
    return Pipeline([("features", scaler), ("model", estimator)])
