"""Figure-of-eight paths of the tool, and the joint motion along them."""

import numpy as np

from ._drive import STANDSTILL
from ._kinematics import ToolMotion, inverse_kinematics, joint_rates

# x of the centre (m), z of the centre (m), rotation about z (deg): section 6.
PATHS = ((0.35, 0.36, -10.0), (0.45, 0.40, 0.0), (0.55, 0.44, 10.0), (0.65, 0.48, 20.0))
SPEEDS = (20.0, 15.0, 10.0, 5.0)
EIGHT = (0.05, 0.10)
TOOL_PITCH = 45.0
TOOL_SWING = (20.0, 20.0, 20.0)
N_SAMPLES = 4000

# The moving tool's swings about its own x, y and z: harmonic of the phase, lead.
_HARMONICS = (1, 2, 3)
_LEADS = (0.0, 0.5, 1.0)


def trajectory_labels(n_paths, n_speeds):
    """Labels of all pairs of path and speed, the speed changing faster.

    Parameters
    ----------
    n_paths, n_speeds : int
        How many there are of each.

    Returns
    -------
    labels : ndarray of shape (n_paths * n_speeds,)
        Such as ``"p2s3"``.

    Examples
    --------
    >>> from skmtgp.datasets._trajectories import trajectory_labels
    >>> trajectory_labels(1, 2).tolist()
    ['p1s1', 'p1s2']
    """
    return np.array(
        [f"p{p + 1}s{s + 1}" for p in range(n_paths) for s in range(n_speeds)]
    )


def joint_trajectories(paths, speeds, n_samples, eight, tool_pitch, tool_swing):
    """Joint angles, velocities and accelerations on all paths at all speeds.

    Parameters
    ----------
    paths : array-like of shape (n_paths, 3)
        Centre's x and z (m) and rotation about the vertical (deg) of each path.
    speeds : array-like of shape (n_speeds,)
        Seconds that a path takes.
    n_samples : int
        Samples along a path, at regular intervals, the end point excluded.
    eight : tuple of (float, float)
        Amplitudes in x and y of the unrotated eight, m.
    tool_pitch : float
        Angle of the tool's z axis below the horizontal +x axis, deg.
    tool_swing : tuple of (float, float, float)
        Amplitudes of the tool's swings about its own axes, deg.

    Returns
    -------
    x : ndarray of shape (n_paths * n_speeds, n_samples, 18)
        q (rad), qd (rad/s) and qdd (rad/s^2) of each trajectory.

    Raises
    ------
    ValueError
        If a path is out of reach or leaves the joint limits; names the path.
    """
    phase = 2 * np.pi * np.arange(n_samples) / n_samples
    trajectories = []
    for p, path in enumerate(paths):
        motion = _tool_motion(path, phase, eight, tool_pitch, tool_swing)
        try:
            q = inverse_kinematics(motion.position, motion.rotation)
        except ValueError as error:
            raise ValueError(
                f"paths: path p{p + 1} at x = {path[0]:g} m, z = {path[1]:g} m, "
                f"rotated by {path[2]:g} deg cannot be followed: {error}; move it or "
                "change eight, tool_pitch or tool_swing."
            ) from error
        slope, curvature = joint_rates(q, motion)
        trajectories += [_at_speed(q, slope, curvature, speed) for speed in speeds]
    return np.stack(trajectories)


def _at_speed(q, slope, curvature, duration):
    """Chain rule from the phase u = 2 pi t / T to the time."""
    rate = 2 * np.pi / duration
    qd = rate * slope
    qd[np.abs(qd) < STANDSTILL] = 0.0
    return np.concatenate([q, qd, rate**2 * curvature], axis=1)


def _tool_motion(path, phase, eight, tool_pitch, tool_swing):
    """Motion of the tool with respect to the phase u."""
    position, velocity, acceleration = _figure_of_eight(path, phase, eight)
    rotation, spin, spin_rate = _tool_rotation(phase, tool_pitch, tool_swing)
    return ToolMotion(
        position,
        rotation,
        np.concatenate([velocity, spin], axis=1),
        np.concatenate([acceleration, spin_rate], axis=1),
    )


def _figure_of_eight(path, phase, eight):
    """Position of ``(a sin 2u, b sin u)``, turned and moved, and two derivatives."""
    x, z, angle = path
    zero = np.zeros_like(phase)
    sin, cos = np.sin(phase), np.cos(phase)
    sin2, cos2 = np.sin(2 * phase), np.cos(2 * phase)
    scale = np.array([eight[0], eight[1], 0.0])
    turn = _axis_rotations(2, np.deg2rad([angle]))[0]
    curves = ([sin2, sin, zero], [2 * cos2, cos, zero], [-4 * sin2, -sin, zero])
    position, velocity, acceleration = (
        (scale * np.stack(curve, axis=1)) @ turn.T for curve in curves
    )
    return position + np.array([x, 0.0, z]), velocity, acceleration


def _tool_rotation(phase, tool_pitch, tool_swing):
    """Axes of the tool, its angular velocity and its angular acceleration."""
    start = _axis_rotations(1, np.deg2rad([90.0 + tool_pitch]))
    rotation = np.broadcast_to(start, (len(phase), 3, 3))
    omega, alpha = np.zeros((2, len(phase), 3))
    for axis, swing in enumerate(np.deg2rad(tool_swing)):
        harmonic = _HARMONICS[axis]
        argument = harmonic * phase + _LEADS[axis]
        direction = rotation[:, :, axis]
        spin = direction * (swing * harmonic * np.cos(argument))[:, None]
        turn = direction * (-swing * harmonic**2 * np.sin(argument))[:, None]
        alpha = alpha + turn + np.cross(omega, spin)
        omega = omega + spin
        rotation = rotation @ _axis_rotations(axis, swing * np.sin(argument))
    return rotation, omega, alpha


def _axis_rotations(axis, angles):
    """Rotations by angles (rad) about a coordinate axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotations = np.zeros((len(angles), 3, 3))
    rotations[:, axis, axis] = 1.0
    rotations[:, first, first] = rotations[:, second, second] = np.cos(angles)
    rotations[:, second, first] = np.sin(angles)
    rotations[:, first, second] = -np.sin(angles)
    return rotations
