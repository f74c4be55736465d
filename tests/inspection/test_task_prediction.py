"""Panels of what is predicted of each task."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from pictured import FRAME, QUICK, TASKS, X, Y, texts, y
from sklearn.compose import make_column_transformer
from sklearn.ensemble import RandomForestRegressor
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import OneHotEncoder, StandardScaler

from skmtgp import MultiTaskGPRegressor
from skmtgp.inspection import TaskPredictionDisplay

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
SIMPLE = X[:, [0, 2]]  # one feature and the task
CURVE = {"feature": 0, "n_points": 7}


@pytest.fixture(scope="module")
def simple():
    return MultiTaskGPRegressor(rank=1, **QUICK).fit(SIMPLE, y)


@pytest.fixture(scope="module")
def named():
    model = MultiTaskGPRegressor(rank=1, task_feature="load", **QUICK)
    return model.fit(FRAME, y)


def test_a_panel_for_each_task(simple):
    shown = TaskPredictionDisplay.from_estimator(simple, SIMPLE, y, n_points=9)
    assert texts(ax.title for ax in shown.axes_) == ["0", "1", "2"]
    assert shown.figure_ is shown.ax_.figure
    grid = np.linspace(SIMPLE[:, 0].min(), SIMPLE[:, 0].max(), 9)
    for task, (line, points) in enumerate(
        zip(shown.lines_, shown.observed_, strict=True)
    ):
        rows = np.column_stack([grid, np.full(9, task)])
        np.testing.assert_allclose(line.get_ydata(), simple.predict(rows))
        np.testing.assert_array_equal(points.get_ydata(), y[task == TASKS])
    lower, upper = simple.predict_interval(rows, 0.95)
    found = shown.curves[shown.curves["task"] == 2]
    np.testing.assert_allclose(found[["lower", "upper"]], np.stack([lower, upper], 1))
    legend = texts(shown.figure_.legends[0].get_texts())
    assert legend == ["95 % interval", "predicted", "observed"]
    assert shown.truths_ == [None] * 3


def test_other_features_are_held(named):
    shown = TaskPredictionDisplay.from_estimator(
        named, FRAME, y, feature="a", at={"b": 0.3}, n_points=5
    )
    grid = np.linspace(FRAME["a"].min(), FRAME["a"].max(), 5)
    rows = pd.DataFrame({"load": "v", "a": grid, "b": 0.3})
    np.testing.assert_allclose(shown.lines_[1].get_ydata(), named.predict(rows))
    assert shown.axes_[0].get_xlabel() == "a"
    usual = TaskPredictionDisplay.from_estimator(named, FRAME, y, feature="a")
    rows["b"] = FRAME["b"][FRAME["load"] == "v"].median()
    ends = usual.lines_[1].get_ydata()[[0, -1]]
    np.testing.assert_allclose(ends, named.predict(rows)[[0, -1]])


def test_text_beside_the_task_has_its_commonest_value():
    frame = FRAME.assign(kind=np.where(np.arange(len(FRAME)) % 3, "new", "old"))
    encoder = make_column_transformer(
        (OneHotEncoder(), ["kind"]), remainder="passthrough"
    )
    frame = frame[["a", "kind", "load"]]
    model = make_pipeline(encoder, MultiTaskGPRegressor(rank=1, **QUICK)).fit(frame, y)
    shown = TaskPredictionDisplay.from_estimator(
        model, frame, y, task_feature="load", **{**CURVE, "feature": "a"}
    )
    rows = pd.DataFrame({"a": shown.curves["x"][:7], "kind": "new", "load": "u"})
    np.testing.assert_allclose(shown.lines_[0].get_ydata(), model.predict(rows))


def test_truth_is_a_function_or_data(simple):
    shown = TaskPredictionDisplay.from_estimator(
        simple, SIMPLE, y, truth=lambda rows: rows[:, 0] + rows[:, 1], n_points=4
    )
    grid = shown.lines_[0].get_xdata()
    np.testing.assert_allclose(shown.truths_[2].get_ydata(), grid + 2)
    assert texts(shown.figure_.legends[0].get_texts())[-1] == "truth"
    rows = np.array([[0.5, 1.0], [0.1, 1.0]])
    shown = TaskPredictionDisplay.from_estimator(
        simple, SIMPLE, y, truth=(rows, [5, 1])
    )
    assert shown.truths_[0] is None
    assert shown.truths_[1].get_xydata().tolist() == [[0.1, 1.0], [0.5, 5.0]]


def test_tasks_are_chosen_in_an_order(named):
    shown = TaskPredictionDisplay.from_estimator(
        named, FRAME, y, feature="a", tasks=["w", "u"]
    )
    assert texts(ax.title for ax in shown.axes_) == ["w", "u"]


def test_one_task_by_its_name(named):
    shown = TaskPredictionDisplay.from_estimator(
        named, FRAME, y, feature="a", tasks="w"
    )
    assert texts(ax.title for ax in shown.axes_) == ["w"]


def share_y(shown):
    first, *others = (ax.get_ylim() for ax in shown.axes_)
    return all(limits == first for limits in others)


@pytest.mark.parametrize("scale", [1.0, 1e4])
def test_panels_of_different_units_have_their_own_axes(scale):
    in_units = y * np.where(TASKS == 2, scale, 1.0)
    model = MultiTaskGPRegressor(rank=1, normalize_y="per_task", **QUICK)
    model.fit(SIMPLE, in_units)
    shown = TaskPredictionDisplay.from_estimator(model, SIMPLE, in_units)
    assert share_y(shown) == (scale == 1.0)
    assert share_y(shown.plot(sharey=True))
    assert not share_y(shown.plot(sharey=False))
    of_two = {"tasks": [0, 1]}  # those that are not drawn do not matter
    assert share_y(
        TaskPredictionDisplay.from_estimator(model, SIMPLE, in_units, **of_two)
    )


def test_large_levels_are_not_written_over_the_title(simple):
    shown = TaskPredictionDisplay.from_estimator(simple, SIMPLE, y + 65553.0)
    curves = shown.curves.assign(**shown.curves[["mean", "lower", "upper"]] + 65553.0)
    shown = TaskPredictionDisplay(curves=curves, points=shown.points).plot(sharey=False)
    shown.figure_.draw_without_rendering()
    assert {ax.yaxis.get_offset_text().get_text() for ax in shown.axes_} == {""}


def test_axes_of_the_user(simple):
    figure, axes = plt.subplots(1, 3)
    shown = TaskPredictionDisplay.from_estimator(simple, SIMPLE, y, ax=axes)
    assert shown.figure_ is figure
    assert list(shown.axes_) == list(axes)
    assert not figure.legends
    figure, (left, right) = plt.subplots(1, 2)
    shown = TaskPredictionDisplay.from_estimator(simple, SIMPLE, y, ax=right)
    figure.draw_without_rendering()
    middle = (left.get_position().x1 + right.get_position().x0) / 2
    assert all(ax.get_position().x0 > middle for ax in shown.axes_)


def test_the_lowest_panels_have_labels():
    curves = pd.DataFrame({"task": range(5), "x": 0.0, "mean": 0.0})
    curves = curves.assign(lower=-1.0, upper=1.0)
    points = pd.DataFrame({"task": [0], "x": [0.0], "y": [0.0]})
    shown = TaskPredictionDisplay(curves=curves, points=points, feature="time").plot()
    labels = [ax.get_xlabel() for ax in shown.axes_]
    assert labels == ["", "", "time", "time", "time"]  # three in the first row


def test_the_panels_at_the_left_have_the_name_of_the_target():
    curves = pd.DataFrame({"task": range(5), "x": 0.0, "mean": 0.0})
    curves = curves.assign(lower=-1.0, upper=1.0)
    points = pd.DataFrame({"task": [0], "x": [0.0], "y": [0.0]})
    shown = TaskPredictionDisplay(curves=curves, points=points, target="torque").plot()
    labels = [ax.get_ylabel() for ax in shown.axes_]
    assert labels == ["torque", "", "", "torque", ""]


@pytest.mark.parametrize(
    ("target", "label"),
    [(y, "y"), (pd.Series(y), "y"), (pd.Series(y, name="torque"), "torque")],
)
def test_the_name_of_the_target(simple, target, label):
    shown = TaskPredictionDisplay.from_estimator(simple, SIMPLE, target, n_points=3)
    assert shown.ax_.get_ylabel() == label


def test_the_name_of_an_output(fitted):
    targets = pd.DataFrame(Y, columns=[f"tau{k}" for k in range(Y.shape[1])])
    shown = TaskPredictionDisplay.from_estimator(
        fitted["RankSearchIC"], X, targets, output=1, feature=0, n_points=3
    )
    assert shown.ax_.get_ylabel() == "tau1"


def test_outputs_and_searches(fitted):
    for name in ("RankSearchIC", "SingleTaskGP", "BayesianLinearRegression"):
        shown = TaskPredictionDisplay.from_estimator(
            fitted[name], X, Y, output=1, **CURVE
        )
        np.testing.assert_array_equal(shown.observed_[0].get_ydata(), Y[TASKS == 0, 1])


def test_scaled_features(named):
    scaler = make_column_transformer(
        (StandardScaler(), ["a", "b"]), remainder="passthrough"
    )
    model = make_pipeline(scaler, MultiTaskGPRegressor(rank=1, **QUICK)).fit(FRAME, y)
    shown = TaskPredictionDisplay.from_estimator(
        model, FRAME, y, task_feature="load", feature="b", n_points=5
    )
    assert shown.lines_[0].get_xdata()[0] == FRAME["b"].min()


def test_descriptors_are_no_features():
    described = np.column_stack([X[:, 0], np.choose(TASKS, [1.0, 2.0, 4.0]), TASKS])
    model = MultiTaskGPRegressor(rank=1, task_descriptors=[1], max_iter=0)
    model.fit(described, y)
    shown = TaskPredictionDisplay.from_estimator(model, described, y, n_points=5)
    assert shown.feature == "0"
    assert shown.lines_[0].get_xdata()[0] == X[:, 0].min()
    with pytest.raises(ValueError, match=r"feature=1 is not one of .* \[0\]"):
        TaskPredictionDisplay.from_estimator(model, described, y, feature=1)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({}, r"several features, \['a', 'b'\]: say by `feature`"),
        ({"feature": "c"}, "feature='c' is not one of the features"),
        ({"feature": "load"}, "feature='load' is not one of the features"),
        ({"feature": "a", "at": {"c": 1}}, "at has 'c', which is not a column"),
        ({"feature": "a", "tasks": ["z"]}, "tasks has 'z', which X has not"),
        ({"feature": "a", "tasks": []}, "tasks is empty"),
        ({"feature": "a", "output": 1}, "output=1 must be 0, as there is one output"),
        ({"feature": "a", "level": 2.0}, "level=2.0 must be"),
    ],
)
def test_what_cannot_be_drawn(named, options, match):
    with pytest.raises(ValueError, match=match):
        TaskPredictionDisplay.from_estimator(named, FRAME, y, **options)


@pytest.mark.parametrize("name", ["n_points", "n_cols"])
@pytest.mark.parametrize("value", [0, -1, "a", 1.5, True])
def test_what_is_no_number_of_points_or_panels(simple, name, value):
    kind, rest = TypeError, "an integer, such as 10"
    if value in (0, -1):
        kind, rest = ValueError, "1 or more"
    with pytest.raises(kind, match=f"{name}={value!r} must be {rest}"):
        TaskPredictionDisplay.from_estimator(simple, SIMPLE, y, **{name: value})


def test_integers_of_numpy_are_numbers_of_points_and_panels(simple):
    numbers = {"n_points": np.int64(2), "n_cols": np.int8(1)}
    shown = TaskPredictionDisplay.from_estimator(simple, SIMPLE, y, **numbers)
    assert len(shown.lines_[0].get_xdata()) == 2
    with pytest.raises(ValueError, match="n_cols=0 must be 1 or more"):
        shown.plot(n_cols=0)


def test_axes_that_do_not_fit(simple):
    _, axes = plt.subplots(1, 2)
    with pytest.raises(ValueError, match="ax has 2 axes, but there are 3 tasks"):
        TaskPredictionDisplay.from_estimator(simple, SIMPLE, y, ax=axes)
    placed = plt.figure().add_axes([0, 0, 1, 1])
    with pytest.raises(ValueError, match="ax has no place in a grid"):
        TaskPredictionDisplay.from_estimator(simple, SIMPLE, y, ax=placed)


def test_more_tasks_than_can_be_read():
    curves = pd.DataFrame({"task": range(30), "x": 0.0, "mean": 0.0})
    curves = curves.assign(lower=0.0, upper=0.0)
    with pytest.raises(ValueError, match="There are 30 tasks, more panels"):
        TaskPredictionDisplay(curves=curves, points=curves).plot()


def test_models_without_intervals():
    forest = RandomForestRegressor(2).fit(SIMPLE, y)
    with pytest.raises(TypeError, match="RandomForestRegressor has no predict_int"):
        TaskPredictionDisplay.from_estimator(forest, SIMPLE, y, task_feature=1)
    with pytest.raises(NotFittedError):
        TaskPredictionDisplay.from_estimator(MultiTaskGPRegressor(), SIMPLE, y)
