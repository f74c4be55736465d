"""Make inverse dynamics data of the Puma 560 with your own loads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Unpack, overload

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import Bunch, check_random_state

from ._bunch import Rows, check_descriptors, package
from ._checks import check_count, check_flag, check_numbers, check_ranges
from ._drive import Drive, motor_motion, motor_torques
from ._loads import (
    CENTRE_RANGE,
    MASS_RANGE,
    N_LOADS,
    SIDE_RANGE,
    complete_loads,
    draw_loads,
)
from ._loads import INERTIAL as INERTIAL_COLUMNS
from ._options import Making
from ._robot import N_JOINTS, import_pinocchio, link_torques
from ._trajectories import (
    EIGHT,
    N_SAMPLES,
    PATHS,
    SPEEDS,
    TOOL_PITCH,
    TOOL_SWING,
    joint_trajectories,
    trajectory_labels,
)

_RIGID = Drive()


@overload
def make_puma560(
    *,
    return_X_y: Literal[False] = False,
    as_frame: bool = False,
    **others: Unpack[Making],
) -> Bunch: ...


@overload
def make_puma560(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[False] = False,
    **others: Unpack[Making],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...


@overload
def make_puma560(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[True],
    **others: Unpack[Making],
) -> tuple[pd.DataFrame, pd.DataFrame]: ...


@overload
def make_puma560(
    *, return_X_y: bool, as_frame: bool = False, **others: Unpack[Making]
) -> Bunch | Any: ...  # not tuple: callers would have to rule it out


def make_puma560(
    *,
    n_samples: int = N_SAMPLES,
    n_loads: int | None = None,
    masses: ArrayLike | None = None,
    loads: pd.DataFrame | None = None,
    side_range: ArrayLike = SIDE_RANGE,
    centre_range: ArrayLike = CENTRE_RANGE,
    paths: ArrayLike = PATHS,
    speeds: ArrayLike = SPEEDS,
    eight: ArrayLike = EIGHT,
    tool: Literal["fixed", "moving"] = "fixed",
    tool_pitch: float = TOOL_PITCH,
    tool_swing: ArrayLike = TOOL_SWING,
    friction: bool = True,
    stribeck: float = 0.0,
    stribeck_speed: float = 0.1,
    load_friction: float = 0.0,
    stiffness: ArrayLike | None = None,
    noise: ArrayLike = 0.0,
    random_state: np.random.RandomState | int | None = 0,
    descriptors: Sequence[str] | None = None,
    return_X_y: bool = False,
    as_frame: bool = False,
) -> Bunch | Any:
    """Make inverse dynamics data of a Puma 560 that holds different loads.

    Every load is carried along every path at every speed. With the default parameters
    these are the 960,000 samples of [1]_, section 6. What the paper leaves open is a
    parameter here.

    Parameters
    ----------
    n_samples : int, default=4000
        Samples of each load on each trajectory, at regular intervals.
    n_loads : int, default=None
        Number of loads to draw. None is 15, or the number of `masses`.
    masses : array-like of shape (n_loads,), default=None
        Masses of the loads, kg. None spaces them evenly from 0.2 to 3.0 kg.
    loads : DataFrame, default=None
        The loads, instead of drawn ones: a frame like ``loads`` of the Bunch. With the
        columns ``mass``, ``centre_*``, ``side_*`` and ``quat_*`` the ten inertial
        parameters are computed. Without them ``m``, ``mc_*`` and ``I_*`` are used
        directly.
    side_range : array-like of shape (2,), default=(0.04, 0.16)
        Range of the cuboids' sides, m. They are drawn uniformly.
    centre_range : array-like of shape (3, 2)
        Ranges of x, y and z of the cuboids' centres in frame 6, m. They are drawn
        uniformly. Default: -0.06 to 0.06, -0.06 to 0.06, 0.05 to 0.15.
    paths : array-like of shape (n_paths, 3)
        For each path p1, p2, ... the x and z of its centre (m) and its rotation about
        the vertical through it (deg). Default: the paper's four.
    speeds : array-like of shape (n_speeds,), default=(20, 15, 10, 5)
        Seconds for one path at the speeds s1, s2, ...
    eight : tuple of (float, float), default=(0.05, 0.10)
        The path is ``x = eight[0] sin 2u, y = eight[1] sin u`` in a horizontal
        plane, m, at the constant rate ``u = 2 pi t / T``.
    tool : {"fixed", "moving"}, default="fixed"
        Orientation of the tool. "fixed" keeps it constant. The loads then differ only
        by mass and centre of mass, not by inertia. "moving" swings the tool smoothly
        along the path, so that the inertia matters, too: on each path once about its x
        axis, twice about y and three times about z.
    tool_pitch : float, default=45
        Angle of the tool's z axis below the horizontal x axis, deg.
    tool_swing : float or array-like of shape (3,), default=(20, 20, 20)
        Amplitudes of the swings about the tool's x, y and z axes if it is moving, deg.
    friction : bool, default=True
        Whether the torques include viscous and Coulomb friction.
    stribeck : float, default=0
        Relative increase of Coulomb friction when a joint begins to move. No model that
        is linear in its parameters describes it. 0.5 is usual.
    stribeck_speed : float, default=0.1
        Velocity, rad/s, at which 1/e of this increase is left.
    load_friction : float, default=0
        Share of the torque on each link that is added to its Coulomb friction, as in
        gears. 0.05 is usual.
    stiffness : float or array-like of shape (6,), default=None
        Stiffness of elastic transmissions, N m/rad. The rotors then lead the joints,
        and the data have the joints' positions. None is rigid; 10,000 is usual.
    noise : float or array-like of shape (6,), default=0
        Standard deviation of normal noise added to each joint's torque, N m.
    random_state : int, RandomState instance or None, default=0
        Source of the drawn loads, then of the noise.
    descriptors : sequence of str, "inertial" or None, default=None
        Columns of the table `loads` that come before the load in the data, such as
        ``["mass"]``. "inertial" means the ten inertial parameters. Use them as
        `task_descriptors` of a MultiTaskGPRegressor.
    return_X_y : bool, default=False
        Whether to return ``(data, target)`` instead of a Bunch.
    as_frame : bool, default=False
        Whether data and target are pandas frames; the load is then a categorical
        ``"c1"``, ``"c2"``, ...

    Returns
    -------
    data : :class:`~sklearn.utils.Bunch`
        Dictionary-like object, with the following attributes. The rows are in
        order of load, path, speed and time.

        data : {ndarray, DataFrame} of shape (n_rows, 19 + n_descriptors)
            q1..q6 (rad), qd1..qd6 (rad/s), qdd1..qdd6 (rad/s^2), descriptors,
            load (from 1).
        target : {ndarray, DataFrame} of shape (n_rows, 6)
            Torques tau1..tau6, N m.
        frame : DataFrame of shape (n_rows, 25 + n_descriptors)
            Data and target; None unless ``as_frame=True``.
        feature_names, target_names : list of str
            Names of the columns.
        trajectory : ndarray of shape (n_rows,)
            Path and speed, such as "p2s3".
        time : ndarray of shape (n_rows,)
            Seconds since the start of the path.
        loads : DataFrame of shape (n_loads, 21)
            Mass (kg), centre (m), sides (m), attitude (unit quaternion) and the
            ten inertial parameters (kg, kg m, kg m^2) of each load in frame 6.
        DESCR : str
            Description of the data.

    (data, target) : tuple if ``return_X_y`` is True
        The first two.

    Raises
    ------
    ImportError
        If Pinocchio is not installed. The extra ``skmtgp[puma]`` installs it.
    TypeError, ValueError
        If an argument is wrong, or a path is out of reach.

    See Also
    --------
    fetch_puma560 : The paper's data, made once and split as in the paper.
    load_puma560 : A part of it that needs no Pinocchio.

    Notes
    -----
    A load is merged with the last link. Velocities and accelerations are those of the
    continuous path, ``qd = J^-1 v`` and ``qdd = J^-1 (a - Jdot qd)``. Velocities below
    1e-9 rad/s are set to 0, so that their sign is not that of a rounding error.

    References
    ----------
    .. [1] K. M. A. Chai, C. K. I. Williams, S. Klanke, S. Vijayakumar,
       "Multi-task Gaussian Process Learning of Robot Inverse Dynamics",
       NIPS 2008.

    Examples
    --------
    >>> from skmtgp.datasets import make_puma560
    >>> puma = make_puma560(n_samples=50, n_loads=3)
    >>> puma.data.shape, puma.target.shape
    ((2400, 19), (2400, 6))
    >>> puma.trajectory[:2].tolist()
    ['p1s1', 'p1s1']
    """
    return_X_y = check_flag("return_X_y", return_X_y)
    as_frame = check_flag("as_frame", as_frame)
    descriptors = check_descriptors(descriptors)
    drive = _check_drive(friction, stribeck, stribeck_speed, load_friction, stiffness)
    noise = _check_noise(noise)
    paths = check_numbers("paths", paths, (None, 3))
    speeds = check_numbers("speeds", speeds, (None,), positive=True)
    rng = check_random_state(random_state)
    loads = _choose_loads(loads, n_loads, masses, side_range, centre_range, rng)
    x = joint_trajectories(
        paths,
        speeds,
        check_count("n_samples", n_samples),
        check_numbers("eight", eight, (2,)),
        check_numbers("tool_pitch", tool_pitch, ()),
        _check_swing(tool, tool_swing),
    )
    torque = load_torques(x, loads, drive, np.tile(speeds, len(paths)))
    if noise.any():
        torque += noise * rng.normal(size=torque.shape)
    rows = _lay_out(x, torque, trajectory_labels(len(paths), len(speeds)), loads)
    time = _times(speeds, len(paths), n_samples, len(loads))
    return package(rows, return_X_y, as_frame, descriptors, time=time)


def load_torques(x, loads, drive=_RIGID, periods=None):
    """Torques of every load at the same states.

    Parameters
    ----------
    x : ndarray of shape (n_trajectories, n_samples, 18)
        q (rad), qd (rad/s), qdd (rad/s^2).
    loads : DataFrame of shape (n_loads, n_columns)
        With the ten inertial parameters.
    drive : Drive
        What is between motors and links.
    periods : ndarray of shape (n_trajectories,), default=None
        Seconds of a path, for elastic transmissions.

    Returns
    -------
    torques : ndarray of shape (n_loads, n_trajectories, n_samples, 6)
        N m.
    """
    import_pinocchio()
    q, qd, qdd = np.split(x, 3, axis=2)
    flat = [np.ascontiguousarray(part).reshape(-1, N_JOINTS) for part in (q, qd, qdd)]
    torques = np.empty((len(loads), *q.shape))
    for k, load in enumerate(loads[INERTIAL_COLUMNS].to_numpy()):
        link = link_torques(*flat, load).reshape(q.shape)
        motion = motor_motion(link, qd, qdd, periods, drive)
        torques[k] = motor_torques(link, *motion, drive)
    return torques


def _lay_out(x, torque, labels, loads):
    """Rows in order of load, trajectory and time."""
    n_loads, n_trajectories, n_samples = torque.shape[:3]
    per_load = n_trajectories * n_samples
    return Rows(
        np.tile(x.reshape(per_load, -1), (n_loads, 1)),
        np.repeat(np.arange(1, n_loads + 1), per_load),
        torque.reshape(-1, N_JOINTS),
        np.tile(np.repeat(labels, n_samples), n_loads),
        loads,
    )


def _times(speeds, n_paths, n_samples, n_loads):
    """Seconds since the start of the path, of every row."""
    times = np.outer(speeds, np.arange(n_samples) / n_samples)
    return np.tile(times.ravel(), n_loads * n_paths)


def _choose_loads(loads, n_loads, masses, side_range, centre_range, rng):
    if loads is not None:
        if n_loads is not None or masses is not None:
            raise ValueError("loads excludes n_loads and masses; leave those out.")
        return complete_loads(loads)
    side_range = check_ranges("side_range", side_range, (2,), positive=True)
    centre_range = check_ranges("centre_range", centre_range, (3, 2))
    if masses is None:
        n_loads = N_LOADS if n_loads is None else check_count("n_loads", n_loads)
        return draw_loads(
            np.linspace(*MASS_RANGE, n_loads), rng, side_range, centre_range
        )
    masses = check_numbers("masses", masses, (None,), positive=True)
    if n_loads is not None and check_count("n_loads", n_loads) != len(masses):
        raise ValueError(
            f"n_loads={n_loads}, but masses has {len(masses)}; leave n_loads out."
        )
    return draw_loads(masses, rng, side_range, centre_range)


def _check_swing(tool, tool_swing):
    if tool not in ("fixed", "moving"):
        raise ValueError(f"tool={tool!r} is unknown; give 'fixed' or 'moving'.")
    swing = check_numbers("tool_swing", tool_swing, (3,), repeat=True)
    return swing if tool == "moving" else np.zeros(3)


def _check_drive(friction, stribeck, stribeck_speed, load_friction, stiffness):
    """What is between motors and links."""
    friction = check_flag("friction", friction)
    shares = {"stribeck": stribeck, "load_friction": load_friction}
    for name, value in shares.items():
        shares[name] = float(check_numbers(name, value, ()))
        if shares[name] < 0.0:
            raise ValueError(f"{name}={value} must be 0 or more.")
        if shares[name] and not friction:
            raise ValueError(
                f"{name}={value} is of friction; leave out friction=False."
            )
    speed = check_numbers("stribeck_speed", stribeck_speed, (), positive=True)
    if stiffness is None:
        return _RIGID._replace(friction=friction, stribeck_speed=float(speed), **shares)
    stiffness = check_numbers(
        "stiffness", stiffness, (N_JOINTS,), positive=True, repeat=True
    )
    return Drive(friction, stribeck_speed=float(speed), stiffness=stiffness, **shares)


def _check_noise(noise) -> NDArray[np.float64]:
    noise = check_numbers("noise", noise, (N_JOINTS,), repeat=True)
    if (noise < 0).any():
        raise ValueError(
            f"noise holds {noise.min()}; give standard deviations in N m, not below 0."
        )
    return noise
