"""The examples as notebooks that run in the reader's browser, by JupyterLite.

Sphinx builds the wheel of this checkout and the notebooks beside the pages, without a
network; a reader's browser fetches Python itself from Pyodide's address.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from doctest import DocTestParser
from pathlib import Path

from docutils import nodes

ROOT = Path(__file__).parents[1]
PAGES = ["index", "tutorials/sensors", "tutorials/robot"]  # beside the gallery's
ELSEWHERE = [
    "auto_examples/plot_real_data",  # fdars has no wheel for a browser
    "auto_examples/plot_tracked_load",  # takes many minutes there
]
INSTALL = "%pip install -q skmtgp matplotlib"
WORDS = "Try it in the browser"
HINT = "Nothing is installed; the first run loads Python, which takes a minute."


def has_notebook(page):
    """Whether the examples of a page can run in a browser."""
    examples = page.startswith("auto_examples/plot_")
    return page in PAGES or (examples and page not in ELSEWHERE)


def notebook_name(page):
    """``tutorials/sensors`` is ``sensors.ipynb``; the first page is ``start.ipynb``."""
    return f"{'start' if page == 'index' else page.rpartition('/')[2]}.ipynb"


def cell(kind, source):
    """A cell of a notebook."""
    fields = {"outputs": [], "execution_count": None} if kind == "code" else {}
    return {"cell_type": kind, "metadata": {}, "source": source, **fields}


def cells_of(markdown):
    """The cells of a page: its prose, and its doctests without what they print."""
    text = markdown.partition("\n::::{grid}")[0]  # cards, and more that leads elsewhere
    text = re.sub(r"```{figure}.*?\n```\n", "", text, flags=re.DOTALL)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)  # links lead to other pages
    text = re.sub(r"{[\w:]+}(`)", r"\1", text)
    for i, part in enumerate(re.split(r"```{doctest}\n(.*?)```\n", text, flags=re.S)):
        if i % 2:
            yield from (cell("code", source) for source in sources_of(part))
        elif part.strip():
            yield cell("markdown", part.strip())


def sources_of(doctest):
    """The statements of a doctest; one that prints ends a cell."""
    source = ""
    for example in DocTestParser().get_examples(doctest):
        source += example.source
        if example.want:
            yield source.strip()
            source = ""
    if source:
        yield source.strip()


def notebook(cells):
    """A notebook that first fetches what it needs."""
    language = {"name": "python"}
    kernel = {**language, "display_name": "Python (Pyodide)", "language": "python"}
    return {
        "cells": [cell("code", INSTALL), *cells],
        "metadata": {"kernelspec": kernel, "language_info": language},
        "nbformat": 4,
        "nbformat_minor": 4,
    }


def notebooks(source, pages):
    """Names and contents; the gallery's are made by sphinx-gallery."""
    for page in pages:
        if page in PAGES:
            cells = list(cells_of((source / f"{page}.md").read_text("utf-8")))
        else:
            made = (source / page).with_suffix(".ipynb").read_text("utf-8")
            cells = json.loads(made)["cells"]
        yield notebook_name(page), notebook(cells)


def run(*command, **options):
    """A module of Python, silently; what it says is shown if it fails."""
    done = subprocess.run(
        [sys.executable, "-m", *map(str, command)],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )
    if done.returncode:
        raise RuntimeError(f"{command[0]} failed:\n{done.stdout}{done.stderr}")


def build(app, error):
    """Put JupyterLite, the wheel and the notebooks into the folder ``lite``."""
    if error or app.builder.name != "html":
        return
    work, output = Path(app.doctreedir).parent / "lite", Path(app.outdir) / "lite"
    for folder in (work, output):  # what is no page any more goes
        shutil.rmtree(folder, ignore_errors=True)
    contents = work / "notebooks"
    contents.mkdir(parents=True)
    pages = [page for page in sorted(app.env.found_docs) if has_notebook(page)]
    for name, content in notebooks(Path(app.srcdir), pages):
        (contents / name).write_text(json.dumps(content, indent=1), "utf-8")
    run("hatchling", "build", "-t", "wheel", "-d", work, cwd=ROOT)
    (wheel,) = work.glob("skmtgp-*.whl")
    options = {"contents": contents, "output-dir": output, "piplite-wheels": wheel}
    apps = [f"--apps={name}" for name in ("lab", "notebooks")]
    flags = [f"--{name}={value}" for name, value in options.items()]
    run("jupyter", "lite", "build", "--no-sourcemaps", *flags, *apps, cwd=work)


def add_button(app, doctree):
    """A link below the title of a page whose examples can run in a browser."""
    page = app.env.docname
    if not has_notebook(page):
        return
    address = f"lite/notebooks/index.html?path={notebook_name(page)}"
    link = nodes.reference("", WORDS, classes=["try-it"], reftitle=HINT)
    link["refuri"] = os.path.relpath(address, os.path.dirname(page) or ".")
    (section, *_) = doctree.findall(nodes.section)
    section.insert(1, nodes.paragraph("", "", link))


def setup(app):
    """As an extension of Sphinx."""
    app.connect("doctree-read", add_button)
    app.connect("build-finished", build, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
