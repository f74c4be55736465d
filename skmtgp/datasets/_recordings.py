"""From a robot's recording to states and torques that a model can learn."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from ._checks import check_count, check_flag, check_numbers

QUINTIC = 5  # degree of the spline that is differentiated, twice smoothly
SLACK = 0.1  # rad, by which an encoder's turn may be longer than one
EVEN = 1e-6  # of a step, that times may be off without being interpolated
FEWEST = 12  # samples
UNKNOWN = 2.0  # periods of the cutoff at the ends, that a filter knows one side of


def prepare_trajectory(
    time: ArrayLike,
    q: ArrayLike,
    tau: ArrayLike,
    qd: ArrayLike | None = None,
    *,
    cutoff: float = 10.0,
    tau_cutoff: float | None = None,
    order: int = 4,
    rate: float | None = None,
    trim: float | None = None,
    unwrap: bool = True,
) -> pd.DataFrame:
    """Filter a robot's recording and differentiate its joint positions.

    Positions and torques pass the same Butterworth filter forward and backward. This
    causes no delay, so both still belong to the same moment. Velocities and
    accelerations are derivatives of a quintic spline through the filtered positions.

    Parameters
    ----------
    time : array-like of shape (n_samples,)
        Increasing times in seconds. Steps may differ a little: samples are interpolated
        to the same number of even steps.
    q : array-like of shape (n_samples, n_joints)
        Joint positions, rad or m. Convert degrees first: `unwrap` counts in radians.
    tau : array-like of shape (n_samples, n_joints)
        Torques, forces or motor currents.
    qd : array-like of shape (n_samples, n_joints), default=None
        Measured velocities. They are filtered, and accelerations are their derivatives.
        None differentiates the positions twice.
    cutoff : float, default=10
        Frequency, Hz, at which the filter halves the signal. With the default order,
        frequencies below a quarter of it change by less than 1 in 10,000.
    tau_cutoff : float, default=None
        The same for `tau`. None is `cutoff`: the filter then removes from the torques
        what it removes from the motion.
    order : int, default=4
        Order of each pass of the filter.
    rate : float, default=None
        Samples per second to keep, at most the recorded rate. None keeps all.
    trim : float, default=None
        Seconds to leave out at the beginning and at the end, where the filter knows
        only one side. None is ``2 / cutoff``. Accelerations of slow motion are then
        right to about 1 in 100; with three times that, to 1 in 100,000.
    unwrap : bool, default=True
        Whether to treat jumps of positions by more than pi as turns by 2 pi. Where the
        positions of a joint span more than a turn, they cannot be that: such jumps
        raise an error.

    Returns
    -------
    frame : DataFrame of shape (n_kept, 1 + 4 * n_joints)
        Columns time, q1, q2, ..., qd1, ..., qdd1, ..., tau1, ....

    Raises
    ------
    TypeError
        If an argument does not hold numbers.
    ValueError
        If an argument has a wrong shape or a value that is not finite. If positions
        jump by what cannot be a turn, as degrees may, and `unwrap` is True. If times do
        not increase, or leave a gap of more than half a period of `cutoff`. If `cutoff`
        is too high for the recorded rate, or if nothing is left.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets import prepare_trajectory
    >>> time = np.arange(4000) / 1000
    >>> q = np.column_stack([np.sin(3 * time), np.cos(2 * time)])
    >>> noise = np.random.default_rng(0).normal(size=q.shape)
    >>> frame = prepare_trajectory(time, q + 1e-4 * noise, q, rate=100)
    >>> frame.shape
    (360, 9)
    >>> error = frame["qdd1"] + 9 * np.sin(3 * frame["time"])
    >>> bool(error.std() < 0.1)
    True
    """
    time = check_numbers("time", time, (None,))
    q = check_numbers("q", q, (len(time), None))
    tau = check_numbers("tau", tau, q.shape)
    cutoff = _check_positive("cutoff", cutoff)
    tau_cutoff = _check_positive("tau_cutoff", tau_cutoff or cutoff)
    order, unwrap = check_count("order", order), check_flag("unwrap", unwrap)
    even, fs = _even_times(time, max(cutoff, tau_cutoff))

    smooth = partial(_smooth, time=time, even=even, fs=fs, order=order)
    position = smooth(_unwrapped(q) if unwrap else q, cutoff)
    velocity = position.derivative()
    if qd is not None:
        velocity = smooth(check_numbers("qd", qd, q.shape), cutoff)
    parts = position, velocity, velocity.derivative(), smooth(tau, tau_cutoff)
    kept = _kept_times(even, fs, rate, UNKNOWN / cutoff if trim is None else trim)
    joints = range(1, q.shape[1] + 1)
    names = [f"{name}{j}" for name in ("q", "qd", "qdd", "tau") for j in joints]
    frame = pd.DataFrame(np.hstack([part(kept) for part in parts]), columns=names)
    frame.insert(0, "time", kept)
    return frame


def _unwrapped(q):
    """Positions without turns by 2 pi from one sample to the next."""
    jumps, spans = np.diff(q, axis=0), np.ptp(q, axis=0)
    strange = (np.abs(jumps) > np.pi) & (spans > 2.0 * np.pi + SLACK)
    if strange.any():
        i, j = np.argwhere(strange)[0]
        raise ValueError(
            f"q jumps by {jumps[i, j]:.4g} after row {i} in column {j}, which spans "
            f"{spans[j]:.4g}: the jump is no turn by 2 pi. If positions are in "
            "degrees, convert them by np.deg2rad. If they do jump, or slide, set "
            "unwrap=False."
        )
    return np.unwrap(q, axis=0)


def _check_positive(name, value):
    return float(check_numbers(name, value, (), positive=True))


def _even_times(time, cutoff):
    """As many times at even steps, and how many there are a second."""
    steps = np.diff(time)
    if len(time) < FEWEST:
        raise ValueError(f"time has {len(time)} samples; give at least {FEWEST}.")
    if (steps <= 0.0).any():
        i = int(np.argmin(steps > 0.0))
        raise ValueError(
            f"time does not increase: {time[i]} s at row {i}, {time[i + 1]} s at the "
            "next. Sort the rows, and drop those that are there twice."
        )
    widest, step = int(np.argmax(steps)), float(np.mean(steps))
    if cutoff >= 0.5 / step:
        raise ValueError(
            f"cutoff={cutoff:g} Hz is not below half the recorded rate of "
            f"{1.0 / step:g} Hz; give a lower one. Is time in seconds?"
        )
    if steps[widest] > 0.5 / cutoff + step:
        raise ValueError(
            f"time has a gap of {steps[widest]:g} s after row {widest}. What happened "
            "there is not known: prepare the rows before and after it on their own."
        )
    return np.linspace(time[0], time[-1], len(time)), 1.0 / step


def _smooth(values, cutoff, *, time, even, fs, order):
    """Filtered, at even times, as a function of time."""
    if not np.allclose(time, even, rtol=0.0, atol=EVEN / fs):
        values = make_interp_spline(time, values, k=3)(even)
    filtered = sosfiltfilt(
        butter(order, cutoff, fs=fs, output="sos"),
        values,
        axis=0,
        padlen=min(len(even) - 1, int(np.ceil(fs / cutoff))),
    )
    return make_interp_spline(even, filtered, k=QUINTIC)


def _kept_times(even, fs, rate, trim):
    """The times of the samples that are kept."""
    rate = fs if rate is None else _check_positive("rate", rate)
    if rate > fs * (1.0 + EVEN):
        raise ValueError(f"rate={rate:g} is above the recorded one, {fs:g} a second.")
    trim = float(check_numbers("trim", trim, ()))
    if trim < 0.0 or 2.0 * trim >= even[-1] - even[0]:
        raise ValueError(
            f"trim={trim:g} s must be 0 or more, and leave something of the "
            f"{even[-1] - even[0]:g} s that were recorded."
        )
    n = int(np.floor((even[-1] - even[0] - 2.0 * trim) * rate + EVEN))
    return even[0] + trim + np.arange(n + 1) / rate
