"""Whether the memory suffices, before it is allocated."""

import contextlib
import math
import os
from pathlib import Path

from skmtgp._support.guide import INFERENCE
from skmtgp.exceptions import InsufficientMemoryError

GIB = 2.0**30
PROC, CGROUP = Path("/proc"), Path("/sys/fs/cgroup")
UNLIMITED = 2.0**60  # version 1 has such a limit for none
CONTROLS = [  # of a control group: limit, use, files within that can be let go
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
]


def check_available(needed, what, advice):
    """Raise an InsufficientMemoryError where so many bytes are not available.

    Parameters
    ----------
    needed : float
        Bytes.
    what : str
        What needs them.
    advice : str
        What to do about it.
    """
    available = available_memory()
    if needed > available:
        raise InsufficientMemoryError(
            f"{what} needs about {needed / GIB:.3g} GiB of memory, but "
            f"{available / GIB:.3g} GiB are available. {advice.strip()} {INFERENCE}"
        )


def available_memory():
    """Bytes that can still be allocated; infinite where the system does not tell.

    The machine's, or what is left to the container if that is less.
    """
    left = (_left(group, *names) for group in _control_groups() for names in CONTROLS)
    return min(_of_the_machine(), *left)


def _control_groups():
    """Folders of the control groups that this process may be in."""
    groups = {CGROUP, CGROUP / "memory"}
    with contextlib.suppress(OSError, ValueError):
        for line in (PROC / "self" / "cgroup").read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers in ("", "memory"):  # version 2, version 1
                group = CGROUP / controllers / path.lstrip("/")
                groups.update([group, *group.parents])
    return groups


def _left(group, limit, used, files):
    """Bytes that a control group leaves; infinite where it has no limit."""
    try:
        most = int((group / limit).read_text())
        if most > UNLIMITED:
            return math.inf
        held = int((group / used).read_text())
    except (OSError, ValueError):  # "max"
        return math.inf
    with contextlib.suppress(OSError, ValueError, KeyError):
        lines = (group / "memory.stat").read_text().splitlines()
        held -= int(dict(line.split() for line in lines)[files])
    return max(0, most - held)


def _of_the_machine():
    with contextlib.suppress(OSError, ValueError, StopIteration):
        lines = (PROC / "meminfo").read_text().splitlines()
        line = next(line for line in lines if line.startswith("MemAvailable:"))
        return 1024 * int(line.split()[1])
    with contextlib.suppress(AttributeError, OSError, ValueError):  # not Linux
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return math.inf
