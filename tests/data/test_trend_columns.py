"""Which columns a trend has, from what the user names."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    OneHotEncoder,
    PolynomialFeatures,
    StandardScaler,
)

from skmtgp._data.trend import read_trend

X = np.array([[1.0, 2.0, 5.0], [3.0, 4.0, 6.0], [0.0, 9.0, 7.0]])
NAMES = np.array(["a", "b", "c"], dtype=object)
ALL = ["a", "task", "b", "c"]


def read(trend, **options):
    return read_trend(trend, X, 1, NAMES, ALL, **options)


def test_names_and_positions():
    for trend in (["c", "a"], [3, 0], [-1, -4]):
        columns = read(trend)
        np.testing.assert_array_equal(columns(X), X[:, [2, 0]])
        assert columns.names == ("c", "a")
        assert len(columns) == 2


def test_words():
    linear = read("linear")
    np.testing.assert_array_equal(linear(X), np.column_stack([np.ones(3), X]))
    assert linear.names == ("1", "a", "b", "c")
    constant = read("constant")
    np.testing.assert_array_equal(constant(X), np.ones((3, 1)))
    assert constant.names == ("1",)


def test_columns_without_names_have_those_of_scikit_learn():
    positions = np.array([0, 2, 3], dtype=object)  # that of the task is 1
    linear = read_trend("linear", X, 1, positions, None)
    assert linear.names == ("1", "x0", "x2", "x3")
    assert read_trend([2], X, 1, positions, None).names == ("x2",)


def test_beside_descriptors():
    described = np.array([1])  # b, which X is without
    options = {"descriptors": described}
    inputs = X[:, [0, 2]]
    columns = read_trend(["c"], inputs, 1, NAMES, ALL, **options)
    np.testing.assert_array_equal(columns(inputs), X[:, [2]])
    linear = read_trend("linear", inputs, 1, NAMES, ALL, **options)
    assert linear.names == ("1", "a", "c")
    np.testing.assert_array_equal(linear(inputs)[:, 1:], inputs)


def test_transformers():
    squares = PolynomialFeatures(2, include_bias=False)
    columns = read(make_pipeline(StandardScaler(), squares))
    assert columns.names[:4] == ("a", "b", "c", "a^2")
    assert columns(X).shape == (3, 9)
    assert columns.inputs == ("a", "b", "c")
    without = read_trend(squares, X, 1, np.array([0, 2, 3], object), None)
    assert without.names[:4] == ("x0", "x2", "x3", "x0^2")
    assert without.inputs is None
    assert not hasattr(squares, "n_output_features_")
    sparse = read(OneHotEncoder())
    assert isinstance(sparse(X), np.ndarray)
    nameless = read(FunctionTransformer(lambda X: np.asarray(X)[:, :2] ** 2))
    assert nameless.names == ("0", "1")


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (np.log, r"makes \[-inf, 2.19.*\] of row 2; the columns .* finite"),
        (lambda X: X[:, 0], r"makes an array of shape \(3,\)"),
        (lambda X: X[:2], r"makes an array of shape \(2, 3\) of 3 rows"),
        (lambda X: X[:, :0], r"makes an array of shape \(3, 0\)"),
        (lambda X: X @ X[:2], "does not take the inputs"),
        (lambda X: [["a"]] * 3, "could not convert string"),
    ],
)
def test_transformers_that_make_no_columns(function, message):
    transformer = FunctionTransformer(lambda X: function(np.asarray(X)))
    with np.errstate(divide="ignore"), pytest.raises(ValueError, match=message):
        read(transformer)
