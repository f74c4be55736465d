"""Fits that take minutes are foreseen."""

import numpy as np
import pytest
from drawn import draw, pose
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp._estimators import base
from skmtgp.exceptions import LongFitWarning
from skmtgp.learning import forecast
from skmtgp.learning.forecast import seconds_of


@pytest.fixture
def few(monkeypatch):
    """As if 36 rows were many."""
    monkeypatch.setattr(forecast, "FEW", 30)
    monkeypatch.setattr(forecast, "SAMPLE", 12)


def test_more_models_take_longer(few):
    problem = pose(draw(np.eye(3)))
    seconds = seconds_of([problem], 1)
    assert seconds > 0.0
    assert seconds_of([problem] * 20, 20) > 20.0 * seconds


def test_few_rows_are_not_foreseen():
    assert seconds_of([pose(draw(np.eye(3)))], 1) == 0.0


def test_it_grows_with_the_cube_of_the_rows(few, monkeypatch):
    times = iter([0.0, 1.0] * 2)
    monkeypatch.setattr(forecast, "perf_counter", lambda: next(times))
    problem, larger = (pose(draw(np.eye(3), per_task=n)) for n in (12, 24))
    assert seconds_of([larger], 1) == pytest.approx(8.0 * seconds_of([problem], 1))


@pytest.mark.parametrize("make", [lambda of: of, RankSearchIC])
def test_a_long_fit_says_so(few, make, monkeypatch):
    monkeypatch.setattr(base, "LONG", 1e-3)
    data = draw(np.eye(3))
    X = np.column_stack([data.X, data.tasks])
    gp = MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1, learning="staged")
    with pytest.warns(LongFitWarning, match="36 rows by dense .* inference='sparse'"):
        make(gp).fit(X, data.y)
    gp.set_params(max_iter=0).fit(X, data.y)  # nothing is learned


def test_the_time_is_in_minutes_or_hours(few, monkeypatch):
    data = draw(np.eye(3))
    X, gp = np.column_stack([data.X, data.tasks]), MultiTaskGPRegressor(rank=1)
    for seconds, match in [(300.0, "5 minutes"), (3e4, "8 hours")]:
        monkeypatch.setattr(base, "seconds_of", lambda *_, of=seconds: of)
        with pytest.warns(LongFitWarning, match=match):
            gp.fit(X, data.y)
