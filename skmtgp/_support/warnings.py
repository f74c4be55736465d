"""Warnings, which are given or collected.

``warnings.catch_warnings`` changes what all threads do with warnings. Where two of them
overlap it leaves that changed for good, and warnings are lost: nothing of ours uses it.
"""

import warnings
from contextlib import contextmanager
from contextvars import ContextVar

_COLLECTED = ContextVar("collected", default=None)


def warn(message, category):
    """Give a warning, or add it to those that are collected.

    Parameters
    ----------
    message : str
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
