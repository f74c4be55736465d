"""Imports only go downward, through the layers of the package."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import skmtgp

ROOT = Path(skmtgp.__file__).parent
LAYERS = [
    {"exceptions"},
    {"_support"},
    {"_numerics"},
    {"_data"},
    {"metrics", "kernels"},
    {"model"},
    {"inference"},
    {"learning"},
    {"_estimators"},
    {"multitask", "baselines", "single_task", "linear"},
    {
        "model_selection",
        "inspection",
        "preprocessing",
        "pipeline",
        "wide",
        "repeats",
        "identification",
        "robot",
    },
    {"predictor", "_plans"},
    {"tracking"},
    {"__init__"},
    {"__main__"},
]
LEVELS = {name: level for level, names in enumerate(LAYERS) for name in names}
APART = "datasets"  # imports nothing of the package, and only __init__ may import it


def part_of(module):
    """The entry of the table that a dotted module belongs to."""
    names = module.split(".")
    return names[1] if len(names) > 1 else "__init__"


def modules():
    """Dotted names and files of all modules on disk."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        names = ["skmtgp", *path.relative_to(ROOT).with_suffix("").parts]
        found[".".join(names[:-1] if names[-1] == "__init__" else names)] = path
    return found


MODULES = modules()


def imported(source, module, *, is_package, known=MODULES):
    """Dotted names of the package's modules that a source imports."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _is_ours(alias.name))
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names if _is_ours(base) else ():
                name = f"{base}.{alias.name}"
                yield name if name in known else base


def _is_ours(name):
    return name.split(".")[0] == "skmtgp"


def fault(module, target):
    """What is wrong with an import, or None."""
    upper, lower = part_of(module), part_of(target)
    for part in (upper, lower):
        if part not in LEVELS and part != APART:
            return f"{part} has no layer: add it to LAYERS in tests/test_layers.py"
    if upper == lower:
        return None
    if upper == APART:
        return f"{module} imports {target}: datasets must import no other part"
    floor = LEVELS["__init__"] if lower == APART else LEVELS[lower]
    if floor <= LEVELS[upper]:
        return None
    return f"{module} imports {target}, which lies above it"


def imports_of(module):
    path = MODULES[module]
    return set(
        imported(path.read_text("utf-8"), module, is_package=path.stem == "__init__")
    )


@pytest.mark.parametrize("module", MODULES)
def test_imports_go_downward(module):
    faults = {fault(module, target) for target in {module, *imports_of(module)}}
    assert not (faults - {None}), "\n".join(sorted(faults - {None}))


def test_the_design_page_names_every_module():
    page = Path(__file__).parents[1] / "docs" / "design.md"
    named = re.findall(r"`(\w+)`", page.read_text("utf-8"))
    assert not {*LEVELS, APART} - set(named)


def test_there_is_no_cycle():
    # Modules of one layer may import each other, but not in a circle.
    graph = {module: imports_of(module) - {module} for module in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"modules import each other: {' <- '.join(error.args[1])}")


KNOWN = {
    "skmtgp.kernels": None,
    "skmtgp.inference.dense": None,
    "skmtgp.inference.kronecker": None,
}


@pytest.mark.parametrize(
    ("source", "module", "expected"),
    [
        ("import numpy, skmtgp.kernels", "skmtgp.a", ["skmtgp.kernels"]),
        ("from skmtgp.kernels import Columns", "skmtgp.a", ["skmtgp.kernels"]),
        (
            "from skmtgp import kernels, RankSearchIC",
            "a.b",
            ["skmtgp.kernels", "skmtgp"],
        ),
        ("from .kernels import Columns", "skmtgp.a", ["skmtgp.kernels"]),
        ("from . import kernels", "skmtgp.a", ["skmtgp.kernels"]),
        ("from .. import kernels", "skmtgp.inference.dense", ["skmtgp.kernels"]),
        ("from . import dense", "skmtgp.inference.sparse", ["skmtgp.inference.dense"]),
        ("def f():\n    from skmtgp import x", "skmtgp.a", ["skmtgp"]),
        ("from numpy import linalg", "skmtgp.a", []),
        ("from skmtgpx import kernels", "skmtgp.a", []),
    ],
)
def test_imports_are_found(source, module, expected):
    found = imported(source, module, is_package=False, known=KNOWN)
    assert list(found) == expected


def test_imports_of_a_package_are_found():
    found = imported("from .dense import A", "skmtgp.inference", is_package=True)
    assert list(found) == ["skmtgp.inference.dense"]


@pytest.mark.parametrize(
    ("module", "target"),
    [
        ("skmtgp.multitask", "skmtgp._estimators.base"),
        ("skmtgp.inference.dense", "skmtgp.model._nodes"),
        ("skmtgp.inference.dense", "skmtgp.inference.kronecker"),
        ("skmtgp.metrics", "skmtgp._data.task_column"),
        ("skmtgp.datasets._make", "skmtgp.datasets._robot"),
        ("skmtgp", "skmtgp.datasets"),
    ],
)
def test_imports_that_are_allowed(module, target):
    assert fault(module, target) is None


@pytest.mark.parametrize(
    ("module", "target", "message"),
    [
        ("skmtgp.kernels", "skmtgp.model._nodes", "which lies above it"),
        ("skmtgp._data.task_column", "skmtgp.kernels", "which lies above it"),
        ("skmtgp.learning", "skmtgp", "which lies above it"),
        ("skmtgp.metrics", "skmtgp.multitask", "which lies above it"),
        ("skmtgp.multitask", "skmtgp.datasets", "which lies above it"),
        (
            "skmtgp.datasets._make",
            "skmtgp._data.task_column",
            "must import no other part",
        ),
        (
            "skmtgp.novel",
            "skmtgp._data.task_column",
            "novel has no layer: add it to LAYERS",
        ),
        ("skmtgp.multitask", "skmtgp.novel", "novel has no layer: add it to LAYERS"),
    ],
)
def test_imports_that_are_not(module, target, message):
    assert message in fault(module, target)
