"""A real robot: recordings of a Kinova Gen3, downloaded from their public source."""

from __future__ import annotations

import io
from collections.abc import Sequence
from importlib import resources
from numbers import Integral
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple, Unpack, overload

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.datasets import get_data_home
from sklearn.utils import Bunch

from ._checks import check_flag
from ._download import fetch_file
from ._options import Recorded
from ._recordings import prepare_trajectory

REVISION = "ff2f3becf7b0f25d4959491404844a29a27d286b"
ADDRESS = "https://raw.githubusercontent.com/SedkiLmm/dynamic-identification"
N_JOINTS = 7
STEP = 1e-3  # seconds between two rows, which count them


class Remote(NamedTuple):
    """A file of the repository: its path there, and its SHA-256."""

    path: str
    sha256: str


_FOLDER = "data/kinova/identification_data/"
RECORDINGS = {
    "quadratic": Remote(
        _FOLDER + "RecordTrajectory_quadratic.csv",
        "82b68faf7b12f73f83e82acb6b6660b5cae28c702058f58269c87718f7ee9ed7",
    ),
    "run": Remote(
        _FOLDER + "RunTrajectory1.csv",
        "2389fbfa1149c7d8884a8a7433fdeaf4cd655f781ae2a8cbb9562a7101e309df",
    ),
    "repeated": Remote(
        _FOLDER + "Trajectory1.csv",
        "3a90a0ed7b88daafd1eb349e08a1a3d50b91cacc000aa7f587016268af76c7e6",
    ),
}
URDF = Remote(
    "exemple/kinova/gen3.urdf",
    "798b384976d9e847f8896e29ac58b0581c1dbcb6bad2d5d8ed9474841b38e1f8",
)
_JOINTS = range(1, N_JOINTS + 1)
FEATURE_NAMES = [f"{name}{j}" for name in ("q", "qd", "qdd") for j in _JOINTS]
TARGET_NAMES = [f"tau{j}" for j in _JOINTS]


@overload
def fetch_kinova_gen3(
    *,
    return_X_y: Literal[False] = False,
    as_frame: bool = False,
    **others: Unpack[Recorded],
) -> Bunch: ...


