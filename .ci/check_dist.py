"""What is in dist: the files of the project, and no others."""

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

DIST = Path("dist")
OF_BUILDING = {"PKG-INFO", ".gitignore"}  # hatchling adds them to the source
METADATA = "METADATA", "WHEEL", "RECORD", "licenses/LICENSE"


def differences():
    """Lines about what should not be there, and what is missing."""
    (sdist,), (wheel,) = DIST.glob("*.tar.gz"), DIST.glob("*-py3-none-any.whl")
    name = sdist.name.removesuffix(".tar.gz")
    project = files_of_project()
    package = {path for path in project if path.startswith("skmtgp/")}
    tests = {path for path in project if path.startswith("tests/")}

    files = {path.removeprefix(f"{name}/") for path in files_of_tar(sdist)}
    needed = package | tests | {"LICENSE", "README.md", "pyproject.toml"}
    yield from (
        f"{sdist}: {path} is too much" for path in files - project - OF_BUILDING
    )
    yield from (f"{sdist}: {path} is missing" for path in needed - files)

    files = set(zipfile.ZipFile(wheel).namelist())
    needed = package | {f"{name}.dist-info/{file}" for file in METADATA}
    yield from (f"{wheel}: {path} is too much" for path in files - needed)
    yield from (f"{wheel}: {path} is missing" for path in needed - files)


def files_of_project():
    """Paths of all files that git has, or would take."""
    listing = "git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"
    paths = subprocess.run(listing, capture_output=True, text=True, check=True).stdout
    return {path for path in paths.split("\0") if path and Path(path).exists()}


def files_of_tar(path):
    """Paths of all files in an archive."""
    with tarfile.open(path) as archive:
        return {each.name for each in archive.getmembers() if each.isfile()}


if __name__ == "__main__":
    sys.exit("\n".join(sorted(differences())) or 0)
