"""What errors and warnings say of the user guide."""

from pathlib import Path

import pytest

from skmtgp._support import guide as _guide

PAGES = Path(__file__).parents[2] / "docs" / "guide"
SENTENCES = [text for name, text in vars(_guide).items() if name.isupper()]


@pytest.mark.parametrize("sentence", SENTENCES)
def test_the_page_exists(sentence):
    titles = [page.read_text("utf-8").split("\n")[0] for page in PAGES.glob("*.md")]
    assert "# " + sentence.split("'")[1] in titles
