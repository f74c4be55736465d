"""What a release says of itself is the same everywhere."""

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import skmtgp

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = PYPROJECT["project"]


def read(path):
    """What a YAML file of the checkout says; not all are in the source distribution."""
    if not (ROOT / path).exists():
        pytest.skip("only in a checkout")
    return yaml.safe_load((ROOT / path).read_text("utf-8"))


def bounds(lines):
    """Requirements as pairs of a name and its versions."""
    parsed = [Requirement(line) for line in lines]
    return {(each.name, str(each.specifier)) for each in parsed}


def test_citation_has_the_version_and_licence():
    citation = read("CITATION.cff")
    assert citation["version"] == skmtgp.__version__
    assert citation["license"] == PROJECT["license"]


def test_recipe_has_the_version_and_licence():
    recipe = read("conda/recipe.yaml")
    assert recipe["context"]["version"] == skmtgp.__version__
    assert recipe["about"]["license"] == PROJECT["license"]


def test_recipe_requires_the_same():
    recipe = read("conda/recipe.yaml")
    python, *others = recipe["requirements"]["run"]
    assert python == "python >=${{ python_min }}"
    assert f">={recipe['context']['python_min']}" == PROJECT["requires-python"]
    assert bounds(others) == bounds(PROJECT["dependencies"])
    built_with = bounds(PYPROJECT["build-system"]["requires"])
    assert built_with <= bounds(recipe["requirements"]["host"][1:])


def test_pythons_that_are_claimed_are_those_that_are_tested():
    prefix = "Programming Language :: Python :: 3."
    claimed = {
        line.removeprefix(prefix[:-2])
        for line in PROJECT["classifiers"]
        if line.startswith(prefix)
    }
    matrix = read(".github/workflows/ci.yml")["jobs"]["test"]["strategy"]["matrix"]
    assert claimed == set(matrix["python-version"])
    assert f">={min(claimed)}" == PROJECT["requires-python"]
