"""Whether a release says the same everywhere, and nothing is left to fill in."""

import hashlib
import re
import sys
import tomllib
from pathlib import Path

import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
BLANK = "FILL-IN"
FILLED = "pyproject.toml", "CITATION.cff", "conda/recipe.yaml"
LATER = {  # what can only be filled in once the release is there
    "conda/recipe.yaml": r'sha256: "0+"|recipe-maintainers: \[\]',
    "paper/paper.md": BLANK,
}


def findings(root):
    """Lines about what must be mended before the release.

    Parameters
    ----------
    root : Path
        Of the checkout.

    Yields
    ------
    line : str
        With the file, what is wrong and how it should be.
    """
    project = tomllib.loads(read(root, "pyproject.toml"))["project"]
    version = re.search(r'__version__ = "(.*)"', read(root, "skmtgp/__init__.py"))[1]
    citation, recipe = (yaml.safe_load(read(root, name)) for name in FILLED[1:])
    yield from of_version(version, citation, recipe, read(root, "CHANGELOG.md"))
    yield from of_links(project["urls"], citation, recipe)
    yield from of_requirements(project, recipe)
    for name in FILLED:
        for k, line in enumerate(read(root, name).splitlines(), 1):
            if BLANK in line and not line.lstrip().startswith("#"):
                yield f"{name}, line {k}: fill in {line.strip()}"


def of_version(version, citation, recipe, changelog):
    """It is that of a release, the same in all files, and has a date."""
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        yield f"skmtgp/__init__.py: {version} is no version of a release"
    told = {FILLED[1]: citation["version"], FILLED[2]: recipe["context"]["version"]}
    for name, other in told.items():
        if other != version:
            yield f"{name}: version {other}, but skmtgp/__init__.py has {version}"
    heading = re.search(r"^## .*$", changelog, re.MULTILINE)[0]
    if not re.fullmatch(rf"## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d", heading):
        expected = f"## [{version}] - YYYY-MM-DD"
        yield f"CHANGELOG.md: fill in the date: {heading!r} must be {expected!r}"


def of_links(urls, citation, recipe):
    """Those that others repeat are those of pyproject.toml."""
    about = recipe["about"]
    repeated = {
        "CITATION.cff, url": (citation["url"], urls["Documentation"]),
        "CITATION.cff, repository-code": (
            citation["repository-code"],
            urls["Repository"],
        ),
        "conda/recipe.yaml, homepage": (about["homepage"], urls["Documentation"]),
        "conda/recipe.yaml, documentation": (
            about["documentation"],
            urls["Documentation"],
        ),
        "conda/recipe.yaml, repository": (about["repository"], urls["Repository"]),
    }
    for where, (found, expected) in repeated.items():
        if found != expected:
            yield f"{where}: {found}, but pyproject.toml has {expected}"


def of_requirements(project, recipe):
    """The recipe needs what pyproject.toml needs."""
    python, *others = recipe["requirements"]["run"]
    least = recipe["context"]["python_min"]
    if (
        python != "python >=${{ python_min }}"
        or f">={least}" != (project["requires-python"])
    ):
        needed = project["requires-python"]
        yield f"conda/recipe.yaml: python_min {least}, pyproject.toml has {needed}"
    for line in sorted(bounds(others) ^ bounds(project["dependencies"])):
        yield f"conda/recipe.yaml and pyproject.toml: {''.join(line)} is in one alone"


def bounds(lines):
    """Requirements as pairs of a name and its versions."""
    parsed = [Requirement(line) for line in lines]
    return {(each.name, str(each.specifier)) for each in parsed}


def later(root):
    """Lines about what is filled in after the release."""
    for name, blank in LATER.items():
        for found in re.findall(blank, read(root, name)):
            yield f"{name}: {found}"


def read(root, name):
    """Text of a file."""
    return (root / name).read_text("utf-8")


def main():
    """Print all of it; fail if something is to be done before the release."""
    for sdist in (ROOT / "dist").glob("*.tar.gz"):
        print(
            f"sha256 of {sdist.name}: {hashlib.sha256(sdist.read_bytes()).hexdigest()}"
        )
    print("To fill in after the release:", *later(ROOT), sep="\n  ")
    found = list(findings(ROOT))
    if found:
        sys.exit("\n  ".join(["Not ready to be released:", *found]))
    print("Ready to be released.")


if __name__ == "__main__":
    main()
