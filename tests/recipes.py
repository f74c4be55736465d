"""The recipes of docs/design.md, and the classes that they define, as they stand there.

They come from the page itself, so that what the tests run is what it says.
"""

import ast
import doctest
from pathlib import Path

import numpy as np  # the page's code calls it np, as do those of the documentation

PAGE = Path(__file__).parents[1] / "docs" / "design.md"


def examples():
    """The statements of the page's code and what they print."""
    blocks = PAGE.read_text(encoding="utf-8").split("```")[1::2]
    code = [block for block in blocks if block.startswith("{doctest}")]
    return doctest.DocTestParser().get_examples("\n".join(code))


def run_page():
    """Number of statements that print something else, and what all define."""
    test = doctest.DocTest(examples(), {"np": np}, PAGE.name, str(PAGE), 0, None)
    failed = doctest.DocTestRunner().run(test, clear_globs=False).failed
    test.globs["NODES"].pop(test.globs["Brownian"])
    return failed, test.globs


def _is_definition(statement):
    return isinstance(statement, (ast.Import, ast.ImportFrom, ast.ClassDef))


for _example in examples():
    if all(map(_is_definition, ast.parse(_example.source).body)):
        exec(_example.source, globals())
