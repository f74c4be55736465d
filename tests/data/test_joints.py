import numpy as np
import pandas as pd
import pytest

from skmtgp import RankSearchIC, make_inverse_dynamics_regressor
from skmtgp._data.joints import check_order
from skmtgp.datasets import load_puma560, puma560_urdf
from skmtgp.exceptions import AngleUnitWarning
from skmtgp.preprocessing import InverseDynamicsFeatures
from skmtgp.robot import RigidBodyFeatures, RigidBodyRegressor

BLOCKS = ["q1", "q2", "qd1", "qd2", "qdd1", "qdd2"]


@pytest.mark.parametrize(
    "names",
    [
        BLOCKS,
        ["q2", "q1", "qd2", "qd1", "qdd2", "qdd1"],
        ["joint1_pos", "joint2_pos", "vel_1", "vel_2", "acc1", "acc2"],
        ["a", "q1", "b", "qd1", "c", "qdd1"],  # says too little
        ["q1", "qd1", "qdd1", "q1"],
        ["q", "qd", "qdd"],
        range(6),
    ],
)
def test_orders_that_are_taken(names):
    """Those that are right, and those that names do not tell."""
    check_order(list(names))


@pytest.mark.parametrize(
    ("names", "first"),
    [
        (["q1", "qd1", "qdd1", "q2", "qd2", "qdd2"], "q1', 'q2', 'qd1"),
        (["pos 1", "vel 1", "acc 1", "pos 2", "vel 2", "acc 2"], "pos 1', 'pos 2"),
        (["qd1", "qd2", "q1", "q2", "qdd1", "qdd2"], "q1', 'q2', 'qd1"),
        (["q1", "q2", "dq2", "dq1", "ddq1", "ddq2"], "q1', 'q2', 'dq1', 'dq2"),
        (BLOCKS[::-1], "q2', 'q1', 'qd2"),
    ],
)
def test_orders_that_are_refused(names, first):
    with pytest.raises(ValueError, match=rf"must have the positions .*X\[\['{first}"):
        check_order(names)


def test_frames_of_a_robot():
    """An interleaved frame was learned without a word."""
    puma = load_puma560(n_per_load=3, loads=[1, 2], as_frame=True)
    joints = [[f"q{j}", f"qd{j}", f"qdd{j}"] for j in range(1, 7)]
    interleaved = puma.data[[*np.ravel(joints), "load"]]
    with pytest.raises(ValueError, match="must have the positions of all joints first"):
        InverseDynamicsFeatures().fit(interleaved)
    model = make_inverse_dynamics_regressor(RankSearchIC(ranks=(1,)))
    with pytest.raises(ValueError, match="must have the positions of all joints first"):
        model.fit(interleaved, puma.target["tau2"])
    load_first = pd.concat(
        [puma.data[["load"]], puma.data.drop(columns="load")], axis=1
    )
    InverseDynamicsFeatures(task_feature="load").fit(load_first)


def states(spans, rates=1.0, n=50):
    """Positions of joints that span so much, velocities, accelerations and a task."""
    t = np.linspace(0.0, 2.0 * np.pi, n)
    q = 0.5 * np.sin(np.add.outer(t, np.arange(len(spans)))) * spans
    q *= spans / np.maximum(np.ptp(q, axis=0), 1e-12)
    x = np.column_stack([q, rates * np.cos(q), rates * np.sin(q)])
    return np.column_stack([x, np.arange(n) % 2])


DEGREES = [[30.0, 80.0], [300.0], [120.0, 3.0, 3.0, 3.0], [26.0, 26.0, 1.0, 1.0]]
RADIANS = [[6.0, 3.0], [25.0], [90.0, 5.0, 5.0], [0.0, 0.0, 0.0], [60.0, 3.0, 3.0, 3.0]]


@pytest.mark.parametrize("spans", DEGREES)
@pytest.mark.parametrize("angles", ["radians", "trigonometric"])
def test_angles_that_look_like_degrees(spans, angles):
    features = InverseDynamicsFeatures(angles=angles)
    wide = [j for j, span in enumerate(spans) if span > 8.0 * np.pi]
    turns = f"{max(spans) / (2.0 * np.pi):.1f} turns"
    match = (
        f"those of columns {', '.join(map(str, wide))} span up to .*{turns}.*deg2rad"
    )
    with pytest.warns(AngleUnitWarning, match=match):
        features.fit(states(spans))
    features.fit(np.deg2rad(states(spans)) * [*[1.0] * 3 * len(spans), 180.0 / np.pi])


@pytest.mark.parametrize("spans", RADIANS)
def test_angles_that_may_be_radians(spans):
    """A continuous joint that winds up for some turns is none in degrees."""
    InverseDynamicsFeatures().fit(states(spans))


def test_joints_that_slide_have_no_angles():
    slides = InverseDynamicsFeatures(joint_types="PPR")
    slides.fit(states([500.0, 500.0, 3.0]))  # millimetres
    with pytest.warns(AngleUnitWarning, match="columns 2 span"):
        slides.fit(states([0.5, 0.5, 90.0]))


def test_names_of_columns_in_degrees():
    X = pd.DataFrame(states([90.0, 3.0, 90.0])[:, :9], columns=list("abcdefghi"))
    with pytest.warns(AngleUnitWarning, match="columns 'a', 'c' span up to 90, which"):
        InverseDynamicsFeatures(task_feature="load").fit(X.assign(load="full"))


@pytest.mark.parametrize("kind", ["features", "regressor"])
def test_robots_in_degrees(kind):
    pytest.importorskip("pinocchio")
    X, y = load_puma560(n_per_load=30, loads=[1, 8], return_X_y=True)
    degrees = X.copy()
    degrees[:, :18] = np.rad2deg(X[:, :18])
    if kind == "features":
        model = RigidBodyFeatures(puma560_urdf(), joint=0)
    else:
        model = RigidBodyRegressor(puma560_urdf())
    model.fit(X, y)
    with pytest.warns(AngleUnitWarning, match="np.deg2rad"):
        model.fit(degrees, y)
