"""Warnings, which are given or collected.

``warnings.catch_warnings`` changes what all threads do with warnings. Where two of them
overlap it leaves that changed for good, and warnings are lost. Nothing of ours uses it
but `quiet`, which lets one thread in at a time, for milliseconds.
"""

import warnings
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock

_COLLECTED = ContextVar("collected", default=None)
_ONE_AT_A_TIME = Lock()


def warn(message, category):
    """Give a warning, or add it to those that are collected.

    Parameters
    ----------
    message : str or Warning
        What is to be said.
    category : type
        Its class.
    """
    collected = _COLLECTED.get()
    if collected is None:
        warnings.warn(message, category, stacklevel=2)
    else:
        collected.append((category, message))


@contextmanager
def collect_warnings():
    """Context whose warnings, those of this thread and of ours, are not given.

    Yields
    ------
    collected : list of (type, str)
        Their classes and messages.
    """
    collected = []
    token = _COLLECTED.set(collected)
    try:
        yield collected
    finally:
        _COLLECTED.reset(token)


@contextmanager
def quiet():
    """Context in which other packages' functions are tried, and do not warn.

    Only for what takes milliseconds, outside of which such warnings would be right.
    """
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
