"""The built documentation, served and read: what test_site.py and test_lite.py need."""

import os
import shutil
import threading
from contextlib import contextmanager
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urldefrag, urljoin, urlsplit

import pytest

BROWSERS = ["chromium", "chromium-browser", "google-chrome", "chrome"]
SITE = os.environ.get("SKMTGP_SITE", "")  # `make test-pages` says where it is
HOST = "http://127.0.0.1"


def folder():
    """Where the built documentation is; without it, tests are skipped."""
    if not SITE:
        pytest.skip("`make test-pages` tests the built documentation")
    path = Path(SITE).resolve()
    assert (path / "index.html").exists(), f"no documentation in {path}"
    return path


def pages(lite=False):
    """The paths of the pages, without those of JupyterLite, which is not ours."""
    if not SITE:
        return []
    found = sorted(p.relative_to(SITE).as_posix() for p in Path(SITE).rglob("*.html"))
    return [p for p in found if not p.startswith(("_static/", "lite/"))]


class Quiet(SimpleHTTPRequestHandler):
    """A server that says nothing."""

    def log_message(self, *args):
        """Nothing."""


@contextmanager
def served(path):
    """The address of a server on this machine."""
    handler = partial(Quiet, directory=str(path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"{HOST}:{server.server_port}"
        server.shutdown()


@contextmanager
def chromium():
    """A browser without a window: the system's, or the one that Playwright fetched."""
    api = pytest.importorskip("playwright.sync_api", reason="needs skmtgp[pages]")
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    with api.sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(
                executable_path=path, args=["--no-sandbox"]
            )
        except api.Error:
            pytest.skip("no Chromium: install it, or `playwright install chromium`")
        yield browser
        browser.close()


class Reader(HTMLParser):
    """The targets and the links of a page."""

    def __init__(self):
        super().__init__()
        self.ids, self.links = set(), set()

    def handle_starttag(self, tag, attrs):
        """Keep what can be linked to, and what is linked to."""
        attrs = dict(attrs)
        self.ids |= {attrs[key] for key in ("id", "name") if attrs.get(key)}
        self.links |= {attrs[key] for key in ("href", "src") if attrs.get(key)}


def read(path):
    """What a page has and what it links to."""
    reader = Reader()
    reader.feed(path.read_text("utf-8"))
    return reader


def internal(page, link):
    """The file and the anchor that a link of a page means; None if it is elsewhere."""
    target = urlsplit(urljoin(f"{HOST}/{page}", link))
    if target.hostname != "127.0.0.1" or target.scheme != "http":
        return None
    address, anchor = urldefrag(target.geturl())
    path = unquote(urlsplit(address).path).lstrip("/")
    if not path or path.endswith("/"):
        path += "index.html"
    return path, unquote(anchor)
