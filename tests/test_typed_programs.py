"""mypy understands programs of users, and finds their mistakes: the hints are right."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parent
README = ROOT / "README.md"
PROGRAMS = [HERE / "typed_program.py", HERE / "typed_mistakes.py"]
# scikit-learn has no hints. Dask's say nothing of skmtgp, and take most of the time.
OPTIONS = """
[mypy]
strict = true
color_output = false
ignore_missing_imports = true
follow_imports = silent
[mypy-dask.*,distributed.*]
follow_imports = skip
"""


def programs_of_the_readme(folder):
    """Files of the programs that bring their data."""
    text = README.read_text("utf-8") if README.is_file() else ""
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for number, block in enumerate(blocks):
        if "skmtgp.datasets" in block:
            path = folder / f"readme_{number}.py"
            path.write_text(block, "utf-8")
            yield path


def errors_of(paths, folder):
    """What mypy says of these files, line by line; skmtgp is that of this checkout."""
    config = folder / "mypy.ini"
    config.write_text(OPTIONS)
    places = ["--config-file", config, "--cache-dir", folder / "cache"]
    command = [sys.executable, "-m", "mypy", *places, *paths]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    return [line for line in done.stdout.splitlines() if ": error: " in line]


def marked(path):
    """Where a mistake is marked: the name of the file, and the line."""
    lines = enumerate(path.read_text("utf-8").splitlines(), 1)
    return {(path.name, n) for n, line in lines if line.endswith("# wrong")}


def test_mistakes_and_nothing_else_are_found(tmp_path):
    pytest.importorskip("mypy")
    paths = [*PROGRAMS, *programs_of_the_readme(tmp_path)]
    errors = errors_of(paths, tmp_path)
    places = [re.match(r"(.*?):(\d+): error", line).groups() for line in errors]
    found = {(Path(name).name, int(n)) for name, n in places}
    wrong = set().union(*map(marked, paths))
    assert wrong
    assert found == wrong, "\n".join(errors)
