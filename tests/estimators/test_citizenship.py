"""What scikit-learn users do with regressors, done with those of the package."""

import contextlib
import io
import pickle

import numpy as np
import pandas as pd
import pytest
import sklearn
from citizens import (
    FRAME,
    TASKS,
    X,
    Y,
    assert_same_bits,
    contained,
    each_twice,
    frame,
    scaled,
    spreads,
    tasks_of,
    y,
)
from scipy.sparse import csr_array, csr_matrix
from sklearn.base import clone
from sklearn.exceptions import NotFittedError, UnsetMetadataPassedError
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils import estimator_html_repr

from skmtgp import RankSearchIC
from skmtgp._estimators.estimator import DOCUMENTATION

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


class TestPipelines:
    @pytest.mark.parametrize("table", [X, FRAME], ids=["array", "frame"])
    def test_task_is_passed_through(self, estimator, table):
        columns = ["a", "b"] if table is FRAME else [0, 1]
        model = scaled(estimator, columns, remainder="passthrough").fit(table, y)
        by_hand = np.column_stack([StandardScaler().fit_transform(X[:, :2]), TASKS])
        expected = clone(estimator).fit(by_hand, y)
        np.testing.assert_allclose(model.predict(table), expected.predict(by_hand))
        labels = table["load"] if table is FRAME else TASKS
        assert tasks_of(model[-1]) == np.unique(labels).tolist()

    def test_task_that_is_dropped_is_missed(self, estimator):
        message = r"fractional numbers .* remainder='passthrough'"
        with pytest.raises(ValueError, match=message):
            scaled(estimator).fit(FRAME, y)

    @pytest.mark.parametrize("container", ["pandas", "polars"])
    def test_names_of_features(self, estimator, container):
        table = contained(container)
        options = {"remainder": "passthrough", "verbose_feature_names_out": False}
        named = "estimator__" * isinstance(estimator, RankSearchIC) + "task_feature"
        estimator.set_params(**{named: "load"})
        model = scaled(estimator, "b", **options).set_output(transform=container)
        model.fit(table[["load", "a", "b"]], y)
        names = ["b", "load", "a"]
        assert model[:-1].get_feature_names_out().tolist() == names
        assert model[-1].feature_names_in_.tolist() == names
        assert model.feature_names_in_.tolist() == ["load", "a", "b"]
        assert tasks_of(model[-1]) == ["u", "v", "w"]

    @pytest.mark.parametrize("option", ["return_std", "return_cov"])
    def test_options_of_predict(self, estimator, option):
        model = scaled(estimator, remainder="passthrough").fit(FRAME, Y)
        options = {option: True, "include_noise": True}
        found = model.predict(FRAME, **options)
        expected = model[-1].predict(model[:-1].transform(FRAME), **options)
        assert_same_bits(found, expected)

    @pytest.mark.parametrize("option", ["return_std", "return_cov"])
    def test_options_of_predict_as_routed_metadata(self, estimator, option):
        options = {option: True, "include_noise": True}
        with sklearn.config_context(enable_metadata_routing=True):
            model = scaled(estimator, remainder="passthrough").fit(FRAME, y)
            with pytest.raises(UnsetMetadataPassedError, match=option):
                model.predict(FRAME, **options)
            model[-1].set_predict_request(**dict.fromkeys(options, True))
            found = model.predict(FRAME, **options)
        expected = model[-1].predict(model[:-1].transform(FRAME), **options)
        assert_same_bits(found, expected)


