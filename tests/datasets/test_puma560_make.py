import numpy as np
import pandas as pd
import pytest

from skmtgp.datasets import fetch_puma560, make_puma560
from skmtgp.datasets._loads import INERTIAL

pytest.importorskip("pinocchio")


def small(**options):
    return make_puma560(**{"n_samples": 20, "n_loads": 3} | options)


def rank(torque, n_loads, joint):
    values = np.linalg.svd(torque.reshape(n_loads, -1, 6)[..., joint], compute_uv=False)
    return int((values > 1e-11 * values[0]).sum())


def test_rows_are_in_order_of_load_trajectory_and_time():
    puma = small()
    assert puma.data.shape == (3 * 16 * 20, 19)
    assert puma.target.shape == (960, 6)
    np.testing.assert_array_equal(puma.data[:, -1], np.repeat([1, 2, 3], 320))
    assert puma.trajectory[[0, 20, 80, 319, 320]].tolist() == [
        *("p1s1", "p1s2", "p2s1", "p4s4", "p1s1"),
    ]
    np.testing.assert_allclose(puma.time[:3], [0, 1, 2])
    np.testing.assert_allclose(puma.time[20:23], [0, 0.75, 1.5])
    np.testing.assert_array_equal(puma.data[:320, :18], puma.data[320:640, :18])


def test_default_options_are_those_of_the_whole_data(data_home, whole):
    puma = make_puma560(n_samples=100)
    x = whole["x"][:, ::40].reshape(-1, 18)
    torque = whole["torque"][:, :, ::40].reshape(-1, 6)
    np.testing.assert_allclose(puma.data[:1600, :18], x, rtol=0, atol=1e-11)
    np.testing.assert_allclose(puma.target, torque, rtol=0, atol=1e-10)
    expected = fetch_puma560(data_home=data_home, n_per_load=1).loads
    pd.testing.assert_frame_equal(puma.loads, expected)


def test_noise_is_normal_with_each_joints_deviation():
    deviation = np.array([0.0, 0.5, 1.0, 0.1, 0.2, 3.0])
    options = {"n_samples": 200, "n_loads": 4}
    noise = make_puma560(noise=deviation, **options).target
    noise = noise - make_puma560(**options).target
    assert (noise[:, 0] == 0).all()
    np.testing.assert_allclose(noise.std(axis=0), deviation, rtol=0.05)
    np.testing.assert_allclose(noise[:, 1:].mean(axis=0) / deviation[1:], 0, atol=0.05)
    correlation = np.corrcoef(noise[:, 1:].T) - np.eye(5)
    assert np.abs(correlation).max() < 0.05


def test_one_deviation_serves_all_joints():
    noise = small(noise=0.5).target - small().target
    np.testing.assert_allclose(noise.std(axis=0), 0.5, rtol=0.15)


def test_friction_can_be_left_out():
    puma, smooth = small(), small(friction=False)
    friction = puma.target - smooth.target
    qd = puma.data[:, 6:12]
    assert (np.sign(friction) == np.sign(qd)).all()
    assert np.abs(friction).min(axis=0)[0] > 20


def test_a_still_joint_has_no_friction():
    options = {"tool_pitch": 90.0, "paths": [(0.35, 0.36, -10.0), (0.45, 0.4, 0.0)]}
    puma, smooth = small(**options), small(friction=False, **options)
    assert (puma.data[:, 9] == 0).all()
    assert (puma.target[:, 3] == smooth.target[:, 3]).all()


@pytest.mark.parametrize(
    ("tool", "ranks"),
    [("fixed", [4, 5, 5, 4, 4, 3]), ("moving", [11, 11, 11, 10, 10, 8])],
)
def test_rank_of_the_tasks(tool, ranks):
    torque = make_puma560(n_samples=100, tool=tool).target
    assert [rank(torque, 15, joint) for joint in range(6)] == ranks


def test_tool_swing_is_ignored_by_a_fixed_tool_only():
    fixed, moving = small(tool_swing=5.0), small(tool="moving", tool_swing=5.0)
    np.testing.assert_array_equal(fixed.data, small().data)
    assert np.abs(moving.data - fixed.data).max() > 0.05
    still = small(tool="moving", tool_swing=0.0)
    np.testing.assert_allclose(still.data, fixed.data, atol=1e-12)


def test_inertia_of_the_load_shows_only_if_the_tool_moves():
    loads = small().loads.iloc[[0, 0]][INERTIAL]
    loads.iloc[1, 4:] *= 1.01
    fixed, moving = (
        small(loads=loads, n_loads=None, tool=tool).target.reshape(2, -1)
        for tool in ("fixed", "moving")
    )
    assert np.abs(fixed[1] - fixed[0]).max() < 1e-12
    assert np.abs(moving[1] - moving[0]).max() > 1e-5


