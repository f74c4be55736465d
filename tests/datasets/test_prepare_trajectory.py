"""Filtering and differentiation of recordings, against signals that are known."""

import numpy as np
import pytest

from skmtgp.datasets import prepare_trajectory

TIME = np.arange(4001) / 1000.0
NAMES = "q", "qd", "qdd", "tau"
FREQUENCIES = np.array([0.5, 1.3])  # Hz, of two joints


def motion(time):
    """Positions, velocities, accelerations and torques."""
    omega = 2.0 * np.pi * FREQUENCIES
    phase = np.outer(time, omega)
    q, qd, qdd = np.sin(phase), omega * np.cos(phase), -(omega**2) * np.sin(phase)
    return q, qd, qdd, 2.0 * qdd + np.cos(q)


def columns(frame, name):
    return frame[[f"{name}1", f"{name}2"]].to_numpy()


def assert_is(frame, *, q, qd, qdd, tau):
    """Errors, of each quantity over its deviation, at most as large."""
    limits = q, qd, qdd, tau
    for name, truth, limit in zip(NAMES, motion(frame["time"]), limits, strict=True):
        error = np.abs(columns(frame, name) - truth).max(axis=0) / truth.std(axis=0)
        assert error.max() < limit, name


def test_without_noise_motion_is_what_it_was():
    q, _, _, tau = motion(TIME)
    frame = prepare_trajectory(TIME, q, tau)
    assert list(frame) == ["time", *(f"{n}{j}" for n in NAMES for j in (1, 2))]
    assert_is(frame, q=2e-4, qd=2e-3, qdd=2e-2, tau=2e-4)
    middle = frame[frame["time"].between(1.0, 3.0)]  # away from the ends
    assert_is(middle, q=1e-6, qd=1e-6, qdd=1e-6, tau=1e-6)


def test_noise_goes():
    q, _, _, tau = motion(TIME)
    rng = np.random.default_rng(0)
    noisy = q + 1e-4 * rng.normal(size=q.shape), tau + 1.0 * rng.normal(size=q.shape)
    frame = prepare_trajectory(TIME, *noisy, cutoff=6.0)
    assert_is(
        frame[frame["time"].between(0.5, 3.5)], q=1e-3, qd=1e-3, qdd=2e-2, tau=0.1
    )
    raw = np.gradient(np.gradient(noisy[0], TIME, axis=0), TIME, axis=0)
    assert np.abs(raw - motion(TIME)[2]).max() > 50.0  # without a filter


def test_torques_and_motion_are_not_shifted():
    """A sum of cosines and its filtered self agree best without a lag."""
    q, _, _, tau = motion(TIME)
    frame = prepare_trajectory(TIME, q, tau, cutoff=3.0)
    found = columns(frame, "tau")[:, 1]
    start = round(frame["time"][0] * 1000)
    lags = range(-5, 6)
    errors = [
        np.square(found - tau[start + lag : start + lag + len(found), 1]).mean()
        for lag in lags
    ]
    assert lags[int(np.argmin(errors))] == 0


def test_at_the_cutoff_amplitudes_are_halved():
    q = np.sin(2.0 * np.pi * 8.0 * TIME)[:, None]
    frame = prepare_trajectory(TIME, q, q, cutoff=8.0)
    middle = frame["q1"][frame["time"].between(1.5, 2.5)]
    assert np.abs(middle).max() == pytest.approx(0.5, abs=0.01)


def test_measured_velocities_are_taken():
    q, qd, _, tau = motion(TIME)
    frame = prepare_trajectory(TIME, q, tau, 3.0 * qd)  # as if of other units
    _, truth, slope, _ = motion(frame["time"])
    inside = frame["time"].between(1.0, 3.0).to_numpy()
    np.testing.assert_allclose(
        columns(frame, "qd")[inside], 3 * truth[inside], atol=1e-4
    )
    np.testing.assert_allclose(
        columns(frame, "qdd")[inside], 3 * slope[inside], atol=1e-2
    )


