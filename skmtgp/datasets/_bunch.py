"""From rows of the data to what scikit-learn's loaders return."""

from importlib import resources
from typing import NamedTuple

import numpy as np
import pandas as pd
from sklearn.utils import Bunch

from ._loads import GEOMETRY, INERTIAL, load_labels
from ._robot import N_JOINTS

_JOINTS = range(1, N_JOINTS + 1)
STATE_NAMES = [f"{name}{j}" for name in ("q", "qd", "qdd") for j in _JOINTS]
TARGET_NAMES = [f"tau{j}" for j in _JOINTS]


def check_descriptors(descriptors):
    """Names of columns of the table of loads.

    Parameters
    ----------
    descriptors : sequence of str, "inertial" or None
        As the user gave them.

    Returns
    -------
    names : list of str
        Of the columns; the ten inertial parameters for "inertial".
    """
    if descriptors is None:
        return []
    if isinstance(descriptors, str) and descriptors == "inertial":
        return list(INERTIAL)
    names, known = list(descriptors), list(dict.fromkeys([*GEOMETRY, *INERTIAL]))
    unknown = [name for name in names if name not in known]
    if isinstance(descriptors, str) or unknown:
        raise ValueError(
            f"descriptors={descriptors!r} must be 'inertial', for the ten inertial "
            f"parameters, or a list of columns of the table of loads: {known}."
        )
    return names


class Rows(NamedTuple):
    """Samples in their final order.

    Attributes
    ----------
    x : ndarray of shape (n_samples, 18)
        q (rad), qd (rad/s), qdd (rad/s^2).
    load : ndarray of shape (n_samples,)
        Number of the load, from 1.
    torque : ndarray of shape (n_samples, 6)
        N m.
    trajectory : ndarray of shape (n_samples,)
        Labels such as ``"p2s3"``.
    loads : DataFrame
        Table of the loads.
    """

    x: np.ndarray
    load: np.ndarray
    torque: np.ndarray
    trajectory: np.ndarray
    loads: pd.DataFrame


def package(rows, return_X_y, as_frame, descriptors=(), **extra):
    """Bunch or pair of arrays or frames.

    Parameters
    ----------
    rows : Rows
        The samples.
    return_X_y : bool
        Whether to return a pair.
    as_frame : bool
        Whether data and target are frames.
    descriptors : sequence of str, default=()
        Columns of the table of loads that come before the load.
    **extra : object
        Further entries of the Bunch.

    Returns
    -------
    data : Bunch or tuple of length 2
        As `return_X_y` says.
    """
    frame, names = None, [*STATE_NAMES, *descriptors, "load"]
    described = _described(rows, descriptors)
    if as_frame:
        frame = _frame(rows, described)
        data, target = frame[names], frame[TARGET_NAMES]
    else:
        load = rows.load.astype(float)
        data, target = np.column_stack([rows.x, described, load]), rows.torque
    if return_X_y:
        return data, target
    return Bunch(
        data=data,
        target=target,
        frame=frame,
        feature_names=names,
        target_names=list(TARGET_NAMES),
        trajectory=rows.trajectory,
        loads=rows.loads,
        DESCR=_description(),
        **extra,
    )


def _described(rows, descriptors):
    """What describes the load of each row, a frame."""
    missing = [name for name in descriptors if name not in rows.loads]
    if missing:
        raise ValueError(
            f"descriptors has {missing}, which the loads lack: they have "
            f"{rows.loads.columns.tolist()}."
        )
    table = rows.loads[list(descriptors)].iloc[rows.load - 1]
    return table.reset_index(drop=True)


def _frame(rows, described):
    frame = pd.DataFrame(rows.x, columns=STATE_NAMES).join(described)
    categories = load_labels(len(rows.loads))
    frame["load"] = pd.Categorical.from_codes(rows.load - 1, categories)
    return pd.concat([frame, pd.DataFrame(rows.torque, columns=TARGET_NAMES)], axis=1)


def _description():
    folder = resources.files("skmtgp.datasets") / "descr"
    return (folder / "puma560.rst").read_text(encoding="utf-8")
