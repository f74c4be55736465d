"""What a bug report should tell: where it happened, and with which versions."""

import os
import platform
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from threadpoolctl import threadpool_info

DEPENDENCIES = "numpy", "scipy", "pandas", "scikit-learn", "joblib", "threadpoolctl"
EXTRAS = "matplotlib", "pin", "dask"


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


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
