"""Cuboid loads, rigidly attached to the last link at a random pose."""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

N_LOADS = 15
MASS_RANGE = (0.2, 3.0)
SIDE_RANGE = (0.04, 0.16)
CENTRE_RANGE = ((-0.06, 0.06), (-0.06, 0.06), (0.05, 0.15))

GEOMETRY = [
    *("mass", "centre_x", "centre_y", "centre_z", "side_x", "side_y", "side_z"),
    *("quat_x", "quat_y", "quat_z", "quat_w"),
]
INERTIAL = ["m", "mc_x", "mc_y", "mc_z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz"]


def load_labels(n_loads):
    """Names of the loads, in order.

    Parameters
    ----------
    n_loads : int
        How many there are.

    Returns
    -------
    labels : list of str
        ``"c1"``, ``"c2"``, ...

    Examples
    --------
    >>> from skmtgp.datasets._loads import load_labels
    >>> load_labels(3)
    ['c1', 'c2', 'c3']
    """
    return [f"c{m + 1}" for m in range(n_loads)]


def draw_loads(masses, rng, side_range=SIDE_RANGE, centre_range=CENTRE_RANGE):
    """Cuboids of random sides at random poses in frame 6.

    Parameters
    ----------
    masses : ndarray of shape (n_loads,)
        Masses, kg.
    rng : numpy.random.RandomState
        Source of the draws. Load by load, so that fewer loads are the first ones.
    side_range : array-like of shape (2,)
        Between which lengths the sides are uniform, m.
    centre_range : array-like of shape (3, 2)
        Between which x, y, z in frame 6 the centre is uniform, m.

    Returns
    -------
    loads : DataFrame of shape (n_loads, 21)
        See :func:`complete_loads`.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._loads import draw_loads
    >>> loads = draw_loads([0.5, 1.0], np.random.RandomState(0))
    >>> loads["mass"].tolist()
    [0.5, 1.0]
    """
    rows = []
    for mass in masses:
        sides = rng.uniform(*side_range, size=3)
        centre = rng.uniform(*np.transpose(centre_range))
        # Four normal numbers, normalised, are uniform over the attitudes.
        attitude = rng.normal(size=4)
        attitude /= np.linalg.norm(attitude)
        rows.append([mass, *centre, *sides, *attitude])
    return complete_loads(pd.DataFrame(rows, columns=GEOMETRY))


def complete_loads(loads):
    """Table of loads with their ten inertial parameters about frame 6.

    Parameters
    ----------
    loads : DataFrame
        With the columns ``mass`` (kg), ``centre_x`` ... ``centre_z`` (m, in frame
        6), ``side_x`` ... ``side_z`` (m, along the cuboid's own axes) and
        ``quat_x`` ... ``quat_w`` (unit quaternion that turns the cuboid's axes
        into those of frame 6); or, for loads that are no cuboids, with ``m``,
        ``mc_x`` ... ``mc_z`` (kg m) and ``I_xx, I_xy, I_yy, I_xz, I_yz, I_zz``
        (kg m^2, about the origin of frame 6). The first, if present, decide.

    Returns
    -------
    loads : DataFrame
        The columns given, with the ten inertial parameters last; one row a load,
        labelled ``"c1"``, ``"c2"``, ...

    Raises
    ------
    TypeError
        If `loads` is no frame.
    ValueError
        If columns are missing, a number is not finite, or a load is not physical.
    """
    if not isinstance(loads, pd.DataFrame):
        raise TypeError(
            f"loads must be a pandas DataFrame, got {type(loads).__name__}; give one "
            f"with the columns {GEOMETRY} or {INERTIAL}."
        )
    columns = _columns_that_decide(loads)
    values = loads[columns].to_numpy(dtype=float)
    _check_numbers(columns, values)
    parameters = values if columns is INERTIAL else _inertial_parameters(values)
    _check_bodies(parameters)
    table = pd.DataFrame(values, columns=columns, index=load_labels(len(loads)))
    table[INERTIAL] = parameters
    return table


def _columns_that_decide(loads):
    for columns in (GEOMETRY, INERTIAL):
        if set(columns) <= set(loads.columns):
            return columns
    missing = [column for column in GEOMETRY if column not in loads.columns]
    raise ValueError(
        f"loads lacks the columns {missing}; give all of {GEOMETRY}, or the ten "
        f"inertial parameters {INERTIAL}."
    )


def _check_numbers(columns, values):
    if len(values) == 0:
        raise ValueError("loads has no rows; give at least one load.")
    for column, numbers in zip(columns, values.T, strict=True):
        positive = column in ("mass", "m", "side_x", "side_y", "side_z")
        bad = ~np.isfinite(numbers) | (positive & ~(numbers > 0))
        if bad.any():
            raise ValueError(
                f"loads has {numbers[bad][0]} in the column {column!r}; give finite "
                f"{'and positive ' if positive else ''}numbers."
            )


def _inertial_parameters(geometry):
    """Ten parameters of cuboids: Huygens-Steiner from the centre to the origin."""
    mass, centre, sides = geometry[:, 0], geometry[:, 1:4], geometry[:, 4:7]
    lengths = np.linalg.norm(geometry[:, 7:11], axis=1)
    if np.any(np.abs(lengths - 1) > 1e-6):
        raise ValueError(
            f"loads has an attitude (quat_x ... quat_w) of length {lengths.max():g}; "
            "give unit quaternions."
        )
    attitude = Rotation.from_quat(geometry[:, 7:11]).as_matrix()
    squares = sides**2
    principal = mass[:, None] / 12 * (squares.sum(axis=1, keepdims=True) - squares)
    about_centre = (attitude * principal[:, None, :]) @ attitude.transpose(0, 2, 1)
    outer = centre[:, :, None] * centre[:, None, :]
    shift = (centre**2).sum(axis=1)[:, None, None] * np.eye(3) - outer
    tensor = about_centre + mass[:, None, None] * shift
    rows, columns = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]
    return np.column_stack([mass, mass[:, None] * centre, tensor[:, rows, columns]])


def _check_bodies(parameters):
    """Refuse tensors that no mass distribution has, up to rounding."""
    for label, row in zip(load_labels(len(parameters)), parameters, strict=True):
        xx, xy, yy, xz, yz, zz = row[4:]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        centre = row[1:4] / row[0]
        shift = row[0] * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        moments = np.linalg.eigvalsh(tensor - shift)
        slack = 1e-9 * np.abs(tensor).max()
        if moments[0] < -slack or moments[0] + moments[1] < moments[2] - slack:
            raise ValueError(
                f"loads: no body has the inertia of {label} (principal moments "
                f"{moments} kg m^2 about its centre); give I_xx ... I_zz about the "
                "origin of frame 6, in kg m^2."
            )
