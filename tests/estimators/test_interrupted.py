"""A fit that is interrupted leaves the estimator as it was."""

import numpy as np
import pytest
from hard_data import ALL, GPS, SHARED, X, Y, with_params

from skmtgp import BayesianLinearRegression, MultiTaskGPRegressor
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


def interrupt(*_):
    raise KeyboardInterrupt
