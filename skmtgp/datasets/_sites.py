"""Simulated measurements at several sites, for examples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Integral
from typing import Any, Literal, overload

import numpy as np
import pandas as pd
from sklearn.utils import check_random_state

# The curve of a day is the same at all sites, but for a level and a factor.
LEVEL = {"north": 2.0, "east": 0.0, "south": -1.0, "west": 1.0, "hill": 4.0}
FACTOR = {"north": 1.0, "east": 1.5, "south": 0.6, "west": -0.8, "hill": 2.0}


@overload
def make_sites(
    n_per_site: Sequence[int] = (30, 20, 12, 7, 4),
    *,
    noise: float = 0.15,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: Literal[False] = False,
) -> tuple[pd.DataFrame, pd.Series]: ...


@overload
def make_sites(
    n_per_site: Sequence[int] = (30, 20, 12, 7, 4),
    *,
    noise: float = 0.15,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: Literal[True],
) -> tuple[pd.DataFrame, pd.Series, Callable[[pd.DataFrame], pd.Series]]: ...


@overload
def make_sites(
    n_per_site: Sequence[int] = (30, 20, 12, 7, 4),
    *,
    noise: float = 0.15,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: bool,
) -> tuple[Any, ...]: ...


def make_sites(
    n_per_site: Sequence[int] = (30, 20, 12, 7, 4),
    *,
    noise: float = 0.15,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: bool = False,
) -> (
    tuple[pd.DataFrame, pd.Series]
    | tuple[pd.DataFrame, pd.Series, Callable[[pd.DataFrame], pd.Series]]
):
    """Simulate measurements at five sites that have much in common.

    All sites have the same course over a day, each with its own level and its own
    factor. Some have many measurements, some few.

    Parameters
    ----------
    n_per_site : sequence of five ints, default=(30, 20, 12, 7, 4)
        Number of measurements at "north", "east", "south", "west" and "hill".
    noise : float, default=0.15
        Standard deviation of the error of a measurement.
    random_state : int, RandomState or None, default=0
        Source of the hours and the errors.
    return_truth : bool, default=False
        Whether to return the function without errors, too.

    Returns
    -------
    X : DataFrame of shape (n_samples, 2)
        Columns "site" (str) and "hour", from 0 to 24.
    y : Series of shape (n_samples,)
        Measurements, named "value".
    truth : callable
        Function that returns the values without errors for a frame such as X. Only if
        `return_truth`.

    Raises
    ------
    ValueError
        If there are not five numbers of 0 or more, or if `noise` is negative.

    Examples
    --------
    >>> from skmtgp.datasets import make_sites
    >>> X, y = make_sites()
    >>> X["site"].value_counts().to_dict()
    {'north': 30, 'east': 20, 'south': 12, 'west': 7, 'hill': 4}
    """
    n_per_site = list(n_per_site)
    whole = all(isinstance(n, Integral) and n >= 0 for n in n_per_site)
    if len(n_per_site) != len(LEVEL) or not whole:
        raise ValueError(
            f"n_per_site={n_per_site} must be five integers of 0 or more, one for each "
            f"of {list(LEVEL)}."
        )
    if not noise >= 0.0:
        raise ValueError(f"noise={noise} must be 0 or more.")
    rng = check_random_state(random_state)
    X = pd.DataFrame({"site": np.repeat(list(LEVEL), n_per_site)})
    X["hour"] = rng.uniform(0.0, 24.0, len(X))
    y = _truth(X) + noise * rng.standard_normal(len(X))
    y = y.rename("value")
    return (X, y, _truth) if return_truth else (X, y)


def _truth(X):
    """Values without error."""
    course = np.sin(X["hour"] * (2.0 * np.pi / 24.0))
    return X["site"].map(LEVEL) + X["site"].map(FACTOR) * course
