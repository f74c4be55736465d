"""Functions of the package stay short enough to be read at once."""

import ast
from pathlib import Path

import numpy as np

import skmtgp

ROOT = Path(skmtgp.__file__).parent


def lengths():
    """Lines of each function's body, without its docstring, by place."""
    found = {}
    for path in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef):
                body = node.body[ast.get_docstring(node) is not None :]
                first, last = body[0] if body else node, node.body[-1]
                place = f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
                found[place] = last.end_lineno - first.lineno + 1
    return found


def test_bodies_are_short():
    found = lengths()
    assert len(found) > 1000
    assert not {place: n for place, n in found.items() if n > 30}
    assert np.quantile(list(found.values()), 0.9) <= 15
