"""The URDF of the Puma has the figures of the data."""

import xml.etree.ElementTree as ET

import numpy as np
import puma560_reference as reference
import pytest
from rigid import rnea, states

from skmtgp.datasets import puma560_urdf
from skmtgp.datasets._drive import GEAR_RATIO, MOTOR_INERTIA
from skmtgp.datasets._robot import JOINT_LIMITS, MASS, inverse_dynamics


def test_links_joints_and_limits():
    robot = ET.fromstring(puma560_urdf())
    masses = [float(mass.get("value")) for mass in robot.iter("mass")]
    assert masses == MASS.tolist()
    limits = [
        [float(each.get(end)) for end in ("lower", "upper")]
        for each in robot.iter("limit")
    ]
    np.testing.assert_array_equal(limits, JOINT_LIMITS)
    children = [joint.find("child").get("link") for joint in robot.iter("joint")]
    assert children == [f"link{j}" for j in range(1, 7)]


def test_its_torques_are_those_of_the_data():
    pin = pytest.importorskip("pinocchio")
    model, X = pin.buildModelFromXML(puma560_urdf()), states(50)
    q, qd, qdd = np.split(X[:, :-1], 3, axis=1)
    found = rnea(model, X) + GEAR_RATIO**2 * MOTOR_INERTIA * qdd
    expected = inverse_dynamics(q, qd, qdd, friction=False)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    assert list(model.names)[1:] == [f"joint{j}" for j in range(1, 7)]


def test_its_frames_are_denavit_and_hartenbergs():
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(puma560_urdf())
    data, q = model.createData(), states(1)[0, :6]
    pin.forwardKinematics(model, data, q)
    # Joint i turns about z of frame i - 1, by its angle already.
    for j, frame in enumerate(reference.frames(q)[:6]):
        turn = pin.rpy.rpyToMatrix(0.0, 0.0, q[j])
        np.testing.assert_allclose(
            data.oMi[j + 1].rotation, frame[:3, :3] @ turn, atol=1e-14
        )
        np.testing.assert_allclose(
            data.oMi[j + 1].translation, frame[:3, 3], atol=1e-14
        )
