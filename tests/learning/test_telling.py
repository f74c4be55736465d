"""What is told of learning, and of a climb while it goes on."""

import re
from dataclasses import replace
from time import time
from types import SimpleNamespace

import numpy as np
import pytest
from drawn import draw, pose, start_of

from skmtgp import MultiTaskGPRegressor
from skmtgp._support import progress
from skmtgp.inference.engines import Dense, Sparse
from skmtgp.learning import forecast
from skmtgp.learning.climbing import climb
from skmtgp.learning.forecast import is_large
from skmtgp.learning.telling import Teller

LINE = (
    r"tasks apart: iteration (\d+), log likelihood (-?\d+\.\d), "
    r"noise \d\.\de[+-]\d\d of the variance \((\d+) evaluations of 36 rows\)"
)
QUICK = {"learning": "staged", "normalize_y": "shared", "noise": "shared"}


@pytest.fixture(scope="module")
def data():
    return draw(np.eye(3))


def test_a_line_after_some_seconds(data, told, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 0.0)  # every likelihood takes so long
    problem = pose(data, max_iter=5, verbose=1)
    mode = climb(problem, start_of(problem))
    found = [re.fullmatch(LINE, line).groups() for line in told()]
    assert [int(n) for *_, n in found] == list(range(1, mode.n_evaluations + 1))
    iterations = [int(n) for n, _, _ in found]
    assert iterations[0] == 0
    assert iterations[-1] == mode.n_iter - 1
    values = [float(value) for _, value, _ in found]
    assert (np.diff(values) >= 0.0).all()  # the best so far
    assert values[-1] == pytest.approx(mode.value, abs=0.06)


@pytest.mark.parametrize("begun", ["long ago", "just now"])
def test_a_fit_that_has_just_begun_is_silent(data, told, monkeypatch, begun):
    monkeypatch.setattr(progress, "_last", 0.0)
    since = time() - 10.0 * (begun == "long ago")
    problem = pose(data, max_iter=5, verbose=1, begun=since)
    climb(problem, start_of(problem))
    assert len(told()) == (begun == "long ago")  # the next is not due yet


def test_a_line_before_a_long_climb(data, told, monkeypatch):
    monkeypatch.setattr(forecast, "FEW", 30)
    for pace, each in [(0.0, ""), (1e-3, ", about 47 s for each evaluation")]:
        Teller(pose(data, verbose=1, pace=pace)).begin()
        assert told() == ["tasks apart: a climb from 36 rows begins" + each]


def test_large_are_those_whose_matrices_are(monkeypatch):
    """Complete data of as many rows are quick; a bound takes all rows."""
    monkeypatch.setattr(forecast, "FEW", 30)
    data = draw(np.eye(3))  # 36 rows
    problem = pose(data)
    found = [
        is_large(replace(problem, engine=of))
        for of in (Dense(), SimpleNamespace(exact=True, side=lambda data: 12), Sparse())
    ]
    assert found == [True, False, True]


def test_quick_climbs_of_many_rows_are_not_announced(told, monkeypatch):
    monkeypatch.setattr(forecast, "FEW", 450)
    x = np.linspace(0.0, 6.0, 150)
    X = np.column_stack([np.tile(x, 3), np.repeat([0, 1, 2], 150)])
    y = np.sin(X[:, 0]) * (1.0 + X[:, 1])
    y += 0.1 * np.random.default_rng(0).standard_normal(450)
    model = MultiTaskGPRegressor(rank=1, verbose=1, tol=10.0, **QUICK).fit(X, y)
    assert model.inference_ == "kronecker"
    assert not any("begins" in line for line in told())


def test_without_verbose_nothing_is_said_nor_done(data, told, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 0.0)
    monkeypatch.setattr(forecast, "FEW", 1)
    problem = pose(data, max_iter=3)
    assert Teller(problem).told(len) is len
    climb(problem, start_of(problem))
    assert told() == []
