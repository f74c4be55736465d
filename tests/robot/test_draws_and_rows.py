"""Draws, rows and progress of a robot's models."""

import logging

import numpy as np
import pytest

from skmtgp.datasets import make_puma560
from skmtgp.exceptions import LongFitWarning
from skmtgp.robot import RigidBodyRegressor, SemiparametricRegressor

pytest.importorskip("pinocchio")
pytestmark = pytest.mark.filterwarnings(
    "ignore::skmtgp.exceptions.CorrelatedResidualsWarning"
)
FRICTION = {"rest": "friction"}


@pytest.fixture(scope="module")
def sticky():
    made = make_puma560(n_samples=20, n_loads=3, stribeck=0.5)
    return made.data, made.target[:, 1:3]


def of_two_joints(puma, sticky, **options):
    """A model of one of two joints for each column of y."""
    X, Y = sticky
    rows = np.random.default_rng(0).permutation(len(X))[:90]
    models = [
        SemiparametricRegressor(puma, joint=j, **options).fit(X[rows], Y[rows, k])
        for k, j in enumerate((1, 2))
    ]
    return models, X[::40][:4]


def test_draws_are_those_of_the_posterior(puma, sticky):
    models, X = of_two_joints(puma, sticky, **FRICTION)
    for model in models:
        mean, cov = model.predict(X, return_cov=True)
        draws = model.sample_y(X, 20_000, random_state=0)
        std = np.sqrt(np.diagonal(cov))
        np.testing.assert_allclose(draws.mean(axis=1), mean, atol=0.04 * std.max())
        np.testing.assert_allclose(np.cov(draws), cov, atol=0.05 * cov.max())


def test_draws_of_all_joints_have_links_in_common():
    """Two joints of an arm in a plane: both carry the second link."""
    from test_semiparametric import arm

    urdf, X, Y = arm()
    model = SemiparametricRegressor(urdf, rest=None).fit(X[:12], Y[:12])
    draws = model.sample_y(X[20:21], 4000, random_state=0)[0]
    design = model._whole(X[20:21, :-1], X[20:21, -1].astype(int)) @ model._factor
    cov = design[0] @ design[0].T
    np.testing.assert_allclose(np.cov(draws), cov, atol=0.1 * cov.max())
    assert abs(np.corrcoef(draws)[0, 1]) > 0.1


def test_draws_where_rows_leave_links_unseen(puma, sticky):
    """The covariance is infinite there; it made LAPACK loop."""
    X, y = sticky[0], sticky[1][:, 1]
    few = np.arange(0, len(X), 4)[:12]
    model = SemiparametricRegressor(puma, joint=2, rest=None, prior=None)
    model.fit(X[few], y[few])
    assert np.isinf(model.predict(X[50:53], return_std=True)[1]).any()
    assert np.isfinite(model.sample_y(X[50:53], 3)).all()


@pytest.mark.parametrize("cls", [RigidBodyRegressor, SemiparametricRegressor])
def test_targets_are_its_own(puma, sticky, cls):
    """The user may change y after fit."""
    (X, Y), old = sticky, sticky[0][:, -1] < 3
    options = FRICTION if cls is SemiparametricRegressor else {}
    rows = np.flatnonzero(old)[::4]
    y, new = np.ascontiguousarray(Y[rows, 1]), np.flatnonzero(~old)[:10]
    model = cls(puma, joint=2, **options).fit(X[rows], y)
    expected = model.add_task(X[new], Y[new, 1]).predict(X[new])
    y *= 0.0
    found = model.add_task(X[new], Y[new, 1]).predict(X[new])
    np.testing.assert_array_equal(found, expected)
    assert model.y_train_.any()


def test_lines_for_each_joint_and_round(puma, sticky, caplog):
    X, Y = make_puma560(n_samples=8, n_loads=2, stribeck=0.5, return_X_y=True)
    models = [
        SemiparametricRegressor(puma, **FRICTION, n_jobs=n_jobs, verbose=verbose)
        for n_jobs, verbose in ((None, 1), (2, 0))
    ]
    with caplog.at_level(logging.DEBUG, "skmtgp"):
        one, two = (model.fit(X[::4], Y[::4]) for model in models)
    lines = caplog.messages
    assert len(lines) == 12
    assert lines[0].startswith("joint1 (1 of 6), round 1 of 2: rest ")
    assert lines[-1].startswith("joint6 (6 of 6), round 2 of 2: rest ")
    assert all("log likelihood" in line for line in lines)
    np.testing.assert_array_equal(one.predict(X), two.predict(X))


def test_what_takes_long_is_foretold(puma, sticky, monkeypatch):
    """Before it begins, of all searches; what one of them says is over by then."""
    X, Y = sticky[0][::8], sticky[1][::8, 1]
    model = SemiparametricRegressor(puma, joint=2)
    monkeypatch.setattr("skmtgp._estimators.doubts.LONG", 1e-9)
    monkeypatch.setattr("skmtgp.robot._semiparametric.choose", stopped)
    match = "what rigid bodies leave will take .* rest='friction', a larger n_jobs"
    with pytest.warns(LongFitWarning, match=match), pytest.raises(Stopped):
        model.fit(X, Y)
    with pytest.raises(Stopped):  # rigid bodies alone take no time
        model.set_params(rest=None).fit(X, Y)


class Stopped(Exception):
    """Learning has begun."""


def stopped(*args, **kwargs):
    raise Stopped
