"""Run the package's own benchmarks, and keep what they print.

``python benchmarks/peers/own_run.py likelihood memory`` writes
``benchmarks/results/likelihood.txt`` and ``memory.txt``, each with what was run, when,
where and with which versions. A benchmark that fails leaves its old file. ``--data
FOLDER`` is passed on to those that take it: data that are no part of the repository.
"""

import argparse
import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

from results import RESULTS, commit, n_cores, processor
from threadpoolctl import threadpool_info

FOLDER = Path(__file__).resolve().parents[1]
PACKAGES = "skmtgp", "numpy", "scipy", "scikit-learn"


def header(name, options=""):
    """Lines that say what is measured, when, where and with what."""
    import scipy.linalg  # noqa: F401  so that its BLAS is loaded

    begun = time.strftime("%Y-%m-%d %H:%M", time.gmtime())
    packages = [f"{package} {version(package)}" for package in PACKAGES]
    blas = {
        f"{library['internal_api']} {library['version']}"
        for library in threadpool_info()
        if library["user_api"] == "blas"
    }
    versions = [f"Python {platform.python_version()}", *packages, *sorted(blas)]
    return (
        f"# python benchmarks/{name}.py{options}, {begun} UTC, at {commit()}\n"
        f"# {processor()}, {n_cores()} cores; {', '.join(versions)}\n"
    )


def keep(name, results, data):
    """Run a benchmark, and write what it prints."""
    part, path = results / f"{name}.part", FOLDER / f"{name}.py"
    takes = data is not None and '"--data"' in path.read_text()
    with part.open("w") as file:
        file.write(header(name, " --data FOLDER" * takes))
        file.flush()
        command = [sys.executable, str(path), *(["--data", str(data)] if takes else [])]
        subprocess.run(command, stdout=file, check=True)
    os.replace(part, results / f"{name}.txt")


def main():
    """Run those that are named, one after another."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="+")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--data", type=Path)
    arguments = parser.parse_args()
    for name in arguments.names:
        print(name, flush=True)
        keep(name, arguments.results, arguments.data)


if __name__ == "__main__":
    main()
