"""Lines that a fit tells: records of logging, printed where nobody set logging up."""

import logging
import subprocess
import sys
from pathlib import Path
from time import time

import numpy as np
import pytest
from joblib import parallel_config

import skmtgp
from skmtgp import MultiTaskGPRegressor, SingleTaskGP
from skmtgp._numerics.parallel import run
from skmtgp._support import progress
from skmtgp._support.progress import LOGGER, is_due, part, say

LINES = "before", "task 1 of 2, within", "after"
FORMS = "tasks apart", "all tasks alike", "rank 1"
BACKENDS = ["loky", "threading", "sequential"]


@pytest.fixture
def plain(monkeypatch):
    """As in a script or a notebook, where nobody has set logging up; pytest has."""
    monkeypatch.setattr(LOGGER, "hasHandlers", lambda: bool(LOGGER.handlers))


@pytest.fixture
def handler(plain):
    """A handler of the user's, which keeps the records."""

    class Keeping(logging.Handler):
        def emit(self, record):
            self.records.append(record)

    handler = Keeping()
    handler.records = []
    LOGGER.addHandler(handler)
    yield handler
    LOGGER.removeHandler(handler)
    LOGGER.setLevel(logging.DEBUG)


def run_script(code):
    """What a new process prints, line by line."""
    root = Path(skmtgp.__file__).parents[1]
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def say_lines():
    say("before")
    with part("task 1 of 2"):
        say("within")
    say("after", logging.DEBUG)


def of_job(k):
    say(f"job {k}")
    return k


def test_without_logging_lines_are_printed(plain, capsys):
    say_lines()
    assert capsys.readouterr() == ("".join(f"[skmtgp] {of}\n" for of in LINES), "")
    assert LOGGER.handlers == []  # ours is on no logger


def test_a_users_handler_takes_the_place_of_printing(handler, capsys):
    say_lines()
    assert [of.getMessage() for of in handler.records] == list(LINES)
    levels = [logging.INFO, logging.INFO, logging.DEBUG]
    assert [of.levelno for of in handler.records] == levels
    assert {of.name for of in handler.records} == {"skmtgp"}
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("level", "n_lines"), [(logging.INFO, 2), (logging.WARNING, 0)]
)
def test_a_users_level_counts(handler, capsys, level, n_lines):
    LOGGER.setLevel(level)
    say_lines()
    assert len(handler.records) == n_lines
    LOGGER.removeHandler(handler)
    say_lines()
    assert len(capsys.readouterr().out.splitlines()) == n_lines


def test_the_roots_handlers_get_records_whatever_its_level(caplog):
    """Verbose is asked for; the usual level of the root, WARNING, is not."""
    assert logging.getLogger().level == logging.WARNING
    say("a line")
    assert caplog.messages == ["a line"]


@pytest.mark.long
def test_a_level_that_was_set_before_the_import_stays():
    level = run_script(
        "import logging; logging.getLogger('skmtgp').setLevel('ERROR');"
        "import skmtgp; print(logging.getLogger('skmtgp').level)"
    )
    assert level == [str(logging.ERROR)]


@pytest.mark.parametrize("backend", BACKENDS)
def test_records_of_workers_come_to_the_users_handlers(handler, capfd, backend):
    with parallel_config(backend=backend, n_jobs=2):
        assert run(of_job, [(1,), (2,)]) == [1, 2]
    found = [of.getMessage() for of in handler.records]
    assert sorted(found) == ["job 1", "job 2"]  # threads take turns
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_of_a_fit(handler, n_jobs):
    """As many lines, of the same levels, whatever the number of processes."""
    x = np.random.default_rng(0).uniform(0.0, 6.0, 30)
    X = np.column_stack([x, np.repeat([0, 1], 15)])
    Y = np.column_stack([np.sin(x), np.cos(x)])
    model = MultiTaskGPRegressor(rank=1, learning="staged", n_jobs=n_jobs, verbose=2)
    model.fit(X, Y)
    found = [of for of in handler.records if of.levelno == logging.INFO]
    assert [of.getMessage().split(":")[0] for of in found[:3]] == [
        "chosen from the data",
        "output 1 of 2, rank 1",
        "output 2 of 2, rank 1",
    ]
    others = [of for of in handler.records if of.levelno == logging.DEBUG]
    assert len(others) > 6
    assert all("iteration" in of.getMessage() for of in others)


@pytest.mark.parametrize("said", [1.0, 9.0])
@pytest.mark.parametrize("begun", [1.0, 9.0])
def test_a_line_is_due_after_some_seconds(monkeypatch, said, begun):
    now = time()
    monkeypatch.setattr(progress, "time", lambda: now)
    monkeypatch.setattr(progress, "_last", now - said)
    assert is_due(now - begun) == (min(said, begun) > progress.SILENCE)


def test_single_tasks_tell_how_far_they_are(told, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 0.0)
    x = np.random.default_rng(0).uniform(0.0, 6.0, 40)
    X = np.column_stack([x, np.repeat(["a", "b"], 20)])
    SingleTaskGP(verbose=1).fit(X, np.sin(x) + 0.1 * np.cos(40.0 * x))
    lines = told()
    ends = [i for i, line in enumerate(lines) if line.endswith("iterations")]
    names = "task a (1 of 2)", "task b (2 of 2)"
    assert [lines[i].split(":")[0] for i in ends] == list(names)
    parts = lines[: ends[0]], lines[ends[0] + 1 : ends[1]]
    for name, part_of in zip(names, parts, strict=True):
        assert part_of
        assert all(line.startswith(f"{name}, all tasks alike: ") for line in part_of)


@pytest.mark.long
@pytest.mark.parametrize("n_jobs", [1, 2])
def test_a_plain_script_prints(n_jobs):
    """Climbs of other processes too, as they go on."""
    script = f"""
import numpy as np
from skmtgp import MultiTaskGPRegressor
X = np.column_stack([np.linspace(0, 6, 20), [0, 1] * 10])
model = MultiTaskGPRegressor(rank=1, learning='staged', verbose=2, n_jobs={n_jobs})
model.fit(X, np.sin(X[:, 0]))
print(f'{{model.log_marginal_likelihoods_[0]:.1f}}')
"""
    *lines, value = run_script(script)
    assert all(line.startswith("[skmtgp] ") for line in lines)
    expected = f"[skmtgp] rank 1: log likelihood {value} ("
    assert sum(line.startswith(expected) for line in lines) == 1
    # of K^rho = I and 1 1^T, which are learned side by side, and of rank 1
    ends = [line for line in lines if "; done, " in line]
    assert [any(of in line for line in ends) for of in FORMS] == [True] * 3
