"""Phrases that readers stumbled over do not come back."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BETTER = {  # a pattern, and plain words for it
    r"\btak(e|es|en|ing) [^.]{0,40}\bfor (certain|granted|known|zero)\b": "treat as",
    r"\bdear to\b": "expensive to",
    r"\bas a rule\b": "usually, by default",
    r"\bnext to (no|nothing|none)\b": "almost no",
    r"\bcome on each\b": "for each",
    r"\bhas not (a|an|any|the)\b": "lacks, does not have",
    r"\bof one's own\b": "your own",
    r"\bwhat does not please\b": "what does not suit you",
    r", for (it|there|they) ": "because",
}
FOLDERS = ".", "docs", "docs/tutorials", "examples/paper", "benchmarks", "paper"
PAGES = [page for of in FOLDERS for page in sorted((ROOT / of).glob("*.md"))]


def words(path):
    """A page in one line."""
    return " ".join(path.read_text("utf-8").split())


def stilted(text):
    """What is found, and what would be better."""
    for pattern, better in BETTER.items():
        for found in re.finditer(pattern, text):
            yield f"{found[0]!r}: rather {better!r}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_pages_are_in_plain_words(path):
    assert list(stilted(words(path))) == []


@pytest.mark.parametrize(
    "text",
    [
        "It takes the model for certain.",
        "Cadmium is dear to measure.",
        "There is next to no noise.",
        "Rows are few, for they are expensive.",
    ],
)
def test_stilted_phrases_are_found(text):
    assert list(stilted(text))
