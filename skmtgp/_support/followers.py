"""Models that learn more: who follows them, and what a call sees meanwhile.

Compiled predictors follow a model and change when it does.

The registry is weak both ways. It belongs to the process: models and predictors that
were copied, cloned or pickled are others, which nobody follows and which follow nobody.
"""

from threading import RLock
from weakref import WeakKeyDictionary, WeakSet

_LOCK = RLock()
_FOLLOWERS = WeakKeyDictionary()


def follow(model, follower):
    """Let a follower know of what a model learns from now on.

    Parameters
    ----------
    model : object
        It says so itself, by `tell`.
    follower : object
        Its method ``_catch_up()`` is called then.
    """
    with _LOCK:
        _FOLLOWERS.setdefault(model, WeakSet()).add(follower)


def leave(follower):
    """Let it know no more, of any model."""
    with _LOCK:
        for followers in _FOLLOWERS.values():
            followers.discard(follower)


def tell(model):
    """Let all followers of a model know that it has learned more."""
    with _LOCK:
        followers = list(_FOLLOWERS.get(model, ()))
    for follower in followers:
        follower._catch_up()


def as_it_is(model):
    """A model as it is now, whatever it learns before a call has ended.

    What learns more replaces all of its attributes at once, and changes none of them.
    """
    now = object.__new__(type(model))
    now.__dict__ = model.__dict__
    return now
