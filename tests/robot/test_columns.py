"""How many base parameters robots have."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from rigid import rnea, states, two_joints

from skmtgp.robot._columns import Columns, independent
from skmtgp.robot._dynamics import Dynamics

pin = pytest.importorskip("pinocchio")
ALL = ["viscous", "asymmetric", "rotor"]


def test_columns_that_depend_on_others_are_left_out():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(30, 4))
    A = np.column_stack([0 * A[:, 0], A, A @ [1, 2, 0, 0], 1e-3 * rng.normal(size=30)])
    assert independent(A) == [1, 2, 3, 4, 6]
    assert independent(np.zeros((3, 2))) == []


def test_the_puma_has_36_base_parameters(puma):
    # the number of Mayeda, Yoshida and Osuka (1990) for a spherical wrist
    dynamics = Dynamics(puma)
    columns = Columns(dynamics, [], range(6))
    assert columns.n_links == len(columns.names) == 36
    x = dynamics.random_states(100)
    whole = dynamics.regressor(x, range(6), range(60)).reshape(-1, 60)
    assert np.linalg.matrix_rank(whole, tol=1e-9) == 36
    assert columns.load == list(range(10))


def test_rotors_of_four_joints_are_told_from_links(puma):
    names = Columns(Dynamics(puma), ["rotor"], range(6)).names[36:]
    assert names == [f"rotor(joint{j})" for j in (3, 4, 5, 6)]


def test_directions_of_friction(puma):
    columns = Columns(Dynamics(puma), ["viscous", "asymmetric"], [2])
    assert columns.names[columns.n_links :] == [
        f"{name}(joint3)" for name in ("viscous", "coulomb+", "coulomb-")
    ]
    np.testing.assert_array_equal(columns.one_way, [[0, 0], [1, 0], [0, 1]])
    np.testing.assert_array_equal(columns.both_ways, [[1, 0], [0, 1], [0, 1]])
    none = Columns(Dynamics(puma), [], [2])
    assert none.one_way.shape == none.both_ways.shape == (0, 0)


def test_friction_that_another_word_has_is_of_no_direction(puma):
    columns = Columns(Dynamics(puma), ["coulomb", "asymmetric"], [2])
    assert columns.one_way.shape == (2, 0)
    np.testing.assert_array_equal(columns.both_ways, np.eye(2))


def test_a_planar_arm_has_the_textbooks_parameters():
    # Joints along y, one after another: each link shows its inertia about y and two
    # first moments, and gravity adds nothing.
    urdf = two_joints("revolute", "revolute").replace('rpy="0.4 0.2 0"', "")
    columns = Columns(Dynamics(urdf), [], range(2))
    assert columns.n_links == 6
    assert [name for name in columns.names if name.startswith("I")] == [
        "I_yy(shoulder)",
        "I_yy(slide)",
    ]


def test_a_public_robot():
    """The UR5e of airo-models, a package of descriptions under the MIT licence."""
    package = importlib.util.find_spec("airo_models")
    if package is None:
        pytest.skip("airo-models is not installed")
    path = Path(package.origin).parent / "arms/ur5e/ur5e.urdf"
    model = pin.buildModelFromUrdf(path)
    columns = Columns(Dynamics(path), ALL, range(6))
    assert columns.n_links == 36
    X = states(20)
    found = columns.of(X[:, :-1])[0] @ columns.nominal
    np.testing.assert_allclose(found, rnea(model, X), rtol=0, atol=1e-10)
