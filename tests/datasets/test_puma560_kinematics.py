import numpy as np
import puma560_reference as reference
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skmtgp.datasets import _kinematics as kinematics
from skmtgp.datasets._trajectories import (
    EIGHT,
    PATHS,
    SPEEDS,
    joint_trajectories,
    trajectory_labels,
)

FIXED, MOVING = (0.0, 0.0, 0.0), (20.0, 20.0, 20.0)


def trajectories(swing=FIXED, pitch=45.0, n_samples=1000, paths=PATHS):
    return joint_trajectories(paths, SPEEDS, n_samples, EIGHT, pitch, swing)


@pytest.fixture(scope="module", params=[FIXED, MOVING], ids=["fixed", "moving"])
def x(request):
    return trajectories(request.param)


def spectral_derivative(values, duration):
    """Derivative of periodic samples along the first axis."""
    n = len(values)
    frequency = 2j * np.pi * np.fft.fftfreq(n, duration / n)
    return np.fft.ifft(frequency[:, None] * np.fft.fft(values, axis=0), axis=0).real


def tool_axes(q):
    return np.array([reference.frames(angles)[6][:3, :3] for angles in q])


def expected_positions(path, n_samples):
    u = 2 * np.pi * np.arange(n_samples) / n_samples
    x, y = 0.05 * np.sin(2 * u), 0.10 * np.sin(u)
    turn = np.deg2rad(path[2])
    return np.column_stack(
        [
            path[0] + np.cos(turn) * x - np.sin(turn) * y,
            np.sin(turn) * x + np.cos(turn) * y,
            np.full(n_samples, path[1]),
        ]
    )


def test_forward_kinematics_are_those_of_the_table():
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    origins, rotations = kinematics.forward_kinematics(q)
    for angles, points, axes in zip(q, origins, rotations, strict=True):
        expected = np.array(reference.frames(angles))
        np.testing.assert_allclose(points, expected[:, :3, 3], atol=1e-14)
        np.testing.assert_allclose(axes, expected[:, :3, :3], atol=1e-14)


def test_the_wrist_follows_the_figure_of_eight(x):
    for p, path in enumerate(PATHS):
        wrist = [reference.frames(q)[6][:3, 3] for q in x[4 * p, ::10, :6]]
        expected = expected_positions(path, 1000)[::10]
        np.testing.assert_allclose(wrist, expected, atol=1e-13)


def test_the_fixed_tool_points_45_degrees_down():
    for q in trajectories()[::4, ::50, :6].reshape(-1, 6):
        tool = reference.frames(q)[6][:3, :3]
        np.testing.assert_allclose(tool[:, 2], [0.5**0.5, 0, -(0.5**0.5)], atol=1e-13)
        np.testing.assert_allclose(tool[:, 1], [0, 1, 0], atol=1e-13)


def test_the_moving_tool_moves_and_swings_about_three_axes():
    axes = tool_axes(trajectories(MOVING)[0, :, :6])
    start = axes[0]
    turned = np.einsum("ji,njk->nik", start, axes)
    generators = turned - turned.transpose(0, 2, 1)
    swings = np.ptp(generators, axis=0)
    assert min(swings[0, 1], swings[0, 2], swings[1, 2]) > 0.5


@pytest.mark.parametrize("order", [1, 2])
def test_rates_are_spectral_derivatives(x, order):
    for trajectory, duration in zip(x, SPEEDS * 4, strict=True):
        lower = trajectory[:, 6 * (order - 1) : 6 * order]
        higher = trajectory[:, 6 * order : 6 * (order + 1)]
        derivative = spectral_derivative(lower, duration)
        scale = np.abs(higher).max()
        np.testing.assert_allclose(derivative, higher, atol=1e-9 * scale)


def test_speeds_share_the_angles_and_scale_the_rates(x):
    slow, fast = x[0], x[3]
    np.testing.assert_array_equal(slow[:, :6], fast[:, :6])
    np.testing.assert_allclose(4 * slow[:, 6:12], fast[:, 6:12], atol=1e-14)
    np.testing.assert_allclose(16 * slow[:, 12:], fast[:, 12:], atol=1e-13)


