"""Arguments of the loaders that say nothing of the type of what is returned.

Type checkers read them in the overloads of each loader, which are then short.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Literal, TypedDict

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike


class Loading(TypedDict, total=False):
    """Of `load_puma560`."""

    subset: Literal["train", "interpolation", "extrapolation"]
    n_per_load: int | None
    loads: Sequence[int | str] | None
    descriptors: Sequence[str] | None


class Fetching(Loading, total=False):
    """Of `fetch_puma560`."""

    data_home: str | PathLike[str] | None
    random_state: int


class Making(TypedDict, total=False):
    """Of `make_puma560`."""

    n_samples: int
    n_loads: int | None
    masses: ArrayLike | None
    loads: pd.DataFrame | None
    side_range: ArrayLike
    centre_range: ArrayLike
    paths: ArrayLike
    speeds: ArrayLike
    eight: ArrayLike
    tool: Literal["fixed", "moving"]
    tool_pitch: float
    tool_swing: ArrayLike
    friction: bool
    stribeck: float
    stribeck_speed: float
    load_friction: float
    stiffness: ArrayLike | None
    noise: ArrayLike
    random_state: np.random.RandomState | int | None
    descriptors: Sequence[str] | None


class Recorded(TypedDict, total=False):
    """Of `fetch_kinova_gen3`."""

    recordings: Sequence[str] | None
    cutoff: float
    rate: float
    data_home: str | PathLike[str] | None
    download_if_missing: bool
    n_retries: int
    delay: float
