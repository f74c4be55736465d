"""From rows of the data to what scikit-learn's loaders return."""

from importlib import resources
from typing import NamedTuple

import numpy as np
import pandas as pd
from sklearn.utils import Bunch

from ._loads import load_labels
from ._robot import N_JOINTS

_JOINTS = range(1, N_JOINTS + 1)
STATE_NAMES = [f"{name}{j}" for name in ("q", "qd", "qdd") for j in _JOINTS]
FEATURE_NAMES = [*STATE_NAMES, "load"]
TARGET_NAMES = [f"tau{j}" for j in _JOINTS]


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


def package(rows, return_X_y, as_frame, **extra):
    """Bunch or pair of arrays or frames.

    Parameters
    ----------
    rows : Rows
        The samples.
    return_X_y : bool
        Whether to return a pair.
    as_frame : bool
        Whether data and target are frames.
    **extra : object
        Further entries of the Bunch.

    Returns
    -------
    data : Bunch or tuple of length 2
        As `return_X_y` says.
    """
    frame = None
    if as_frame:
        frame = _frame(rows)
        data, target = frame[FEATURE_NAMES], frame[TARGET_NAMES]
    else:
        data, target = np.column_stack([rows.x, rows.load.astype(float)]), rows.torque
    if return_X_y:
        return data, target
    return Bunch(
        data=data,
        target=target,
        frame=frame,
        feature_names=list(FEATURE_NAMES),
        target_names=list(TARGET_NAMES),
        trajectory=rows.trajectory,
        loads=rows.loads,
        DESCR=_description(),
        **extra,
    )


def _frame(rows):
    frame = pd.DataFrame(rows.x, columns=STATE_NAMES)
    categories = load_labels(len(rows.loads))
    frame["load"] = pd.Categorical.from_codes(rows.load - 1, categories)
    return pd.concat([frame, pd.DataFrame(rows.torque, columns=TARGET_NAMES)], axis=1)


def _description():
    folder = resources.files("skmtgp.datasets") / "descr"
    return (folder / "puma560.rst").read_text(encoding="utf-8")
