import numpy as np
import pandas as pd
import pytest
import sklearn
from checks import checks_of
from sklearn.compose import ColumnTransformer
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp.datasets import load_puma560
from skmtgp.exceptions import AngleUnitWarning
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.preprocessing import InverseDynamicsFeatures

NAMES = ["q1", "q2", "qd1", "qd2", "qdd1", "qdd2"]
LABELS = {
    "int": [3, 1, 3, 2, 1],
    "str": ["b", "a", "b", "c", "a"],
    "bool": [True, False, True, True, False],
    "category": pd.Categorical(list("babca"), list("dcba"), ordered=True),
    "int category": pd.Categorical([3, 1, 3, 2, 1]),
    "Int64": pd.array([3, 1, 3, 2, 1], dtype="Int64"),
    "string": pd.array(list("babca"), dtype="string"),
}


@pytest.fixture
def states():
    x = np.random.default_rng(0).normal(size=(5, 6)) * 10.0 ** np.arange(-2, 4)
    x[:3, 2] = 0.0, 1e-9, -1.1e-9
    return x + [0.0, 100.0, 0.0, 0.0, -5.0, 1e4]


def frame(states, labels="str", names=NAMES):
    return pd.DataFrame(states, columns=names).assign(load=LABELS[labels])


def expected_features(states):
    z = (states - states.mean(axis=0)) / states.std(axis=0)
    velocities = np.where(np.abs(states[:, 2:4]) <= 1e-9, 0.0, states[:, 2:4])
    return np.hstack([z, np.sign(velocities)])


class OfAnyWidth(InverseDynamicsFeatures):
    """Takes as many joints as fit, for checks that use 2 or 3 columns."""

    def _count_joints(self, n_features):
        return (n_features - 1) // 3


@checks_of([OfAnyWidth()])
def test_scikit_learns_checks(estimator, check):
    # The class itself refuses the widths of most checks; see the test of its errors.
    check(estimator)


@pytest.mark.parametrize("n_joints", [None, 2, np.int64(2)])
def test_states_are_standardised_and_signs_added(states, n_joints):
    X = np.column_stack([states, [3, 1, 3, 2, 1]])
    transformer = InverseDynamicsFeatures(n_joints)
    found = transformer.fit_transform(X)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found[:, :8], expected_features(states), atol=1e-14)
    np.testing.assert_array_equal(found[:, 6], [0, 0, -1, *np.sign(states[3:, 2])])
    np.testing.assert_array_equal(found[:, 8], X[:, 6])
    assert transformer.n_joints_ == 2
    assert transformer.n_features_in_ == 7
    np.testing.assert_allclose(transformer.mean_, states.mean(axis=0))
    np.testing.assert_allclose(transformer.scale_, states.std(axis=0))


def test_trigonometric_angles(states):
    X = frame(states)
    transformer = InverseDynamicsFeatures(angles="trigonometric", joint_types="RP")
    found = transformer.set_output(transform="pandas").fit_transform(X)
    names = ["cos(q1)", "sin(q1)", *NAMES[1:], "sgn(qd1)", "sgn(qd2)", "load"]
    assert list(found.columns) == names
    q = states[:, 0]
    np.testing.assert_array_equal(found["cos(q1)"], np.cos(q))
    np.testing.assert_array_equal(found["sin(q1)"], np.sin(q))
    z = (states[:, 1] - states[:, 1].mean()) / states[:, 1].std()
    np.testing.assert_allclose(found["q2"], z)
    others = states[:, 2:]  # zero stays zero
    expected = others / np.sqrt(np.square(others).mean(axis=0))
    np.testing.assert_allclose(found[NAMES[2:]], expected)
    np.testing.assert_array_equal(
        found["sgn(qd1)"], expected_features(states)[:, 6], strict=False
    )
    assert transformer.mean_.shape == transformer.scale_.shape == (7,)


@pytest.mark.parametrize("joint_types", [None, "RR", ["revolute", "R"]])
def test_all_joints_turn_unless_told_otherwise(states, joint_types):
    X = np.column_stack([states, np.ones(5)])
    options = {"angles": "trigonometric", "joint_types": joint_types}
    found = InverseDynamicsFeatures(**options).fit_transform(X)
    q = states[:, :2]
    expected = np.stack([np.cos(q), np.sin(q)], axis=-1).reshape(5, 4)
    np.testing.assert_array_equal(found[:, :4], expected)
    assert found.shape == (5, 11)


