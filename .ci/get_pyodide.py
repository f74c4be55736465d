"""A whole Pyodide from PyPI alone: the Python that the notebooks run on in a browser.

Browsers fetch it from Pyodide's own address, which tests do not ask. On PyPI it is
inside one application's wheel, with NumPy, SciPy, pandas, scikit-learn and Matplotlib
as Pyodide's authors built them; only those files are taken, none of the application.
What the notebook's kernel needs besides is pure Python and comes from PyPI, too.
"""

import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

HOLDER = "open-webui==0.12.4"
CORE = ["pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip"]
LOCK = "pyodide-lock.json"
NEEDED = ["matplotlib", "micropip", "pandas", "scikit-learn", "ipython", "jedi"]
MORE = ["comm"]  # of the kernel, and unknown to Pyodide


def download(folder, *names):
    """Wheels by pip, as files of a folder."""
    command = "pip", "download", "-q", "--no-deps", "--only-binary=:all:"
    options = "--ignore-requires-python", "--disable-pip-version-check", "-d", folder
    done = subprocess.run(
        [sys.executable, "-m", *command, *map(str, options), *names],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        *_, reason = done.stderr.strip().splitlines() or ["pip failed"]
        sys.exit(f"No Pyodide, so that no notebook is run in a browser: {reason}")


def normal(name):
    """The name of a package as indexes spell it."""
    return re.sub("[-_.]+", "-", name).lower()


def closure(packages, names):
    """The packages of these names and all that they need."""
    found, waiting = {}, list(names)
    while waiting:
        name = normal(waiting.pop())
        if name not in found:
            found[name] = packages[name]
            waiting += packages[name]["depends"]
    return list(found.values())


def extract(archive, folder, names):
    """Put files of Pyodide into a folder; the names of those that are not there."""
    held = {Path(path).name: path for path in archive.namelist() if "/pyodide/" in path}
    for name in set(names) & set(held):
        (folder / name).write_bytes(archive.read(held[name]))
    return set(names) - set(held)


def added(path):
    """The entry of a wheel that Pyodide does not know."""
    name, version, *_ = path.name.split("-")
    return {
        "name": name,
        "version": version,
        "file_name": path.name,
        "imports": [name],
        "depends": [],
        "install_dir": "site",
        "package_type": "package",
        "unvendored_tests": False,
    }


def digest(path):
    """What Pyodide compares before it takes a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def complete(folder, lock, missing):
    """Pure Python from PyPI: not the bytes of Pyodide's wheels, but their versions."""
    lacking = [e for e in lock["packages"].values() if e["file_name"] in missing]
    download(folder, *(f"{e['name']}=={e['version']}" for e in lacking), *MORE)
    for name in MORE:
        (path,) = folder.glob(f"{name}-*.whl")
        lock["packages"][name] = added(path)
        lacking.append(lock["packages"][name])
    for entry in lacking:
        entry["sha256"] = digest(folder / entry["file_name"])


def assemble(folder):
    """Fill a folder; its lock, which tells that it is whole, is written last."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as place:
        download(place, HOLDER)
        (wheel,) = Path(place).iterdir()
        with zipfile.ZipFile(wheel) as archive:
            (path,) = (name for name in archive.namelist() if name.endswith(f"/{LOCK}"))
            lock = json.loads(archive.read(path))
            packages = {normal(name): e for name, e in lock["packages"].items()}
            wanted = closure(packages, NEEDED)
            missing = extract(archive, folder, [e["file_name"] for e in wanted])
            absent = extract(archive, folder, ["package.json", *CORE])
    assert not absent, f"not in {HOLDER}: {absent}"
    for entry in wanted:
        name = entry["file_name"]
        assert name in missing or digest(folder / name) == entry["sha256"], name
    complete(folder, lock, missing)
    (folder / LOCK).write_text(json.dumps(lock), "utf-8")


if __name__ == "__main__":
    assemble(Path(sys.argv[1]))
