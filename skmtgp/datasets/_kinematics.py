"""Kinematics of the Puma 560: position, inverse, velocity and acceleration."""

from typing import NamedTuple

import numpy as np

from ._robot import DH_A, DH_ALPHA, DH_D, JOINT_LIMITS, N_JOINTS

FOREARM = np.hypot(DH_A[2], DH_D[3])


class ToolMotion(NamedTuple):
    """Motion of frame 6 in the base frame, sampled along a path.

    Attributes
    ----------
    position : ndarray of shape (n_samples, 3)
        Origin of frame 6, the wrist centre, m.
    rotation : ndarray of shape (n_samples, 3, 3)
        Axes of frame 6 as columns.
    twist : ndarray of shape (n_samples, 6)
        Linear (m/s) and angular (rad/s) velocity.
    acceleration : ndarray of shape (n_samples, 6)
        Linear (m/s^2) and angular (rad/s^2) acceleration.
    """

    position: np.ndarray
    rotation: np.ndarray
    twist: np.ndarray
    acceleration: np.ndarray


def forward_kinematics(q):
    """Origins and axes of the frames 0..6.

    Parameters
    ----------
    q : ndarray of shape (n_samples, 6)
        Joint angles, rad.

    Returns
    -------
    origins : ndarray of shape (n_samples, 7, 3)
        Origins of the Denavit-Hartenberg frames in the base frame, m.
    rotations : ndarray of shape (n_samples, 7, 3, 3)
        Their axes as columns.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._kinematics import forward_kinematics
    >>> origins, _ = forward_kinematics(np.zeros((1, 6)))
    >>> origins[0, 6].round(4).tolist()
    [0.4521, -0.15, 0.4318]
    """
    origins = np.zeros((len(q), N_JOINTS + 1, 3))
    rotations = np.zeros((len(q), N_JOINTS + 1, 3, 3))
    rotations[:, 0] = np.eye(3)
    for j in range(N_JOINTS):
        rotation, offset = _link_transform(j, q[:, j])
        step = (rotations[:, j] @ offset[..., None])[..., 0]
        origins[:, j + 1] = origins[:, j] + step
        rotations[:, j + 1] = rotations[:, j] @ rotation
    return origins, rotations


def _link_transform(j, angle):
    """Rotation and origin of frame j + 1 in frame j."""
    cos, sin = np.cos(angle), np.sin(angle)
    cos_alpha, sin_alpha = np.cos(DH_ALPHA[j]), np.sin(DH_ALPHA[j])
    zero = np.zeros_like(cos)
    rows = [
        [cos, -sin * cos_alpha, sin * sin_alpha],
        [sin, cos * cos_alpha, -cos * sin_alpha],
        [zero, zero + sin_alpha, zero + cos_alpha],
    ]
    rotation = np.moveaxis(np.array(rows), -1, 0)
    offset = np.stack([DH_A[j] * cos, DH_A[j] * sin, zero + DH_D[j]], axis=-1)
    return rotation, offset


def inverse_kinematics(position, rotation):
    """Joint angles of a closed path: righty, elbow up, wrist not flipped.

    Parameters
    ----------
    position : ndarray of shape (n_samples, 3)
        Wrist centre along the path, m.
    rotation : ndarray of shape (n_samples, 3, 3)
        Axes of frame 6 along the path, as columns.

    Returns
    -------
    q : ndarray of shape (n_samples, 6)
        Joint angles, rad. The first sample of each lies in the turn that holds
        the joint's range (joint 3: [-225, 135) deg); the others follow it
        without jumps.

    Raises
    ------
    ValueError
        If a sample is out of reach or outside the joint limits.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets import _kinematics as kinematics
    >>> pose = np.deg2rad([[10.0, 60.0, -150.0, 20.0, -30.0, 40.0]])
    >>> origins, rotations = kinematics.forward_kinematics(pose)
    >>> q = kinematics.inverse_kinematics(origins[:, 6], rotations[:, 6])
    >>> np.rad2deg(q).round(6).tolist()
    [[10.0, 60.0, -150.0, 20.0, -30.0, 40.0]]
    """
    arm = _arm_angles(position)
    _, rotations = forward_kinematics(np.column_stack([arm, np.zeros_like(arm)]))
    wrist = _wrist_angles(rotations[:, 3].transpose(0, 2, 1) @ rotation)
    q = _track(np.column_stack([arm, wrist]))
    _check_limits(q)
    return q