@overload
def fetch_kinova_gen3(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[False] = False,
    **others: Unpack[Recorded],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...


@overload
def fetch_kinova_gen3(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[True],
    **others: Unpack[Recorded],
) -> tuple[pd.DataFrame, pd.DataFrame]: ...


@overload
def fetch_kinova_gen3(
    *, return_X_y: bool, as_frame: bool = False, **others: Unpack[Recorded]
) -> Bunch | Any: ...  # not tuple: callers would have to rule it out


def fetch_kinova_gen3(
    *,
    recordings: Sequence[str] | None = None,
    cutoff: float = 10.0,
    rate: float = 100.0,
    data_home: str | PathLike[str] | None = None,
    download_if_missing: bool = True,
    n_retries: int = 3,
    delay: float = 1.0,
    return_X_y: bool = False,
    as_frame: bool = False,
) -> Bunch | Any:
    """Fetch recordings of a Kinova Gen3, a real robot arm (multi-output regression).

    These are states and torques of seven joints without a load, filtered and
    differentiated by :func:`prepare_trajectory`. They are downloaded once, 5 MB, from a
    fixed revision of the public repository [1]_, and kept in scikit-learn's data home.
    The repository has an MIT licence.

    =================   =============================
    Samples total       765, at 100 a second
    Dimensionality      21, and the load, of one kind
    Targets             7 torques
    =================   =============================

    Parameters
    ----------
    recordings : list of {"quadratic", "run", "repeated"}, default=None
        Recordings to return, in this order. "run" and "repeated" are the same motion of
        1.9 s, recorded twice. "quadratic" is another motion of 4.9 s. None is all.
    cutoff : float, default=10
        Cutoff frequency of the filter, Hz, see :func:`prepare_trajectory`.
    rate : float, default=100
        Samples per second to keep, of the 1000 that were recorded.
    data_home : str or path-like, default=None
        Folder of the downloaded files. None is
        :func:`sklearn.datasets.get_data_home`.
    download_if_missing : bool, default=True
        Whether to download missing files. False raises an OSError instead.
    n_retries : int, default=3
        Number of retries if an address does not answer.
    delay : float, default=1.0
        Seconds between retries.
    return_X_y : bool, default=False
        Whether to return ``(data, target)`` instead of a Bunch.
    as_frame : bool, default=False
        Whether data and target are pandas frames.

    Returns
    -------
    data : :class:`~sklearn.utils.Bunch`
        Dictionary-like object, with the following attributes. The rows are in order of
        recording and time.

        data : {ndarray, DataFrame} of shape (n_rows, 22)
            q1..q7 (rad), qd1..qd7 (rad/s), qdd1..qdd7 (rad/s^2), load, which is 1.
        target : {ndarray, DataFrame} of shape (n_rows, 7)
            Torques tau1..tau7 of the motors' currents, N m.
        frame : DataFrame of shape (n_rows, 29)
            Data and target; None unless ``as_frame=True``.
        feature_names, target_names : list of str
            Names of the columns.
        recording : ndarray of shape (n_rows,)
            Its name.
        time : ndarray of shape (n_rows,)
            Seconds since the recording began.
        urdf : str
            The robot's description, XML, which the repository has beside them.
        DESCR : str
            Description of the data.

    (data, target) : tuple if ``return_X_y`` is True
        The first two.

    Raises
    ------
    OSError
        If the files are not there and cannot be downloaded.
    TypeError, ValueError
        If an argument is wrong.

    Warns
    -----
    UserWarning
        If a kept file is damaged and downloaded again, if an address does not answer
        at once, or if the files cannot be kept.

    See Also
    --------
    fetch_puma560 : A simulated robot under fifteen loads.
    prepare_trajectory : The same preparation, of recordings of your own.

    References
    ----------
    .. [1] "Robotic Dynamics Identification Toolkit",
       https://github.com/SedkiLmm/dynamic-identification

    Examples
    --------
    >>> from skmtgp.datasets import fetch_kinova_gen3
    >>> kinova = fetch_kinova_gen3(recordings=["run"])
    >>> kinova.data.shape, kinova.target.shape
    ((155, 22), (155, 7))
    """
    return_X_y = check_flag("return_X_y", return_X_y)
    as_frame = check_flag("as_frame", as_frame)
    download = check_flag("download_if_missing", download_if_missing)
    names = _check_recordings(recordings)
    if not isinstance(n_retries, Integral) or n_retries < 0:
        raise ValueError(f"n_retries={n_retries!r} must be a whole number from 0.")
    options = {"download": download, "n_retries": n_retries, "delay": delay}
    folder = Path(get_data_home(data_home)) / f"kinova_gen3_{REVISION[:7]}"
    frames = []
    for name in names:
        content = _fetch(folder, RECORDINGS[name], options)
        frames.append(_prepare(content, cutoff, rate).assign(recording=name))
    frame = pd.concat(frames, ignore_index=True)
    X = frame[FEATURE_NAMES].assign(load=1)
    y = frame[TARGET_NAMES]
    if not as_frame:
        X, y = X.to_numpy(dtype=float), y.to_numpy()
    if return_X_y:
        return X, y
    return Bunch(
        data=X,
        target=y,
        frame=pd.concat([X, y], axis=1) if as_frame else None,
        feature_names=[*FEATURE_NAMES, "load"],
        target_names=list(TARGET_NAMES),
        recording=frame["recording"].to_numpy(dtype=object),
        time=frame["time"].to_numpy(),
        urdf=_fetch(folder, URDF, options).decode(),
        DESCR=_description(),
    )


def _fetch(folder, remote, options):
    """Content of a file of the repository."""
    url = f"{ADDRESS}/{REVISION}/{remote.path}"
    return fetch_file(url, folder / Path(remote.path).name, remote.sha256, **options)


def _prepare(content, cutoff, rate):
    """States and torques of a recording."""
    raw = pd.read_csv(io.BytesIO(content))
    q, qd, tau = (
        raw[[f"{name}{j}" for j in _JOINTS]].to_numpy()
        for name in ("Position", "Velocity", "TorqueCur")
    )
    time = STEP * np.arange(len(raw))
    return prepare_trajectory(time, q, tau, qd, cutoff=cutoff, rate=rate)


def _check_recordings(recordings):
    if recordings is None:
        return list(RECORDINGS)
    names = [recordings] if isinstance(recordings, str) else list(recordings)
    known = ", ".join(map(repr, RECORDINGS))
    for name in names:
        if name not in RECORDINGS:
            raise ValueError(f"recordings has {name!r}; there are {known}.")
    if not names or len(set(names)) < len(names):
        raise ValueError(f"recordings={recordings!r} must name each once, of {known}.")
    return names


def _description():
    folder = resources.files("skmtgp.datasets") / "descr"
    return (folder / "kinova_gen3.rst").read_text(encoding="utf-8")
