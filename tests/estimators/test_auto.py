"""``hyperparameters="auto"``: draws where rows are few, Laplace where they suffice."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF
from waves import draw

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC

pytestmark = pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
AUTO = {"hyperparameters": "auto", "n_draws": 8}

X, y = draw()
Z = np.column_stack([np.linspace(0.0, 7.0, 6), [0, 1, 2, 0, 1, 2]])


def test_few_rows_are_sampled():
    options = {**AUTO, "hyperparameters": "sampled"}
    model = MultiTaskGPRegressor(rank=1, random_state=0, **options).fit(X, y)
    auto = MultiTaskGPRegressor(rank=1, random_state=0, **AUTO).fit(X, y)
    assert auto.hyperparameters_ == model.hyperparameters_ == "sampled"
    np.testing.assert_array_equal(auto.theta_samples_, model.theta_samples_)


def test_many_rows_a_hyperparameter_are_not():
    rows, t = draw(rows=40)
    model = IndependentGP(**AUTO).fit(rows, t)
    assert model.hyperparameters_ == "laplace"
    assert not hasattr(model, "theta_samples_")
    expected = IndependentGP(hyperparameters="laplace").fit(rows, t)
    found = [of.predict(Z, return_std=True) for of in (model, expected)]
    np.testing.assert_array_equal(*found)


def test_where_it_would_take_long(monkeypatch):
    from skmtgp._estimators import sampled

    monkeypatch.setattr(sampled, "MOST_ROWS", len(y) - 1)
    model = MultiTaskGPRegressor(rank=1, **AUTO).fit(X, y)
    assert model.hyperparameters_ == "laplace"


def test_search():
    model = MultiTaskGPRegressor(learning="staged", **AUTO)
    search = RankSearchIC(model, ranks=(1, 2), simpler=False).fit(X, y)
    assert search.best_estimator_.hyperparameters_ == "sampled"


def test_a_search_that_chooses_single_tasks(monkeypatch):
    from skmtgp import model_selection

    tabulate = model_selection.tabulate

    def alone_is_best(*args):
        table = tabulate(*args)
        table["bic"][-1] = table["bic"].min() - 1.0
        return table

    monkeypatch.setattr(model_selection, "tabulate", alone_is_best)
    model = MultiTaskGPRegressor(learning="staged", **AUTO)
    search = RankSearchIC(model, ranks=(1,), simpler=True, criterion="bic").fit(X, y)
    found = [of.hyperparameters_ for of in search.best_estimator_.estimators_]
    assert found == ["sampled"] * 3


def test_dask():
    da = pytest.importorskip("dask.array")
    model = MultiTaskGPRegressor(rank=1, inference="sparse", **AUTO)
    model.fit(da.from_array(X), da.from_array(y))
    assert model.hyperparameters_ == "mode"


def test_memory_is_not_asked_for_what_is_not_drawn(monkeypatch):
    import skmtgp._numerics.memory as memory
    from skmtgp._estimators import sampled

    monkeypatch.setattr(sampled, "MOST_ROWS", len(y) - 1)
    monkeypatch.setattr(memory, "available_memory", lambda: 50e6)
    options = {"hyperparameters": "auto", "n_draws": 10**6}
    model = MultiTaskGPRegressor(rank=1, **options).fit(X, y)
    assert model.hyperparameters_ == "laplace"


@pytest.mark.parametrize(
    "params", [{"kernel": [RBF(1.0), RBF(3.0)]}, {"inference": "sparse"}]
)
def test_where_only_the_mode_is_known(params, monkeypatch):
    from skmtgp._estimators import sampled

    monkeypatch.setattr(sampled, "MOST_ROWS", len(y) - 1)
    options = {"rank": 1, **AUTO, **params}
    assert MultiTaskGPRegressor(**options).fit(X, y).hyperparameters_ == "mode"


@pytest.mark.parametrize("noise", [0.3, 3.0])
def test_rows_that_are_mostly_noise_are_sampled(noise):
    """They tell as little as few rows do."""
    rows, t = draw(rows=40)
    t = t + noise * np.random.default_rng(0).standard_normal(len(t))
    model = IndependentGP(**AUTO).fit(rows, t)
    n_told = len(t) / model.n_hyperparameters_
    assert n_told > 16.0
    assert model.hyperparameters_ == ("sampled" if noise > 1.0 else "laplace")
