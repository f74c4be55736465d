"""The paper's Puma 560 data: all of it, and the bundled part."""

from collections.abc import Sequence
from importlib import resources
from os import PathLike
from typing import Any, Literal, Unpack, overload

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.utils import Bunch

from . import _store as store
from ._bunch import Rows, check_descriptors, package
from ._checks import check_flag, check_loads, check_n_per_load, check_seed, check_subset
from ._loads import N_LOADS
from ._options import Fetching, Loading
from ._split import subset_rows
from ._trajectories import N_SAMPLES
from ._whole import LABELS, loads_table, select_rows, stored_arrays

BUNDLED = "the bundled Puma 560 data, seed 0"


@overload
def fetch_puma560(
    *,
    return_X_y: Literal[False] = False,
    as_frame: bool = False,
    **others: Unpack[Fetching],
) -> Bunch: ...


@overload
def fetch_puma560(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[False] = False,
    **others: Unpack[Fetching],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...


@overload
def fetch_puma560(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[True],
    **others: Unpack[Fetching],
) -> tuple[pd.DataFrame, pd.DataFrame]: ...


@overload
def fetch_puma560(
    *, return_X_y: bool, as_frame: bool = False, **others: Unpack[Fetching]
) -> Bunch | Any: ...  # not tuple: callers would have to rule it out


def fetch_puma560(
    *,
    subset: Literal["train", "interpolation", "extrapolation"] = "train",
    n_per_load: int | None = None,
    loads: Sequence[int | str] | None = None,
    data_home: str | PathLike[str] | None = None,
    random_state: int = 0,
    descriptors: Sequence[str] | None = None,
    return_X_y: bool = False,
    as_frame: bool = False,
) -> Bunch | Any:
    """Fetch the Puma 560 inverse dynamics data (multi-task regression).

    These are the 960,000 samples of [1]_, section 6: 15 loads, 16 trajectories and 4000
    samples each, with the paper's training and test sets. They are not downloaded.
    :func:`make_puma560` makes them once, and they are kept in scikit-learn's data home.
    Only making them needs Pinocchio.

    =================   ==================================
    Samples total       960,000
    Rows of a load      4000 / 4000 / 60,000 (by `subset`)
    Dimensionality      18, and the load
    Targets             6 torques
    =================   ==================================

    Parameters
    ----------
    subset : {"train", "interpolation", "extrapolation"}, default="train"
        "train" has 2000 random samples of the trajectory (p2, s3) and 2000 of the
        load's own trajectory, Table 1 of [1]_. "interpolation" has the other samples of
        these two. "extrapolation" has all samples of the load that are not in "train".
    n_per_load : int, default=None
        Number of rows of each load. They are in random order, so the first n are a
        random subset, and larger subsets contain smaller ones. None is all.
    loads : list of (int or str), default=None
        Loads to keep, as numbers 1..15 or names "c1".."c15", in this order. None
        is all. The multi-task experiments of [1]_ leave out c15.
    data_home : str or path-like, default=None
        Folder of the stored data. None is :func:`sklearn.datasets.get_data_home`.
    random_state : int, default=0
        Seed of the loads and the sets. Each value has its own stored file of 55 MB.
    descriptors : sequence of str, "inertial" or None, default=None
        Columns of the table `loads` that come before the load in the data, such as
        ``["mass"]``. "inertial" means the ten inertial parameters. Use them as
        `task_descriptors` of a MultiTaskGPRegressor.
    return_X_y : bool, default=False
        Whether to return ``(data, target)`` instead of a Bunch.
    as_frame : bool, default=False
        Whether data and target are pandas frames; the load is then a categorical
        ``"c1"`` to ``"c15"``.

    Returns
    -------
    data : :class:`~sklearn.utils.Bunch`
        Dictionary-like object, with the following attributes. The rows are
        grouped by load.

        data : {ndarray, DataFrame} of shape (n_rows, 19 + n_descriptors)
            q1..q6 (rad), qd1..qd6 (rad/s), qdd1..qdd6 (rad/s^2), descriptors,
            load (1..15).
        target : {ndarray, DataFrame} of shape (n_rows, 6)
            Torques tau1..tau6, N m.
        frame : DataFrame of shape (n_rows, 25 + n_descriptors)
            Data and target; None unless ``as_frame=True``.
        feature_names, target_names : list of str
            Names of the columns.
        trajectory : ndarray of shape (n_rows,)
            Path and speed, such as "p2s3".
        loads : DataFrame of shape (15, 21)
            Mass (kg), centre (m), sides (m), attitude (unit quaternion) and the
            ten inertial parameters (kg, kg m, kg m^2) of each load in frame 6.
        DESCR : str
            Description of the data.

    (data, target) : tuple if ``return_X_y`` is True
        The first two.

    Raises
    ------
    ImportError
        If the data must be made and Pinocchio is not installed.
    TypeError, ValueError
        If an argument is wrong.

    Warns
    -----
    UserWarning
        If the stored file is damaged or from another version, and is made again. If the
        data cannot be stored; they are still returned.

    See Also
    --------
    load_puma560 : The first rows of these sets, without Pinocchio.
    make_puma560 : The same robot with other loads, paths or noise.

    References
    ----------
    .. [1] K. M. A. Chai, C. K. I. Williams, S. Klanke, S. Vijayakumar,
       "Multi-task Gaussian Process Learning of Robot Inverse Dynamics",
       NIPS 2008.

    Examples
    --------
    >>> from skmtgp.datasets import fetch_puma560
    >>> X, y = fetch_puma560(
    ...     n_per_load=20, loads=range(1, 15), return_X_y=True
    ... )
    >>> X.shape, y.shape
    ((280, 19), (280, 6))
    """
    return_X_y = check_flag("return_X_y", return_X_y)
    as_frame = check_flag("as_frame", as_frame)
    descriptors = check_descriptors(descriptors)
    subset = check_subset(subset)
    seed = check_seed(random_state)
    numbers = check_loads(loads, N_LOADS)
    orders = [subset_rows(subset, m, LABELS, N_SAMPLES, seed) for m in numbers]
    n_per_load = check_n_per_load(n_per_load, len(orders[0]), subset)
    arrays = stored_arrays(data_home, seed)
    rows = select_rows(arrays, numbers, [order[:n_per_load] for order in orders])
    return package(rows, return_X_y, as_frame, descriptors)


@overload
def load_puma560(
    *,
    return_X_y: Literal[False] = False,
    as_frame: bool = False,
    **others: Unpack[Loading],
) -> Bunch: ...


@overload
def load_puma560(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[False] = False,
    **others: Unpack[Loading],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...


@overload
def load_puma560(
    *,
    return_X_y: Literal[True],
    as_frame: Literal[True],
    **others: Unpack[Loading],
) -> tuple[pd.DataFrame, pd.DataFrame]: ...


@overload
def load_puma560(
    *, return_X_y: bool, as_frame: bool = False, **others: Unpack[Loading]
) -> Bunch | Any: ...  # not tuple: callers would have to rule it out


def load_puma560(
    *,
    subset: Literal["train", "interpolation", "extrapolation"] = "train",
    n_per_load: int | None = None,
    loads: Sequence[int | str] | None = None,
    descriptors: Sequence[str] | None = None,
    return_X_y: bool = False,
    as_frame: bool = False,
) -> Bunch | Any:
    """Load the bundled part of the Puma 560 inverse dynamics data.

    These are the first rows of each set of ``fetch_puma560(random_state=0)``. Loading
    needs neither Pinocchio nor a network.

    =================   ==================================
    Rows of a load      200 / 180 / 340 (by `subset`)
    Dimensionality      18, and the load
    Targets             6 torques
    =================   ==================================

    Parameters
    ----------
    subset : {"train", "interpolation", "extrapolation"}, default="train"
        Which of the paper's sets, see :func:`fetch_puma560`.
    n_per_load : int, default=None
        Number of rows of each load. They are in random order, so the first n are a
        random subset, and larger subsets contain smaller ones. None is all.
    loads : list of (int or str), default=None
        Loads to keep, as numbers 1..15 or names "c1".."c15", in this order. None
        is all.
    descriptors : sequence of str, "inertial" or None, default=None
        Columns of the table `loads` that come before the load in the data, such as
        ``["mass"]``. "inertial" means the ten inertial parameters. Use them as
        `task_descriptors` of a MultiTaskGPRegressor.
    return_X_y : bool, default=False
        Whether to return ``(data, target)`` instead of a Bunch.
    as_frame : bool, default=False
        Whether data and target are pandas frames; the load is then a categorical
        ``"c1"`` to ``"c15"``.

    Returns
    -------
    data : :class:`~sklearn.utils.Bunch`
        Dictionary-like object with ``data`` of shape (n_rows, 19 + n_descriptors),
        ``target`` of shape (n_rows, 6), ``frame``, ``feature_names``, ``target_names``,
        ``trajectory``, ``loads`` and ``DESCR``, as :func:`fetch_puma560` has it.

    (data, target) : tuple if ``return_X_y`` is True
        The first two.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong.

    See Also
    --------
    fetch_puma560 : The whole data.
    make_puma560 : The same robot with other loads, paths or noise.

    Examples
    --------
    >>> from skmtgp.datasets import load_puma560
    >>> puma = load_puma560(n_per_load=20, loads=["c1", "c2"])
    >>> puma.data.shape, puma.target.shape
    ((40, 19), (40, 6))
    >>> puma.feature_names[:3], puma.target_names[:3]
    (['q1', 'q2', 'q3'], ['tau1', 'tau2', 'tau3'])

    With the mass of each load:

    >>> puma = load_puma560(n_per_load=20, loads=["c15"], descriptors=["mass"])
    >>> puma.feature_names[-3:], puma.data[0, -2:].tolist()
    (['qdd6', 'mass', 'load'], [3.0, 15.0])
    """
    return_X_y = check_flag("return_X_y", return_X_y)
    as_frame = check_flag("as_frame", as_frame)
    descriptors = check_descriptors(descriptors)
    subset = check_subset(subset)
    numbers = check_loads(loads, N_LOADS)
    with resources.as_file(bundled_path()) as path:
        arrays = store.read(path, BUNDLED)
    available = arrays[f"{subset}_x"].shape[1]
    hint = "; fetch_puma560 has more"
    n_per_load = check_n_per_load(n_per_load, available, subset, hint)
    rows = _first_rows(arrays, subset, numbers, n_per_load)
    return package(rows, return_X_y, as_frame, descriptors)


def bundled_path():
    """Where the bundled file is.

    Returns
    -------
    path : importlib.resources.abc.Traversable
        The npz file within the package.
    """
    return resources.files("skmtgp.datasets") / "data" / "puma560.npz"


def _first_rows(arrays, subset, numbers, n_per_load):
    """Rows of the bundled file."""
    x, torque, trajectory = (
        np.concatenate(
            [arrays[f"{subset}_{name}"][m - 1, :n_per_load] for m in numbers]
        )
        for name in ("x", "torque", "trajectory")
    )
    load = np.repeat(numbers, n_per_load)
    return Rows(x, load, torque, LABELS[trajectory], loads_table(arrays))
