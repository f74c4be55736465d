"""Models of robots are saved by skops, which takes neither tables nor Pinocchio's."""

import numpy as np
import pytest
from rigid import two_joints

from skmtgp.robot import (
    RigidBodyFeatures,
    RigidBodyRegressor,
    SemiparametricRegressor,
    make_semiparametric_regressor,
)
from skmtgp.robot._dynamics import Dynamics


def reloaded(model):
    """The model from what skops saves; it trusts the package's own types alone."""
    io = pytest.importorskip("skops.io")
    data = io.dumps(model)
    types = io.get_untrusted_types(data=data)
    assert all(name.startswith(("skmtgp.", "sklearn.")) for name in types)
    return io.loads(data, trusted=types)


@pytest.mark.parametrize("empty_task", [None, 1])
def test_rigid_bodies(puma, moved, empty_task):
    X, Y, _ = moved
    model = RigidBodyRegressor(puma, empty_task=empty_task).fit(X[::2], Y[::2])
    again = reloaded(model)
    np.testing.assert_array_equal(again.predict(X), model.predict(X))
    for name in ("parameters_", "load_parameters_"):
        assert getattr(again, name).equals(getattr(model, name))
    assert reloaded(RigidBodyRegressor(puma)).model == puma


MODELS = SemiparametricRegressor, make_semiparametric_regressor


@pytest.mark.parametrize("make", MODELS)
def test_rigid_bodies_and_what_they_leave(puma, moved, make):
    X, Y, _ = moved
    model = make(puma, joint=2).fit(X[::2], Y[::2, 2])
    np.testing.assert_array_equal(reloaded(model).predict(X), model.predict(X))


def test_features(puma, moved):
    X, *_ = moved
    features = RigidBodyFeatures(puma, joint=2).fit(X)
    expected = features.transform(X)
    np.testing.assert_array_equal(reloaded(features).transform(X), expected)


def test_a_model_of_pinocchio_keeps_all_digits():
    dynamics = Dynamics(two_joints())
    again = reloaded(dynamics)
    assert again._model == dynamics._model
    x = dynamics.random_states(5)
    rows = [of.regressor(x, [0, 1], range(20)) for of in (dynamics, again)]
    np.testing.assert_array_equal(*rows)


def test_tables_are_made_anew(puma, moved):
    X, Y, _ = moved
    model = RigidBodyRegressor(puma).fit(X[::2], Y[::2])
    table = model.parameters_
    table.iloc[0] = 0.0
    assert model.parameters_.iloc[0].all()
