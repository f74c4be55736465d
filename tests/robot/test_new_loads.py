"""A load that joins a robot's model by a few rows; states that look like degrees."""

import numpy as np
import pandas as pd
import pytest

from skmtgp.exceptions import AngleUnitWarning
from skmtgp.robot import RigidBodyRegressor

pytest.importorskip("pinocchio")


@pytest.fixture(scope="module")
def fitted(puma, moved):
    """With half of the rows."""
    X, Y, _ = moved
    return RigidBodyRegressor(puma, empty_task=1).fit(X[::2], Y[::2])


def noisy(Y, sizes):
    return Y + sizes * np.random.default_rng(0).normal(size=Y.shape)


def test_few_rows_of_a_new_load_are_told_by_the_known_loads(puma, moved):
    """A textbook's posterior: a normal prior of the known loads, and the rows."""
    X, Y, _ = moved
    Y, old = noisy(Y, 0.1), X[:, -1] < 4
    model = RigidBodyRegressor(puma, empty_task=1).fit(X[old], Y[old])
    new, y = X[~old][:4], Y[~old][:4]
    found = model.add_task(new, y)
    empty = np.column_stack([new[:, :-1], np.ones(4)])
    columns, scale = model._columns.of(new[:, :-1])[1], model._scale[1]
    weights = 1.0 / np.sqrt(model.noise_variance_)
    A = (columns / scale * weights[:, None]).reshape(24, 10)
    left = ((y - model.predict(empty)) * weights).ravel()
    known = model.load_parameters_.to_numpy() * scale
    prior = np.cov(known.T, bias=True) + np.square(known).mean() * np.eye(10)
    precision = np.linalg.inv(prior)
    covariance = np.linalg.inv(A.T @ A + precision)
    coef = covariance @ (A.T @ left + precision @ known.mean(axis=0))
    np.testing.assert_allclose(found.load_parameters_.loc[4], coef / scale, rtol=1e-6)
    expected = covariance / np.outer(scale, scale)
    np.testing.assert_allclose(found.load_covariance_[3], expected, rtol=1e-6)


def test_rows_that_are_nearly_the_same_make_no_huge_torques(puma, moved):
    X, Y, _ = moved
    Y, old = noisy(Y, 0.1), X[:, -1] < 4
    model = RigidBodyRegressor(puma, empty_task=1).fit(X[old], Y[old])
    step = 1e-3 * np.arange(10)[:, None]
    first, second = np.flatnonzero(~old)[:2]
    new = np.column_stack([X[first, :-1] + step * X[second, :-1], np.full(10, 4)])
    true = RigidBodyRegressor(puma, empty_task=1).fit(X, Y)
    y = noisy(true.predict(new), 0.1)
    largest = [
        np.abs(model.add_task(new, y, prior=prior).predict(X[~old])).max()
        for prior in ("tasks", None)
    ]
    assert largest[0] < 1.5 * np.abs(Y).max()
    assert largest[1] > 10.0 * np.abs(Y).max()


def test_a_prior_of_a_new_load_that_is_none(fitted, moved):
    with pytest.raises(ValueError, match="prior='loads' must be 'tasks' or None"):
        fitted.add_task(moved[0][:2], moved[1][:2], prior="loads")


def test_degrees_of_new_states(puma, moved):
    """They were radians in training."""
    X, Y, _ = moved
    model = RigidBodyRegressor(puma).fit(X, Y)
    model.predict(X)
    degrees = X.copy()
    degrees[:, :-1] = np.rad2deg(X[:, :-1])
    with pytest.warns(AngleUnitWarning, match="span with those in training up to"):
        model.predict(degrees)
    with pytest.warns(AngleUnitWarning):
        model.predict(degrees[:1])


def test_torques_in_another_order_than_the_joints(puma, moved):
    X, Y, _ = moved
    kinds = [f"{kind}{j}" for kind in ("q", "qd", "qdd") for j in range(1, 7)]
    frame = pd.DataFrame(X[::2], columns=[*kinds, "load"]).astype({"load": int})
    torques = pd.DataFrame(Y[::2], columns=[f"tau{j}" for j in range(1, 7)])
    model = RigidBodyRegressor(puma, task_feature="load")
    with pytest.raises(ValueError, match=r"y has the columns \['tau6'.*y\[\['tau1'"):
        model.fit(frame, torques.iloc[:, ::-1])
    expected = model.fit(frame, torques).predict(frame)
    others = torques.set_axis(list("abcdef"), axis=1)  # these say nothing
    np.testing.assert_array_equal(model.fit(frame, others).predict(frame), expected)


def test_more_rows_of_a_known_load(fitted, moved):
    X, Y, _ = moved
    with pytest.raises(ValueError, match="known one fit the model to all samples"):
        fitted.add_task(X[:1], Y[:1])
    with pytest.raises(ValueError, match="Unknown task 77") as error:
        fitted.predict([[*X[0, :-1], 77]])
    assert "shared" not in str(error.value)
