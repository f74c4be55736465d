import numpy as np
import pandas as pd
import puma560_reference as reference
import pytest

from skmtgp.datasets._loads import GEOMETRY, INERTIAL, complete_loads, draw_loads


@pytest.fixture
def loads():
    return draw_loads(np.linspace(0.2, 3.0, 15), np.random.RandomState(0))


def test_masses_range_evenly(loads):
    np.testing.assert_allclose(loads["mass"], 0.2 * np.arange(1, 16))
    assert loads.index.tolist() == [f"c{m}" for m in range(1, 16)]
    assert loads.columns.tolist() == GEOMETRY + INERTIAL


def test_geometry_stays_within_its_ranges(loads):
    sides = loads[["side_x", "side_y", "side_z"]].to_numpy()
    assert 0.04 <= sides.min() < sides.max() <= 0.16
    assert loads[["centre_x", "centre_y"]].abs().to_numpy().max() <= 0.06
    assert loads["centre_z"].between(0.05, 0.15).all()
    assert len(np.unique(sides)) == sides.size


def test_parameters_are_those_of_the_second_moments(loads):
    for _, load in loads.iterrows():
        turn = reference.quaternion_matrix(*load[GEOMETRY[7:]])
        sides = load[["side_x", "side_y", "side_z"]].to_numpy()
        centre = load[["centre_x", "centre_y", "centre_z"]].to_numpy()
        spread = turn @ np.diag(sides**2 / 12) @ turn.T + np.outer(centre, centre)
        moments = load["mass"] * spread
        tensor = np.trace(moments) * np.eye(3) - moments
        expected = [load["mass"], *(load["mass"] * centre)]
        expected += [tensor[0, 0], tensor[0, 1], tensor[1, 1]]
        expected += [tensor[0, 2], tensor[1, 2], tensor[2, 2]]
        np.testing.assert_allclose(
            load[INERTIAL].to_numpy(), expected, rtol=1e-12, atol=1e-16
        )


def test_merging_with_the_last_link_is_the_parallel_axis_theorem(loads):
    pin = pytest.importorskip("pinocchio")
    from skmtgp.datasets._robot import _pinocchio_model

    load = loads.loc["c9"]
    merged = _pinocchio_model(pin, load[INERTIAL].to_numpy()).inertias[6]
    bodies = [(0.09, np.array([0, 0, 0.032]), np.diag([0.15e-3, 0.15e-3, 0.04e-3]))]
    bodies.append(reference.cuboid(load))
    mass = sum(m for m, _, _ in bodies)
    centre = sum(m * c for m, c, _ in bodies) / mass
    tensor = np.zeros((3, 3))
    for m, c, inertia in bodies:
        r = c - centre
        tensor += inertia + m * (r @ r * np.eye(3) - np.outer(r, r))
    np.testing.assert_allclose(merged.mass, mass, rtol=1e-14)
    np.testing.assert_allclose(merged.lever, centre, rtol=1e-12)
    np.testing.assert_allclose(merged.inertia, tensor, rtol=1e-12, atol=1e-16)


def test_fewer_loads_are_the_first_ones():
    many = draw_loads([0.5] * 6, np.random.RandomState(7))
    few = draw_loads([0.5] * 2, np.random.RandomState(7))
    pd.testing.assert_frame_equal(many.iloc[:2], few)


def test_attitudes_have_no_preferred_direction():
    loads = draw_loads([1.0] * 2000, np.random.RandomState(1))
    axes = np.array(
        [reference.quaternion_matrix(*q)[:, 0] for q in loads[GEOMETRY[7:]].to_numpy()]
    )
    assert np.abs(axes.mean(axis=0)).max() < 0.06
    np.testing.assert_allclose(axes.T @ axes / 2000, np.eye(3) / 3, atol=0.04)


def test_a_frame_is_completed_from_its_geometry(loads):
    edited = loads.iloc[:3].copy()
    edited["mass"] *= 2
    completed = complete_loads(edited)
    np.testing.assert_allclose(completed[INERTIAL], 2 * loads[INERTIAL].iloc[:3])


def test_a_frame_of_inertial_parameters_is_taken_as_it_is(loads):
    completed = complete_loads(loads[INERTIAL])
    pd.testing.assert_frame_equal(completed, loads[INERTIAL])


def test_loads_that_are_no_frame_are_refused():
    with pytest.raises(TypeError, match="loads must be a pandas DataFrame, got list"):
        complete_loads([1, 2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.drop(columns=["side_y"]), r"lacks the columns \['side_y'\]"),
        (lambda f: f.iloc[:0], "loads has no rows"),
        (lambda f: f.assign(mass=-1.0), r"-1.0 in the column 'mass'; give .*positive"),
        (lambda f: f.assign(centre_x=np.nan), "nan in the column 'centre_x'"),
        (lambda f: f.assign(quat_w=3.0), "length .*; give unit quaternions"),
    ],
)
def test_bad_loads_are_refused(loads, change, message):
    with pytest.raises(ValueError, match=message):
        complete_loads(change(loads[GEOMETRY]))


def test_an_impossible_inertia_is_refused(loads):
    frame = loads[INERTIAL].copy()
    frame.loc["c2", "I_zz"] = 1.0
    with pytest.raises(ValueError, match="no body has the inertia of c2"):
        complete_loads(frame)
