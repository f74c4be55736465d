"""Calls of the fuzz: what they may raise, warn of and print."""

import contextlib
import io
import warnings

import numpy as np
from sklearn.exceptions import (
    ConvergenceWarning,
    NotFittedError,
    UndefinedMetricWarning,
)

from skmtgp import exceptions

ERRORS = ValueError, TypeError, NotFittedError, exceptions.InsufficientMemoryError
WARNINGS = (
    ConvergenceWarning,
    UndefinedMetricWarning,  # of r2_score, for a single row
    exceptions.AmbiguousFitWarning,
    exceptions.ConstantTargetWarning,
    exceptions.CorrelatedResidualsWarning,
    exceptions.DescriptorWarning,
    exceptions.FarLevelsWarning,
    exceptions.JitterWarning,
    exceptions.NarrowIntervalsWarning,
    exceptions.OutlierWarning,
    exceptions.PrecisionWarning,
    exceptions.RepeatedRowsWarning,
    exceptions.RowEffectsWarning,
    exceptions.SamplingWarning,
    exceptions.SeveralKernelsWarning,
    exceptions.SkewedInputWarning,
    exceptions.SmallTaskWarning,
    exceptions.TargetScaleWarning,
    exceptions.TaskColumnWarning,
    exceptions.TaskUnitWarning,
    exceptions.UnderflowWarning,
    exceptions.UnidentifiedNoiseWarning,
    exceptions.UnrelatedTasksWarning,
)


class Wrong(AssertionError):
    """What must not happen did."""


def require(condition, what):
    if not condition:
        raise Wrong(what)


def is_documented(error):
    """Whether an error is of a documented class; NumPy's LinAlgError is not."""
    ours = isinstance(error, exceptions.NotPositiveDefiniteError)
    return isinstance(error, ERRORS) and (
        ours or not isinstance(error, np.linalg.LinAlgError)
    )


@contextlib.contextmanager
def watched(what, warns=()):
    """Context in which nothing is printed, and warnings are the package's own."""
    out = io.StringIO()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            yield
    require(not out.getvalue(), f"{what} printed {out.getvalue()[:200]!r}")
    for w in caught:
        where = f"{w.category.__name__}: {w.message} ({w.filename}:{w.lineno})"
        expected = issubclass(w.category, (*WARNINGS, *warns))
        require(expected, f"{what} warned of {where}")


def attempt(what, call, *args, legal=True, warns=(), **options):
    """What the call returns, or None where it was refused as it should be."""
    try:
        with watched(what, warns):
            return call(*args, **options)
    except (Wrong, TimeoutError):
        raise
    except BaseException as error:
        described = f"{what} raised {type(error).__name__}: {error}"
        require(is_documented(error), described)
        require(not legal, f"{described}, and the input is legal")
        return None
