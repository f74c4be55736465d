"""A simulated survey of metals in the soil, for cokriging."""

from __future__ import annotations

from typing import Literal, overload

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.utils import check_random_state

from ._checks import check_count

SIDE = 5.0  # km
METALS = ["cadmium", "nickel", "zinc"]
LOG_MEANS = np.log([0.9, 18.0, 70.0])  # of ppm
# Two fields with exponential covariances of these lengths; each metal has its parts
LENGTHS = 1.5, 0.3  # km
PARTS = np.array([[0.35, 0.45, 0.30], [0.45, 0.05, 0.40]])
N_GRID = 41


@overload
def make_soil(
    n_samples: int = 180,
    *,
    n_cadmium: int = 60,
    noise: float = 0.1,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: Literal[False] = False,
) -> pd.DataFrame: ...


@overload
def make_soil(
    n_samples: int = 180,
    *,
    n_cadmium: int = 60,
    noise: float = 0.1,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: Literal[True],
) -> tuple[pd.DataFrame, pd.DataFrame]: ...


@overload
def make_soil(
    n_samples: int = 180,
    *,
    n_cadmium: int = 60,
    noise: float = 0.1,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: bool,
) -> pd.DataFrame | tuple[pd.DataFrame, pd.DataFrame]: ...


def make_soil(
    n_samples: int = 180,
    *,
    n_cadmium: int = 60,
    noise: float = 0.1,
    random_state: int | np.random.RandomState | None = 0,
    return_truth: bool = False,
) -> pd.DataFrame | tuple[pd.DataFrame, pd.DataFrame]:
    """Simulate a survey of three metals in the soil of 5 km by 5 km.

    Nickel and zinc are measured at all places, cadmium only at some of them. The metals
    have two sources. The rock changes over kilometres and contains all three. Spills
    change over a few hundred metres; they contain cadmium and zinc, but hardly any
    nickel.

    Parameters
    ----------
    n_samples : int, default=180
        Number of places.
    n_cadmium : int, default=60
        Number of places where cadmium is measured, too. They come first.
    noise : float, default=0.1
        Standard deviation of the error of a logarithm; 0.1 is about 10 %.
    random_state : int, RandomState or None, default=0
        Source of the fields, the places and the errors.
    return_truth : bool, default=False
        Whether to return the true concentrations on a grid, too.

    Returns
    -------
    survey : DataFrame of shape (n_samples, 5)
        Columns "east" and "north" in km, and "cadmium", "nickel" and "zinc" in ppm,
        with NaN where cadmium is not measured. :func:`skmtgp.stack_tasks` turns them
        into tasks.
    truth : DataFrame of shape (1681, 5)
        The same columns, without error, on a grid of 41 by 41 places, row after row
        from the south. Only if `return_truth`.

    Raises
    ------
    ValueError
        If a count is less than 1, if `n_cadmium` is above `n_samples`, or if `noise` is
        negative.

    Notes
    -----
    The logarithms are drawn from a linear model of coregionalisation. It has two
    structures of rank 1 with exponential covariances, and a nugget that is measurement
    error.

    Examples
    --------
    >>> from skmtgp.datasets import make_soil
    >>> make_soil(100, n_cadmium=25).count().to_dict()
    {'east': 100, 'north': 100, 'cadmium': 25, 'nickel': 100, 'zinc': 100}
    """
    check_count("n_samples", n_samples)
    check_count("n_cadmium", n_cadmium)
    if n_cadmium > n_samples:
        raise ValueError(
            f"n_cadmium={n_cadmium} is more than n_samples={n_samples}: cadmium is "
            "measured at some of the places."
        )
    if not noise >= 0.0:
        raise ValueError(f"noise={noise} must be 0 or more.")
    rng = check_random_state(random_state)
    side = np.linspace(0.0, SIDE, N_GRID)
    north, east = map(np.ravel, np.meshgrid(side, side, indexing="ij"))
    grid = np.column_stack([east, north])
    places = np.vstack([grid, rng.uniform(0.0, SIDE, (n_samples, 2))])
    logs = LOG_MEANS + _fields(places, rng) @ PARTS
    truth, sampled = np.split(logs, [len(grid)])
    sampled = sampled + noise * rng.standard_normal(sampled.shape)
    survey = _frame(places[len(grid) :], sampled)
    survey.loc[n_cadmium:, "cadmium"] = np.nan
    return (survey, _frame(grid, truth)) if return_truth else survey


def _fields(places: NDArray, rng: np.random.RandomState) -> NDArray:
    """Values of the two random fields, of shape (n_places, 2)."""
    distance = np.linalg.norm(places[:, None] - places, axis=2)
    tiny = 1e-9 * np.eye(len(places))  # for the digits of the factor
    return np.column_stack(
        [
            np.linalg.cholesky(np.exp(-distance / length) + tiny)
            @ rng.standard_normal(len(places))
            for length in LENGTHS
        ]
    )


def _frame(places: NDArray, logs: NDArray) -> pd.DataFrame:
    """Places and concentrations."""
    frame = pd.DataFrame(places, columns=["east", "north"])
    frame[METALS] = np.exp(logs)
    return frame
