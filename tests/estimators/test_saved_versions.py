"""Saved models know the versions that they were saved with."""

import copy
import pickle

import pytest
from citizens import ESTIMATORS, FRAME, Y, assert_same_bits, spreads
from sklearn.base import clone
from sklearn.exceptions import InconsistentVersionWarning
from sklearn.pipeline import make_pipeline

from skmtgp import (
    IndependentGP,
    RankSearchIC,
    WideRegressor,
    compile_predictor,
)
from skmtgp._support import versions

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(params=sorted(ESTIMATORS))
def model(request):
    return clone(ESTIMATORS[request.param])


@pytest.fixture(scope="module", params=sorted(ESTIMATORS))
def fitted(request):
    """Packed and copied, but not changed."""
    return clone(ESTIMATORS[request.param]).fit(FRAME, Y)


@pytest.fixture
def save(monkeypatch):
    """Pickles a model as another version of a package would."""

    def with_version(model, name, version):
        now = versions._version
        with monkeypatch.context() as patch:
            found = {name: version}
            patch.setattr(versions, "_version", lambda of: found.get(of) or now(of))
            return pickle.dumps(model)

    return with_version


@pytest.mark.parametrize("name", ["skmtgp", "scikit-learn"])
def test_models_of_another_version_warn(model, name, save):
    """Also without a transformer of scikit-learn inside, which would warn itself."""
    saved, now = save(model, name, "0.0.7"), versions._version(name)
    with pytest.warns(InconsistentVersionWarning) as warned:
        again = pickle.loads(saved)
    assert str(warned[-1].message).startswith(  # those before are of models inside
        f"This {type(model).__name__} was saved with {name} 0.0.7, and is loaded "
        f"with {name} {now}. It may fail"
    )
    assert repr(again) == repr(model)


def test_models_without_versions_warn_of_all():
    """As those that were saved before versions were."""
    state = {"kernel": None}
    again = IndependentGP.__new__(IndependentGP)
    match = "skmtgp of unknown version and scikit-learn of unknown version, and is"
    with pytest.warns(InconsistentVersionWarning, match=match):
        again.__setstate__(state)
    assert state == {"kernel": None}
    assert repr(again) == repr(IndependentGP())
    assert clone(again).get_params() == IndependentGP().get_params()


@pytest.mark.parametrize("pack", [pickle.dumps, copy.copy, copy.deepcopy, "skops"])
def test_models_of_the_same_versions_do_not(fitted, pack):
    if pack == "skops":
        skops = pytest.importorskip("skops.io")
        data = skops.dumps(make_pipeline(fitted))
        again = skops.loads(data, trusted=skops.get_untrusted_types(data=data))[-1]
    else:
        again = pack(fitted)
        again = pickle.loads(again) if isinstance(again, bytes) else again
    assert vars(again).keys() == vars(fitted).keys()
    assert_same_bits(spreads(again, FRAME), spreads(fitted, FRAME))


def test_models_inside_of_others_warn_too(save):
    model = WideRegressor(RankSearchIC(IndependentGP()))
    saved = save(model, "skmtgp", "0.0.7")
    with pytest.warns(InconsistentVersionWarning) as warned:
        pickle.loads(saved)
    names = [of.message.estimator_name for of in warned]
    assert names == ["IndependentGP", "RankSearchIC", "WideRegressor"]


def test_compiled_predictors_warn_too(save):
    predictor = compile_predictor(IndependentGP(max_iter=0).fit(FRAME, Y))
    with pytest.warns(InconsistentVersionWarning, match="This CompiledPredictor was"):
        again = pickle.loads(save(predictor, "skmtgp", "0.0.7"))
    assert repr(again) == repr(predictor)
    assert vars(copy.copy(predictor)).keys() == vars(predictor).keys()
