"""The notebooks that run in the browser: what they hold, and that they run there.

Here they run as much like there as CPython allows, with no thread, no process and no
`os.sched_getaffinity`. In Chromium, on Pyodide, test_notebooks.py runs some.
"""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"

pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only in a checkout")

# Pages of the gallery that take more than ten seconds
SLOW = {"plot_inducing_inputs", "plot_sampled", "plot_grid_search", "plot_novel_load"}
SLOW |= {"plot_joint_states", "plot_transfer", "plot_five_loads", "plot_choose_rank"}

DRAWS = """  # before threads are refused: Pyodide's Matplotlib starts none
import matplotlib; matplotlib.use("agg")
import matplotlib.pyplot
"""

LIKE_PYODIDE = """
import os, sys, sysconfig, threading, threadpoolctl, types
sysconfig.get_config_vars()  # before it asks which platform it is
threadpoolctl.threadpool_info()  # this looks for the C library, there in Pyodide

def refuse(*args, **kwargs):
    raise RuntimeError("can't start new thread")

sys.platform = "emscripten"
sys.modules["_multiprocessing"] = types.ModuleType("empty")  # scikit-learn 1.9 asks
sys.modules["_posixshmem"] = None
sys.modules["resource"] = None
threading.Thread.start = refuse
os.cpu_count = os.process_cpu_count = lambda: 1
for name in ("sched_getaffinity", "fork", "forkpty", "posix_spawn", "register_at_fork"):
    if hasattr(os, name):
        delattr(os, name)
"""


@pytest.fixture
def lite(monkeypatch):
    pytest.importorskip("docutils")
    monkeypatch.syspath_prepend(str(DOCS))
    import lite

    return lite


def codes(lite, page):
    """The cells of code of a page that is written by hand."""
    (found,) = dict(lite.notebooks(DOCS, [page])).values()
    return [cell["source"] for cell in found["cells"] if cell["cell_type"] == "code"]


def run(script, before=""):
    """What a script does there; BLAS has one thread, as Pyodide's has."""
    names = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"
    return subprocess.run(
        [sys.executable, "-W", "ignore", "-c", before + LIKE_PYODIDE + script],
        env=os.environ | dict.fromkeys(names, "1"),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def script_of(cells):
    """The cells one after another, in one namespace."""
    lines = ["names = {}", *(f"exec({source!r}, names)" for source in cells)]
    return "\n".join(lines)


def test_cells_are_prose_and_statements(lite):
    text = "# A title\n\n{class}`Thing`, [here](x.md).\n\n```{doctest}\n>>> a = 1\n"
    text += ">>> a\n1\n>>> b = a\n```\n```{figure} x.png\n:alt: x\n```\nThe end.\n"
    found = [(cell["cell_type"], cell["source"]) for cell in lite.cells_of(text)]
    assert found == [
        ("markdown", "# A title\n\n`Thing`, here."),
        ("code", "a = 1\na"),
        ("code", "b = a"),
        ("markdown", "The end."),
    ]


def test_notebooks_fetch_skmtgp_first(lite):
    for page in lite.PAGES:
        first, *others = codes(lite, page)
        assert first.startswith("%pip install")
        assert others
        assert not [source for source in others if ">>>" in source]


def test_names_of_notebooks_differ(lite):
    pages = [*lite.PAGES, *(f"auto_examples/{p.stem}" for p in gallery())]
    names = [lite.notebook_name(page) for page in pages if lite.has_notebook(page)]
    assert len(set(names)) == len(names) > 15


def gallery():
    return sorted((ROOT / "examples" / "gallery").glob("plot_*.py"))


def test_first_page_runs_like_in_a_browser(lite):
    script = script_of(codes(lite, "index")[1:])
    end = "print(sys.platform, names['model'].predict(names['noon']))"
    done = run(f"import skmtgp; skmtgp.show_versions()\n{script}\nimport sys; {end}")
    assert done.returncode == 0, done.stderr
    assert "\nemscripten [" in done.stdout


@pytest.mark.long
@pytest.mark.parametrize("n_jobs", [2, -1])
def test_more_processes_than_a_browser_has(n_jobs):
    """They are one, and nothing fails."""
    done = run(
        "from skmtgp import RankSearchIC, MultiTaskGPRegressor\n"
        "from skmtgp.datasets import make_sites\n"
        "X, y = make_sites()\n"
        "model = MultiTaskGPRegressor(learning='staged', task_feature='site')\n"
        f"search = RankSearchIC(model, ranks=(1, 2), n_jobs={n_jobs}).fit(X, y)\n"
        "print(search.best_rank_)"
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() in {"1", "2"}


@pytest.mark.longest  # more than ten seconds, too
def test_tutorial_runs_like_in_a_browser(lite):
    pytest.importorskip("matplotlib")
    done = run(script_of(codes(lite, "tutorials/sensors")[1:]), before=DRAWS)
    assert done.returncode == 0, done.stderr


def source(path):
    return path.read_text("utf-8")


def of_gallery():
    """Quick ones together, as imports take longer; slow ones for `make test-longest`.

    One that needs what may not be there is alone.
    """
    apart = [p for p in gallery() if p.stem in SLOW or "statsmodels" in source(p)]
    quick = [p for p in gallery() if p not in apart]
    for paths in (quick[::2], quick[1::2], *([path] for path in apart)):
        slow = SLOW.intersection(path.stem for path in paths)
        mark = pytest.mark.longest if slow else pytest.mark.long
        yield pytest.param(paths, marks=mark, id="-".join(p.stem for p in paths[:2]))


@pytest.mark.parametrize("paths", list(of_gallery()))
def test_gallery_runs_like_in_a_browser(lite, paths):
    """Those that need a package which a browser has not are not offered there."""
    paths = [p for p in paths if lite.has_notebook(f"auto_examples/{p.stem}")]
    if not paths:
        pytest.skip("is not offered")
    texts = {path.name: source(path) for path in paths}
    if any("statsmodels" in text for text in texts.values()):
        pytest.importorskip("statsmodels")
    close = "matplotlib.pyplot.close('all')"
    script = "\n".join(
        f"exec(compile({text!r}, {name!r}, 'exec'), {{}}); {close}"
        for name, text in texts.items()
    )
    done = run(script, before=DRAWS)
    assert done.returncode == 0, done.stderr


def imported():
    """Modules of the standard library that skmtgp imports."""
    names = set()
    for path in (ROOT / "skmtgp").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module)
    return sorted(n for n in names if n.split(".")[0] in sys.stdlib_module_names)


def test_no_module_that_a_browser_lacks():
    assert "concurrent.futures" in imported()
    assert not {"multiprocessing", "resource", "subprocess"} & set(imported())
