"""Versions: for bug reports, and of what has saved a model."""

import os
import platform
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from sklearn.exceptions import InconsistentVersionWarning
from threadpoolctl import threadpool_info

from skmtgp._support.warnings import warn

DEPENDENCIES = "numpy", "scipy", "pandas", "scikit-learn", "joblib", "threadpoolctl"
EXTRAS = "matplotlib", "pin", "dask"
# Where a saved model has the versions of what its attributes depend on
IN_STATES = {"skmtgp": "_skmtgp_version", "scikit-learn": "_sklearn_version"}


class OtherVersionsWarning(InconsistentVersionWarning):
    """Scikit-learn's warning, of every package whose version is another.

    Parameters
    ----------
    estimator_name : str
        Class of the model.
    saved, now : dict of str to str or None
        Versions by package; None is unknown.
    """

    def __init__(self, estimator_name, saved, now):
        super().__init__(
            estimator_name=estimator_name,
            current_sklearn_version=now["scikit-learn"],
            original_sklearn_version=saved["scikit-learn"],
        )
        self.saved, self.now = saved, now

    def __str__(self):
        other = [name for name in self.now if self.saved[name] != self.now[name]]
        saved, now = (
            " and ".join(f"{name} {of[name] or 'of unknown version'}" for name in other)
            for of in (self.saved, self.now)
        )
        return (
            f"This {self.estimator_name} was saved with {saved}, and is loaded with "
            f"{now}. It may fail, or predict other values. Load it with the versions "
            "that it was saved with, or fit it again."
        )


def with_versions(state):
    """The state of a model to save, with the versions that it is saved with."""
    return state | {key: _version(name) for name, key in IN_STATES.items()}


def without_versions(state, estimator_name):
    """The state that was saved; a warning where versions are others now."""
    saved = {name: state.get(key) for name, key in IN_STATES.items()}
    now = {name: _version(name) for name in IN_STATES}
    if saved != now:
        warn(OtherVersionsWarning(estimator_name, saved, now), OtherVersionsWarning)
    keys = IN_STATES.values()
    return {name: value for name, value in state.items() if name not in keys}


def show_versions() -> None:
    """Print the system and the versions of what is installed, for bug reports.

    The same is printed by ``python -m skmtgp``.

    Examples
    --------
    >>> from skmtgp import show_versions
    >>> show_versions()
    System:
           python: 3...
    """
    _show("System", _system())
    _show("Python dependencies", _versions())
    for library in threadpool_info():
        _show("Thread pool", library)


def _show(title: str, items: Mapping[str, object]) -> None:
    print(f"{title}:")
    for name, value in items.items():
        print(f"{name:>15}: {value}")
    print()


def _system() -> dict[str, object]:
    return {
        "python": sys.version.replace("\n", " "),
        "executable": sys.executable,
        "machine": platform.platform(),
        "processors": os.cpu_count(),
    }


def _versions() -> dict[str, str | None]:
    """Versions by name; None of what is not installed."""
    return {name: _version(name) for name in ("skmtgp", *DEPENDENCIES, *EXTRAS)}


@cache
def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