def test_joint_limits_hold(x):
    low, high = np.deg2rad(reference.LIMITS).T
    q = x[..., :6]
    assert ((q > low) & (q < high)).all()


def test_the_configuration_is_righty_elbow_up_and_never_jumps(x):
    q = x[..., :6]
    assert np.abs(np.diff(q, axis=1)).max() < 0.05
    assert np.abs(q[:, 0] - q[:, -1]).max() < 0.05
    for angles in q[:, ::100].reshape(-1, 6):
        points = np.array(reference.frames(angles))[:, :3, 3]
        radial = np.array([np.cos(angles[0]), np.sin(angles[0]), 0])
        assert points[6] @ radial > 0
        # The elbow (frame 2) lies above the line from the shoulder to the wrist.
        slope = points[6, 2] / (points[6] @ radial)
        assert points[2, 2] > slope * (points[2] @ radial)
        assert abs(angles[3]) < np.pi / 2


def test_path_4_is_close_to_full_reach():
    q = trajectories(paths=PATHS[3:])[0, :, :6]
    origins, rotations = kinematics.forward_kinematics(q)
    wrist = origins[:, 6]
    reach = np.sqrt((wrist**2).sum(axis=1) - 0.15005**2).max()
    assert round(reach, 3) == 0.856
    condition = np.linalg.cond(kinematics._jacobian(origins, rotations)).max()
    assert round(condition) == 41


def test_no_velocity_is_rounding_noise(x):
    qd = np.abs(x[..., 6:12])
    assert not ((qd > 0) & (qd < 1e-9)).any()


def test_a_tool_straight_down_keeps_joint_4_exactly_still():
    x = trajectories(pitch=90.0, paths=PATHS[:3])
    assert (x[..., 9] == 0).all()
    assert np.abs(x[..., 15]).max() < 1e-9


def test_an_unreachable_path_is_named():
    paths = [PATHS[0], (0.9, 0.4, 5.0)]
    message = r"path p2 at x = 0.9 m, z = 0.4 m, rotated by 5 deg .* out of reach"
    with pytest.raises(ValueError, match=message):
        trajectories(paths=paths)


def test_a_path_through_the_shoulder_is_named():
    with pytest.raises(ValueError, match=r"path p1 .* out of reach"):
        trajectories(paths=[(0.0, 0.1, 0.0)])


def test_a_path_beyond_a_joint_limit_is_named():
    message = r"path p4 .* joint 5 would move .* outside its limits -100 and 100 deg"
    with pytest.raises(ValueError, match=message):
        trajectories(pitch=90.0)


def test_labels_change_the_speed_first():
    labels = trajectory_labels(4, 4).tolist()
    assert labels[:5] == ["p1s1", "p1s2", "p1s3", "p1s4", "p2s1"]
    assert len(set(labels)) == 16


@pytest.mark.parametrize("degrees", [175.0, -175.0])
def test_a_joint_that_passes_half_a_turn_is_followed(degrees):
    q = np.tile(np.deg2rad([10.0, 60.0, -150.0, 20.0, -40.0, degrees]), (50, 1))
    q[:, 5] += 0.3 * np.sin(np.linspace(0, 2 * np.pi, 50))
    origins, rotations = kinematics.forward_kinematics(q)
    found = kinematics.inverse_kinematics(origins[:, 6], rotations[:, 6])
    np.testing.assert_allclose(found, q, atol=1e-12)


RANGES = [(-90, 90), (20, 120), (-200, -100), (-80, 80), (-90, -10), (-170, 170)]


@settings(max_examples=100, deadline=None)
@given(st.tuples(*(st.floats(low, high) for low, high in RANGES)))
def test_inverse_kinematics_undo_the_forward_ones(angles):
    q = np.deg2rad([angles])
    origins, rotations = kinematics.forward_kinematics(q)
    # Stretched or folded arms, and a wrist over the shoulder, have other solutions.
    radial = origins[0, 6] @ [np.cos(q[0, 0]), np.sin(q[0, 0]), 0]
    if radial < 0.05:
        return
    found = kinematics.inverse_kinematics(origins[:, 6], rotations[:, 6])
    np.testing.assert_allclose(found, q, atol=1e-7)
