"""Fits on a Dask cluster of two processes, with the same results as without."""

import contextlib
import os
from importlib import import_module

import numpy as np
import pytest
from joblib import parallel_config
from samples import draw
from sklearn import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import GridSearchCV

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
    single_task,
)
from skmtgp.datasets import load_puma560
from skmtgp.learning import stages
from skmtgp.model_selection import TaskStratifiedKFold

distributed = pytest.importorskip("distributed")

QUICK = MultiTaskGPRegressor(rank=1, max_iter=5)
RANKS = RankSearchIC(QUICK, ranks=(1, 2))
CV = TaskStratifiedKFold(2)
FITS = {
    "outputs": QUICK,
    "independent": IndependentGP(max_iter=5),
    "restarts": clone(QUICK).set_params(n_restarts_optimizer=3, random_state=0),
    "staged": clone(QUICK).set_params(learning="staged", n_restarts_optimizer=1),
    "ranks": RANKS,
    "diagonal": clone(RANKS).set_params(estimator__diagonal=True),
    "sparse": clone(RANKS).set_params(
        estimator__inference="sparse", estimator__n_inducing=8
    ),
    "tasks": SingleTaskGP(max_iter=5),
    "sparse tasks": SingleTaskGP(max_iter=5, inference="sparse", n_inducing=8),
    "cells": GridSearchCV(QUICK, {"rank": [1, 2]}, cv=CV),
    "cells of ranks": GridSearchCV(RANKS, {"criterion": ["bic", "aic"]}, cv=CV),
}
X, Y = draw(n_outputs=2)
pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.long,  # processes begin
]


@pytest.fixture(scope="module")
def client():
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture
def dask(client):
    with parallel_config(backend="dask"):
        yield client


def alone(model, X, Y):
    """Fitted in this process."""
    with parallel_config(backend="sequential"):
        return clone(model).fit(X, Y)


def assert_same(model, X, Y):
    """The same bits on Dask as in this process."""
    found, expected = clone(model).fit(X, Y), alone(model, X, Y)
    np.testing.assert_array_equal(found.predict(X), expected.predict(X))
    if isinstance(model, GridSearchCV):
        for fold in ("split0_test_score", "split1_test_score"):
            scores = found.cv_results_[fold], expected.cv_results_[fold]
            np.testing.assert_array_equal(*scores)


@pytest.mark.parametrize("model", FITS.values(), ids=FITS)
def test_same_results(model, dask):
    assert_same(model, X, Y)


def test_same_results_of_a_pipeline(dask):
    data = load_puma560(n_per_load=4, loads=(1, 2), return_X_y=True)
    pipeline = make_inverse_dynamics_regressor(IndependentGP(max_iter=2))
    noise = {f"{pipeline.steps[-1][0]}__noise": ["shared", "per_task"]}
    assert_same(GridSearchCV(pipeline, noise, cv=CV), *data)


def test_nested_parts_are_not_shared_out(dask):
    """One process does a job and what is nested in it, so its warnings are its own."""
    with pytest.warns(ConvergenceWarning) as caught:
        SingleTaskGP(max_iter=3).fit(X, Y)
    told = [str(of.message) for of in caught if of.category is ConvergenceWarning]
    assert [text.split(":")[0] for text in told] == ["Tasks 0, 1, 2"]


@pytest.mark.parametrize("name", ["outputs", "ranks", "tasks"])
def test_progress(name, dask, told):
    lines = []
    for fit in (alone, lambda model, X, Y: model.fit(X, Y)):
        fit(clone(FITS[name]).set_params(verbose=1), X, Y)
        # but for how far a climb is after some seconds, in which a worker began
        lines.append([line for line in told() if ": iteration " not in line])
    assert lines[0] == lines[1]
    assert lines[0]


def test_lines_of_climbs_come_back(dask, told):
    """They are told in the workers, where the user's handlers are not."""
    lines = []
    for fit in (alone, lambda model, X, Y: model.fit(X, Y)):
        fit(clone(FITS["outputs"]).set_params(verbose=2), X, Y)
        lines.append(sorted(line for line in told() if "; done, " in line))
    assert lines[0] == lines[1]
    assert any(line.startswith("output 2 of 2, ") for line in lines[0])


def test_callbacks(dask):
    callback = pytest.importorskip("sklearn.callback", reason="new in scikit-learn 1.9")
    pytest.importorskip("rich")
    search = clone(FITS["cells of ranks"]).set_callbacks(callback.ProgressBar())
    np.testing.assert_array_equal(
        search.fit(X, Y).predict(X), alone(FITS["cells of ranks"], X, Y).predict(X)
    )


def test_errors_arrive(dask):
    with pytest.raises(ValueError, match="rank=4 is above the number of tasks, 3"):
        GridSearchCV(QUICK, {"rank": [4]}, cv=CV, error_score="raise").fit(X, Y)


def spring(module, name, path):
    """In a worker: whichever is the first to call a function dies of it."""
    module = import_module(module)
    function = getattr(module, name)

    def fatal(*args, **kwargs):
        with contextlib.suppress(FileExistsError):
            path.touch(exist_ok=False)
            os._exit(1)
        return function(*args, **kwargs)

    setattr(module, name, fatal)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning")
@pytest.mark.parametrize(
    ("model", "module", "name"),
    [(RANKS, stages, "_follow"), (FITS["tasks"], single_task, "_fit_alone")],
    ids=["ranks", "tasks"],
)
def test_death_of_a_worker(model, module, name, dask, tmp_path):
    """Another one does what it was about to do."""
    died = tmp_path / "died"
    dask.run(spring, module.__name__, name, died)
    assert_same(model, *draw(per_task=60, n_outputs=2))
    assert died.exists()
    dask.wait_for_workers(2)
