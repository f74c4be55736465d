"""WideRegressor: names of columns and of tasks, whatever form X has in a call."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.compose import make_column_transformer
from sklearn.ensemble import RandomForestRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import OneHotEncoder, StandardScaler

from skmtgp import MultiTaskGPRegressor, WideRegressor

x = np.linspace(0.0, 6.0, 14)
X = pd.DataFrame({"x": x, "z": np.cos(5.0 * x)})
Y = pd.DataFrame({"v": np.sin(x), "u": np.cos(x)})
MODEL = WideRegressor(MultiTaskGPRegressor("rbf", rank=1, max_iter=3))
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
LACK = "X does not have valid feature names, but WideRegressor was fitted with feature"
HAVE = "X has feature names, but WideRegressor was fitted without feature names"


@pytest.mark.parametrize("y", [Y, Y.to_numpy()], ids=["named", "unnamed"])
@pytest.mark.parametrize(
    ("in_fit", "later", "told"),
    [(X, X.to_numpy(), LACK), (X.to_numpy(), X, HAVE)],
    ids=["array after a frame", "frame after an array"],
)
def test_x_of_another_form_is_taken_as_that_of_fit(in_fit, later, told, y):
    """Scikit-learn's warning says so, once."""
    model = clone(MODEL).fit(in_fit, y)
    with pytest.warns(UserWarning, match=told) as warned:
        found = model.predict(later)
    assert len(warned) == 1
    np.testing.assert_array_equal(found, model.predict(in_fit))
    with pytest.warns(UserWarning, match=told):
        assert np.isfinite(model.score(later, y))


def test_an_array_of_numbers_and_text_is_taken_as_the_frame_of_fit():
    table = X.assign(site=["A", "B"] * 7)
    encoder = make_column_transformer(
        (OneHotEncoder(), ["site"]), remainder="passthrough", sparse_threshold=0
    )
    piped = make_pipeline(encoder, clone(MODEL.estimator))
    model = WideRegressor(piped).fit(table, Y)
    with pytest.warns(UserWarning, match=LACK):
        found = model.predict(table.to_numpy())
    np.testing.assert_array_equal(found, model.predict(table))


def test_tasks_have_the_names_of_y_behind_a_scaler():
    model = make_pipeline(StandardScaler(), clone(MODEL)).fit(X, Y)[-1]
    assert model.estimator_.tasks_.tolist() == ["u", "v"]
    assert list(model.estimator_.task_correlation_) == ["u", "v"]
    named = X.set_axis([0, 1], axis=1)  # scikit-learn takes strings alone as names
    assert clone(MODEL).fit(named, Y).estimator_.tasks_.tolist() == ["u", "v"]


def test_positions_name_tasks_where_y_has_no_strings():
    for y in (Y.to_numpy(), Y.set_axis([7, 5], axis=1)):
        assert clone(MODEL).fit(x[:, None], y).estimator_.tasks_.tolist() == [0, 1]


def test_other_models_take_numbers_alone():
    forest = WideRegressor(RandomForestRegressor(3, random_state=0))
    assert forest.fit(X.to_numpy(), Y).predict(X.to_numpy()).shape == Y.shape


def test_steps_of_a_pipeline_inside_take_numbers():
    """Tasks of an array are positions then."""
    pipeline = make_pipeline(StandardScaler(), MODEL.estimator)
    model = WideRegressor(pipeline).fit(X.to_numpy(), Y)
    assert np.isfinite(model.predict(X.to_numpy())).all()
    assert model.outputs_.tolist() == ["v", "u"]


def test_the_density_of_a_row_without_values():
    model = clone(MODEL).fit(X, Y)
    found = model.log_predictive_density(X[:1], Y[:1] * np.nan)
    np.testing.assert_array_equal(found, [[np.nan, np.nan]])
