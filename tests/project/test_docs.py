"""What docs/conf.py asks for: numbers and pictures of pages, the examples' warnings."""

import re
import runpy
import warnings
from itertools import pairwise
from pathlib import Path

import pytest

from skmtgp import exceptions

DOCS = Path(__file__).parents[2] / "docs"
ONE_PANEL = {"benchmark-evaluation.png", "control.png"}  # wide, nothing to stack

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


def shown():
    """The pictures of docs/images that pages show."""
    pages = [p for p in DOCS.rglob("*.md") if "_build" not in p.parts]
    texts = [page.read_text("utf-8") for page in pages]
    return {
        name for text in texts for name in re.findall(r"images/([\w-]+\.png)", text)
    }


def test_wide_pictures_have_a_narrow_one():
    pytest.importorskip("PIL")
    module, images = tools("pages"), DOCS / "images"
    pictures = [images / name for name in shown() if (images / name).exists()]
    wide = [path for path in pictures if module["width"](path) > module["PHONE"]]
    narrow = {path: path.with_stem(path.stem + module["NARROW"]) for path in wide}
    assert {path.name for path in wide if not narrow[path].exists()} == ONE_PANEL
    there = [path for path in narrow.values() if path.exists()]
    assert set(there) == set(images.glob(f"*{module['NARROW']}.png"))
    assert all(module["width"](path) < 0.75 * module["PHONE"] for path in there)


def test_a_narrow_picture_is_beside_the_wide_one_with_the_same_words():
    pytest.importorskip("PIL")
    nodes = pytest.importorskip("docutils.nodes")
    wide = nodes.image(uri="../images/sites.png", alt="five sites", classes=["wide"])
    paragraph = nodes.paragraph("", "", wide)
    tools("pages")["offer"](wide, DOCS / "images" / "sites-narrow.png")
    narrow, last = paragraph.children
    assert last is wide
    assert (narrow["uri"], narrow["alt"]) == (
        "../images/sites-narrow.png",
        "five sites",
    )
    assert narrow["classes"] == ["on-phones"]
    assert wide["classes"] == ["wide", "on-desktops"]
    assert narrow["width"] == "420px"


def drawn(n_panels):
    """A wide figure of panels that share an axis, with a legend."""
    plt = pytest.importorskip("matplotlib.pyplot")
    options = {"sharey": True, "squeeze": False, "layout": "constrained"}
    figure, axes = plt.subplots(1, n_panels, figsize=(10, 4), **options)
    for ax in axes[0]:
        ax.plot([0, 1], label="a")
        ax.plot([1, 0], label="b")
        ax.set_xlabel("hour")
    axes[0, 0].set_ylabel("target")
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=2)
    return figure


def test_panels_are_stacked_for_phones(tmp_path):
    figure = drawn(3)
    tools("stacked")["save"](figure, tmp_path / "a.png", dpi=50)
    assert {path.name for path in tmp_path.iterdir()} == {"a.png", "a-narrow.png"}
    boxes = [ax.get_position() for ax in figure.axes]
    assert all(low.y1 < high.y0 for high, low in pairwise(boxes))
    assert all(ax.get_ylabel() == "target" for ax in figure.axes)
    assert [ax.get_xlabel() for ax in figure.axes] == ["", "", "hour"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["a", "b"]


def test_one_panel_stays(tmp_path):
    tools("stacked")["save"](drawn(1), tmp_path / "a.png", dpi=50)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


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


def test_the_page_of_warnings_has_each_of_them():
    page = (DOCS / "guide" / "warnings.md").read_text("utf-8")
    told = set(re.findall(r"skmtgp\.exceptions\.(\w+)`", page))
    assert told == {name for name in exceptions.__all__ if name.endswith("Warning")}
