"""What docs/conf.py asks for: numbers and pictures of pages, the examples' warnings."""

import re
import runpy
import warnings
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"

pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only in a checkout")


def tools(name):
    pytest.importorskip("sphinx_gallery")
    return runpy.run_path(str(DOCS / f"{name}.py"))


@pytest.mark.parametrize(
    "text", ["1", "-1,234.5", "1e-07", "0.73 MiB", "< 3", "1.2 ± 0.1", "88 %", "2 ms"]
)
def test_numbers_stay_in_one_line(text):
    assert tools("pages")["NUMBER"].fullmatch(text)


@pytest.mark.parametrize("text", ["", "not legible", "n = 280", "3 of 10", "GPy"])
def test_words_may_break(text):
    assert not tools("pages")["NUMBER"].fullmatch(text)


def test_width_of_a_picture_is_by_inches(tmp_path):
    image = pytest.importorskip("PIL.Image")
    width, picture = tools("pages")["width"], image.new("L", (400, 20))
    for name, dpi, wanted in (("a.png", 200, 200), ("b.png", 100, 400)):
        picture.save(tmp_path / name, dpi=(dpi, dpi))
        assert width(tmp_path / name) == pytest.approx(wanted, rel=1e-3)


def test_warning_is_shown_once_and_without_a_path(monkeypatch):
    monkeypatch.setattr(warnings, "formatwarning", None)
    runpy.run_path(str(DOCS / "gallery_order.py"))["short_warnings"]({}, "plot_x.py")
    shown = [
        warnings.formatwarning(text, UserWarning, "/somewhere/a.py", 3)
        for text in ("few rows", "few rows", "slow")
    ]
    assert shown == ["UserWarning: few rows\n", "", "UserWarning: slow\n"]


def test_wide_pictures_have_a_narrow_one_on_the_first_page():
    text = (DOCS / "index.md").read_text("utf-8")
    for shape in ("on-phones", "on-desktops"):
        (path,) = re.findall(rf"{{\w+}} (\S+)\n:alt: .+\n:class: {shape}\n", text)
        assert (DOCS / path).exists()


def test_links_that_are_filled_in_are_on_every_page(tmp_path):
    text = (DOCS.parent / "pyproject.toml").read_text("utf-8")
    filled = re.sub(r"https://FILL-IN\.invalid", "https://example.org", text)
    (tmp_path / "pyproject.toml").write_text(filled, "utf-8")
    shown = runpy.run_path(str(DOCS / "links.py"))["icons"](tmp_path / "pyproject.toml")
    assert [link["name"] for link in shown] == ["Repository", "Issues"]
    assert all(link["url"] in filled for link in shown)


def test_links_that_are_blank_are_not_shown(tmp_path):
    text = '[project.urls]\nRepository = "https://a.org"\nIssues = "https://FILL-IN"\n'
    (tmp_path / "pyproject.toml").write_text(text, "utf-8")
    (shown,) = runpy.run_path(str(DOCS / "links.py"))["icons"](
        tmp_path / "pyproject.toml"
    )
    assert shown["url"] == "https://a.org"
