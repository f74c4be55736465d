"""The paper's whole data as arrays: made once, kept in the data home."""

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from sklearn.datasets import get_data_home

from . import _store as store
from ._bunch import Rows
from ._loads import GEOMETRY, INERTIAL, MASS_RANGE, N_LOADS, draw_loads, load_labels
from ._make import load_torques
from ._robot import N_JOINTS
from ._trajectories import (
    EIGHT,
    N_SAMPLES,
    PATHS,
    SPEEDS,
    TOOL_PITCH,
    joint_trajectories,
    trajectory_labels,
)

# Raised whenever what is made changes, so that older files are not mistaken for it.
VERSION = 1
LABELS = trajectory_labels(len(PATHS), len(SPEEDS))
SHAPES = {
    "x": (len(LABELS), N_SAMPLES, 3 * N_JOINTS),
    "torque": (N_LOADS, len(LABELS), N_SAMPLES, N_JOINTS),
    "loads": (N_LOADS, len(GEOMETRY) + len(INERTIAL)),
}


def stored_path(data_home, seed):
    """Where the whole data of one seed are kept.

    Parameters
    ----------
    data_home : path-like or None
        As for :func:`fetch_puma560`.
    seed : int
        Its random state.

    Returns
    -------
    path : pathlib.Path
        The npz file, there or not.
    """
    return Path(get_data_home(data_home)) / f"puma560_v{VERSION}_seed{seed}.npz"


def generate(seed):
    """Make the paper's data.

    Parameters
    ----------
    seed : int
        Draws the loads.

    Returns
    -------
    arrays : dict of str to ndarray
        ``x`` (16, 4000, 18), shared by the loads, ``torque`` (15, 16, 4000, 6) and
        ``loads`` (15, 21).
    """
    loads = draw_loads(np.linspace(*MASS_RANGE, N_LOADS), np.random.RandomState(seed))
    x = joint_trajectories(PATHS, SPEEDS, N_SAMPLES, EIGHT, TOOL_PITCH, (0.0, 0.0, 0.0))
    return {"x": x, "torque": load_torques(x, loads), "loads": loads.to_numpy()}


def stored_arrays(data_home, seed):
    """Read the data of one seed; make and keep them if they are not there or damaged.

    Parameters
    ----------
    data_home : path-like or None
        As for :func:`fetch_puma560`.
    seed : int
        Its random state.

    Returns
    -------
    arrays : dict of str to ndarray
        See :func:`generate`.

    Warns
    -----
    UserWarning
        If the file is there, but damaged or another version's, or if what was made
        cannot be kept.
    """
    what = f"the Puma 560 data, version {VERSION}, seed {seed}"
    try:
        path = stored_path(data_home, seed)
        store.remove_stale(path)
        return store.read(path, what, SHAPES)
    except OSError:  # most often they are not there; keeping them tells anything else
        pass
    except store.DamagedFileError as error:
        warnings.warn(f"{error}; the Puma 560 data are made again.", stacklevel=3)
    arrays = generate(seed)
    try:
        store.write(stored_path(data_home, seed), arrays, what)
    except OSError as error:
        warnings.warn(
            f"The Puma 560 data were made, but cannot be kept: {error}. Pass another "
            "data_home, or they are made again each time.",
            stacklevel=3,
        )
    return arrays


def select_rows(arrays, numbers, orders):
    """Rows of some loads, each in its order.

    Parameters
    ----------
    arrays : dict of str to ndarray
        See :func:`generate`.
    numbers : list of int
        The loads, from 1.
    orders : list of ndarray of shape (n_per_load,)
        The samples of each, positions in the trajectories laid end to end.

    Returns
    -------
    rows : Rows
        Grouped by load.
    """
    x = arrays["x"].reshape(-1, arrays["x"].shape[-1])
    torque = arrays["torque"].reshape(N_LOADS, -1, N_JOINTS)
    taken = np.concatenate(orders)
    return Rows(
        x[taken],
        np.repeat(numbers, len(orders[0])),
        np.concatenate(
            [torque[m - 1][o] for m, o in zip(numbers, orders, strict=True)]
        ),
        LABELS[taken // N_SAMPLES],
        loads_table(arrays),
    )


def loads_table(arrays):
    """Table of the loads.

    Parameters
    ----------
    arrays : dict of str to ndarray
        With ``loads`` of shape (15, 21).

    Returns
    -------
    loads : DataFrame of shape (15, 21)
        Labelled by load and quantity.
    """
    columns, labels = [*GEOMETRY, *INERTIAL], load_labels(N_LOADS)
    return pd.DataFrame(arrays["loads"], index=labels, columns=columns)
