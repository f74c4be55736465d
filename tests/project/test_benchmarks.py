"""Scripts that no test runs name what the package has today."""

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(
    path.relative_to(ROOT)
    for folder in ("benchmarks", "examples", "docs")
    for path in (ROOT / folder).rglob("*.py")
    if not any(part.startswith((".", "_build")) for part in path.parts)
)


def unknown_names(code):
    """What code takes from skmtgp, or asks of that, that is not there; with lines."""
    nodes, taken, unknown = list(ast.walk(ast.parse(code))), {}, []
    for node in nodes:
        module = node.module if isinstance(node, ast.ImportFrom) else None
        if module is None or module.partition(".")[0] != "skmtgp":
            continue
        home = import_module(module)
        for name, as_name in ((of.name, of.asname or of.name) for of in node.names):
            if hasattr(home, name):
                taken[as_name] = getattr(home, name)
            elif find_spec(f"{module}.{name}") is None:
                unknown.append(f"{node.lineno}: {module}.{name}")
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            of = taken.get(node.value.id)
            if of is not None and not hasattr(of, node.attr):
                unknown.append(f"{node.lineno}: {node.value.id}.{node.attr}")
    return unknown


@pytest.mark.parametrize("path", SCRIPTS, ids=str)
def test_scripts_name_what_there_is(path):
    """A benchmark that takes hours is run seldom, and would be broken then."""
    assert unknown_names((ROOT / path).read_text("utf-8")) == []


def test_names_that_are_not_there_are_found():
    """In modules, and of what is taken from them."""
    used = "import os\nfrom skmtgp import IndependentGP\nIndependentGP.y\n"
    assert unknown_names(used) == ["3: IndependentGP.y"]
    missing = "from skmtgp import learning, fit_all"
    assert unknown_names(missing) == ["1: skmtgp.fit_all"]
    missing = "from skmtgp.learning import nothing"
    assert unknown_names(missing) == ["1: skmtgp.learning.nothing"]
