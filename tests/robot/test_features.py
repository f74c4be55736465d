"""The regressor as features, against Pinocchio's inverse dynamics."""

import pickle
import sys

import numpy as np
import pandas as pd
import pytest
from rigid import rnea, states, two_joints
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline

from skmtgp.robot import RigidBodyFeatures

pin = pytest.importorskip("pinocchio")


def torques(features, X):
    """With the parameters that the model has."""
    return features.transform(X)[:, :-1] @ features.nominal_


@pytest.mark.parametrize("joint", range(6))
def test_columns_times_parameters_are_the_torque(puma, joint):
    X = states(40)
    features = RigidBodyFeatures(puma, joint=joint).fit(X)
    expected = rnea(pin.buildModelFromXML(puma), X)[:, joint]
    np.testing.assert_allclose(torques(features, X), expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("kind", ["prismatic", "revolute", "continuous"])
def test_joints_that_slide_turn_or_turn_without_end(kind):
    X = states(20, 2)
    slides = "prismatic" if kind == "prismatic" else "revolute"
    reference = pin.buildModelFromXML(two_joints("revolute", slides))
    for j in range(2):
        features = RigidBodyFeatures(two_joints("revolute", kind), joint=j).fit(X)
        expected = rnea(reference, X)[:, j]
        np.testing.assert_allclose(torques(features, X), expected, atol=1e-10)
    if kind == "continuous":
        assert pin.buildModelFromXML(two_joints("revolute", kind)).nq == 3


@pytest.mark.parametrize("joint", range(6))
def test_no_column_depends_on_others(puma, joint):
    X = states(300)
    words = "viscous", "coulomb", "asymmetric", "offset", "rotor"
    features = RigidBodyFeatures(puma, joint=joint, friction=words).fit(X)
    columns = features.transform(X)[:, :-1]
    values = np.linalg.svd(columns / np.linalg.norm(columns, axis=0))[1]
    assert values[-1] > 1e-3
    names = features.get_feature_names_out()
    friction = [name.split("(")[0] for name in names if name[0] in "vcor"]
    assert friction[:3] == ["viscous", "coulomb", "coulomb+"]
    assert friction[3:] == ["rotor"] * (joint > 1)


def test_columns_span_the_whole_regressor(puma):
    model = pin.buildModelFromXML(puma)
    X, data = states(300), model.createData()
    rows = [np.split(row, 3) for row in X[:, :-1]]
    whole = np.array(
        [pin.computeJointTorqueRegressor(model, data, *row)[2] for row in rows]
    )
    features = RigidBodyFeatures(puma, joint=2, friction=None)
    columns = features.fit_transform(X)[:, :-1]
    assert columns.shape[1] == np.linalg.matrix_rank(whole, tol=1e-9) == 28
    fitted = columns @ np.linalg.lstsq(columns, whole, rcond=None)[0]
    np.testing.assert_allclose(fitted, whole, atol=1e-10)


def test_friction_of_the_first_joint():
    X = np.zeros((4, 7))
    X[:, 2], X[:, 4] = [0.5, -2.0, 1e-9, -1e-9], [1.0, 2.0, 3.0, 4.0]
    words = ["viscous", "coulomb", "offset"]
    options = {"joint": "shoulder", "friction": words}
    features = RigidBodyFeatures(two_joints(), **options).fit(X)
    names = features.get_feature_names_out()
    expected = [f"{word}(shoulder)" for word in words]
    assert names[-4:-1].tolist() == expected
    found = features.transform(X)[:, -4:-1]
    np.testing.assert_array_equal(found[:, 0], X[:, 2])
    np.testing.assert_array_equal(found[:, 1], [1, -1, 0, 0])
    np.testing.assert_array_equal(found[:, 2], 1.0)


def test_asymmetric_friction_has_a_column_for_each_direction():
    X = np.zeros((3, 7))
    X[:, 2] = 0.5, -2.0, 0.0
    options = {"joint": 0, "friction": "asymmetric"}
    found = RigidBodyFeatures(two_joints(), **options).fit_transform(X)
    np.testing.assert_array_equal(found[:, -3], [1, 0, 0])
    np.testing.assert_array_equal(found[:, -2], [0, -1, 0])


def test_a_rotor_is_left_out_where_a_link_turns_like_it(puma):
    last_names = [
        RigidBodyFeatures(puma, joint=j, friction="rotor")
        .fit(states(3))
        .get_feature_names_out()[-2]
        for j in range(6)
    ]
    assert last_names[:2] == ["I_zz(joint6)"] * 2
    assert last_names[2:] == [f"rotor(joint{j})" for j in (3, 4, 5, 6)]


def test_a_straight_line_on_the_features_is_the_robot(puma, moved):
    X, Y, _ = moved
    one = X[:, -1] == 2
    model = make_pipeline(RigidBodyFeatures(puma, joint=4), LinearRegression())
    model.fit(X[one], Y[one, 4])
    np.testing.assert_allclose(model.predict(X[one]), Y[one, 4], rtol=0, atol=1e-9)


def test_the_columns_do_not_depend_on_the_data(puma):
    many, one = states(30), states(1, seed=5)
    first, second = (
        RigidBodyFeatures(puma, joint=3).fit(X).transform(many) for X in (many, one)
    )
    np.testing.assert_array_equal(first, second)


def test_a_model_a_path_and_a_text_are_the_same(puma, tmp_path):
    path, X = tmp_path / "puma.urdf", states(5)
    path.write_text(puma)
    given = puma, path, str(path), pin.buildModelFromXML(puma)
    expected, *others = (
        RigidBodyFeatures(model, joint=1).fit_transform(X) for model in given
    )
    for found in others:
        np.testing.assert_array_equal(found, expected)


def test_frames_keep_names_index_and_labels(puma):
    names = [f"{of}{j}" for of in ("q", "qd", "qdd") for j in range(1, 7)]
    X = pd.DataFrame(states(3)[:, :-1], columns=names, index=[5, 6, 7])
    X.insert(0, "load", pd.Categorical(["b", "a", "b"]))
    features = RigidBodyFeatures(puma, joint="joint2", task_feature="load")
    found = features.set_output(transform="pandas").fit_transform(X)
    assert list(found.columns) == list(features.get_feature_names_out())
    assert found.columns[-1] == "load"
    assert found.index.tolist() == [5, 6, 7]
    assert found["load"].dtype == X["load"].dtype
    array = features.set_output(transform="default").transform(X)
    np.testing.assert_array_equal(array[:, :-1].astype(float), found.iloc[:, :-1])
    assert array[:, -1].tolist() == ["b", "a", "b"]


@pytest.mark.parametrize("given", ["text", "model"])
def test_clones_and_copies(puma, given):
    model = puma if given == "text" else pin.buildModelFromXML(puma)
    X = states(4)
    features = RigidBodyFeatures(model, joint=2, friction=["viscous"]).fit(X)
    copied = pickle.loads(pickle.dumps(features))
    np.testing.assert_array_equal(copied.transform(X), features.transform(X))
    fresh = clone(features)
    assert fresh.get_params()["friction"] == ["viscous"]
    with pytest.raises(NotFittedError):
        fresh.transform(X)
    np.testing.assert_array_equal(fresh.fit_transform(X), features.transform(X))


class Broken:
    pass


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"model": Broken()}, TypeError, "path of a URDF, its text or a pinocchio.M"),
        ({"model": "none.urdf"}, FileNotFoundError, "'none.urdf': there is no such"),
        ({"model": "<robot"}, ValueError, "model='<robot' cannot be read"),
        ({"joint": 6}, ValueError, r"joint=6 is out of range: the model has 6 joints"),
        ({"joint": "elbow"}, ValueError, "joint='elbow' is none of the model's: .'jo"),
        ({"joint": 1.5}, TypeError, "joint=1.5 must be the position .*, not float"),
        ({"joint": True}, TypeError, "joint=True must be the position"),
        ({"friction": "stiction"}, ValueError, "has 'stiction'; it must be of 'visco"),
        ({"friction": ["rotor", 3]}, ValueError, "has 3; it must be of 'viscous'"),
        ({"friction": 3}, TypeError, "friction=3 must be None, a word or a sequence"),
        ({"task_feature": "load"}, ValueError, "task_feature='load' names a column"),
    ],
)
def test_wrong_parameters_are_named(puma, options, error, message):
    features = RigidBodyFeatures(**{"model": puma, "joint": 0} | options)
    with pytest.raises(error, match=message):
        features.fit(states(2))
    assert not hasattr(features, "n_features_in_")


def test_wrong_columns_are_named(puma):
    features = RigidBodyFeatures(puma, joint=0)
    with pytest.raises(ValueError, match="X has 18 columns, but the model has 6 joi"):
        features.fit(states(2)[:, 1:])
    X = states(2)
    X[1, 7] = np.nan
    with pytest.raises(ValueError, match="column 7"):
        features.fit(X)
    X = pd.DataFrame(states(2)).rename(columns="c{}".format)
    with pytest.raises(ValueError, match="feature names"):
        features.fit(X).transform(X.rename(columns={"c3": "elbow"}))


def test_joints_of_several_degrees_of_freedom_are_refused():
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "floating")
    with pytest.raises(ValueError, match="'floating' of the model has 6 degrees"):
        RigidBodyFeatures(model, joint=0).fit(states(2))
    with pytest.raises(ValueError, match="no joint that moves"):
        RigidBodyFeatures(pin.Model(), joint=0).fit(states(2))


def test_without_pinocchio_the_error_names_the_extra(puma, monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(ImportError, match=r'pip install "skmtgp\[robot\]"'):
        RigidBodyFeatures(puma, joint=0).fit(states(2))
