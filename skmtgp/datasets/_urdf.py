"""The Puma 560 as a URDF, the robot description that most programs read."""

from xml.etree import ElementTree as ET

import numpy as np

from ._robot import (
    CENTRE_OF_MASS,
    DH_A,
    DH_ALPHA,
    DH_D,
    INERTIA,
    JOINT_LIMITS,
    MASS,
    N_JOINTS,
)

UNLIMITED = 1e6  # a URDF must have limits of torque and speed; the figures have none


def puma560_urdf() -> str:
    """Return a URDF of the Puma 560 of the data sets.

    Returns
    -------
    urdf : str
        Text of the file: the links, their masses and inertias, the joints and the
        limits of their angles.

    See Also
    --------
    make_puma560 : The data.
    skmtgp.robot.RigidBodyRegressor : A model that reads it.

    Notes
    -----
    The figures are those published with the Robotics Toolbox [1]_, in standard
    Denavit-Hartenberg frames: joint i turns about the z axis of frame i - 1, which is
    the frame of ``"link{i-1}"``'s end and of ``"joint{i}"``. A URDF has neither the
    inertia of the motors nor Coulomb friction that differs between directions, as in
    the data. So it gives the torques of the links alone. A URDF must have limits of
    torque and speed; here they are 1e6, which means no limit.

    References
    ----------
    .. [1] P. I. Corke, B. Armstrong-Helouvry, "A search for consensus among model
       parameters reported for the PUMA 560 robot", ICRA 1994, 1608-1613.

    Examples
    --------
    >>> from skmtgp.datasets import puma560_urdf
    >>> puma560_urdf().splitlines()[0]
    '<robot name="puma560">'
    """
    robot = ET.Element("robot", name="puma560")
    ET.SubElement(robot, "link", name="base")
    for j in range(N_JOINTS):
        _add_link(robot, j)
        _add_joint(robot, j)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot, j):
    """The body that joint j moves, in the frame of that joint."""
    centre, inertia = _in_joint_frame(j)
    link = ET.SubElement(robot, "link", name=f"link{j + 1}")
    body = ET.SubElement(link, "inertial")
    ET.SubElement(body, "origin", xyz=_words(*centre), rpy=_words(DH_ALPHA[j], 0, 0))
    ET.SubElement(body, "mass", value=_words(MASS[j]))
    xx, yy, zz = map(_words, inertia)
    off = {"ixy": "0", "ixz": "0", "iyz": "0"}
    ET.SubElement(body, "inertia", ixx=xx, iyy=yy, izz=zz, **off)


def _in_joint_frame(j):
    """Centre of mass in the frame of joint j; inertia in axes turned by alpha."""
    cos, sin = np.cos(DH_ALPHA[j]), np.sin(DH_ALPHA[j])
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    return turn @ CENTRE_OF_MASS[j] + [DH_A[j], 0.0, DH_D[j]], INERTIA[j]


def _add_joint(robot, j):
    """Joint j, a Denavit-Hartenberg step from the joint before it."""
    joint = ET.SubElement(robot, "joint", name=f"joint{j + 1}", type="revolute")
    ET.SubElement(joint, "parent", link=f"link{j}" if j else "base")
    ET.SubElement(joint, "child", link=f"link{j + 1}")
    step = (DH_A[j - 1], 0.0, DH_D[j - 1]) if j else (0.0, 0.0, 0.0)
    turn = DH_ALPHA[j - 1] if j else 0.0
    ET.SubElement(joint, "origin", xyz=_words(*step), rpy=_words(turn, 0, 0))
    ET.SubElement(joint, "axis", xyz="0 0 1")
    lower, upper = map(_words, JOINT_LIMITS[j])
    none = _words(UNLIMITED)
    ET.SubElement(joint, "limit", lower=lower, upper=upper, effort=none, velocity=none)


def _words(*values):
    """Numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
