"""Checks of the loaders' arguments; each error names the value and the fix."""

from numbers import Integral

import numpy as np
from numpy.typing import NDArray

from ._split import SUBSETS


def check_flag(name, value):
    """Refuse anything but a bool.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : object
        Its value.

    Returns
    -------
    value : bool
        As a Python bool.

    Raises
    ------
    TypeError
        If it is no bool.
    """
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {value!r}.")
    return bool(value)


def check_count(name, value):
    """Refuse anything but a whole number from 1.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : object
        Its value.

    Returns
    -------
    value : int
        As a Python int.

    Raises
    ------
    TypeError
        If it is no whole number.
    ValueError
        If it is below 1.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} must be a whole number, got {value!r}.")
    if value < 1:
        raise ValueError(f"{name}={value} is too small; give at least 1.")
    return int(value)


def check_seed(seed):
    """Refuse a random_state that cannot name a file.

    Parameters
    ----------
    seed : object
        Value of ``random_state``.

    Returns
    -------
    seed : int
        As a Python int.

    Raises
    ------
    TypeError
        If it is no whole number.
    ValueError
        If it is negative or above 2**32 - 1.
    """
    if not isinstance(seed, Integral) or isinstance(seed, bool):
        raise TypeError(
            f"random_state must be a whole number, got {seed!r}: the data are stored "
            "under it. make_puma560 takes anything."
        )
    if not 0 <= seed < 2**32:
        raise ValueError(f"random_state={seed} must be between 0 and 2**32 - 1.")
    return int(seed)


def check_numbers(
    name, value, shape, positive=False, repeat=False
) -> NDArray[np.float64]:
    """Finite numbers of a shape.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : array-like
        Its value.
    shape : tuple of (int or None)
        Lengths wanted; None is any from 1.
    positive : bool, default=False
        Whether all must be above 0.
    repeat : bool, default=False
        Whether a single number may stand for all.

    Returns
    -------
    numbers : ndarray
        Of floats.

    Raises
    ------
    TypeError
        If they are no numbers.
    ValueError
        If the shape or a number is wrong.

    Examples
    --------
    >>> from skmtgp.datasets._checks import check_numbers
    >>> check_numbers("noise", 0.5, (2,), repeat=True).tolist()
    [0.5, 0.5]
    """
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must hold numbers, got {value!r}.") from error
    if repeat and numbers.ndim == 0:
        numbers = np.full(shape, numbers)
    if not _fits(numbers.shape, shape):
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise ValueError(f"{name} has shape {numbers.shape}; give ({wanted}).")
    bad = ~np.isfinite(numbers) | (positive & ~(numbers > 0))
    if bad.any():
        kind = "finite, positive" if positive else "finite"
        raise ValueError(f"{name} holds {numbers[bad][0]}; give {kind} numbers.")
    return numbers


def _fits(shape, wanted):
    return len(shape) == len(wanted) and all(
        got == n or (n is None and got > 0)
        for got, n in zip(shape, wanted, strict=True)
    )


def check_ranges(name, value, shape, positive=False):
    """Pairs of a lower and an upper end.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : array-like
        Its value.
    shape : tuple of int
        Its shape, the last length 2.
    positive : bool, default=False
        Whether all must be above 0.

    Returns
    -------
    ranges : ndarray
        Of floats.

    Raises
    ------
    TypeError
        If they are no numbers.
    ValueError
        If the shape or a number is wrong, or a lower end is above its upper one.
    """
    ranges = check_numbers(name, value, shape, positive)
    if (ranges[..., 0] > ranges[..., 1]).any():
        raise ValueError(
            f"{name}={value!r} has a lower end above the upper; swap them."
        )
    return ranges


def check_subset(subset):
    """Refuse the name of an unknown subset.

    Parameters
    ----------
    subset : object
        The name.

    Returns
    -------
    subset : str
        The same.

    Raises
    ------
    ValueError
        If there is no such subset.
    """
    if not isinstance(subset, str) or subset not in SUBSETS:
        raise ValueError(f"subset={subset!r} is unknown; give one of {SUBSETS}.")
    return subset


def check_loads(loads, n_loads):
    """Numbers of the loads asked for.

    Parameters
    ----------
    loads : sequence of (int or str) or None
        Numbers from 1 or names such as ``"c3"``; None is all.
    n_loads : int
        How many there are.

    Returns
    -------
    numbers : list of int
        In the order given.

    Raises
    ------
    TypeError
        If it is no sequence.
    ValueError
        If one is unknown or given twice, or there is none.

    Examples
    --------
    >>> from skmtgp.datasets._checks import check_loads
    >>> check_loads(["c3", 1], 15)
    [3, 1]
    """
    if loads is None:
        return list(range(1, n_loads + 1))
    if isinstance(loads, str) or not np.iterable(loads):
        raise TypeError(
            f"loads must be a list of loads, got {loads!r}; give [{loads!r}]."
        )
    numbers = [_load_number(load, n_loads) for load in loads]
    if not numbers or len(set(numbers)) < len(numbers):
        raise ValueError(
            f"loads={list(loads)!r} must hold at least one load, and each only once."
        )
    return numbers


def _load_number(load, n_loads):
    known = {f"c{m}": m for m in range(1, n_loads + 1)}
    is_number = isinstance(load, Integral) and not isinstance(load, bool)
    name = f"c{load}" if is_number else load
    if not isinstance(name, str) or name not in known:
        raise ValueError(
            f"loads holds {load!r}, which is none of the loads; give whole numbers "
            f"1..{n_loads} or names 'c1'..'c{n_loads}'."
        )
    return known[name]


def check_n_per_load(n_per_load, available, subset, hint=""):
    """Rows to take of each load.

    Parameters
    ----------
    n_per_load : int or None
        Rows asked for; None is all.
    available : int
        Rows there are.
    subset : str
        Name of the subset, for the message.
    hint : str, default=""
        Where more are to be had.

    Returns
    -------
    n_per_load : int
        Rows to take.

    Raises
    ------
    TypeError
        If it is no whole number.
    ValueError
        If it is below 1 or more than there are.
    """
    if n_per_load is None:
        return available
    n_per_load = check_count("n_per_load", n_per_load)
    if n_per_load > available:
        raise ValueError(
            f"n_per_load={n_per_load} is more than the {available} rows that each load "
            f"has in subset={subset!r}; give at most {available}{hint}."
        )
    return n_per_load