def _arm_angles(position):
    x, y, z = position.T
    lateral = DH_D[2]
    out = np.sqrt(np.maximum(x**2 + y**2 - lateral**2, 0.0))
    theta1 = np.arctan2(y, x) + np.arctan2(lateral, out)
    # Triangle of upper arm, forearm and the line from shoulder to wrist.
    distance = np.hypot(out, z)
    _check_reach(np.where(x**2 + y**2 < lateral**2, 0.0, distance))
    upper = DH_A[1]
    bend = (distance**2 - upper**2 - FOREARM**2) / (2 * upper * FOREARM)
    elbow = -np.arccos(bend)
    theta2 = np.arctan2(z, out) - np.arctan2(
        FOREARM * np.sin(elbow), upper + FOREARM * np.cos(elbow)
    )
    return np.stack([theta1, theta2, elbow - np.arctan2(DH_D[3], DH_A[2])], axis=-1)


def _wrist_angles(rotation):
    """Angles of Rz(q4) Ry(-q5) Rz(q6), the rotation from frame 3 to 6."""
    x, y, z = rotation[:, :, 2].T
    theta4 = np.arctan2(y, x)
    theta5 = -np.arctan2(np.hypot(x, y), z)
    theta6 = np.arctan2(rotation[:, 2, 1], -rotation[:, 2, 0])
    return np.stack([theta4, theta5, theta6], axis=-1)


def _check_reach(distance):
    shortest, longest = np.abs(DH_A[1] - FOREARM), DH_A[1] + FOREARM
    worst = distance[np.argmax(np.abs(distance - (shortest + longest) / 2))]
    if not shortest < worst < longest:
        raise ValueError(
            f"the wrist centre is out of reach: {worst:.4f} m from the shoulder, "
            f"beside its offset, where {shortest:.4f} to {longest:.4f} m are possible"
        )


def _track(q):
    """Put the first sample into its turn and follow it without jumps."""
    middle = JOINT_LIMITS.mean(axis=1)
    lowest = np.where(np.arange(N_JOINTS) == 2, JOINT_LIMITS[:, 0], middle - np.pi)
    first = lowest + np.mod(q[0] - lowest, 2 * np.pi)
    return np.unwrap(q, axis=0) + (first - q[0])


def _check_limits(q):
    outside = (q < JOINT_LIMITS[:, 0]) | (q > JOINT_LIMITS[:, 1])
    if outside.any():
        joint = int(np.flatnonzero(outside.any(axis=0))[0])
        low, high = np.rad2deg(JOINT_LIMITS[joint])
        angles = np.rad2deg(q[:, joint])
        raise ValueError(
            f"joint {joint + 1} would move between {angles.min():.1f} and "
            f"{angles.max():.1f} deg, outside its limits {low:.0f} and {high:.0f} deg"
        )


def joint_rates(q, motion):
    """Joint velocities and accelerations of a motion of the tool.

    Parameters
    ----------
    q : ndarray of shape (n_samples, 6)
        Joint angles along the motion, rad.
    motion : ToolMotion
        The motion, of the same samples.

    Returns
    -------
    qd : ndarray of shape (n_samples, 6)
        ``J^-1 v``, rad/s.
    qdd : ndarray of shape (n_samples, 6)
        ``J^-1 (a - Jdot qd)``, rad/s^2.
    """
    origins, rotations = forward_kinematics(q)
    jacobian = _jacobian(origins, rotations)
    qd = np.linalg.solve(jacobian, motion.twist[..., None])[..., 0]
    bias = _acceleration_bias(origins, rotations, qd)
    qdd = np.linalg.solve(jacobian, (motion.acceleration - bias)[..., None])[..., 0]
    return qd, qdd


def _jacobian(origins, rotations):
    """Geometric Jacobian of frame 6, shape (n_samples, 6, 6)."""
    axes = rotations[:, :-1, :, 2]
    linear = np.cross(axes, origins[:, -1:] - origins[:, :-1])
    return np.concatenate([linear, axes], axis=-1).transpose(0, 2, 1)


def _acceleration_bias(origins, rotations, qd):
    """Jdot qd: the acceleration of frame 6 at constant joint velocities."""
    omega, alpha, linear = np.zeros((3, len(qd), 3))
    for j in range(N_JOINTS):
        spin = rotations[:, j, :, 2] * qd[:, j, None]
        alpha = alpha + np.cross(omega, spin)
        omega = omega + spin
        arm = origins[:, j + 1] - origins[:, j]
        linear = linear + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    return np.concatenate([linear, alpha], axis=-1)
