"""Where tests lie, and what pages for developers say of it."""

import re
from collections import Counter
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
PAGES = [ROOT / "docs" / "design.md", ROOT / "CONTRIBUTING.md"]
FILES = sorted(TESTS.rglob("*.py"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_pages_name_exist(page):
    named = re.findall(r"\btests/[\w/.]*\w", page.read_text("utf-8"))
    assert named
    assert not [path for path in named if not (ROOT / path).exists()]


def test_no_file_is_long():
    lengths = {p.name: p.read_text("utf-8").count("\n") for p in FILES}
    assert not {name: n for name, n in lengths.items() if n > 500}


def test_every_room_has_tests():
    rooms = [p.parent.name for p in (ROOT / "skmtgp").glob("*/__init__.py")]
    assert rooms
    assert {room.removeprefix("_") for room in rooms} <= {p.parent.name for p in FILES}


def test_no_name_is_given_twice():
    """Pytest finds files by their names alone."""
    counts = Counter(p.name for p in FILES if p.name != "conftest.py")
    assert not [name for name, n in counts.items() if n > 1]