def test_a_joint_that_rests_has_no_scale(states):
    states[:, 2] = 0.0
    X = np.column_stack([states, np.ones(5)])
    transformer = InverseDynamicsFeatures(angles="trigonometric").fit(X)
    assert transformer.scale_[4] == 1.0
    np.testing.assert_array_equal(transformer.transform(X)[:, 4], 0.0)


def test_types_of_joints_do_not_matter_to_radians(states):
    X = np.column_stack([states, np.ones(5)])
    found = InverseDynamicsFeatures(joint_types="RP").fit_transform(X)
    np.testing.assert_array_equal(found, InverseDynamicsFeatures().fit_transform(X))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"angles": "degrees"},
            "angles='degrees' must be 'radians' or '",
        ),
        ({"joint_types": "RRR"}, "'RRR' are those of 3 joints, but there are 2"),
        ({"joint_types": "RX"}, "has 'X' for joint 2; it must be 'revolute'"),
    ],
)
def test_angles_and_types_that_are_none(states, options, message):
    with pytest.raises(ValueError, match=message):
        InverseDynamicsFeatures(**options).fit(frame(states))


def test_scales_are_those_of_the_training_data(states):
    X = np.column_stack([states, np.ones(5)])
    transformer = InverseDynamicsFeatures().fit(X)
    np.testing.assert_array_equal(
        transformer.transform(X[3:]), transformer.transform(X)[3:]
    )


