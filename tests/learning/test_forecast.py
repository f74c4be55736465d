"""Fits that take minutes are foreseen."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from drawn import draw, pose
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
    multitask,
    single_task,
)
from skmtgp._estimators import base, deciding, doubts
from skmtgp.exceptions import LongFitWarning
from skmtgp.learning import forecast
from skmtgp.learning.forecast import Forecast, foresee, foresee_bounds


@pytest.fixture
def few(monkeypatch):
    """As if 36 rows were many."""
    monkeypatch.setattr(forecast, "FEW", 30)
    monkeypatch.setattr(forecast, "SAMPLE", 12)


def test_more_models_take_longer(few):
    problem = pose(draw(np.eye(3)))
    one, many = foresee([problem]), foresee([problem] * 20, 20)
    assert one.seconds > 0.0
    assert np.divide(many.n_evaluations, one.n_evaluations).tolist() == [400.0]


def test_noisy_data_take_fewer_steps_from_all_rows(few):
    levels = {"coarse": 12, "coarse_per_task": 2, "refinement": 2.0}
    problem = pose(draw(np.eye(3)), **levels)
    assert foresee([problem]).n_evaluations == [250, 120, 120]
    assert foresee([replace(problem, noisy=True)]).n_evaluations == [250, 100, 100]


@pytest.mark.parametrize(("asked", "noisy"), [(0.1, True), (1, False)])
def test_the_small_model_says_first_whether_they_are_unless_it_takes_long(
    few, monkeypatch, asked, noisy
):
    monkeypatch.setattr(deciding, "ASKED", asked)
    data, found = draw(np.eye(3), per_task=20), []
    y = data.y + np.random.default_rng(0).standard_normal(60)

    def record(problems, n_forms):
        found.append(problems[0].noisy)
        return foresee(problems, n_forms)

    monkeypatch.setattr(base, "foresee", record)
    X = np.column_stack([data.X, data.tasks])
    MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1, max_iter=9).fit(X, y)
    assert found[0] is noisy


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SkmtgpWarning")
@pytest.mark.parametrize(
    ("model", "n_forms"),
    [
        (MultiTaskGPRegressor(), 5),
        (MultiTaskGPRegressor(rank=1), 1),
        (RankSearchIC(MultiTaskGPRegressor(), ranks=(1, 2)), 2),
    ],
)
def test_sparse_fits_are_foreseen_by_the_bound(few, monkeypatch, model, n_forms):
    """Once, before they begin."""
    monkeypatch.setattr(doubts, "LONG", 1e-9)
    monkeypatch.setattr(forecast, "BOUNDS", 7)
    data, found = draw(np.eye(3), per_task=20), []

    def record(*of):
        found.append((of[-1], foresee_bounds(*of)))
        return found[-1][1]

    monkeypatch.setattr(multitask, "foresee_bounds", record)
    sparse = {"inference": "sparse", "n_inducing": 9, "n_exact": 30, "max_iter": 3}
    nested = isinstance(model, RankSearchIC)
    model.set_params(**{"estimator__" * nested + k: v for k, v in sparse.items()})
    X = np.column_stack([data.X, data.tasks])
    match = "60 rows by sparse .* A given rank or fewer n_inducing take less"
    with pytest.warns(LongFitWarning, match=match):
        model.fit(X, data.y)
    assert [n for n, _ in found] == [n_forms]
    assert found[0][1] > 0.0


def test_few_rows_are_not_foreseen():
    assert foresee([pose(draw(np.eye(3)))]).seconds == 0.0


def test_few_rows_of_many_models_are(monkeypatch):
    problem = pose(draw(np.eye(3)))  # of 36 rows
    monkeypatch.setattr(forecast, "FEW", 71)
    monkeypatch.setattr(forecast, "SAMPLE", 12)
    assert foresee([problem] * 7).seconds == 0.0
    assert foresee([problem] * 2, 4).seconds > 0.0  # eight: as one of 72 rows


def test_it_grows_with_the_cube_of_the_rows(few, monkeypatch):
    times = iter([0.0, 1.0, 3.0] * 2)  # the second one was held up
    monkeypatch.setattr(forecast, "perf_counter", lambda: next(times))
    problem, larger = (pose(draw(np.eye(3), per_task=n)) for n in (12, 24))
    assert foresee([larger]).seconds == pytest.approx(8.0 * foresee([problem]).seconds)


@pytest.mark.parametrize("make", [lambda of: of, RankSearchIC])
def test_a_long_fit_says_so(few, make, monkeypatch):
    monkeypatch.setattr(doubts, "LONG", 1e-3)
    data = draw(np.eye(3))
    X = np.column_stack([data.X, data.tasks])
    gp = MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1, learning="staged")
    with pytest.warns(LongFitWarning, match="36 rows by dense .* inference='sparse'"):
        make(gp).fit(X, data.y)
    gp.set_params(max_iter=0).fit(X, data.y)  # nothing is learned


def test_the_time_is_in_minutes_or_hours(few, monkeypatch):
    data = draw(np.ones((3, 3)))
    X, gp = np.column_stack([data.X, data.tasks]), MultiTaskGPRegressor(rank=1)
    for seconds, match in [(300.0, "5 minutes"), (3e4, "8 hours")]:
        forecast = Forecast([100], [1], seconds / 100**3)
        monkeypatch.setattr(base, "foresee", lambda *_, of=forecast: of)
        with pytest.warns(LongFitWarning, match=match):
            gp.fit(X, data.y)


@pytest.mark.parametrize(
    "make", [lambda of: of, partial(RankSearchIC, ranks=(0, 1, 2, 3))]
)
def test_with_verbose_it_is_said_how_much_there_is_to_do(few, make, told):
    data = draw(np.ones((3, 3)))
    X = np.column_stack([data.X, data.tasks])
    gp = MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1, learning="staged", verbose=1)
    make(gp).fit(X, data.y)
    lines = told()
    first = next(line for line in lines if "Learning" in line)
    n_forms = 1 if make(gp) is gp else 4
    assert first.startswith(
        "Learning from 36 rows by dense inference will take very roughly "
        f"{250 * n_forms} evaluations of 36 rows at "
    )


@pytest.mark.parametrize("make", [lambda of: of, RankSearchIC])
def test_it_is_said_once_and_before_units_are_chosen(few, make, told, monkeypatch):
    monkeypatch.setattr(doubts, "LONG", 1e-3)
    data = draw(np.eye(3))
    gp = MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1, max_iter=3, verbose=1)
    with pytest.warns() as caught:
        make(gp).fit(np.column_stack([data.X, data.tasks]), data.y)
    assert sum(of.category is LongFitWarning for of in caught) == 1
    lines = told()
    assert lines[0].startswith("Learning from 36 rows by dense inference")
    assert sum("Learning from 36 rows" in line for line in lines) == 1


@pytest.mark.parametrize("verbose", [0, 1])
def test_single_tasks_are_foreseen_together(few, told, monkeypatch, verbose):
    """Before the first one begins, and once."""
    monkeypatch.setattr(single_task, "FEW", 30)
    data = draw(np.ones((3, 3)), per_task=36)
    X, begun = np.column_stack([data.X, data.tasks]), []

    def foresee(problems):
        begun.append(len(problems[0].data))
        return Forecast([36], [2], 60.0 / 36**3)

    monkeypatch.setattr(single_task, "foresee", foresee)
    monkeypatch.setattr(doubts, "LONG", 100.0)
    gp = SingleTaskGP(RBF([1.0, 1.0]), verbose=verbose)
    with pytest.warns(LongFitWarning, match="3 tasks of up to 36 rows .* 6 minutes"):
        gp.fit(X[:108], data.y[:108])
    assert begun == [36]
    lines = told()
    if not verbose:
        assert lines == []
    else:
        assert lines[0].endswith("will take very roughly 360 s on one processor")
        assert lines[1].startswith("task 0 (1 of 3), Learning from 36 rows by")
    gp.set_params(max_iter=0).fit(X, data.y)
    assert begun == [36]
