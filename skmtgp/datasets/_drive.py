"""The drives of the Puma 560: rotors, friction and elastic transmissions.

Rigid bodies with viscous and Coulomb friction are linear in their parameters: least
squares learns them to rounding. A real drive has what no such formula holds.
"""

from typing import NamedTuple

import numpy as np

# Slower than this (rad/s) a joint stands still; its sign would be rounding.
STANDSTILL = 1e-9

MOTOR_INERTIA = np.array([200e-6, 200e-6, 200e-6, 33e-6, 33e-6, 33e-6])
GEAR_RATIO = np.array([-62.6111, 107.815, -53.7063, 76.0364, 71.923, 76.686])
VISCOUS = np.array([1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6])
COULOMB_POSITIVE = np.array([0.395, 0.126, 0.132, 11.2e-3, 9.26e-3, 3.96e-3])
COULOMB_NEGATIVE = np.array([-0.435, -0.071, -0.105, -16.9e-3, -14.5e-3, -10.5e-3])


class Drive(NamedTuple):
    """What is between the motors and the links.

    Attributes
    ----------
    friction : bool
        Whether there is any.
    stribeck : float
        By which share of it Coulomb friction is larger where a joint begins to move.
    stribeck_speed : float
        Velocity, rad/s, at which 1/e of that is left.
    load_friction : float
        Share of the torque on the link that is added to Coulomb friction.
    stiffness : ndarray of shape (6,)
        Of the transmissions, N m/rad; infinite where they are rigid.
    """

    friction: bool = True
    stribeck: float = 0.0
    stribeck_speed: float = 0.1
    load_friction: float = 0.0
    stiffness: np.ndarray = np.full(6, np.inf)


def friction_torques(qd, link=0.0, drive=None):
    """Friction of the motors, seen at the joints.

    Parameters
    ----------
    qd : ndarray of shape (n_samples, 6)
        Velocities of the motors behind their gears, rad/s.
    link : float or ndarray of shape (n_samples, 6), default=0.0
        Torques on the links, N m.
    drive : Drive, default=None
        None is viscous and Coulomb friction.

    Returns
    -------
    torques : ndarray of shape (n_samples, 6)
        ``G^2 B qd + |G| Tc(sign of qd)`` in N m, with ``Tc(0) = 0``. The Coulomb part
        is larger by the factor ``1 + s exp(-(qd / v)^2)`` and by ``c |link|``, with s,
        v and c of the drive.

    Notes
    -----
    The toolbox of 2008 computed ``G (B qd + Tc)`` with a signed ``G``, which
    reverses the friction of joints 1 and 3 and makes the viscous part far too
    weak; the formula above is the physical one.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._drive import friction_torques
    >>> friction_torques(np.zeros((1, 6))).tolist()
    [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
    """
    forward, backward = qd > STANDSTILL, qd < -STANDSTILL
    coulomb = forward * COULOMB_POSITIVE + backward * COULOMB_NEGATIVE
    dry = np.abs(GEAR_RATIO) * coulomb
    if drive is not None and drive.stribeck:
        dry = dry * (1.0 + drive.stribeck * np.exp(-((qd / drive.stribeck_speed) ** 2)))
    if drive is not None and drive.load_friction:
        sign = forward.astype(float) - backward
        dry = dry + drive.load_friction * np.abs(link) * sign
    return GEAR_RATIO**2 * VISCOUS * qd + dry


def motor_torques(link, qd, qdd, drive):
    """Torques of the motors, behind their gears, that make those on the links.

    Parameters
    ----------
    link : ndarray of shape (n_samples, 6)
        Torques on the links, N m.
    qd, qdd : ndarray of shape (n_samples, 6)
        Velocities (rad/s) and accelerations (rad/s^2) of the motors behind their gears.
    drive : Drive
        What is between.

    Returns
    -------
    torques : ndarray of shape (n_samples, 6)
        N m.
    """
    torques = link + GEAR_RATIO**2 * MOTOR_INERTIA * qdd
    return torques + friction_torques(qd, link, drive) if drive.friction else torques


def motor_motion(link, qd, qdd, periods, drive):
    """Velocities and accelerations of the motors, which elastic transmissions let lead.

    A motor's angle is that of the joint and ``link / stiffness``.

    Parameters
    ----------
    link, qd, qdd : ndarray of shape (n_trajectories, n_samples, 6)
        Torques on the links, velocities and accelerations of the joints, at regular
        intervals of closed paths.
    periods : ndarray of shape (n_trajectories,)
        Seconds of a path.
    drive : Drive
        With the stiffness.

    Returns
    -------
    qd, qdd : ndarray of shape (n_trajectories, n_samples, 6)
        Those of the motors behind their gears.
    """
    if np.isinf(drive.stiffness).all():
        return qd, qdd
    n = link.shape[1]
    spectrum = np.fft.rfft(link / drive.stiffness, axis=1)
    rate = 2j * np.pi * np.fft.rfftfreq(n, 1.0 / n) / periods[:, None]
    if n % 2 == 0:
        rate[:, -1] = 0.0  # the highest frequency has no sign
    first, second = (
        np.fft.irfft(spectrum * rate[..., None] ** k, n, axis=1) for k in (1, 2)
    )
    return qd + first, qdd + second