def test_own_loads_paths_and_speeds():
    loads = small().loads.iloc[[2, 0]]
    options = {"paths": [(0.5, 0.4, 0.0)], "speeds": [8.0], "eight": (0.02, 0.03)}
    puma = small(loads=loads, n_loads=None, **options)
    assert puma.data.shape == (40, 19)
    assert set(puma.trajectory) == {"p1s1"}
    assert puma.loads.index.tolist() == ["c1", "c2"]
    np.testing.assert_array_equal(puma.loads, loads)


def test_own_masses_sides_and_centres():
    puma = make_puma560(
        n_samples=2,
        masses=[0.7, 0.1],
        side_range=(0.1, 0.1),
        centre_range=[(0, 0), (0, 0), (0.2, 0.2)],
    )
    assert puma.loads["mass"].tolist() == [0.7, 0.1]
    assert (puma.loads[["side_x", "side_y", "side_z"]] == 0.1).all(axis=None)
    assert (puma.loads["centre_z"] == 0.2).all()
    # A cube's inertia is the same about all axes.
    np.testing.assert_allclose(puma.loads["I_zz"], puma.loads["mass"] * 0.01 / 6)


def test_random_state_draws_loads_and_noise():
    same = small(noise=1.0, random_state=np.random.RandomState(5)).target
    # OpenBLAS of NumPy 1.26 rounds by where in memory a matrix lies
    np.testing.assert_allclose(small(noise=1.0, random_state=5).target, same, 1e-11)
    assert not np.array_equal(small(random_state=5).target, small().target)
    assert not np.array_equal(
        small(random_state=None).target, small(random_state=None).target
    )


def test_frames_and_pairs():
    puma, (X, y) = small(as_frame=True), small(return_X_y=True)
    np.testing.assert_array_equal(puma.frame.iloc[:, :18], X[:, :18])
    np.testing.assert_array_equal(puma.target, y)
    assert puma.data["load"].cat.categories.tolist() == ["c1", "c2", "c3"]
    assert small().frame is None


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"n_samples": 0}, ValueError, "n_samples=0 is too small"),
        ({"n_samples": 2.5}, TypeError, "n_samples must be a whole number, got 2.5"),
        ({"n_loads": 0}, ValueError, "n_loads=0 is too small"),
        ({"n_loads": True}, TypeError, "n_loads must be a whole number, got True"),
        ({"masses": [1.0, 2.0]}, ValueError, "n_loads=3, but masses has 2"),
        (
            {"masses": [1.0, -2.0, 1.0]},
            ValueError,
            "masses holds -2.0; give finite, pos",
        ),
        ({"loads": pd.DataFrame()}, ValueError, "loads excludes n_loads and masses"),
        (
            {"paths": [0.3, 0.4, 0.0]},
            ValueError,
            r"paths has shape \(3,\); give \(any, 3",
        ),
        ({"paths": []}, ValueError, r"paths has shape \(0,\)"),
        ({"paths": [(2.0, 0.4, 0.0)]}, ValueError, "path p1 at x = 2 m"),
        ({"speeds": [5.0, 0.0]}, ValueError, "speeds holds 0.0; give finite, positive"),
        ({"speeds": 5.0}, ValueError, r"speeds has shape \(\); give \(any\)"),
        ({"speeds": "fast"}, TypeError, "speeds must hold numbers, got 'fast'"),
        ({"eight": (1.0,)}, ValueError, r"eight has shape \(1,\); give \(2\)"),
        ({"tool": "loose"}, ValueError, "tool='loose' is unknown; give 'fixed' or"),
        ({"tool_pitch": np.inf}, ValueError, "tool_pitch holds inf; give finite"),
        (
            {"tool_swing": (1, 2)},
            ValueError,
            r"tool_swing has shape \(2,\); give \(3\)",
        ),
        ({"noise": -0.1}, ValueError, "noise holds -0.1; give standard deviations"),
        ({"noise": [0.1] * 5}, ValueError, r"noise has shape \(5,\); give \(6\)"),
        ({"friction": "no"}, TypeError, "friction must be True or False, got 'no'"),
        ({"as_frame": 1}, TypeError, "as_frame must be True or False, got 1"),
        ({"side_range": (0.2, 0.1)}, ValueError, "side_range=.* lower end above"),
        (
            {"side_range": (0.0, 0.1)},
            ValueError,
            "side_range holds 0.0; give finite, p",
        ),
        ({"centre_range": (0.0, 0.1)}, ValueError, r"centre_range has shape \(2,\)"),
    ],
)
def test_bad_arguments_are_named(options, error, message):
    with pytest.raises(error, match=message):
        small(**options)
