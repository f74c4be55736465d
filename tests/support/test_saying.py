"""Lines that a fit prints."""

from time import time

import numpy as np
import pytest

from skmtgp import SingleTaskGP
from skmtgp._support import progress
from skmtgp._support.progress import is_due, part, say


def test_a_line_of_a_part_names_it(capsys):
    say("before")
    with part("task 1 of 2"):
        say("within")
    say("after")
    lines = ["before", "task 1 of 2, within", "after"]
    assert capsys.readouterr().out == "".join(f"[skmtgp] {of}\n" for of in lines)


@pytest.mark.parametrize("said", [1.0, 9.0])
@pytest.mark.parametrize("begun", [1.0, 9.0])
def test_a_line_is_due_after_some_seconds(monkeypatch, said, begun):
    now = time()
    monkeypatch.setattr(progress, "time", lambda: now)
    monkeypatch.setattr(progress, "_last", now - said)
    assert is_due(now - begun) == (min(said, begun) > progress.SILENCE)


def test_single_tasks_tell_how_far_they_are(capsys, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 0.0)
    x = np.random.default_rng(0).uniform(0.0, 6.0, 40)
    X = np.column_stack([x, np.repeat([0, 1], 20)])
    SingleTaskGP(verbose=1).fit(X, np.sin(x) + 0.1 * np.cos(40.0 * x))
    lines = capsys.readouterr().out.splitlines()
    ends = [i for i, line in enumerate(lines) if "iterations" in line]
    assert [lines[i].split(" after")[0] for i in ends] == [
        "[skmtgp] task 1 of 2",
        "[skmtgp] task 2 of 2",
    ]
    for m, part_of in enumerate((lines[: ends[0]], lines[ends[0] + 1 : ends[1]]), 1):
        assert part_of
        assert all(f"] task {m} of 2, the output, " in line for line in part_of)
