"""Fitted models as functions of one state, of tasks that numbers describe."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from skmtgp import (
    MultiTaskGPRegressor,
    compile_predictor,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import load_puma560

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
]
START = {"max_iter": 0}
SPARSE = {"inference": "sparse", "n_inducing": 20, "n_exact": 20}


def cube(z):
    return z**3


ROOTS = np.cbrt, cube
KINDS = {
    "defaults": {},
    "without levels": {"task_levels": False},
    "shared": {"shared": True, "rank": 1},
    "transformed": {"target_transform": ROOTS},
    "sampled": {"hyperparameters": "sampled", "n_draws": 4},
    "sparse": SPARSE,
}


def data():
    rng = np.random.default_rng(0)
    task = np.repeat(np.arange(6), 10)
    d, x = rng.uniform(1.0, 3.0, (6, 2)), rng.uniform(0.0, 6.0, (60, 2))
    y = d[task, 0] * np.sin(x[:, 0]) + d[task, 1] * np.cos(x[:, 1]) + task
    return d, x, task, y + 0.05 * rng.standard_normal(60)


@pytest.mark.parametrize("kind", KINDS)
def test_known_tasks_and_others(kind):
    d, x, task, y = data()
    X = np.column_stack([d[task, 0], x, d[task, 1], task])
    model = MultiTaskGPRegressor(
        **{"rank": 2, "max_iter": 3, **KINDS[kind]}, task_descriptors=[0, 3]
    ).fit(X, y)
    predictor = compile_predictor(model, std=True)
    assert predictor.n_features_in == 2
    state, other = np.array([1.0, 4.0]), np.array([1.3, 2.9])
    row = [[d[2, 0], *state, d[2, 1], 2]]
    mean, std = model.predict(row, return_std=True)
    np.testing.assert_allclose(predictor(state, task=2), mean, rtol=1e-9)
    np.testing.assert_allclose(predictor.std(state, task=2), std, rtol=1e-6)
    expected = model.predict([[other[0], *state, other[1], 99]])
    found = predictor(state, descriptors=other)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.DescriptorWarning")
def test_after_features():
    names = ["mass", "mc_x"]
    X, y = load_puma560(
        n_per_load=6, loads=[1, 2, 3, 4], descriptors=names, return_X_y=True
    )
    model = MultiTaskGPRegressor(rank=1, max_iter=2, task_levels=False)
    model = make_inverse_dynamics_regressor(model, task_descriptors=[18, 19])
    models = [clone(model).fit(X, y[:, j]) for j in (0, 1)]
    predictor = pickle.loads(pickle.dumps(compile_predictor(models)))
    row = X[:1].copy()
    found = predictor(row[0, :18], task=int(row[0, -1]))
    np.testing.assert_allclose(found, [m.predict(row)[0] for m in models])
    row[0, 18:] = 0.7, -0.05, 50
    found = predictor(row[0, :18], descriptors=row[0, 18:20])
    np.testing.assert_allclose(found, [m.predict(row)[0] for m in models])


def test_what_is_refused():
    d, x, task, y = data()
    X = np.column_stack([d[task], x, task])
    model = MultiTaskGPRegressor(rank=2, task_descriptors=[0, 1], **START)
    scaled = make_pipeline(FunctionTransformer(), clone(model)).fit(X, y)
    with pytest.raises(ValueError, match="with task_descriptors alone, or after"):
        compile_predictor(scaled)
    model.fit(X, y)
    with pytest.raises(ValueError, match=r"has shape \(1,\), not \(2,\): one number"):
        compile_predictor(model)([1.0, 2.0], descriptors=[1.0])
    plain = MultiTaskGPRegressor(**START).fit(X, y)
    for wrong in (compile_predictor(model, task=2), compile_predictor(plain)):
        with pytest.raises(ValueError, match="same task_descriptors, compiled with"):
            wrong(np.zeros(wrong.n_features_in), descriptors=[1.0, 2.0])
