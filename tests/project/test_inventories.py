"""Links to other projects, and a build of the documentation without a network."""

import runpy
from pathlib import Path
from urllib.error import URLError

import pytest

FILE = Path(__file__).parents[2] / "docs" / "inventories.py"
URLS = {"up": "https://up.example/", "down": "https://down.example/"}

pytestmark = pytest.mark.skipif(not FILE.exists(), reason="only in a checkout")


class Answer:
    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def urlopen(url, timeout):
    assert timeout < 30.0
    assert url.endswith(".example/objects.inv")
    if "down" in url:
        raise URLError("no network")
    return Answer()


def test_projects_that_answer_are_linked(monkeypatch):
    monkeypatch.setattr("urllib.request.urlopen", urlopen)
    reachable = runpy.run_path(str(FILE))["reachable"]
    assert reachable(**URLS) == {"up": (URLS["up"], None)}
    assert reachable(down=URLS["down"]) == {}
