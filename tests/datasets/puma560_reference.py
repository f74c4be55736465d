"""The Puma 560 written a second time, for the tests: body by body in the base frame.

Nothing here is shared with the package: the figures are typed again, the load is a
body of its own instead of a part of link 6, and every force and moment is taken in
the base frame (Newton and Euler, not link frames, not Pinocchio).
"""

import numpy as np

# alpha (deg), a, d, m, com x, y, z, Ixx, Iyy, Izz, Jm, G, B, Tc+, Tc-
# fmt: off
TABLE = np.array([
    [90, 0, 0, 0, 0, 0, 0, 0, 0.35, 0,
     200e-6, -62.6111, 1.48e-3, 0.395, -0.435],
    [0, 0.4318, 0, 17.4, -0.3638, 0.006, 0.2275, 0.13, 0.524, 0.539,
     200e-6, 107.815, 0.817e-3, 0.126, -0.071],
    [-90, 0.0203, 0.15005, 4.8, -0.0203, -0.0141, 0.070, 0.066, 0.086, 0.0125,
     200e-6, -53.7063, 1.38e-3, 0.132, -0.105],
    [90, 0, 0.4318, 0.82, 0, 0.019, 0, 1.8e-3, 1.3e-3, 1.8e-3,
     33e-6, 76.0364, 71.2e-6, 11.2e-3, -16.9e-3],
    [-90, 0, 0, 0.34, 0, 0, 0, 0.3e-3, 0.4e-3, 0.3e-3,
     33e-6, 71.923, 82.6e-6, 9.26e-3, -14.5e-3],
    [0, 0, 0, 0.09, 0, 0, 0.032, 0.15e-3, 0.15e-3, 0.04e-3,
     33e-6, 76.686, 36.7e-6, 3.96e-3, -10.5e-3],
])
# fmt: on
LIMITS = [(-160, 160), (-45, 225), (-225, 45), (-110, 170), (-100, 100), (-266, 266)]


def frames(q):
    """4 x 4 transforms of the frames 0..6 for one set of joint angles."""
    transforms = [np.eye(4)]
    for angle, (alpha, a, d) in zip(q, TABLE[:, :3], strict=True):
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array(
            [[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]]
        )
        cos, sin = np.cos(np.deg2rad(alpha)), np.sin(np.deg2rad(alpha))
        twist = np.array(
            [[1, 0, 0, a], [0, cos, -sin, 0], [0, sin, cos, 0], [0, 0, 0, 1]]
        )
        transforms.append(transforms[-1] @ turn @ twist)
    return transforms


def quaternion_matrix(x, y, z, w):
    """Rotation matrix of a unit quaternion."""
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def cuboid(load):
    """Mass, centre and inertia about the centre, in frame 6, of a row of loads."""
    turn = quaternion_matrix(*load[["quat_x", "quat_y", "quat_z", "quat_w"]])
    a, b, c = load[["side_x", "side_y", "side_z"]]
    tensor = np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) / 12
    centre = load[["centre_x", "centre_y", "centre_z"]].to_numpy(dtype=float)
    return load["mass"], centre, load["mass"] * turn @ tensor @ turn.T


def torques(q, qd, qdd, load=None, friction=True):
    """Joint torques of one state; load is None or (mass, centre, inertia)."""
    transforms = frames(q)
    axes = [t[:3, 2] for t in transforms[:-1]]
    origins = [t[:3, 3] for t in transforms]
    omega, alpha, linear = np.zeros(3), np.zeros(3), np.array([0, 0, 9.81])
    moments = np.zeros(6)
    for j in range(6):
        spin = axes[j] * qd[j]
        alpha = alpha + axes[j] * qdd[j] + np.cross(omega, spin)
        omega = omega + spin

        def acceleration(point, base=origins[j], a=linear, o=omega, al=alpha):
            arm = point - base
            return a + np.cross(al, arm) + np.cross(o, np.cross(o, arm))

        bodies = [(TABLE[j, 3], TABLE[j, 4:7], np.diag(TABLE[j, 7:10]))]
        bodies += [load] if load is not None and j == 5 else []
        rotation = transforms[j + 1][:3, :3]
        for mass, centre, inertia in bodies:
            point = origins[j + 1] + rotation @ centre
            force = mass * acceleration(point)
            tensor = rotation @ inertia @ rotation.T
            moment = tensor @ alpha + np.cross(omega, tensor @ omega)
            # d'Alembert: every joint further in carries this body's share.
            for i in range(j + 1):
                lever = np.cross(point - origins[i], force)
                moments[i] += axes[i] @ (lever + moment)
        linear = acceleration(origins[j + 1])
    return moments + motor_torques(qd, qdd, friction)


def motor_torques(qd, qdd, friction=True):
    """Rotors, viscous and Coulomb friction."""
    rotor, ratio, viscous, forward, backward = TABLE[:, 10:].T
    coulomb = np.where(qd > 0, forward, np.where(qd < 0, backward, 0))
    drag = ratio**2 * viscous * qd + np.abs(ratio) * coulomb
    return ratio**2 * rotor * qdd + (drag if friction else 0)
