import gc

import pytest

from skmtgp._estimators import sampled
from skmtgp.learning import sampling
from skmtgp.learning.sampling import LENGTH, N_WARM, THINNED


@pytest.hookimpl(wrapper=True)
def pytest_collect_file():
    """Tests have no examples in docstrings, and several files are called conftest."""
    collectors = yield
    return [each for each in collectors if type(each).__name__ != "DoctestModule"]


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Nothing that is collected becomes garbage: looking for it took half the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.fixture(scope="module")
def certain_theta():
    """All of theta counts as known, so that variances are those of the textbook.

    It holds for the rest of a file's tests.
    """
    with pytest.MonkeyPatch.context() as patch:
        for path in ("multitask.with_open_rows", "_estimators.fitted.with_growth"):
            patch.setattr(f"skmtgp.{path}", lambda problem, mode, posterior: mode)
        yield


@pytest.fixture
def told(caplog):
    """Lines that fits have told since it was called last."""

    def lines():
        found = [of.getMessage() for of in caplog.records if of.name == "skmtgp"]
        caplog.clear()
        return found

    return lines


@pytest.fixture(autouse=True, scope="module")
def length_of_chains():
    """Short ones: what is done with draws does not need good ones.

    Only tests of what is drawn have them as they are: see `long_chains`.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampling, "N_WARM", 10)
        patch.setattr(sampling, "LENGTH", 1.0)
        for module in (sampling, sampled):
            patch.setattr(module, "THINNED", 4)
        yield


@pytest.fixture
def long_chains(monkeypatch):
    """Chains of hyperparameters as users have them."""
    monkeypatch.setattr(sampling, "N_WARM", N_WARM)
    monkeypatch.setattr(sampling, "LENGTH", LENGTH)
    for module in (sampling, sampled):
        monkeypatch.setattr(module, "THINNED", THINNED)
