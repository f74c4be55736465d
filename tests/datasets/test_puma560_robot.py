import sys

import numpy as np
import puma560_reference as reference
import pytest

from skmtgp.datasets import make_puma560
from skmtgp.datasets._drive import friction_torques
from skmtgp.datasets._loads import INERTIAL, draw_loads
from skmtgp.datasets._robot import (
    JOINT_LIMITS,
    import_pinocchio,
    inverse_dynamics,
)

pytest.importorskip("pinocchio")


def random_states(n, seed=0):
    rng = np.random.default_rng(seed)
    low, high = np.deg2rad(reference.LIMITS).T
    return rng.uniform(low, high, (n, 6)), *rng.normal(0, 3, (2, n, 6))


@pytest.fixture
def loads():
    return draw_loads(np.linspace(0.2, 3.0, 15), np.random.RandomState(3))


@pytest.mark.parametrize("friction", [True, False])
def test_torques_are_those_of_newton_and_euler(loads, friction):
    states = random_states(12)
    for _, load in loads.iterrows():
        made = inverse_dynamics(*states, load=load[INERTIAL], friction=friction)
        body = reference.cuboid(load)
        expected = [
            reference.torques(*state, body, friction)
            for state in zip(*states, strict=True)
        ]
        np.testing.assert_allclose(made, expected, rtol=0, atol=1e-10)


def test_torques_of_the_empty_hand_are_those_of_newton_and_euler():
    states = random_states(100, seed=1)
    made = inverse_dynamics(*states)
    expected = [reference.torques(*state) for state in zip(*states, strict=True)]
    np.testing.assert_allclose(made, expected, rtol=0, atol=1e-10)


def test_torques_at_rest_are_the_gradient_of_the_potential_energy():
    q = random_states(1, seed=2)[0][0]
    rest = np.zeros((1, 6))

    def height_energy(q):
        energy = 0.0
        for j, frame in enumerate(reference.frames(q)[1:]):
            centre = frame @ [*reference.TABLE[j, 4:7], 1.0]
            energy += 9.81 * reference.TABLE[j, 3] * centre[2]
        return energy

    steps = 1e-6 * np.eye(6)
    slope = [(height_energy(q + s) - height_energy(q - s)) / 2e-6 for s in steps]
    made = inverse_dynamics(q[None], rest, rest)[0]
    np.testing.assert_allclose(made, slope, atol=1e-6)


def test_torques_are_linear_in_the_loads_ten_parameters(loads):
    states = random_states(50, seed=4)
    empty = inverse_dynamics(*states)
    parameters = loads[INERTIAL].to_numpy()
    effects = [inverse_dynamics(*states, load=p) - empty for p in parameters]
    torques = np.reshape(effects, (15, -1))
    regressor, *_ = np.linalg.lstsq(parameters[:10], torques[:10], rcond=None)
    assert np.linalg.matrix_rank(parameters[:10]) == 10
    predicted = parameters[10:] @ regressor
    np.testing.assert_allclose(predicted, torques[10:], atol=1e-7)
    both = inverse_dynamics(*states, load=parameters[3] + parameters[7]) - empty
    np.testing.assert_allclose(both, effects[3] + effects[7], rtol=0, atol=1e-11)


def test_friction_opposes_every_joint_and_is_off_at_rest():
    qd = np.array([[0.3] * 6, [-0.3] * 6, [0.0] * 6, [9e-10] * 6, [-9e-10] * 6])
    friction = friction_torques(qd)
    assert (friction[0] > 0).all()
    assert (friction[1] < 0).all()
    assert (friction[2] == 0).all()
    assert np.abs(friction[3:]).max() < 1e-8
    expected = [reference.motor_torques(v, np.zeros(6)) for v in qd[:2]]
    np.testing.assert_allclose(friction[:2], expected, rtol=1e-14)


def test_coulomb_friction_of_joint_4_has_the_published_size():
    jump = friction_torques(np.array([[2e-9] * 6, [-2e-9] * 6]))[:, 3]
    np.testing.assert_allclose(jump, [0.85, -1.29], atol=0.01)


def test_joint_limits_are_the_published_ones():
    np.testing.assert_allclose(np.rad2deg(JOINT_LIMITS), reference.LIMITS)


def test_without_pinocchio_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(ImportError, match=r'pip install "skmtgp\[puma\]"'):
        import_pinocchio()
    with pytest.raises(ImportError, match="load_puma560 works without it"):
        make_puma560(n_samples=2)
