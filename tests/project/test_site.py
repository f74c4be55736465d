"""Every page of the documentation in a browser; ``make test-pages`` asks for it."""

import hashlib
import io
import json
import re

import pytest
import site_tools as tools

WIDTHS = [390, 768, 1280]  # a phone, a tablet, a desktop
WORDS = re.compile(r"(?!min|ms|[KMG]i?B)\b[A-Za-z]{2,}")  # but for units
DARK = 0.45  # of full brightness: panels and pictures of a dark page stay below

STILL = """document.addEventListener("DOMContentLoaded", () => {
  const style = document.createElement("style");
  style.textContent = "* { transition: none !important }";
  document.head.append(style);
})"""

OVERFLOW = """() => {
  const width = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth <= width) return [];
  const scrolls = node => node && node !== document.body && (
    getComputedStyle(node).overflowX !== "visible" || scrolls(node.parentElement));
  return [...document.querySelectorAll("body *")].filter(node =>
    node.getBoundingClientRect().right > width + 1 && !scrolls(node.parentElement)
  ).slice(0, 4).map(node => node.tagName + "." + node.className);
}"""

UNBROKEN = """() => [...document.querySelectorAll("article :is(td, th)")]
  .filter(cell => getComputedStyle(cell).whiteSpace === "nowrap")
  .map(cell => cell.textContent)"""

IMAGES = """async () => {
  const found = [...document.querySelectorAll("img")];
  for (const node of found) node.loading = "eager";
  await Promise.all(found.map(node => node.decode().catch(() => null)));
  const faults = [];
  for (const node of found) {
    const name = node.currentSrc || node.src;
    if (!node.complete || !node.naturalWidth) faults.push("does not load: " + name);
    const title = node.closest(".sphx-glr-thumbcontainer");  // says it in words
    if (!node.alt.trim() && !(title && title.textContent.trim()))
      faults.push("says nothing in words: " + name);
  }
  return faults;
}"""

DONE = """() => /finished|did not match/.test(
  document.querySelector("#search-results .search-summary").textContent)"""

FORMULAE = """() => [...document.querySelectorAll("mjx-merror")]
  .map(node => "formula: " + node.textContent)"""

BLURRED = """async () => {  // a phone's pixels are the smallest
  const faults = [], sharp = innerWidth < 600 ? 2 : 1.5;
  for (const node of document.querySelectorAll("article img")) {
    const copy = new Image();
    copy.src = node.currentSrc;
    await copy.decode().catch(() => null);
    const wanted = node.getBoundingClientRect().width * sharp;
    if (!/[.]svg$/.test(copy.src) && copy.naturalWidth < 0.95 * wanted)
      faults.push(`${copy.naturalWidth} < ${wanted} pixels: ${copy.src}`);
  }
  return faults;
}"""

PANELS = """dark => {
  const faults = [];
  for (const node of document.querySelectorAll("body *")) {
    const box = node.getBoundingClientRect();
    if (box.width * box.height < 1000 || box.bottom <= 0) continue;
    const [r, g, b, a = 1] = getComputedStyle(node).backgroundColor
      .match(/[0-9.]+/g).map(Number);
    const bright = (0.2126 * r + 0.7152 * g + 0.0722 * b) / 255;
    if (a > 0.3 && bright > dark) faults.push(node.tagName + "." + node.className);
  }
  return [...new Set(faults)];
}"""


@pytest.fixture(scope="module")
def address():
    with tools.served(tools.folder()) as address:
        yield address


@pytest.fixture(scope="module")
def browser():
    with tools.chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def window(browser):
    context = browser.new_context(device_scale_factor=2, reduced_motion="reduce")
    page = context.new_page()
    page.add_init_script(STILL)
    yield page
    context.close()


@pytest.fixture
def said(window, address):
    """What goes wrong while a page opens: errors, and requests that are not served."""
    heard = []
    listeners = {
        "console": lambda m: m.type in ("error", "warning") and heard.append(m.text),
        "pageerror": lambda error: heard.append(str(error)),
        "requestfailed": lambda r: heard.append(f"{r.failure}: {r.url}"),
        "request": lambda r: (
            not r.url.startswith((address, "data:", "blob:"))
            and heard.append(f"elsewhere: {r.url}")
        ),
        "response": lambda r: r.status >= 400 and heard.append(f"{r.status}: {r.url}"),
    }
    for event, listener in listeners.items():
        window.on(event, listener)
    yield heard
    for event, listener in listeners.items():
        window.remove_listener(event, listener)


def settled(window):
    """Wait for the formulae."""
    window.evaluate("() => window.MathJax?.startup?.promise")


def resized(window, width):
    window.set_viewport_size({"width": width, "height": 900})
    window.evaluate("() => new Promise(done => requestAnimationFrame(done))")


