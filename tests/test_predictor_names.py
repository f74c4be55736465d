"""States with names, which have to be those of the features."""

import pickle

import numpy as np
import pandas as pd
import pytest
from samples import draw
from sklearn.base import clone
from sklearn.compose import make_column_transformer
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import (
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    compile_predictor,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import load_puma560

START = {"task_feature": "load", "max_iter": 0}
X, Y = draw()
FRAME = pd.DataFrame({"a": X[:, 0], "load": X[:, 2].astype(int), "b": X[:, 1]})
SCALER = make_column_transformer(
    (StandardScaler(), ["b", "a"]),
    remainder="passthrough",
    verbose_feature_names_out=False,
).set_output(transform="pandas")
MODELS = {
    "model": MultiTaskGPRegressor(rank=1, **START),
    "single": SingleTaskGP(**START),
    "search": RankSearchIC(MultiTaskGPRegressor(**START), ranks=(1,)),
    "pipeline": make_pipeline(SCALER, MultiTaskGPRegressor(rank=1, **START)),
}


@pytest.fixture(scope="module", params=MODELS)
def model(request):
    return clone(MODELS[request.param]).fit(FRAME, Y)


def refused(predictor, x, match, **options):
    for ask in (predictor, predictor.std):
        with pytest.raises(ValueError, match=match):
            ask(x, **options)


def test_names_in_another_order_are_refused(model):
    predictor = pickle.loads(pickle.dumps(compile_predictor(model, 1, std=True)))
    x = pd.Series({"a": 0.3, "b": -0.2})
    expected = model.predict(pd.DataFrame({"a": [0.3], "load": [1], "b": [-0.2]}))
    np.testing.assert_allclose(predictor(x), expected)
    match = r"x has the names \['b', 'a'\], but .* are \['a', 'b'\], in this order"
    refused(predictor, x[::-1], match)
    with pytest.raises(ValueError, match=match):
        predictor.predict_tasks(x[::-1])
    refused(predictor, FRAME.loc[0], r"names \['a', 'load', 'b'\]")
    refused(predictor, x.rename({"b": "c"}), r"names \['a', 'c'\]")


def test_what_has_no_names_is_taken_by_position(model):
    predictor = compile_predictor(model, task=1)
    expected = predictor(np.array([0.3, -0.2]))
    for x in ([0.3, -0.2], pd.Series([0.3, -0.2])):
        np.testing.assert_array_equal(predictor(x), expected)


def test_features_without_names_take_any():
    predictor = compile_predictor(PooledGP(max_iter=0).fit(X, Y), task=1)
    x = pd.Series({"b": 0.3, "a": -0.2})
    np.testing.assert_array_equal(predictor(x), predictor(x.to_numpy()))


def test_each_of_several_models_counts():
    models = [PooledGP(**START).fit(FRAME[list(of)], Y) for of in (FRAME, FRAME)]
    compile_predictor(models, task=1)(pd.Series({"a": 0.3, "b": -0.2}))
    models[1] = PooledGP(**START).fit(FRAME[["b", "a", "load"]], Y)
    predictor = compile_predictor(models, task=1, std=True)
    refused(predictor, pd.Series({"a": 0.3, "b": -0.2}), r"are \['b', 'a'\]")


def test_descriptors_are_no_part_of_a_state():
    table = FRAME.assign(mass=FRAME["load"] * 2.0)[["mass", "a", "load", "b"]]
    options = {"rank": 2, "task_descriptors": ["mass"]}
    model = MultiTaskGPRegressor(**options, **START).fit(table, Y)
    predictor, x = compile_predictor(model), pd.Series({"a": 0.3, "b": -0.2})
    np.testing.assert_array_equal(predictor(x, 1), predictor(x.to_numpy(), 1))
    for ask in (predictor.by_descriptors, predictor.predict_tasks):
        with pytest.raises(ValueError, match=r"names \['b', 'a'\]"):
            ask(x[::-1])


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.DescriptorWarning")
@pytest.mark.parametrize("described", [None, ["mass"]], ids=str)
def test_features_of_a_robot(described):
    loads = {"loads": [1, 2, 3], "descriptors": described}
    table, torques = load_puma560(n_per_load=6, **loads, as_frame=True, return_X_y=True)
    model = MultiTaskGPRegressor(rank=1, max_iter=0)
    model = make_inverse_dynamics_regressor(
        model, task_feature="load", task_descriptors=described
    )
    model = model.fit(table, torques.iloc[:, 1])
    x = table.drop(columns=["load", *(described or [])]).loc[0]
    predictor = compile_predictor(model, table.loc[0, "load"], std=True)
    np.testing.assert_allclose(predictor(x), model.predict(table[:1]), rtol=1e-9)
    refused(predictor, x[::-1], "x has the names .'qdd6'")
