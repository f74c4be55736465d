"""Callbacks of scikit-learn 1.9, which tell of a fit's progress."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from samples import draw
from sklearn import clone
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import Pipeline, make_pipeline

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators import posing
from skmtgp.learning.problem import Problem
from skmtgp.learning.tuning import TUNING
from skmtgp.preprocessing import InverseDynamicsFeatures

callback = pytest.importorskip("sklearn.callback", reason="new in scikit-learn 1.9")

MODELS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=1, max_iter=0),
    "IndependentGP": IndependentGP(max_iter=0),
    "PooledGP": PooledGP(max_iter=0),
    "SingleTaskGP": SingleTaskGP(max_iter=0),
    "BayesianLinearRegression": BayesianLinearRegression(),
    "RankSearchIC": RankSearchIC(MultiTaskGPRegressor(max_iter=0), ranks=(1, 2)),
}
# Outputs, tasks, or outputs and ranks; where there are several starts, these before.
N_JOBS = dict(zip(MODELS, [2, 2, 2, 3, None, 4], strict=True))
N_STARTS = {"MultiTaskGPRegressor": 2 * 3, "RankSearchIC": 2 * 6}
DECIDE = "MultiTaskGPRegressor", "IndependentGP", "PooledGP", "RankSearchIC"
EACH = pytest.mark.parametrize("name", MODELS)
X, Y = draw(n_outputs=2)


class Recorder:
    """Keeps the names of what begins and ends."""

    max_propagation_depth = None

    def __init__(self):
        self.events, self.fitted = [], None

    def setup(self, estimator, context):
        self.events.append("setup")

    def teardown(self, estimator, context):
        self.events.append("teardown")

    def on_fit_task_begin(self, estimator, context, *, X=None, y=None):
        self.events.append(("begin", context.task_name, context.max_subtasks))

    def on_fit_task_end(self, estimator, context, *, fitted_estimator=None):
        self.events.append(("end", context.task_name, context.max_subtasks))
        self.fitted = fitted_estimator


def events_of(name):
    """Setup, the fit with its stages and their jobs, and teardown."""
    job = [("begin", "job", 0), ("end", "job", 0)]
    stages = []
    units = ("units", int(name in DECIDE))
    for stage in (units, ("starts", N_STARTS.get(name)), ("learning", N_JOBS[name])):
        if stage[1]:
            stages += [("begin", *stage), *(stage[1] * job), ("end", *stage)]
    return ["setup", ("begin", "fit", None), *stages, ("end", "fit", None), "teardown"]


@EACH
@pytest.mark.parametrize("n_jobs", [None, 2])
def test_events(name, n_jobs):
    recorder, model = Recorder(), clone(MODELS[name])
    if name != "BayesianLinearRegression":
        model.set_params(n_jobs=n_jobs)
    model.set_callbacks(recorder).fit(X, Y)
    assert recorder.events == events_of(name)
    np.testing.assert_array_equal(
        model.predict(X), clone(MODELS[name]).fit(X, Y).predict(X)
    )
    np.testing.assert_array_equal(model.predict(X), recorder.fitted.predict(X))


def test_stages_of_large_data(monkeypatch):
    """Coarse data first, then all rows."""
    tuning = replace(TUNING, coarse=15, coarse_per_task=1)
    monkeypatch.setattr(posing, "Problem", partial(Problem, tuning=tuning))
    recorder = Recorder()
    MultiTaskGPRegressor(max_iter=0).set_callbacks(recorder).fit(X, Y[:, 0])
    stages = [e[1] for e in recorder.events if e[0] == "begin" and e[2] == 1]
    assert stages == ["units", "learning", "learning from all rows"]


@EACH
def test_failed_fit_is_torn_down(name):
    recorder = Recorder()
    model = clone(MODELS[name]).set_callbacks(recorder)
    before = dict(vars(model))
    with pytest.raises(ValueError, match="NaN"):
        model.fit(X, np.full_like(Y, np.nan))
    assert recorder.events == ["setup", ("begin", "fit", None), "teardown"]
    assert vars(model) == before
    assert model.fit(X, Y).predict(X).shape == Y.shape


@EACH
def test_progress_bar(name, capsys):
    pytest.importorskip("rich")
    clone(MODELS[name]).set_callbacks(callback.ProgressBar()).fit(X, Y)
    shown = capsys.readouterr().out
    assert f"{name} - fit" in shown
    assert "100%" in shown


@EACH
def test_inside_others(name):
    """They go down a search and a pipeline."""
    recorder = Recorder()
    pipe = Pipeline([("as_it_is", "passthrough"), ("model", clone(MODELS[name]))])
    grid = {"model__ranks": [(1,)]} if name == "RankSearchIC" else {}
    search = GridSearchCV(pipe, grid, cv=2).set_callbacks(recorder).fit(X, Y)
    assert recorder.events.count("setup") == recorder.events.count("teardown") == 1
    n_fits = 3  # two folds, and the best on all
    n_stages = sum(e[0] == "end" and e[1] == "learning" for e in recorder.events)
    assert n_stages == n_fits * (N_JOBS[name] is not None)
    assert np.isfinite(search.predict(X)).all()


def test_of_a_transformer():
    recorder = Recorder()
    states = np.column_stack([X[:, :2], X[:, 0], X[:, 2]])
    pipe = make_pipeline(InverseDynamicsFeatures(), PooledGP(max_iter=0))
    pipe.set_callbacks(recorder).fit(states, Y)
    assert recorder.events.count(("end", "learning", 2)) == 1
    features = InverseDynamicsFeatures().set_callbacks(recorder)
    recorder.events.clear()
    features.fit(states)
    assert recorder.events == events_of("BayesianLinearRegression")


def test_callback_that_fails():
    """What it raises is not lost, and the model stays as it was."""

    class Failing(Recorder):
        def on_fit_task_end(self, estimator, context):
            raise RuntimeError("from the callback")

    model = PooledGP(max_iter=0).fit(X, Y)
    before = model.predict(X)
    with pytest.raises(RuntimeError, match="from the callback"):
        model.set_callbacks(Failing()).fit(X, 2.0 * Y)
    np.testing.assert_array_equal(model.predict(X), before)
