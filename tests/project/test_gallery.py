"""The gallery's examples are what sphinx-gallery takes; the documentation runs them."""

import ast
import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GALLERY = ROOT / "examples" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))


def test_every_script_is_in_a_section():
    """As a picture, and in the list of pages; both in the same order."""
    text = (GALLERY / "index.rst").read_text("utf-8")
    shown = re.findall(r"^   \.\./examples/gallery/(\w+)\.py$", text, re.MULTILINE)
    assert SCRIPTS
    assert sorted(shown) == [path.stem for path in SCRIPTS]
    assert re.findall(r"^   (plot_\w+)$", text, re.MULTILINE) == shown


def test_every_script_has_its_place():
    order = runpy.run_path(str(ROOT / "docs" / "gallery_order.py"))
    assert sorted(order["ORDER"]) == [path.stem for path in SCRIPTS]
    assert sorted(SCRIPTS, key=order["position"])[0].stem == order["ORDER"][0]


def test_pictures_and_links_of_the_pages_are_of_scripts():
    pages = [*ROOT.glob("docs/*.md"), *ROOT.glob("docs/guide/*.md")]
    found = {
        name
        for page in pages
        for name in re.findall(
            r"auto_examples/(?:images/sphx_glr_)?(plot_[a-z_]+[a-z])",
            page.read_text("utf-8"),
        )
    }
    assert found
    assert found <= {path.stem for path in SCRIPTS}


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
