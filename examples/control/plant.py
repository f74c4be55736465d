"""A simulated Puma 560 that is driven by torques and may change its load.

Rigid links and loads move by Pinocchio's articulated body algorithm; the motors' rotors
turn with them, and joints have the friction of the data sets. Coulomb friction can hold
a joint at rest, which no step of an ordinary differential equation can: each step finds
the impulses of friction that stop joints or oppose their motion (Stewart and Trinkle,
1996), by projected Gauss-Seidel.
"""

import numpy as np
import pinocchio as pin

from skmtgp.datasets import _drive as drive
from skmtgp.datasets import make_puma560
from skmtgp.datasets._robot import _pinocchio_model, inverse_dynamics
from skmtgp.datasets._trajectories import PATHS

RATE = 4000  # steps of the simulation a second
CONTROL = 1000  # torques a second
SWEEPS = 20  # of Gauss-Seidel, at most

ROTORS = drive.GEAR_RATIO**2 * drive.MOTOR_INERTIA
VISCOUS = drive.GEAR_RATIO**2 * drive.VISCOUS
LARGEST = np.abs(drive.GEAR_RATIO) * drive.COULOMB_POSITIVE
SMALLEST = np.abs(drive.GEAR_RATIO) * drive.COULOMB_NEGATIVE


class Puma:
    """The robot and its state.

    Parameters
    ----------
    q, qd : array-like of shape (6,)
        Joint angles (rad) and velocities (rad/s) at the beginning.
    load : array-like of shape (10,)
        Inertial parameters of what it carries, about the origin of frame 6.
    stribeck, stribeck_speed : float
        See `make_puma560`.
    """

    def __init__(self, q, qd, load, *, stribeck=0.0, stribeck_speed=0.1):
        self.q, self.qd = np.array(q, dtype=float), np.array(qd, dtype=float)
        self.stribeck, self.stribeck_speed = stribeck, stribeck_speed
        self.carry(load)

    def carry(self, load):
        """Change the load; positions and velocities stay."""
        self._model = _pinocchio_model(pin, load)
        self._model.armature = ROTORS
        self._data = self._model.createData()

    def step(self, torque):
        """Move for a period of the controller under a constant torque."""
        for _ in range(RATE // CONTROL):
            self._step(torque, 1.0 / RATE)

    def _step(self, torque, h):
        model, data = self._model, self._data
        free = pin.aba(model, data, self.q, self.qd, torque - VISCOUS * self.qd)
        inverse = pin.computeMinverse(model, data, self.q)
        inverse = np.triu(inverse) + np.triu(inverse, 1).T
        largest, smallest = LARGEST * h, SMALLEST * h
        if self.stribeck:
            more = np.exp(-((self.qd / self.stribeck_speed) ** 2))
            factor = 1.0 + self.stribeck * more
            largest, smallest = largest * factor, smallest * factor
        self.qd = _oppose(self.qd + h * free, inverse, smallest, largest)
        self.q = self.q + h * self.qd


def _oppose(qd, inverse, smallest, largest):
    """Velocities after impulses of friction between two bounds.

    An impulse stops its joint if it can, and opposes its motion as much as it can if
    not.
    """
    rows, qd, impulses = inverse.tolist(), qd.tolist(), [0.0] * len(qd)
    bounds = list(zip(smallest.tolist(), largest.tolist(), strict=True))
    for _ in range(SWEEPS):
        moved = 0.0
        for j, (least, most) in enumerate(bounds):
            impulse = impulses[j] + qd[j] / rows[j][j]
            impulse = min(max(impulse, least), most)
            change = impulse - impulses[j]
            if change:
                impulses[j] = impulse
                moved = max(moved, abs(change))
                qd = [v - change * r for v, r in zip(qd, rows[j], strict=True)]
        if moved < 1e-14:
            break
    return np.array(qd)


class Reference:
    """A path of the data sets, at the controller's rate.

    Parameters
    ----------
    path, speed : int
        From 1: p1 to p4, s1 to s4.

    Attributes
    ----------
    q, qd : ndarray of shape (n_steps, 6)
        Where the robot should be when a torque is chosen.
    ahead : ndarray of shape (n_steps, 18)
        Positions, velocities and accelerations half a period later, for which the
        torque is chosen, since it stays for a period.
    """

    def __init__(self, path, speed):
        seconds = (20.0, 15.0, 10.0, 5.0)[speed - 1]
        puma = make_puma560(
            paths=[PATHS[path - 1]],
            speeds=[seconds],
            n_samples=int(2 * CONTROL * seconds),
            n_loads=1,
        )
        states = puma.data[:, :18]
        self.q, self.qd = states[::2, :6], states[::2, 6:12]
        self.ahead = np.ascontiguousarray(states[1::2])


def torques(states, load):
    """What makes the robot move so with a load, by the equations of the data sets."""
    parts = np.split(np.atleast_2d(states), 3, axis=1)
    return inverse_dynamics(*map(np.ascontiguousarray, parts), load)


def training_states(n_steady, n_shaken, rng):
    """States on all paths and, the later ones, of motions that shake about them.

    On the paths accelerations are small, and go with position and velocity. A load that
    is picked up moves the arm otherwise: sines of 1 to 5 Hz and up to 3 rad/s^2 in each
    joint make such states.
    """
    references = [
        Reference(path, speed) for path in range(1, 5) for speed in (1, 2, 3, 4)
    ]
    n = n_steady + n_shaken
    states = np.array(
        [rng.choice(references[k % len(references)].ahead) for k in range(n)]
    )
    shaken = states[n_steady:].reshape(-1, 3, 6)
    rate = 2 * np.pi * rng.uniform(1.0, 5.0, (len(shaken), 6))
    phase = rng.uniform(0.0, 2 * np.pi, rate.shape)
    acceleration = rng.uniform(0.0, 3.0, rate.shape)
    shaken[:, 0] += acceleration / rate**2 * np.sin(phase)
    shaken[:, 1] += acceleration / rate * np.cos(phase)
    shaken[:, 2] -= acceleration * np.sin(phase)
    return states
