"""The oldest versions tested are the lower bounds in pyproject.toml."""

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PINS = ROOT / ".ci" / "oldest.txt"
EXTRAS = "puma", "plot", "test"
UNTESTED = {"ruff"}  # does not run the tests


def required(project):
    """What the tests are installed with, by name, but for the package itself."""
    extras = project["optional-dependencies"]
    lists = project["dependencies"], *(extras[name] for name in EXTRAS)
    parsed = [Requirement(line) for lines in lists for line in lines]
    return {each.name: each for each in parsed if each.name != project["name"]}


@pytest.mark.skipif(not PINS.exists(), reason="only in a checkout")
def test_oldest_versions_are_the_lower_bounds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = PINS.read_text().splitlines()
    pins = dict(line.split()[0].split("==") for line in lines if "==" in line)
    bounds = required(project)
    assert pins.keys() >= bounds.keys() - UNTESTED
    for name in bounds.keys() - UNTESTED:
        (bound,) = bounds[name].specifier
        assert bound.operator == ">="
        assert f"{pins[name]}.".startswith(f"{bound.version}."), name