def brightness(locator):
    """The mean of the frame of a picture as it is shown, from 0 to 1."""
    image = pytest.importorskip("PIL.Image")
    np = pytest.importorskip("numpy")
    shown = np.asarray(image.open(io.BytesIO(locator.screenshot())).convert("L")) / 255
    edges = [shown[2:4], shown[-4:-2], shown[:, 2:4].T, shown[:, -4:-2].T]
    return np.concatenate([edge.ravel() for edge in edges]).mean()


@pytest.mark.parametrize("page", tools.pages())
def test_page(page, window, address, said):
    """Nothing sticks out, fails, blurs, is nameless, or glares in the dark."""
    window.emulate_media(color_scheme="light")
    resized(window, WIDTHS[0])
    window.goto(f"{address}/{page}", wait_until="load")
    settled(window)
    faults = window.evaluate(IMAGES) + window.evaluate(FORMULAE)
    for width in WIDTHS:
        resized(window, width)
        faults += [f"{width} px: {name}" for name in window.evaluate(OVERFLOW)]
        faults += [f"{width} px: {name}" for name in window.evaluate(BLURRED)]
    cells = window.evaluate(UNBROKEN)
    faults += [f"unbroken: {text}" for text in cells if WORDS.search(text)]
    window.emulate_media(color_scheme="dark")
    window.wait_for_function("document.documentElement.dataset.theme === 'dark'")
    faults += [f"bright in the dark: {name}" for name in window.evaluate(PANELS, DARK)]
    for picture in window.locator("article img:visible").all():
        if brightness(picture) > DARK:
            faults.append(f"bright in the dark: {picture.get_attribute('src')}")
    if faults + said:
        pytest.fail("\n".join(faults + said), pytrace=False)


@pytest.fixture(scope="module")
def contents():
    """What every page has and what it links to."""
    site = tools.folder()
    return {page: tools.read(site / page) for page in tools.pages()}


def test_links(contents):
    """Every file is there, and every anchor of a page."""
    site, faults = tools.folder(), []
    for page, reader in contents.items():
        for path, anchor in filter(
            None, (tools.internal(page, link) for link in reader.links)
        ):
            if not (site / path).exists():
                faults.append(f"{page}: no {path}")
            elif page.startswith("_modules/"):
                continue  # viewcode mistakes the anchor where two modules share a file
            elif anchor and path in contents and anchor not in contents[path].ids:
                faults.append(f"{page}: no #{anchor} in {path}")
    assert not faults


def test_favicon(contents):
    site = tools.folder()
    for page in contents:
        assert re.search(
            r'<link rel="(shortcut )?icon"', (site / page).read_text("utf-8")
        )


FOUND = {  # what readers look for, and the title of what they should find first
    "GPU": "Speed",
    "kriging": "[Kk]riging",
    "missing": "missing",
    "offset": "levels",
    "plot": "Plots",
    "save": "Saving",
    "slow": "Speed",
}


@pytest.mark.parametrize("word", FOUND)
def test_search(word, window, address):
    window.goto(f"{address}/search.html?q={word}")
    window.wait_for_selector("#search-results .search-summary:not(:empty)")
    window.wait_for_function(DONE)
    title = window.locator("#search-results ul.search > li > a").first.text_content()
    assert re.search(FOUND[word], title), title


def test_notebooks(contents):
    """Every button has its notebook, and the wheel is the one that pip finds."""
    lite = tools.folder() / "lite"
    found = {
        link.partition("path=")[2]
        for reader in contents.values()
        for link in reader.links
        if "lite/notebooks" in link
    }
    assert found == {path.name for path in lite.glob("files/*.ipynb")}
    assert {"start.ipynb", "sensors.ipynb", "plot_sites.ipynb"} <= found
    (releases,) = json.loads((lite / "pypi" / "all.json").read_text("utf-8")).values()
    ((file,),) = releases["releases"].values()
    wheel = (lite / "pypi" / file["filename"]).read_bytes()
    assert hashlib.sha256(wheel).hexdigest() == file["digests"]["sha256"]
    assert file["filename"].endswith("-py3-none-any.whl")


def test_notebook_opens(browser, address):
    """The runtime is Pyodide's and comes from elsewhere: it is not fetched here."""
    context = browser.new_context()
    context.route(lambda url: not url.startswith(address), lambda route: route.abort())
    page, errors = context.new_page(), []
    page.on("pageerror", lambda e: "pyodide.mjs" in str(e) or errors.append(str(e)))
    page.goto(f"{address}/lite/notebooks/index.html?path=start.ipynb")
    page.wait_for_selector("text=MultiTaskGPRegressor", timeout=120_000)
    page.wait_for_selector("text=Python (Pyodide)", timeout=60_000)
    context.close()
    assert not errors
