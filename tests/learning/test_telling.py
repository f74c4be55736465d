"""What a climb prints while it goes on."""

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
    r"\[skmtgp\] the output, fixed task covariance, 36 rows, iteration (\d+), "
    r"(\d+) likelihoods: log marginal likelihood (-?\d+\.\d\d), "
    r"noise variance \d\.\de[+-]\d\d of the target's"
)
QUICK = {"learning": "staged", "normalize_y": "shared", "noise": "shared"}


@pytest.fixture(scope="module")
def data():
    return draw(np.eye(3))


def lines_of(capsys):
    return capsys.readouterr().out.splitlines()


def test_a_line_after_some_seconds(data, capsys, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 0.0)  # every likelihood takes so long
    problem = pose(data, max_iter=5, verbose=1)
    mode = climb(problem, start_of(problem))
    found = [re.fullmatch(LINE, line).groups() for line in lines_of(capsys)]
    assert [int(n) for _, n, _ in found] == list(range(1, mode.n_evaluations + 1))
    iterations = [int(n) for n, _, _ in found]
    assert iterations[0] == 0
    assert iterations[-1] == mode.n_iter - 1
    values = [float(value) for _, _, value in found]
    assert (np.diff(values) >= 0.0).all()  # the best so far
    assert values[-1] == pytest.approx(mode.value, abs=0.006)


@pytest.mark.parametrize("begun", ["long ago", "just now"])
def test_a_fit_that_has_just_begun_is_silent(data, capsys, monkeypatch, begun):
    monkeypatch.setattr(progress, "_last", 0.0)
    since = time() - 10.0 * (begun == "long ago")
    problem = pose(data, max_iter=5, verbose=1, begun=since)
    climb(problem, start_of(problem))
    assert len(lines_of(capsys)) == (begun == "long ago")  # the next is not due yet


def test_a_line_before_a_long_climb(data, capsys, monkeypatch):
    monkeypatch.setattr(forecast, "FEW", 30)
    for pace, each in [(0.0, ""), (1e-3, ", about 47 s for each likelihood")]:
        Teller(pose(data, verbose=1, pace=pace)).begin()
        assert lines_of(capsys) == [
            "[skmtgp] the output, fixed task covariance: a climb with 36 rows begins"
            + each
        ]


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


def test_quick_climbs_of_many_rows_are_not_announced(capsys):
    x = np.linspace(0.0, 6.0, 500)
    X = np.column_stack([np.tile(x, 3), np.repeat([0, 1, 2], 500)])
    y = np.sin(X[:, 0]) * (1.0 + X[:, 1])
    y += 0.1 * np.random.default_rng(0).standard_normal(1500)
    model = MultiTaskGPRegressor(rank=1, verbose=1, tol=10.0, **QUICK).fit(X, y)
    assert model.inference_ == "kronecker"
    assert "begins" not in capsys.readouterr().out


def test_without_verbose_nothing_is_said_nor_done(data, capsys, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 0.0)
    monkeypatch.setattr(forecast, "FEW", 1)
    problem = pose(data, max_iter=3)
    assert Teller(problem).told(len) is len
    climb(problem, start_of(problem))
    assert lines_of(capsys) == []
