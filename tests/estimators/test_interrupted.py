"""A fit that is interrupted leaves the estimator as it was."""

import numpy as np
import pytest
from hard_data import ALL, GPS, SHARED, X, Y, with_params
from sklearn.base import clone

from skmtgp import BayesianLinearRegression, MultiTaskGPRegressor, TaskIdentifier
from skmtgp._numerics.one_thread import OneThread
from skmtgp._numerics.parallel import ONE_THREAD
from skmtgp.inference.dense import DenseLikelihood, DensePosterior

pytestmark = pytest.mark.usefixtures("nothing_is_printed")


def interrupted_at(monkeypatch, owner, name, call):
    """Raise KeyboardInterrupt in the given call of a function."""
    original, calls = getattr(owner, name), iter(range(call))

    def interrupted(*args, **kwargs):
        if next(calls, None) is None:
            raise KeyboardInterrupt
        return original(*args, **kwargs)

    monkeypatch.setattr(owner, name, interrupted)


class TestInterrupted:
    """In the last steps, when the first output or task is done already."""

    PLACES = {
        name: (DenseLikelihood, "posterior", 1 if name in SHARED else 2) for name in GPS
    } | {"BayesianLinearRegression": (BayesianLinearRegression, "_outputs_first", 1)}

    @pytest.mark.parametrize("before", ["unfitted", "fitted"])
    @pytest.mark.parametrize("name", ALL)
    def test_fit(self, monkeypatch, name, before):
        is_linear = name == "BayesianLinearRegression"
        model = with_params(ALL[name], **({} if is_linear else {"max_iter": 0}))
        if before == "fitted":
            model.fit(X[:, 1:], Y)
        kept = dict(vars(model))
        interrupted_at(monkeypatch, *self.PLACES[name])
        with pytest.raises(KeyboardInterrupt):
            model.fit(X, np.column_stack([Y, Y]))
        assert vars(model).keys() == kept.keys()
        assert all(vars(model)[key] is value for key, value in kept.items())

    def test_add_task(self, monkeypatch):
        model = MultiTaskGPRegressor(max_iter=0).fit(X, Y)
        kept = dict(vars(model))
        monkeypatch.setattr(DensePosterior, "__init__", interrupt)
        with pytest.raises(KeyboardInterrupt):
            model.add_task([[0.0, 0.0, 9.0]], [1.0])
        assert vars(model).keys() == kept.keys()
        assert all(vars(model)[key] is value for key, value in kept.items())


class TestThreads:
    """A signal in place of the end of a limit leaves BLAS its threads."""

    MODEL = MultiTaskGPRegressor(rank=1, max_iter=1)

    @pytest.mark.parametrize("method", ["__enter__", "__exit__"])
    @pytest.mark.parametrize("call", [0, 1, 5])
    def test_fit(self, monkeypatch, method, call):
        interrupted_at(monkeypatch, OneThread, method, call)
        with pytest.raises(KeyboardInterrupt):
            clone(self.MODEL).fit(X, Y)
        monkeypatch.undo()
        assert (ONE_THREAD.depth, ONE_THREAD.inside) == (0, set())

    @pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
    @pytest.mark.parametrize("method", ["predict", "sample_y", "predict_interval"])
    def test_predictions(self, monkeypatch, method):
        model = clone(self.MODEL).fit(X, Y)
        interrupted_at(monkeypatch, OneThread, "__exit__", 0)
        with pytest.raises(KeyboardInterrupt):
            getattr(model, method)(
                X, **{"return_std": True} if method == "predict" else {}
            )
        monkeypatch.undo()
        assert (ONE_THREAD.depth, ONE_THREAD.inside) == (0, set())

    @pytest.mark.parametrize("method", ["predict", "partial_fit"])
    def test_identification(self, monkeypatch, method):
        identifier = TaskIdentifier(with_params(self.MODEL, max_iter=0).fit(X, Y))
        interrupted_at(monkeypatch, OneThread, "__exit__", 0)
        with pytest.raises(KeyboardInterrupt):
            getattr(identifier, method)(X[:2], Y[:2])
        monkeypatch.undo()
        assert (ONE_THREAD.depth, ONE_THREAD.inside) == (0, set())


def interrupt(*_):
    raise KeyboardInterrupt