class TestContainers:
    """Labels of every type, in test_inputs.py, but for what is not a model's own."""

    @each_twice(
        "of",
        [
            ([0, 1, 2], None),
            (["u", "v", "w"], object),
            (["u", "v", "w"], "category"),
            ([False, True, True], None),
            ([0, 1, 2], "Int64"),
            (["u", "v", "w"], "string"),
            ([False, True, True], "boolean"),
        ],
    )
    def test_labels_in_a_pipeline(self, estimator, of):
        labels, dtype = of
        table = frame(labels, dtype)
        model = scaled(estimator, remainder="passthrough").fit(table, y)
        assert tasks_of(model[-1]) == sorted(set(labels))
        codes = np.unique(labels, return_inverse=True)[1][TASKS]
        array = np.column_stack([X[:, :2], codes])
        expected = scaled(clone(estimator), [0, 1], remainder="passthrough")
        expected = expected.fit(array, y).predict(array)
        np.testing.assert_allclose(model.predict(table), expected, rtol=1e-9)

    @pytest.mark.parametrize("container", ["object", "polars"])
    def test_other_tables(self, fitted, container):
        model = clone(fitted).fit(contained(container), Y)
        assert tasks_of(model) == ["u", "v", "w"]
        assert_same_bits(spreads(model, contained(container)), spreads(fitted, FRAME))

    def test_sparse_columns_of_a_frame_are_made_dense(self, fitted):
        """As one-hot codes of pandas may be."""
        sparse = FRAME.assign(a=pd.arrays.SparseArray(FRAME["a"], fill_value=0.0))
        model = clone(fitted).fit(sparse, Y)
        assert_same_bits(spreads(model, sparse), spreads(fitted, FRAME))

    @pytest.mark.parametrize("kind", [csr_array, csr_matrix])
    def test_sparse_input_is_refused(self, estimator, kind):
        sparse = kind(X)
        message = r"Sparse data was passed for X, but dense data is required.*toarray"
        with pytest.raises(TypeError, match=message):
            estimator.fit(sparse, y)
        with pytest.raises(NotFittedError):
            estimator.predict(X)
        with pytest.raises(TypeError, match=message):
            estimator.fit(X, y).predict(sparse)


class TestInterface:
    def test_clone_of_a_fitted_model(self, fitted):
        before = pickle.dumps(fitted)
        copy = clone(fitted)
        assert repr(copy) == repr(fitted)
        with pytest.raises(NotFittedError):
            copy.predict(FRAME)
        assert_same_bits(spreads(copy.fit(FRAME, Y), FRAME), spreads(fitted, FRAME))
        assert pickle.dumps(fitted) == before

    def test_parameters(self, estimator):
        nested = "estimator__" * isinstance(estimator, RankSearchIC)
        name = f"{nested}task_feature"
        assert estimator.get_params()[name] == -1
        assert estimator.set_params(**{name: "load"}) is estimator
        assert estimator.get_params()[name] == "load"
        with pytest.raises(ValueError, match="Invalid parameter 'task' for estimator"):
            estimator.set_params(**{f"{nested}task": 0})

    def test_refit_with_other_parameters(self, estimator):
        nested = "estimator__" * isinstance(estimator, RankSearchIC)
        moved = clone(estimator).set_params(**{f"{nested}task_feature": 0})
        found = moved.fit(X[:, [2, 0, 1]], Y).predict(X[:, [2, 0, 1]])
        moved.set_params(**{f"{nested}task_feature": -1}).fit(FRAME, Y)
        assert_same_bits(spreads(moved, FRAME), spreads(estimator.fit(FRAME, Y), FRAME))
        np.testing.assert_allclose(found, moved.predict(FRAME), rtol=1e-9)

    def test_html(self, fitted):
        for model in (fitted, clone(fitted), make_pipeline(clone(fitted))):
            html = estimator_html_repr(model)
            name = type(fitted).__name__
            assert f'href="{DOCUMENTATION}/api/{name}.html"' in html

    def test_nothing_is_printed(self, estimator):
        with contextlib.redirect_stdout(io.StringIO()) as out:
            estimator.fit(FRAME, Y).predict(FRAME)
        assert out.getvalue() == ""

    def test_other_names_of_features(self, fitted):
        renamed = FRAME.rename(columns={"b": "c"})
        with pytest.raises(ValueError, match=r"(?s)feature names should match.*- b"):
            fitted.predict(renamed)
        with pytest.raises(ValueError, match="must be in the same order"):
            fitted.predict(FRAME[["b", "a", "load"]])
        with pytest.warns(UserWarning, match="X does not have valid feature names"):
            found = fitted.predict(FRAME.to_numpy())
        np.testing.assert_array_equal(found, fitted.predict(FRAME))

    def test_names_of_an_array(self, estimator):
        assert not hasattr(estimator.fit(FRAME.to_numpy(), y), "feature_names_in_")
        with pytest.warns(UserWarning, match="X has feature names, but"):
            estimator.predict(FRAME)
        assert estimator.fit(FRAME, y).feature_names_in_.tolist() == ["a", "b", "load"]
        assert estimator.n_features_in_ == 3
