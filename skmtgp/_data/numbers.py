"""Numbers of features and targets: checked, and named where they cannot be used."""

import re
from datetime import date, timedelta
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.sparse import issparse
from sklearn.utils import check_array

MOST = 5  # columns that an error names
DATES = date, timedelta, pd.Period, np.datetime64, np.timedelta64
# Text that is no number: a date, with the year first or last, and 1,5
DATE = re.compile(r"\s*(\d{4}([-/.])\d\d?\2\d\d?|\d\d?([-/.])\d\d?\3\d{4})\b")
DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+\s*")
SINCE = (  # a day that is the same in fit and predict
    "to days since a fixed one for example: "
    "(pd.to_datetime(dates) - pd.Timestamp('2000-01-01'))"
)


def as_frame(values):
    """A frame as one of pandas with dense columns; anything else as it is.

    As one array its columns would get a common type: dates become integers, and
    integers floats. What is masked in an array is missing.

    Raises
    ------
    TypeError
        If its rows are still to be computed.
    """
    if type(values).__name__ == "LazyFrame":
        raise TypeError("A LazyFrame has no rows yet: pass what its .collect() gives.")
    if isinstance(values, pd.DataFrame):
        return _dense(values)
    if not hasattr(values, "columns"):
        return unmasked(values)
    if type(values).__module__.startswith("pyarrow"):  # its columns have no names
        return values.to_pandas()
    return pd.DataFrame({name: as_array(values[name]) for name in values.columns})


def unmasked(values):
    """A masked array as one with NaN for what is masked; anything else as it is.

    Arrays of numbers that are no floats become objects, which keep all digits.
    """
    if not isinstance(values, np.ma.MaskedArray):
        return values
    if not np.ma.is_masked(values):
        return np.ma.getdata(values)
    kept = values if values.dtype.kind == "f" else values.astype(object)
    return kept.filled(np.nan)


def _dense(frame):
    """The frame without sparse columns, as one-hot codes may be."""
    kinds = frame.dtypes.items()
    sparse = {
        of: kind.subtype for of, kind in kinds if isinstance(kind, pd.SparseDtype)
    }
    return frame.astype(sparse) if sparse else frame


def as_array(column):
    """A column as an array; NumPy alone gives the strings of polars a fixed width."""
    if hasattr(column, "to_numpy"):
        return column.to_numpy()
    return np.asarray(unmasked(column))


def check_numbers(values, name, columns=None, *, advise=None, estimator=None):
    """Numbers as float64, row after row in memory.

    Parameters
    ----------
    values : array-like of shape (n_samples,) or (n_samples, n_columns)
        What the user passed, or some columns of it.
    name : str
        What it is called in errors: "X" or "y", say.
    columns : sequence, default=None
        What its columns are called. None is the names of a frame, or positions.
    advise : callable, default=None
        Of the position of a column that holds text, what an error says beside that.
    estimator : estimator or str, default=None
        Is named in errors.

    Returns
    -------
    numbers : ndarray of the shape of values
        All finite.

    Raises
    ------
    ValueError
        If a value is missing, infinite, a date, a time or text that is no number. The
        column is named.
    """
    values = as_frame(values)
    if not (isinstance(values, (pd.DataFrame, pd.Series)) or issparse(values)):
        values = np.asarray(values)
    refuse_empty(name, values)
    if _are_plain(values):
        return by_rows(values)
    explain = partial(_explain, values, name, columns, advise)
    if _has_dates(values):  # alone, they would become numbers of some unit
        explain()
    try:
        numbers = check_array(
            values,
            ensure_2d=False,
            dtype=np.float64,
            input_name=name,
            estimator=estimator,
        )
    except (TypeError, ValueError):
        explain()
        raise
    return by_rows(numbers)


def _are_plain(values):
    """Whether this is an array of finite numbers, which needs no closer look."""
    if type(values) is not np.ndarray or values.dtype != np.float64:
        return False
    with np.errstate(over="ignore", invalid="ignore"):  # then it gets one
        return values.ndim in (1, 2) and values.size > 0 and np.isfinite(values.sum())


def by_rows(values):
    """The values, row after row in memory, as those of a frame are not.

    Sums over them are then rounded alike, and what is learned from a frame is what is
    learned from an array.
    """
    by_columns = values.ndim == 2 and values.strides[0] < values.strides[1]
    return np.ascontiguousarray(values) if by_columns else values


