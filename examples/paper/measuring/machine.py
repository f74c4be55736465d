"""Where, how and from which commit the results of each experiment came about."""

import json
import os
import platform
import shutil
import subprocess
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGES = ("skmtgp", "numpy", "scipy", "scikit-learn", "pandas", "joblib", "pin")


def record(folder, experiment, command, n_jobs):
    """Add this run to machine.json, unless the last one was the same."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "machine.json"
    runs = json.loads(path.read_text()) if path.exists() else {}
    run = describe() | {"command": command, "n_jobs": n_jobs, "commit": commit()}
    earlier = runs.setdefault(experiment, [])
    if not earlier or {**earlier[-1], "begun": None} != {**run, "begun": None}:
        earlier.append(run)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(runs, indent=2) + "\n")
    part.replace(path)


def describe():
    """The machine and its software."""
    return {
        "processor": processor(),
        "cores": n_cores(),
        "memory_gib": memory_gib(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": {p: v for p in PACKAGES if (v := installed(p))},
        "begun": time.strftime("%Y-%m-%d %H:%M", time.gmtime()),
    }


def processor():
    """Name of the processor."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    names = [x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def n_cores():
    """Cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count()


def memory_gib():
    """Memory of the machine in GiB."""
    size = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return round(size / 2**30, 1)


def installed(package):
    """Version of a package, None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def commit():
    """The commit, with a plus where the package differs from it."""
    if shutil.which("git") is None:
        return "unknown"
    found = _git("rev-parse", "--short", "HEAD")
    changed = _git("status", "--porcelain", "--", "skmtgp", "examples/paper/**/*.py")
    return (found or "unknown") + ("+" if changed else "")


def _git(*words):
    root = HERE.parents[2]
    command = ["git", "-C", str(root), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip()
