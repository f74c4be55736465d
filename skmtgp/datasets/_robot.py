"""The links of the Puma 560: published figures, and torques on them by Pinocchio.

The figures are those published with the Robotics Toolbox (``mdl_puma560``;
Corke and Armstrong-Helouvry, ICRA 1994, pp. 1608-1613), in standard
Denavit-Hartenberg frames and SI units. Only :func:`link_torques` needs
Pinocchio, and imports it when it is called.
"""

import numpy as np

from ._drive import Drive, motor_torques

N_JOINTS = 6

DH_ALPHA = np.deg2rad([90.0, 0.0, -90.0, 90.0, -90.0, 0.0])
DH_A = np.array([0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0])
DH_D = np.array([0.0, 0.0, 0.15005, 0.4318, 0.0, 0.0])

MASS = np.array([0.0, 17.4, 4.8, 0.82, 0.34, 0.09])
CENTRE_OF_MASS = np.array(
    [
        [0.0, 0.0, 0.0],
        [-0.3638, 0.006, 0.2275],
        [-0.0203, -0.0141, 0.070],
        [0.0, 0.019, 0.0],
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.032],
    ]
)
# Diagonals of the inertia tensors about the centres of mass, kg m^2.
INERTIA = np.array(
    [
        [0.0, 0.35, 0.0],
        [0.13, 0.524, 0.539],
        [0.066, 0.086, 0.0125],
        [1.8e-3, 1.3e-3, 1.8e-3],
        [0.3e-3, 0.4e-3, 0.3e-3],
        [0.15e-3, 0.15e-3, 0.04e-3],
    ]
)

JOINT_LIMITS = np.deg2rad(
    [[-160, 160], [-45, 225], [-225, 45], [-110, 170], [-100, 100], [-266, 266]]
)


def link_torques(q, qd, qdd, load=None):
    """Torques on the links that move the robot, holding a load, as prescribed.

    Parameters
    ----------
    q, qd, qdd : ndarray of shape (n_samples, 6)
        Joint angles (rad), velocities (rad/s) and accelerations (rad/s^2).
    load : array-like of shape (10,), default=None
        Inertial parameters of the load about the origin of frame 6, in the
        order ``m, m c_x, m c_y, m c_z, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``. None
        is the empty hand.

    Returns
    -------
    torques : ndarray of shape (n_samples, 6)
        N m, without rotors and friction.

    Raises
    ------
    ImportError
        If Pinocchio is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._robot import link_torques
    >>> rest = np.zeros((1, 6))
    >>> link_torques(rest, rest, rest).shape
    (1, 6)
    """
    pin = import_pinocchio()
    model = _pinocchio_model(pin, load)
    data = model.createData()
    torques = np.empty_like(q)
    for i, state in enumerate(zip(q, qd, qdd, strict=True)):
        torques[i] = pin.rnea(model, data, *state)
    return torques


def import_pinocchio():
    """Pinocchio, or an error that says how to get it.

    Returns
    -------
    pinocchio : module
        The imported package.

    Raises
    ------
    ImportError
        If Pinocchio is not installed, naming the extra that brings it.
    """
    try:
        import pinocchio
    except ImportError as error:
        raise ImportError(
            "Making the Puma 560 data needs Pinocchio, which is not installed: "
            'pip install "skmtgp[puma]". load_puma560 works without it.'
        ) from error
    return pinocchio


def _pinocchio_model(pin, load):
    """Chain of six revolute joints whose body 6 is the last link with its load."""
    model = pin.Model()
    placement = pin.SE3.Identity()
    for j in range(N_JOINTS):
        joint = model.addJoint(j, pin.JointModelRZ(), placement, f"joint{j + 1}")
        # A joint turns about z of DH frame j - 1; its link's figures are in frame
        # j, a fixed step further.
        placement = _dh_step(pin, j)
        model.appendBodyToJoint(joint, _link_inertia(pin, j), placement)
    if load is not None:
        inertia = pin.Inertia.FromDynamicParameters(np.asarray(load, dtype=float))
        model.appendBodyToJoint(joint, inertia, placement)
    return model


def _dh_step(pin, j):
    """Placement of DH frame j in the joint's own, rotated frame."""
    cos, sin = np.cos(DH_ALPHA[j]), np.sin(DH_ALPHA[j])
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    return pin.SE3(rotation, np.array([DH_A[j], 0.0, DH_D[j]]))


def _link_inertia(pin, j):
    return pin.Inertia(MASS[j], CENTRE_OF_MASS[j], np.diag(INERTIA[j]))


def inverse_dynamics(q, qd, qdd, load=None, friction=True):
    """Torques of the motors, of rigid transmissions, behind their gears.

    Parameters
    ----------
    q, qd, qdd, load
        See :func:`link_torques`.
    friction : bool, default=True
        Whether the motors have friction.

    Returns
    -------
    torques : ndarray of shape (n_samples, 6)
        N m.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._robot import inverse_dynamics
    >>> rest = np.zeros((1, 6))
    >>> inverse_dynamics(rest, rest, rest).shape
    (1, 6)
    """
    link = link_torques(q, qd, qdd, load)
    return motor_torques(link, qd, qdd, Drive(friction=friction))
