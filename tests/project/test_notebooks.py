"""Notebooks run in a browser, on Pyodide; ``make test-pages`` asks for it.

With ``PYTESTFLAGS="-m long"`` the gallery's run, too: half an hour.

The built JupyterLite opens them in Chromium as it does for a reader. What it fetches
from Pyodide's address comes from a folder that ``.ci/get_pyodide.py`` fills: the same
packages for the same version of Python, so that nothing leaves this machine.
"""

import json
import os
import re
from doctest import DocTestParser
from pathlib import Path

import pytest
import site_tools as tools

ROOT = Path(__file__).parents[2]
PYODIDE = os.environ.get("SKMTGP_PYODIDE", "")
THERE = re.compile(r"https://[^/]+/pyodide/v(\d+)[\d.]*/full/([\w.+-]+)")
KINDS = {".wasm": "application/wasm", ".mjs": "text/javascript"}
STARTED = 120_000  # milliseconds, as are the next: the page and its kernel
FINISHED = 480_000

PAGES = ["index", "tutorials/sensors"]
PRINTED = [  # of what cells put out: not what they warn of, not pictures
    "[data-mime-type='text/plain']",
    "[data-mime-type='text/html']",
    "[data-mime-type='application/vnd.jupyter.stdout']",
]
FAILED = "[data-mime-type='application/vnd.jupyter.error']"
WARNED = "[data-mime-type='application/vnd.jupyter.stderr']"

DONE = """() => {
  const cells = [...document.querySelectorAll(".jp-CodeCell .jp-InputPrompt")];
  const numbered = cells.filter(cell => /\\d/.test(cell.textContent));
  return numbered.length === cells.length
    || document.querySelector("[data-mime-type='application/vnd.jupyter.error']");
}"""

SHOWN = """nodes => nodes.map(node => {  // also of what is out of sight
  const cells = [...node.querySelectorAll("th, td")];
  return cells.map(cell => cell.textContent).join(" ") || node.textContent;
})"""

IMPORT = """async ([address, names]) => {
  const { loadPyodide } = await import(`${address}/pyodide.mjs`);
  const python = await loadPyodide();
  return python.runPython(`
import importlib
", ".join(importlib.import_module(name).__name__ for name in ${JSON.stringify(names)})
`);
}"""


def pyodide():
    """The folder that is whole; without it, tests are skipped."""
    folder = Path(PYODIDE).resolve()
    if not PYODIDE or not (folder / "pyodide-lock.json").exists():
        pytest.skip("no Pyodide: `make test-pages` fetches it, or says why it cannot")
    return folder


def version(folder):
    """The first part of a Pyodide's version: which Python and which interface."""
    return json.loads((folder / "package.json").read_text("utf-8"))["version"]


@pytest.fixture(scope="module")
def browser():
    with tools.chromium() as browser:
        yield browser


@pytest.fixture
def elsewhere():
    """The addresses that a notebook asks for, and that are not served here."""
    return []


@pytest.fixture
def window(browser, address, elsewhere):
    """A page of a browser for which Pyodide's address is a folder."""
    folder = pyodide()

    def answer(route):
        url = route.request.url
        found = THERE.fullmatch(url.partition("?")[0])
        if url.startswith((address, "data:", "blob:")):
            route.continue_()
        elif found and (folder / found[2]).exists():
            kind = KINDS.get(Path(found[2]).suffix, "application/octet-stream")
            headers = {"Access-Control-Allow-Origin": "*", "Content-Type": kind}
            route.fulfill(path=folder / found[2], headers=headers)
        else:
            elsewhere.append(url)
            route.abort()

    context = browser.new_context(service_workers="block")
    context.route("**/*", answer)
    yield context.new_page()
    context.close()


@pytest.fixture(scope="module")
def address():
    with tools.served(tools.folder()) as address:
        yield address


def same_python(folder):
    """Skip where JupyterLite asks for another Python than the folder holds."""
    scripts = (tools.folder() / "lite" / "extensions").rglob("*.js")
    wanted = {
        found[1]
        for path in scripts
        for found in THERE.finditer(path.read_text("utf-8", "replace"))
    }
    held = version(folder)
    if wanted and held.partition(".")[0] not in wanted:
        pytest.skip(f"JupyterLite runs on Pyodide {wanted}, the folder has {held}")


def examples():
    """The gallery's notebooks in the built documentation."""
    if not tools.SITE:
        return []
    return sorted(path.name for path in Path(tools.SITE).glob("lite/files/plot_*"))


def words(texts):
    """What is printed, however it is laid out."""
    return [word for text in texts for word in text.split()]


def alike(here, there):
    """Dots stand for digits that depend on the processor."""
    return re.fullmatch(re.escape(here).replace(r"\.\.\.", ".*"), there)


def printed(page):
    """What a page of the documentation says that its cells print."""
    text = (ROOT / "docs" / f"{page}.md").read_text("utf-8")
    blocks = re.findall(r"```{doctest}\n(.*?)```\n", text, flags=re.DOTALL)
    return [e.want for b in blocks for e in DocTestParser().get_examples(b)]


def strangers(texts):
    """Warnings from the code of other packages, of which readers know nothing."""
    lines = [line for text in texts for line in text.splitlines()]
    return [x for x in lines if "Warning:" in x and "/skmtgp/" not in x]


def run_all(window, address, name):
    """Open a notebook and run all cells as a reader does; errors of cells."""
    window.goto(f"{address}/lite/notebooks/index.html?path={name}")
    window.wait_for_selector("text=Python (Pyodide)", timeout=STARTED)
    window.wait_for_selector(".jp-CodeCell", timeout=STARTED)
    window.get_by_role("menuitem", name="Run", exact=True).first.click()
    window.get_by_text("Run All Cells", exact=True).click()
    window.wait_for_function(DONE, timeout=FINISHED)
    return window.locator(FAILED).all_text_contents()


@pytest.mark.parametrize("page", PAGES)
def test_notebook_runs(page, window, address, elsewhere, monkeypatch):
    """It prints what the page says, and asks nothing but Pyodide's address."""
    same_python(pyodide())
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import lite

    assert not run_all(window, address, lite.notebook_name(page))
    assert not strangers(window.locator(WARNED).all_text_contents())
    outputs = window.locator(", ".join(PRINTED)).evaluate_all(SHOWN)
    here, there = words(printed(page)), words(outputs)
    assert not [pair for pair in zip(here, there, strict=True) if not alike(*pair)]
    assert not elsewhere


@pytest.mark.long
@pytest.mark.parametrize("name", examples())
def test_example_runs(name, window, address, elsewhere):
    same_python(pyodide())
    assert not run_all(window, address, name)
    assert not elsewhere


def test_standard_modules(browser):
    """Those of the standard library that skmtgp imports are in Pyodide."""
    from test_lite import imported

    names = imported()
    with tools.served(pyodide()) as address:
        page = browser.new_page()
        page.goto(f"{address}/package.json")
        found = page.evaluate(IMPORT, [address, names])
        page.close()
    assert found.split(", ") == names