def test_a_constant_column_is_only_centred(states):
    states[:, 4] = 0.1
    X = np.column_stack([states, np.ones(5)])
    transformer = InverseDynamicsFeatures().fit(X)
    assert transformer.scale_[4] == 1.0
    X[0, 4] = 2.1
    found = transformer.transform(X)[:, 4]
    np.testing.assert_allclose(found, [2.0, 0.0, 0.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("position", [0, 3, -2])
def test_the_task_column_moves_to_the_end(states, position):
    last = InverseDynamicsFeatures().fit_transform(frame(states))
    X = frame(states)
    place = position % 7
    names = [*NAMES[:place], "load", *NAMES[place:]]
    for task_feature in (position, "load"):
        transformer = InverseDynamicsFeatures(task_feature=task_feature)
        np.testing.assert_array_equal(transformer.fit_transform(X[names]), last)
        assert transformer.get_feature_names_out()[-1] == "load"


@pytest.mark.parametrize("labels", LABELS)
@pytest.mark.parametrize("as_frame", [True, False])
def test_labels_survive_in_arrays(states, labels, as_frame):
    X = frame(states, labels)
    found = InverseDynamicsFeatures().fit_transform(X if as_frame else X.to_numpy())
    assert type(found) is np.ndarray
    assert found[:, -1].tolist() == list(LABELS[labels])
    text = labels in ("str", "category", "string")
    assert found.dtype == (object if text else np.float64)
    np.testing.assert_allclose(
        found[:, :8].astype(float), expected_features(states), atol=1e-14
    )


@pytest.mark.parametrize("labels", LABELS)
def test_labels_are_untouched_in_frames(states, labels):
    X = frame(states, labels).set_axis(list("vwxyz"))
    transformer = InverseDynamicsFeatures().set_output(transform="pandas")
    found = transformer.fit_transform(X)
    pd.testing.assert_series_equal(found["load"], X["load"])
    assert list(found.columns) == [*NAMES, "sgn(qd1)", "sgn(qd2)", "load"]
    assert (found.dtypes.iloc[:8] == np.float64).all()
    np.testing.assert_allclose(found.iloc[:, :8], expected_features(states), atol=1e-14)


def test_frames_by_configuration_and_from_arrays(states):
    X = frame(states).to_numpy()
    with sklearn.config_context(transform_output="pandas"):
        found = InverseDynamicsFeatures().fit_transform(X)
    assert list(found.columns) == [*(f"x{i}" for i in range(6)), *SIGNS_OF_X, "x6"]
    assert found["x6"].tolist() == LABELS["str"]
    assert (found.dtypes.iloc[:8] == np.float64).all()


SIGNS_OF_X = ["sgn(x2)", "sgn(x3)"]


def test_integers_that_floats_cannot_hold_are_not_rounded(states):
    X = pd.DataFrame(states, columns=NAMES).assign(load=2**60 + np.arange(5))
    found = InverseDynamicsFeatures().fit_transform(X)
    assert found[:, -1].tolist() == X["load"].tolist()


def test_the_smallest_integer_that_floats_may_have_rounded(states):
    """2**53 + 1 is 2**53 as a float, which no model takes for a label."""
    X = pd.DataFrame(states, columns=NAMES).assign(load=2**53)
    found = InverseDynamicsFeatures().fit_transform(X)
    assert found.dtype == object
    assert found[:, -1].tolist() == [2**53] * 5


@pytest.mark.parametrize("dtype", ["Float64", "float32", "Int64", object])
def test_numbers_of_other_types(states, dtype):
    whole = np.round(100.0 * states)
    found = InverseDynamicsFeatures().fit_transform(
        pd.DataFrame(whole, columns=NAMES).astype(dtype).assign(load=LABELS["category"])
    )
    np.testing.assert_allclose(
        found[:, :8].astype(float), expected_features(whole), atol=1e-6
    )


def test_names_with_and_without_names_of_features(states):
    transformer = InverseDynamicsFeatures().fit(frame(states))
    assert list(transformer.feature_names_in_) == [*NAMES, "load"]
    expected = [*NAMES, "sgn(qd1)", "sgn(qd2)", "load"]
    assert transformer.get_feature_names_out().tolist() == expected
    transformer.fit(frame(states).to_numpy())
    assert not hasattr(transformer, "feature_names_in_")
    given = transformer.get_feature_names_out([*NAMES, "context"])
    assert given.tolist() == [*expected[:-1], "context"]


def test_names_that_differ_from_those_in_fit(states):
    transformer = InverseDynamicsFeatures().fit(frame(states))
    with pytest.raises(ValueError, match="not equal to feature_names_in_"):
        transformer.get_feature_names_out([*NAMES, "context"])
    with pytest.raises(ValueError, match=r"unseen at fit time:\n- context"):
        transformer.transform(frame(states).rename(columns={"load": "context"}))


@pytest.mark.parametrize("method", ["transform", "get_feature_names_out"])
def test_not_fitted(method):
    with pytest.raises(NotFittedError):
        getattr(InverseDynamicsFeatures(), method)(np.ones((1, 4)))


def test_the_bundled_data_give_what_the_papers_kernel_expects():
    X = load_puma560(as_frame=True, n_per_load=3).data
    found = InverseDynamicsFeatures().set_output(transform="pandas").fit_transform(X)
    assert found.shape == (45, 25)
    kernel = inverse_dynamics_kernel(6)
    K, gradient = kernel(found.iloc[:, :-1].to_numpy(), eval_gradient=True)
    assert np.linalg.eigvalsh(K)[0] > -1e-10
    assert gradient.shape == (45, 45, kernel.n_dims)


def test_labels_pass_through_a_column_transformer_before(states):
    before = ColumnTransformer(
        [("x", StandardScaler(), NAMES)],
        remainder="passthrough",
        verbose_feature_names_out=False,
    )
    pipeline = make_pipeline(before, InverseDynamicsFeatures())
    found = pipeline.set_output(transform="pandas").fit_transform(frame(states))
    assert found["load"].tolist() == LABELS["str"]
    np.testing.assert_allclose(
        found.iloc[:, :6], expected_features(states)[:, :6], atol=1e-14
    )


def test_a_failed_fit_changes_nothing(states):
    features = InverseDynamicsFeatures().fit(frame(states))
    before = dict(vars(features))
    with pytest.raises(ValueError, match="X has 5 columns"):
        features.fit(np.ones((2, 5)))
    assert vars(features).keys() == before.keys()
    assert all(vars(features)[key] is value for key, value in before.items())


@pytest.mark.parametrize("width", [2, 3, 5, 6, 20])
def test_widths_that_are_not_of_a_robot(width):
    message = (
        rf"X has {width} columns, but J joints need 3 J \+ 1: positions q1\.\.qJ "
        r"\(rad\), velocities .* accelerations .* and the task column"
    )
    with pytest.raises(ValueError, match=message):
        InverseDynamicsFeatures().fit(np.ones((2, width)))


@pytest.mark.parametrize("n_joints", [1, 3])
def test_n_joints_that_disagrees_with_the_width(n_joints, states):
    message = f"X has 7 columns, but n_joints={n_joints} needs {3 * n_joints + 1}: "
    with pytest.raises(ValueError, match=message):
        InverseDynamicsFeatures(n_joints).fit(frame(states))


@pytest.mark.parametrize("n_joints", [True, 2.0, "2"])
def test_n_joints_of_another_type(n_joints, states):
    with pytest.raises(TypeError, match=rf"n_joints={n_joints!r} must be None or an i"):
        InverseDynamicsFeatures(n_joints).fit(frame(states))


@pytest.mark.parametrize("n_joints", [0, -1])
def test_n_joints_must_be_positive(n_joints, states):
    with pytest.raises(ValueError, match=rf"n_joints={n_joints} must be at least 1"):
        InverseDynamicsFeatures(n_joints).fit(frame(states))


@pytest.mark.parametrize(
    ("task_feature", "error", "message"),
    [
        (7, ValueError, "task_feature=7 is out of range: X has 7 columns"),
        ("context", ValueError, "'context' is not a column"),
        (None, TypeError, "task_feature=None must be the position"),
    ],
)
def test_task_column_that_is_not_there(states, task_feature, error, message):
    with pytest.raises(error, match=message):
        InverseDynamicsFeatures(task_feature=task_feature).fit(frame(states))


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("load", None, "1 missing label .* first in row 1"),
        ("q1", np.nan, "Input X contains NaN"),
        ("qdd2", np.inf, "Input X contains infinity"),
        ("qd1", "fast", "column ('qd1'|2) holds strings such as 'fast'"),
    ],
)
@pytest.mark.parametrize("as_frame", [True, False])
def test_bad_cells(states, column, value, message, as_frame):
    good, bad = frame(states), frame(states).astype(object)
    bad.loc[1, column] = value
    if not as_frame:
        good, bad = good.to_numpy(), bad.to_numpy()
    with pytest.raises(ValueError, match=message):
        InverseDynamicsFeatures().fit(bad)
    with pytest.raises(ValueError, match=message):
        InverseDynamicsFeatures().fit(good).transform(bad)


