"""Compiled predictions of robots are those of `predict`."""

import pickle
from copy import copy

import numpy as np
import pytest
from rigid import rnea, states, two_joints
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from skmtgp import (
    MultiTaskGPRegressor,
    compile_predictor,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import make_puma560
from skmtgp.robot import RigidBodyRegressor, SemiparametricRegressor

pin = pytest.importorskip("pinocchio")
PROCESS = MultiTaskGPRegressor(
    rank=1, shared=True, noise="shared", learning="staged", max_iter=20
)
QUICK = {"estimator": PROCESS}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def arm(kinds=("revolute", "prismatic"), n=60):
    """Two joints, friction that no law has, and two loads."""
    urdf, X = two_joints(*kinds), states(n, 2)
    X[:, -1] = np.arange(n) % 2
    shown = urdf.replace("continuous", "revolute")  # torques are the same
    Y = rnea(pin.buildModelFromXML(shown), X)
    Y += X[:, 2:4] + 0.8 * np.sin(3.0 * X[:, 2:4]) * (1.0 + X[:, [-1]])
    return urdf, X, Y + 0.05 * np.random.default_rng(0).normal(size=Y.shape)


def check(model, X, **options):
    """Of each row by its task, against `predict`."""
    predictor = compile_predictor(model, **options)
    mean = np.reshape(model.predict(X), (len(X), -1))
    for x, expected in zip(X, mean, strict=True):
        found = predictor(x[:-1], x[-1])
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)
    return predictor


@pytest.mark.parametrize(
    "friction", [None, "coulomb", ("offset", "viscous", "asymmetric", "rotor")]
)
@pytest.mark.parametrize("joint", [None, 1])
@pytest.mark.parametrize(
    "kinds", [("revolute", "prismatic"), ("continuous", "revolute")], ids=str
)
def test_rigid_bodies(kinds, joint, friction):
    urdf, X, Y = arm(kinds)
    Y = Y if joint is None else Y[:, joint]
    model = RigidBodyRegressor(urdf, friction=friction, joint=joint).fit(X, Y)
    check(model, X[:8])


@pytest.mark.parametrize("joint", [None, 0])
@pytest.mark.parametrize("rest", ["friction", "states", None])
def test_with_processes(rest, joint):
    urdf, X, Y = arm()
    Y = Y if joint is None else Y[:, joint]
    model = SemiparametricRegressor(urdf, rest=rest, joint=joint, **QUICK).fit(X, Y)
    chosen = np.array([found.name != "none" for found in model._rests])
    assert chosen.any() == (rest is not None)
    far = X[:8] * np.append(np.full(6, 3.0), 1.0)  # features stay at their edge
    check(model, np.vstack([X[:8], far]))


def test_a_pipeline_of_a_robot(puma):
    made = make_puma560(n_samples=8, n_loads=2, stribeck=0.5, noise=0.01)
    X, Y = made.data[::4], made.target[::4]
    options = {"kernel": "rigid-body", "robot": puma}
    quick = clone(PROCESS).set_params(max_iter=3)
    model = make_inverse_dynamics_regressor(quick, **options)
    predictor = check(model.fit(X, Y), X[:4])
    assert predictor.outputs == list(range(6))
    assert predictor.predict_tasks(X[0, :-1]).shape == (2, 6)


def test_deviations_outputs_and_pickles():
    urdf, X, Y = arm()
    model = SemiparametricRegressor(urdf, **QUICK).fit(X, Y)
    predictor = compile_predictor(model, task=1, outputs=[1], std=True)
    x = np.append(X[3, :-1], 1.0)[None]
    mean, std = model.predict(x, return_std=True)
    for of in (predictor, pickle.loads(pickle.dumps(predictor))):
        np.testing.assert_allclose(of(x[0, :-1]), mean[0, 1:], rtol=1e-8)
        np.testing.assert_allclose(of.std(x[0, :-1]), std[0, 1:], rtol=1e-8)


@pytest.mark.parametrize("kind", [RigidBodyRegressor, SemiparametricRegressor])
def test_a_load_that_joins(kind):
    urdf, X, Y = arm()
    model = kind(urdf).set_params(**QUICK if kind is SemiparametricRegressor else {})
    model = model.fit(X, Y)
    predictor, new = compile_predictor(model), X[:9].copy()
    new[:, -1] = 7
    other = model.add_task(new, 1.3 * Y[:9])
    with pytest.raises(ValueError, match="task=7 is not one of the tasks that"):
        predictor(X[0, :-1], 7)
    predictor.refresh(other)
    expected = other.predict(new[:1])[0]
    np.testing.assert_allclose(predictor(new[0, :-1], 7), expected, rtol=1e-8)
    with pytest.raises(ValueError, match="Unknown task 99"):
        compile_predictor(model, task=99)


def test_the_columns_and_the_task_where_they_are():
    urdf, X, Y = arm()
    model = RigidBodyRegressor(urdf, task_feature=0).fit(X[:, [6, *range(6)]], Y)
    expected = model.predict(X[:1, [6, *range(6)]])[0]
    found = compile_predictor(model)(X[0, :-1], X[0, -1])
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    with pytest.raises(NotFittedError):
        compile_predictor(copy(RigidBodyRegressor(urdf)))
