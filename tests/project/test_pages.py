"""The pages of benchmarks and of the paper are what the results say."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BENCHMARKS = ROOT / "benchmarks" / "peers" / "page.py"
PAPER = ROOT / "examples" / "paper" / "page.py"
SHORT = ["benchmarks.md", "paper.md"]
NAMES = {
    BENCHMARKS: ["benchmarks.md", "benchmarks_how.md", "benchmarks_tables.md"],
    PAPER: ["paper.md", "paper_details.md"],
}
READMES = {script: script.parent / "README.md" for script in NAMES}
READMES[BENCHMARKS] = ROOT / "benchmarks" / "README.md"
ALL = [name for names in NAMES.values() for name in names]

pytestmark = pytest.mark.skipif(not BENCHMARKS.exists(), reason="only in a checkout")


def make(script, folder, *options):
    """The pages without their plots, in a folder."""
    pytest.importorskip("matplotlib")
    command = [sys.executable, script, "--no-plots", "--docs", folder, *options]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return folder


@pytest.fixture(scope="module", params=NAMES, ids=lambda path: path.parent.name)
def made(request, tmp_path_factory):
    """A command, and the folder with its pages."""
    return request.param, make(request.param, tmp_path_factory.mktemp("pages"))


def read(path):
    return path.read_text("utf-8")


@pytest.mark.long
def test_pages_are_what_the_results_say(made):
    script, folder = made
    stale = [n for n in NAMES[script] if read(folder / n) != read(DOCS / n)]
    assert not stale, f"python {script.relative_to(ROOT)} makes them anew"


@pytest.mark.long
def test_goals_are_what_the_results_say(made):
    script, folder = made
    assert read(folder / "README.md") == read(READMES[script])
    assert "| goal | measured | reached |" in read(READMES[script])


@pytest.mark.long
def test_without_results_there_are_pages(tmp_path):
    folder = make(BENCHMARKS, tmp_path / "docs", "--results", tmp_path)
    assert "Not measured." in read(folder / "benchmarks.md")


@pytest.mark.parametrize("name", ALL)
def test_goals_of_development_are_elsewhere(name):
    """A reader wants to know what is, not what was wanted."""
    assert not re.findall(r"(?i)\bgoals?\b|not met|\*\*no\*\*", read(DOCS / name))


@pytest.mark.parametrize("name", SHORT)
def test_short_pages_are_short(name):
    text = read(DOCS / name)
    words = [line for line in text.splitlines() if not line.startswith("|")]
    assert len(" ".join(words).split()) < 420
    assert len(re.findall(r"^\| --- ", text, re.MULTILINE)) <= 3
    assert len(re.findall("^:alt: ", text, re.MULTILINE)) <= 2


@pytest.mark.parametrize("name", ALL)
def test_pictures_are_there_and_have_words(name):
    text = read(DOCS / name)
    shown = re.findall(r"!\[(.*?)\]\((.+?)\)", text)
    shown += [
        (words, path)
        for path, words in re.findall(r"```{image} (\S+)\n:alt: (.*)\n", text)
    ]
    assert text.count("{image}") + text.count("![") == len(shown)
    for words, path in shown:
        assert words.strip()
        assert (DOCS / path).exists()


def test_expected_times_are_those_that_were_measured():
    results = ROOT / "benchmarks" / "results" / "expected_times.txt"
    rows = [line for line in read(results).splitlines() if line.startswith("|")]
    assert len(rows) > 3
    assert "\n".join(rows) in read(DOCS / "guide" / "inference.md")