def refuse_empty(name, values):
    """Raise a ValueError where there are no rows."""
    shape = getattr(values, "shape", None)
    if isinstance(shape, tuple) and shape[:1] == (0,):
        raise ValueError(f"{name} has 0 sample(s) (shape={shape}): give at least 1.")


def column_names(values):
    """Names of the columns of a frame, or their positions."""
    if hasattr(values, "columns"):
        return list(values.columns)
    return list(range(values.shape[1])) if np.ndim(values) == 2 else [None]


def _has_dates(values):
    if isinstance(values, pd.DataFrame):
        return any(_has_dates(values.iloc[:, j]) for j in range(values.shape[1]))
    if values.dtype.kind != "O":
        return values.dtype.kind in "mM"
    kinds = set(map(type, np.asarray(values, dtype=object).ravel()))
    return any(issubclass(kind, DATES) for kind in kinds)


def _explain(values, name, columns, advise):
    """Raise an error that names the first column that cannot be used, if one can."""
    if issparse(values) or values.ndim not in (1, 2) or not len(values):
        return
    if isinstance(values, pd.DataFrame):
        parts = [values.iloc[:, j] for j in range(values.shape[1])]
    else:
        parts = np.asarray(values).reshape(len(values), -1).T
    if columns is None:
        columns = column_names(values)
    found = [
        (column, _bad_of(np.asarray(part), name, column, advise and partial(advise, k)))
        for k, (column, part) in enumerate(zip(columns, parts, strict=True))
    ]
    found = [(column, bad) for column, bad in found if bad]
    if found:
        _refuse_bad(name, len(values), *found)


class _Bad(NamedTuple):
    """Values of a column that are not finite."""

    what: str
    n: int
    first: int


def _bad_of(values, name, column, advise):
    """Those of a column, or None."""
    kind = values.dtype.kind
    if kind in "OSUTmM":
        for value in values.tolist() if kind in "SUT" else values:
            _check_value(value, name, column, advise)
        values = np.where(pd.isna(values), np.nan, values).astype(np.float64)
    elif kind != "f":
        return None
    bad = ~np.isfinite(values)
    if not bad.any():
        return None
    what = "NaN" if np.isnan(values).any() else "infinity"
    return _Bad(what, bad.sum(), bad.argmax())


def _refuse_bad(name, n, first, *others):
    column, bad = first
    where = "" if column is None else f" in column {column!r}"
    named = ", ".join(f"{other!r} ({of.n})" for other, of in others[:MOST])
    more = f"; more in columns {named}" if others else ""
    more += f" and {len(others) - MOST} others" * (len(others) > MOST)
    raise ValueError(
        f"Input {name} contains {bad.what}{where}: {bad.n} of {n} values, the first in "
        f"row {bad.first}{more}. Every value must be a finite number: impute those "
        "that are not, or leave their rows out."
    )


def _check_value(value, name, column, advise):
    """Raise an error where a value is neither a number nor missing."""
    subject = "Features" if name == "X" else name
    where = "" if column is None else f" column {column!r}"
    what = f"{subject} must be numbers, but{where} holds"
    if isinstance(value, (timedelta, np.timedelta64)):
        _refuse_dates(what, pd.Timedelta(value), "to days for example: durations")
    if isinstance(value, pd.Period):
        how = SINCE.replace("pd.to_datetime(dates)", "periods.dt.to_timestamp()")
        _refuse_dates(what, value, how)
    if isinstance(value, DATES):
        _refuse_dates(what, value)
    try:
        float(0 if value is None or value is pd.NA else value)
    except TypeError as error:
        raise TypeError(f"{what} {value!r}: {error}.") from error
    except ValueError as error:
        if DATE.match(str(value)):
            _refuse_dates(what, repr(value))
        advice = advise() if advise else ""
        if DECIMAL_COMMA.fullmatch(str(value)):
            advice = " Is that a decimal comma? Then read the table with decimal=','."
        raise ValueError(f"{what} strings such as {value!r}.{advice}") from error


def _refuse_dates(what, value, how=SINCE):
    """Raise a ValueError that says how to make numbers of dates or durations."""
    raise ValueError(
        f"{what} dates or times such as {value}. Convert it, {how} / "
        "pd.Timedelta(days=1)."
    )