def test_uneven_times():
    rng = np.random.default_rng(1)
    time = TIME + 3e-4 * rng.uniform(-1.0, 1.0, len(TIME))
    q, _, _, tau = motion(time)
    frame = prepare_trajectory(time, q, tau)
    assert np.ptp(np.diff(frame["time"])) < 1e-9
    assert_is(
        frame[frame["time"].between(1.0, 3.0)], q=1e-5, qd=1e-5, qdd=1e-4, tau=1e-3
    )


def test_rate_and_trim():
    q, _, _, tau = motion(TIME)
    whole = prepare_trajectory(TIME, q, tau, trim=0.0)
    assert len(whole) == len(TIME)
    some = prepare_trajectory(TIME, q, tau, trim=0.5, rate=50.0)
    np.testing.assert_allclose(some["time"], np.arange(0.5, 3.501, 0.02))
    of_whole = whole.iloc[500:3501:20]
    np.testing.assert_allclose(some, of_whole, atol=1e-9)


def test_turns():
    angle = 4.0 * TIME[:, None]
    wrapped = (angle + np.pi) % (2.0 * np.pi) - np.pi
    frame = prepare_trajectory(TIME, wrapped, angle)
    inside = frame["time"].between(1.0, 3.0)
    np.testing.assert_allclose(frame["qd1"][inside], 4.0, rtol=1e-6)
    kept = prepare_trajectory(TIME, wrapped, angle, unwrap=False)
    assert np.abs(kept["qd1"]).max() > 50.0


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"cutoff": 600.0}, "half the recorded rate of 1000 Hz"),
        ({"cutoff": 0.0}, "cutoff"),
        ({"tau_cutoff": -1.0}, "tau_cutoff"),
        ({"order": 0}, "order=0"),
        ({"rate": 2000.0}, "rate=2000 is above the recorded one"),
        ({"trim": 2.5}, "trim=2.5"),
        ({"trim": -1.0}, "trim=-1"),
        ({"tau": np.zeros((4001, 3))}, r"tau has shape \(4001, 3\)"),
        ({"qd": np.zeros(4001)}, "qd has shape"),
        ({"q": np.full((4001, 2), np.nan)}, "q "),
        ({"time": TIME[::-1]}, "does not increase"),
        ({"time": TIME + (TIME > 2.0)}, "gap of 1.001 s after row 2000"),
        ({"time": TIME * 1000.0}, "Is time in seconds"),
    ],
)
def test_bad_arguments(changed, match):
    q, _, _, tau = motion(TIME)
    with pytest.raises(ValueError, match=match):
        prepare_trajectory(**{"time": TIME, "q": q, "tau": tau, **changed})


def test_words_are_no_numbers():
    with pytest.raises(TypeError, match="q must hold numbers"):
        prepare_trajectory([0.0, 1.0], [["a"], ["b"]], [[0.0], [0.0]])


def test_too_few_samples():
    few = slice(0, 5)
    q, _, _, tau = motion(TIME[few])
    with pytest.raises(ValueError, match="5 samples"):
        prepare_trajectory(TIME[few], q, tau)


def test_degrees_are_not_taken_for_turns():
    time = np.arange(400) / 40.0
    q = np.rad2deg(np.column_stack([1.5 * np.sin(2.0 * time), np.cos(time)]))
    with pytest.raises(ValueError, match="column 0, which spans 171"):
        prepare_trajectory(time, q, q, cutoff=5.0)
    wrapped = (1.2 * np.arange(400) + np.pi) % (2.0 * np.pi) - np.pi  # rad
    fast = prepare_trajectory(time, wrapped[:, None], wrapped[:, None], cutoff=5.0)
    np.testing.assert_allclose(fast["qd1"], 1.2 * 40.0, rtol=1e-2)
    frame = prepare_trajectory(time, q, q, cutoff=5.0, unwrap=False)
    assert frame["q1"].max() == pytest.approx(np.rad2deg(1.5), rel=0.01)
