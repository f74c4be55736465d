"""Stribeck friction, friction that grows with the load, elastic transmissions."""

import numpy as np
import pytest

from skmtgp.datasets import make_puma560
from skmtgp.datasets._drive import (
    COULOMB_POSITIVE,
    GEAR_RATIO,
    MOTOR_INERTIA,
    VISCOUS,
    Drive,
    friction_torques,
    motor_motion,
)

SIZE = {"n_samples": 400, "masses": [0.5, 2.5], "paths": [[0.45, 0.4, 0.0]]}
SPEEDS = (20.0, 5.0)


def made(**options):
    pytest.importorskip("pinocchio")
    return make_puma560(**SIZE, speeds=SPEEDS, **options)


def parts(puma):
    q, qd, qdd = np.split(puma.data[:, :18], 3, axis=1)
    return q, qd, qdd, puma.target


class TestStribeck:
    def test_is_most_where_a_joint_begins_to_move(self):
        drive = Drive(stribeck=0.5, stribeck_speed=0.1)
        speeds = np.array([1e-6, 0.1, 0.3, 3.0])[:, None] * np.ones(6)
        usual = friction_torques(speeds)
        more = friction_torques(speeds, drive=drive) - usual
        coulomb = np.abs(GEAR_RATIO) * COULOMB_POSITIVE
        expected = 0.5 * np.exp([0.0, -1.0, -9.0, -900.0])[:, None] * coulomb
        np.testing.assert_allclose(more, expected, atol=1e-8)

    def test_in_the_data(self):
        _, qd, _, usual = parts(made())
        *_, found = parts(made(stribeck=0.5, stribeck_speed=0.2))
        drive = Drive(stribeck=0.5, stribeck_speed=0.2)
        expected = friction_torques(qd, drive=drive) - friction_torques(qd)
        np.testing.assert_allclose(found - usual, expected, atol=1e-9)
        assert np.abs(expected).max() > 1.0

    def test_least_squares_no_longer_finds_it(self):
        """Of one joint, whose rigid torque is known: viscous, Coulomb, an offset."""
        _, qd, _, smooth = parts(made(friction=False))
        unexplained = {}
        for share in (0.0, 0.5):
            friction = parts(made(stribeck=share))[3][:, 1] - smooth[:, 1]
            v = qd[:, 1]
            A = np.column_stack([v, v > 1e-9, v < -1e-9])
            rest = friction - A @ np.linalg.lstsq(A, friction, rcond=None)[0]
            unexplained[share] = rest.var() / friction.var()
        assert unexplained[0.0] < 1e-20
        assert unexplained[0.5] > 1e-3


class TestLoadFriction:
    def test_opposes_motion_in_proportion_to_the_torque(self):
        _, qd, qdd, smooth = parts(made(friction=False))
        *_, usual = parts(made())
        *_, found = parts(made(load_friction=0.05))
        link = smooth - GEAR_RATIO**2 * MOTOR_INERTIA * qdd
        expected = 0.05 * np.abs(link) * np.sign(qd)
        np.testing.assert_allclose(found - usual, expected, atol=1e-9)

    def test_a_still_joint_has_none(self):
        drive = Drive(load_friction=0.1)
        still = friction_torques(np.zeros((2, 6)), np.full((2, 6), 50.0), drive)
        np.testing.assert_array_equal(still, 0.0)


class TestStiffness:
    @pytest.mark.parametrize("n", [400, 401])
    def test_rotors_lead_by_the_twist(self, n):
        """Derivatives of a known periodic torque."""
        time = np.arange(n) / n * 4.0
        omega = 2.0 * np.pi / 4.0
        link = (np.sin(omega * time) + 0.2 * np.cos(3 * omega * time))[None, :, None]
        link = link * np.arange(1, 7)
        zeros, drive = np.zeros_like(link), Drive(stiffness=np.full(6, 50.0))
        qd, qdd = motor_motion(link, zeros, zeros, np.array([4.0]), drive)
        first = omega * np.cos(omega * time) - 0.6 * omega * np.sin(3 * omega * time)
        second = -(omega**2) * np.sin(omega * time)
        second = second - 1.8 * omega**2 * np.cos(3 * omega * time)
        sizes = np.arange(1, 7) / 50.0
        np.testing.assert_allclose(qd[0], np.outer(first, sizes), atol=1e-10)
        np.testing.assert_allclose(qdd[0], np.outer(second, sizes), atol=1e-9)

    def test_in_the_data(self):
        """Against differences along the path, of each load and speed."""
        stiffness = 2000.0
        *_, smooth = parts(made(friction=False))
        _, _, qdd, found = parts(made(friction=False, stiffness=stiffness))
        link = (smooth - GEAR_RATIO**2 * MOTOR_INERTIA * qdd).reshape(2, 2, 400, 6)
        step = np.array(SPEEDS)[:, None, None] / 400
        twist = link / stiffness
        second = np.roll(twist, 1, 2) - 2 * twist + np.roll(twist, -1, 2)
        expected = GEAR_RATIO**2 * MOTOR_INERTIA * second / step**2
        difference = (found - smooth).reshape(expected.shape)
        np.testing.assert_allclose(
            difference, expected, atol=1e-3 * np.abs(expected).max()
        )

    def test_stiff_is_rigid(self):
        *_, rigid = parts(made())
        *_, stiff = parts(made(stiffness=[1e15] * 6))
        np.testing.assert_allclose(stiff, rigid, atol=1e-6)

    def test_friction_is_that_of_the_rotor(self):
        _, qd, _, rigid = parts(made())
        *_, soft = parts(made(stiffness=500.0))
        *_, smooth = parts(made(friction=False))
        *_, soft_smooth = parts(made(friction=False, stiffness=500.0))
        change = (soft - soft_smooth) - (rigid - smooth)
        moving = np.abs(qd) > 0.2  # whose rotors turn the same way
        viscous = np.abs(change[moving]).max()
        assert 0.0 < viscous < (GEAR_RATIO**2 * VISCOUS).max()


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"stribeck": -0.5}, ValueError, "stribeck=-0.5 must be 0 or more"),
        ({"load_friction": -1}, ValueError, "load_friction=-1"),
        ({"stribeck_speed": 0.0}, ValueError, "stribeck_speed"),
        ({"stiffness": 0.0}, ValueError, "stiffness"),
        ({"stiffness": [1.0, 2.0]}, ValueError, "stiffness"),
        ({"stiffness": "soft"}, TypeError, "stiffness"),
        ({"stribeck": 0.5, "friction": False}, ValueError, "leave out friction=False"),
    ],
)
def test_bad_arguments(options, error, match):
    with pytest.raises(error, match=match):
        made(**options)
