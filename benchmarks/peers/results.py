"""Result files: one JSON object a line, appended as soon as it is known.

The last row of a key counts, so that what is measured again replaces what was there.
"""

import json
import os
import platform
import subprocess
import time
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[1] / "results"
KEYS = {
    "fits": ("package", "settings", "n", "joint", "draw"),
    "timings": ("package", "settings", "n"),
    "checks": ("package", "settings", "n", "joint", "draw"),
    "sparse_fits": (
        *("n", "m", "n_exact", "ranks", "rank", "joint", "draw", "noise_floor"),
    ),
    "sparse_timings": ("package", "settings", "n", "m"),
    "sparse_peers": ("package", "settings", "n", "m", "rank", "joint", "draw"),
    "sparse_checks": ("package", "settings", "n", "m", "joint", "draw"),
    "real_data": ("data", "draw", "output", "model"),
}


class Table:
    """Rows of one kind.

    Parameters
    ----------
    kind : str
        Which of KEYS.
    folder : Path
        Where its file is.
    """

    def __init__(self, kind, folder=RESULTS):
        self.key_names = KEYS[kind]
        self.path = Path(folder) / f"{kind}.jsonl"
        self.rows = {}
        if self.path.exists():
            for line in self.path.read_text().splitlines():
                row = json.loads(line)
                self.rows[self.key(row)] = row

    def key(self, row):
        """What identifies a row."""
        values = (row[name] for name in self.key_names)
        return tuple(tuple(v) if isinstance(v, list) else v for v in values)

    def append(self, row):
        """Add a row, to the file at once."""
        row = {**row, "date": time.strftime("%Y-%m-%d %H:%M", time.gmtime())}
        self.rows[self.key(row)] = row
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with open(self.path, "a") as file:
            file.write(json.dumps(row) + "\n")
        return row

    def select(self, **wanted):
        """Rows with these values, in the order of their keys."""
        return [
            self.rows[key]
            for key in sorted(self.rows)
            if all(self.rows[key].get(k) == v for k, v in wanted.items())
        ]


def write_machine(folder, command, **run):
    """Say where and how results came about: one entry a run, the newest last.

    Parameters
    ----------
    folder : Path
        Of the results.
    command : str
        What was run.
    **run : object
        What else is to be known of it: the threads, what ran beside it, ...
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "machine.json"
    runs = json.loads(path.read_text())["runs"] if path.exists() else []
    begun = time.strftime("%Y-%m-%d %H:%M", time.gmtime())
    runs.append({"command": command, **run, "commit": commit(), "begun": begun})
    machine = {
        "processor": processor(),
        "cores": n_cores(),
        "memory_gib": memory_gib(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "runs": runs,
    }
    path.write_text(json.dumps(machine, indent=2) + "\n")


def processor():
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        names = [x.split(":", 1)[1].strip() for x in lines if "model name" in x]
        return names[0]
    except (OSError, IndexError):
        return platform.processor() or "unknown"


def n_cores():
    """Cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count()


def memory_gib():
    """Memory of the machine in GiB."""
    size = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return round(size / 2**30, 1)


def commit():
    """The commit that was measured."""
    command = ["git", "-C", str(RESULTS.parent), "rev-parse", "--short", "HEAD"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"
