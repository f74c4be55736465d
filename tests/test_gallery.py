"""The gallery's examples are what sphinx-gallery takes; the documentation runs them."""

import ast
import re
from pathlib import Path

import pytest

GALLERY = Path(__file__).parents[1] / "examples" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))


def test_there_are_scripts_and_a_header():
    assert SCRIPTS
    assert (GALLERY / "README.txt").is_file()


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_script_is_an_example(path):
    text = path.read_text(encoding="utf-8")
    compile(text, str(path), "exec")
    title, line, *prose = ast.get_docstring(ast.parse(text)).splitlines()
    assert path.name.startswith("plot_")  # others are not run
    assert set(line) == {"="}
    assert len(line) == len(title)
    assert any(prose)
    assert "# %%\n" in text
    for title, line in re.findall(r"^# %%\n# (.+)\n# (-+)$", text, re.MULTILINE):
        assert len(line) == len(title), title