def test_a_feature_in_the_place_of_the_task(states):
    X = np.column_stack([np.arange(5), states])
    with pytest.raises(ValueError, match=r"fractional numbers .* Does task_feature"):
        InverseDynamicsFeatures().fit(X)


class TestDescriptors:
    """Columns that describe the tasks are passed on as they are."""

    STATES = np.array([[0.1, -2.0, 5.0], [0.3, 0.0, 9.0], [0.2, 1.0, 7.0]])
    X = np.column_stack([STATES[:, :1], [3.0, 4.0, 4.0], STATES[:, 1:], [1, 2, 2]])

    def test_in_front_of_the_task(self):
        features = InverseDynamicsFeatures(task_descriptors=[1]).fit(self.X)
        plain = InverseDynamicsFeatures().fit(np.delete(self.X, 1, axis=1))
        expected = plain.transform(np.delete(self.X, 1, axis=1))
        found = features.transform(self.X)
        assert features.n_joints_ == 1
        np.testing.assert_array_equal(found[:, -2], [3.0, 4.0, 4.0])
        np.testing.assert_array_equal(np.delete(found, -2, axis=1), expected)

    def test_their_names(self):
        frame = pd.DataFrame(self.X, columns=["q1", "mass", "qd1", "qdd1", "load"])
        frame["load"] = ["a", "b", "b"]
        options = {"task_descriptors": ["mass"], "angles": "trigonometric"}
        features = InverseDynamicsFeatures(**options).set_output(transform="pandas")
        found = features.fit_transform(frame)
        expected = ["cos(q1)", "sin(q1)", "qd1", "qdd1", "sgn(qd1)", "mass", "load"]
        assert found.columns.tolist() == expected
        assert features.get_feature_names_out().tolist() == expected
        assert found["load"].tolist() == ["a", "b", "b"]

    def test_other_columns_are_counted(self):
        with pytest.raises(ValueError, match="4 columns beside the task_descriptors"):
            InverseDynamicsFeatures(2, task_descriptors=[1]).fit(self.X)


def test_degrees_of_new_states():
    """They were radians in training."""
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(-1.5, 1.5, (20, 9)), np.ones(20)])
    features = InverseDynamicsFeatures().fit(X)
    features.transform(X)
    degrees = np.column_stack([np.rad2deg(X[:, :-1]), X[:, -1]])
    with pytest.warns(AngleUnitWarning, match="span with those in training up to"):
        features.transform(degrees[:1])
    with pytest.warns(AngleUnitWarning):
        of_degrees = InverseDynamicsFeatures().fit(degrees)
    of_degrees.transform(degrees)  # fit has said so
